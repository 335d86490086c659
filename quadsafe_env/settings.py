"""From the keywords of ``gym.make`` to a world."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import keywords_of, known_keywords, one_of, positive_integer, real_array
from quadsafe_core.maths.counter_rng import KEY_LIMIT
from quadsafe_core.shapes import Obstacles, shapes_from
from quadsafe_env.others.chosen import choice_of
from quadsafe_env.pictures.camera import camera_from, picture_size, text
from quadsafe_env.references.track import TrackTask
from quadsafe_env.scene_settings import check_room, furnished, mapped, resized, walls_of, within
from quadsafe_env.signals.given import signals_from
from quadsafe_env.signals.kinds import WORLDS
from quadsafe_env.simulation.rates import Rates
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.conditions import conditions_from, is_lag_told
from quadsafe_env.tasks.drawn_bodies import MovingTask
from quadsafe_env.tasks.gates import GatesTask
from quadsafe_env.tasks.rooms import RoomsTask
from quadsafe_env.tasks.scenes import AvoidTask, FlightTask, ForestTask
from quadsafe_env.track_settings import blocked_on_track, course_of, led

TASKS = {
    "flight": FlightTask(body_count=1, observed_count=1, ends_at_goal=False, low=(-4, -5, -4), high=(8, 5, 8)),
    # The sphere's centre is 1.2 m or more from start and goal; 0.15 m are kept free.
    "avoid": AvoidTask(body_count=1, observed_count=1, ends_at_goal=True, largest_keep_out=1.05),
    # At 2 m every second draw is clear of start and goal.
    "forest": ForestTask(
        body_count=10, observed_count=8, ends_at_goal=True, sizes=(0.2, 0.4), largest_keep_out=2.0
    ),
    "rooms": RoomsTask(
        body_count=20, observed_count=8, ends_at_goal=True, layout="surfaces", is_mixed=True, opening_count=1
    ),
    # A course of six gates for the largest vehicle is 18 m long.
    "gates": GatesTask(
        body_count=24,
        observed_count=8,
        ends_at_goal=True,
        low=(-12.0, -4.0, -4.0),
        high=(12.0, 4.0, 4.0),
        layout="surfaces",
        is_mixed=True,
        opening_count=6,
    ),
    "track": TrackTask(
        body_count=4, observed_count=4, ends_at_goal=False, sizes=(0.2, 0.4), largest_keep_out=0.8
    ),
    "moving": MovingTask(
        body_count=8, observed_count=8, ends_at_goal=True, sizes=(0.2, 0.4), is_mixed=True, moves=True
    ),
}
RENDER_MODES = ("human", "rgb_array")
# Of an action.
ENTRY = np.dtype(np.float32)


def build_world(n: int, render_mode: str | None = None, is_single: bool = False, **settings: Any) -> World:
    """A world of ``n`` rows, see ``build_worlds``."""
    return build_worlds((n,), render_mode, is_single, **settings)[0]


def build_worlds(
    counts: Sequence[int],
    render_mode: str | None = None,
    is_single: bool = False,
    *,
    task: str = "avoid",
    action: str = "velocity",
    params="crazyflie",
    plant: Any = None,
    obstacles: Sequence[Any] | None = None,
    bounds: Sequence[Sequence[float]] | None = None,
    start: Any = None,
    goal: Any = None,
    blocked: float | None = None,
    policy_hz: int = 25,
    control_hz: int = 100,
    physics_hz: int | None = None,
    terminate_on_violation: bool = True,
    sphere_count: int | None = None,
    sphere_radius: Sequence[float] | None = None,
    reference: str | None = None,
    size: float | None = None,
    period: float | None = None,
    observation: Any = "relative",
    reward: Any = None,
    opening: float | None = None,
    gates: int | None = None,
    pillars: int | None = None,
    boxes: int | None = None,
    rotor_limits: bool = False,
    conditions=None,
    lag_compensation: str | bool = False,
    render_size: int = 480,
    camera=None,
    caption: str = "",
) -> list[World]:
    """Worlds alike but for the numbers of their rows.

    Args:
        counts: number of rows of each.
        render_mode: one that was checked, or None; what is rendered remembers its past.
        is_single: whether functions given as observation and reward get one row without an axis of rows.
        task: "flight", "avoid", "forest", "rooms", "gates", "track" or "moving"; fixed by the id.
        action: "velocity", "snap", "wrench", "rates" or "attitude"; see ``quadsafe_env.vehicle.actions``.
        params: preset name, mapping of fields or of the arguments of ``QuadrotorParams.from_airframe``, or
            QuadrotorParams; ``docs/vehicles.md`` has the presets.
        plant: what flies it in place of our own: the name of a plant that others wrote, a mapping of its
            ``name`` and options, or a ``Plant`` (``quadsafe_env.plants``); ``docs/plants.md``.
        obstacles: in place of the task's own: shapes (``quadsafe_core.shapes``), mappings as of ``as_dict`` of
            one, rows [x, y, z, radius], m, or an array of rows; all without the vehicle's radius.
        bounds: a box to keep in, [low, high], (3,) each, m: six walls beside the obstacles, given or drawn.
        start: where flights begin among given obstacles, in place of the task's own starts: a point (3,), a box
            [low, high] to draw from, m, a list of boxes, or of one, three or more points, to choose from.
        goal: where they are to fly, likewise; lists of starts and goals of one length are pairs.
        blocked: among given obstacles, the least share of scenes whose straight way from start to goal is
            blocked (``quadsafe_env.tasks.ends``); 0.5 unless given, 0 takes starts and goals as they come.
        policy_hz: rate of ``step``, Hz.
        control_hz: rate of the filter slot, Hz; a multiple of policy_hz.
        physics_hz: rate of the inner loop and of RK4, Hz, a multiple of control_hz; 500, or that of the plant.
        terminate_on_violation: whether a violation ends the episode.
        sphere_count: number of spheres of a forest, 10 unless given, or on a reference, 4 unless given.
        sphere_radius: least and greatest obstacle radius of avoid, forest and track scenes, m.
        reference: of track, "figure-eight", the default, or "minimum-snap"; ``quadsafe_env.references.curves``.
        size: half of the length of the reference, m, 1.5 unless given.
        period: of the figure-eight, and of four segments of the spline, s, 10 unless given.
        observation: "relative", the task's own; "world", that of ``quadsafe_env.signals.given.world_view``; or
            (function, space), a function of ``quadsafe_env.signals.quantities.Quantities`` and the
            ``gymnasium.spaces.Box`` that it gives.
        reward: a function of the same quantities, in place of the task's own.
        opening: width of the doorway or window of rooms, width and height of every gate, m, 0.8 unless given.
        gates: number of gates, 1 to 6; 0, the default, draws 3 to 6.
        pillars: number of pillars of a room, 4 unless given.
        boxes: number of its boxes, 6 unless given.
        rotor_limits: whether every rotor keeps to [0, thrust_max/4] (``quadsafe_env.vehicle.rotors``), and the
            desired yaw motion to ``quadsafe_env.vehicle.authority.yaw_range``.
        conditions: None, preset name, mapping of fields, or Conditions; see ``quadsafe_env.tasks.conditions``.
        lag_compensation: "told" for an inner loop that counts the rotor lag of the conditions, or False.
        render_size: side of pictures, pixels, 32 to 2048.
        camera: where pictures are seen from: a mapping of some of azimuth, elevation (degrees), distance (m),
            follow, or Camera; see ``quadsafe_env.pictures.camera``. None shows the whole map.
        caption: a text in the upper right corner of pictures, as who flies.

    Warns:
        UserWarning: where numbers of the vehicle do not fit together, see ``fitting``.

    Raises:
        ValueError, TypeError: naming the keyword, what was expected and what came.

    Warns:
        UserWarning: with the share found, if the straight way cannot be blocked in the share asked for.
    """
    met, told = conditions_from(conditions), is_lag_told(lag_compensation)
    limited = _flag("rotor_limits", rotor_limits)
    choice = choice_of(plant, params, physics_hz, met, rotor_limits=limited, lag_compensation=told)
    vehicle, draws = choice.params, obstacles is None
    given = None if obstacles is None else shapes_from(obstacles)
    walls = [] if bounds is None else walls_of(bounds, vehicle.radius)
    drawn = resized(task, TASKS[one_of("task", task, tuple(TASKS))], sphere_count, sphere_radius)
    furniture = {"opening": opening, "gates": gates, "pillars": pillars, "boxes": boxes}
    drawn = furnished(task, drawn, vehicle.radius, draws, **furniture)
    drawn = led(task, drawn, reference=reference, size=size, period=period)
    course = course_of(drawn)
    if draws:
        check_room(drawn, vehicle.radius)
    elif sphere_count is not None or sphere_radius is not None:
        raise ValueError("sphere_count and sphere_radius must be left out where obstacles are given, got both")
    if bounds is not None:
        drawn = within(drawn, *np.asarray(bounds, dtype=np.float64))
    if course is not None:
        blocked = blocked_on_track(goal, blocked, draws)
    drawn = mapped(drawn, given, walls, vehicle.radius, start=start, goal=goal, blocked=blocked)
    kept: dict[str, Any] = {
        "action": action,
        "obstacles": Obstacles.pack([*(given or []), *walls], keep_out=vehicle.radius),
        "draws": draws,
        "rates": Rates(
            positive_integer("policy_hz", policy_hz),
            positive_integer("control_hz", control_hz),
            positive_integer("physics_hz", choice.physics_hz),
        ),
        "terminate_on_violation": _flag("terminate_on_violation", terminate_on_violation),
        "rotor_limits": limited,
    }
    looks = {"camera": camera_from(camera), "size": picture_size("render_size", render_size)}
    looks["caption"] = text("caption", caption)
    kept |= {} if render_mode is None else looks
    signals = signals_from(observation, reward, course, is_single, drawn.observed_count)
    kept |= {} if signals is None else {"signals": signals}
    kept |= {"conditions": met, "compensates_lag": told} if choice.kind == "conditions" else {}
    kind = WORLDS[signals is not None, choice.kind, render_mode]
    return [kind(n, drawn, vehicle, **kept, **choice.plants_for(n)) for n in counts]


def check_keywords(maker: str, settings: Mapping[str, Any], own: tuple[str, ...]) -> None:
    """Raise a TypeError for a keyword that neither a world nor its environment, made by ``maker``, has."""
    # The task is that of the id.
    known = [name for name in (*own, *keywords_of(build_worlds)) if name != "task"]
    known_keywords(maker, [name for name in settings if name != "task"], known)


def scene_integer(name: str, value) -> int:
    """``value`` as a scene integer, 0 <= k < 2^64.

    Raises:
        ValueError: for anything else.
    """
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_integer or not 0 <= value < KEY_LIMIT:
        raise ValueError(f"{name} must be an integer in [0, 2^64), got {value!r}")
    return int(value)


def known_options(options: Any, names: tuple[str, ...]) -> Mapping[str, Any]:
    """``options`` of a reset, {} for None.

    Raises:
        TypeError, ValueError: for what is no mapping, or has other keys.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise TypeError(f"options must be a mapping with {', '.join(map(repr, names))}, got {options!r}")
    for name in options:
        one_of("a key of options", name, names)
    return options


def check_begun(has_begun: bool) -> None:
    """Raise unless there is a scene to fly in: before the first reset there is none.

    Raises:
        gymnasium.error.ResetNeeded: before the first reset.
    """
    if not has_begun:
        raise ResetNeeded("reset must be called before the first step, got a step without it")


def action_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """``value`` as C-ordered float32 of exactly this shape; entries may be non-finite.

    Raises:
        TypeError, ValueError: for anything else.
    """
    if type(value) is np.ndarray and value.dtype == ENTRY and value.flags.c_contiguous and value.shape == shape:
        return value
    try:
        wide = real_array(value)
        # What only float64 holds would become infinite; it is clipped to 1 in any case.
        array = np.ascontiguousarray(
            np.where(np.isfinite(wide), np.clip(wide, -2.0, 2.0), wide), dtype=np.float32
        )
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"{name} must be an array of real numbers, got {value!r}") from error
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {np.shape(value)}")
    return array


def check_render_mode(render_mode: str | None, modes: tuple[str, ...]) -> str | None:
    """``render_mode``, one of the supported ones or None."""
    return None if render_mode is None else one_of("render_mode", render_mode, modes)


def _flag(name: str, value) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)
