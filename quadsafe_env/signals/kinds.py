"""Which kind of world it takes: looked at or not, what flies in it, told as by its task or not."""

from quadsafe_env.disturbances.disturbed_world import DisturbedWorld, FilmedDisturbedWorld, ShownDisturbedWorld
from quadsafe_env.others.plant_world import FilmedPlantWorld, PlantWorld, ShownPlantWorld
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.signals.told_worlds import (
    ToldDisturbedWorld,
    ToldFilmedDisturbedWorld,
    ToldFilmedPlantWorld,
    ToldFilmedWorld,
    ToldPlantWorld,
    ToldShownDisturbedWorld,
    ToldShownPlantWorld,
    ToldShownWorld,
    ToldWorld,
)
from quadsafe_env.simulation.world import World

# By whether signals are given or a reference is followed, what flies ("model", "conditions", or the "plant" of
# others), and the render mode.
WORLDS: dict[tuple[bool, str, str | None], type[World]] = {
    (False, "model", None): World,
    (False, "model", "rgb_array"): FilmedWorld,
    (False, "model", "human"): ShownWorld,
    (False, "conditions", None): DisturbedWorld,
    (False, "conditions", "rgb_array"): FilmedDisturbedWorld,
    (False, "conditions", "human"): ShownDisturbedWorld,
    (False, "plant", None): PlantWorld,
    (False, "plant", "rgb_array"): FilmedPlantWorld,
    (False, "plant", "human"): ShownPlantWorld,
    (True, "model", None): ToldWorld,
    (True, "model", "rgb_array"): ToldFilmedWorld,
    (True, "model", "human"): ToldShownWorld,
    (True, "conditions", None): ToldDisturbedWorld,
    (True, "conditions", "rgb_array"): ToldFilmedDisturbedWorld,
    (True, "conditions", "human"): ToldShownDisturbedWorld,
    (True, "plant", None): ToldPlantWorld,
    (True, "plant", "rgb_array"): ToldFilmedPlantWorld,
    (True, "plant", "human"): ToldShownPlantWorld,
}
