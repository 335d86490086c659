"""Which kind of world it takes: looked at or not, under conditions or not, told as by its task or not."""

from quadsafe_env.disturbances.disturbed_world import DisturbedWorld, FilmedDisturbedWorld, ShownDisturbedWorld
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.signals.told_worlds import (
    ToldDisturbedWorld,
    ToldFilmedDisturbedWorld,
    ToldFilmedWorld,
    ToldShownDisturbedWorld,
    ToldShownWorld,
    ToldWorld,
)
from quadsafe_env.simulation.world import World

# By whether signals are given or a reference is followed, whether there are conditions, and the render mode.
WORLDS: dict[tuple[bool, bool, str | None], type[World]] = {
    (False, False, None): World,
    (False, False, "rgb_array"): FilmedWorld,
    (False, False, "human"): ShownWorld,
    (False, True, None): DisturbedWorld,
    (False, True, "rgb_array"): FilmedDisturbedWorld,
    (False, True, "human"): ShownDisturbedWorld,
    (True, False, None): ToldWorld,
    (True, False, "rgb_array"): ToldFilmedWorld,
    (True, False, "human"): ToldShownWorld,
    (True, True, None): ToldDisturbedWorld,
    (True, True, "rgb_array"): ToldFilmedDisturbedWorld,
    (True, True, "human"): ToldShownDisturbedWorld,
}
