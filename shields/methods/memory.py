"""What the sampled shields remember: one array of bytes, read off as typed parts in the order of these tuples.

One array with everything in it crosses into a kernel faster than many.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from quadsafe_core.authority import Authority
from quadsafe_core.kernels.borrow import carved, taken
from quadsafe_core.kernels.choice import only_if, same_without
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.feedback import held_gains
from shields.backup.recovery import RECOVERY_POLE
from shields.backup.stored_stop import LED_PLAN, PLAN
from shields.filters.easing import Easing, easing_at
from shields.interface.filtered import NUMBERS
from shields.interface.records import FlightLimits, FlightRules, ThrustBand
from shields.interface.row_checks import BRAKING_POLE, FLOATS
from shields.methods.flight_bounds import FlightBounds, closing_bounds
from shields.methods.halfspace import Sampling

# What is fixed for a control period. Gains act on (r, v, a, j), or on (v, a, j).
SETTINGS = np.dtype(
    [
        ("rows", "i8"),  # N
        ("obstacles", "i8"),  # K
        ("delay", "i8"),  # periods
        ("looks_ahead", "i8"),  # whether answers may be on their way, or lost: 0 or 1
        ("moves", "i8"),  # whether there are velocities of every row: 0 or 1
        ("u_max", "f8"),  # m/s⁴
        ("gamma", "f8"),
        ("input_max", "f8"),  # m/s⁴
        ("period", "f8"),  # s
        ("snap_max", "f8"),  # of a certified flight, m/s⁴
        ("stop_snap_max", "f8"),  # of a stop, m/s⁴
        ("jerk_max", "f8"),  # m/s³
        ("specific_thrust_min", "f8"),  # specific, m/s²
        ("specific_thrust_max", "f8"),  # specific, m/s²
        ("gravity", "f8"),  # m/s²
        ("margin", "f8"),  # of a radius
        ("tracking", "f8", (4,)),  # onto a stored stop
        ("braking", "f8", (3,)),
        ("recovery", "f8", (3,)),
        ("easing", "f8", (4,)),
        ("easing_left", "f8"),
        ("easing_within", "f8"),
        ("closing", "f8", (3,)),  # least R1 m/s, R2 m/s², R3 m/s³
        ("authority", "f8", (5,)),  # the fields of ``Authority``
        ("tube", "f8", (2,)),  # the fields of ``Width``, m
        ("lag", "f8"),  # between snap and vehicle, s
        ("jitter", "f8"),  # of the period
    ],
    align=True,
)
# The half-space that a sphere asked for last: its direction, and the least input along it, m/s⁴.
HALF_SPACE = np.dtype([("n", "f8", (3,)), ("least", "f8")])
# Stands where there is no authority: without the JIT a tuple is made of it in any case, and checked.
UNREAD = Authority(1.0, 1.0, 1.0, 20.0, 9.81)
# What a shield knows of the snap behind a lag.
CARRIED = np.dtype(
    [
        ("lagged", "f8", (3,)),  # s at the last sample, m/s⁴
        ("flown", "f8", (3,)),  # the answer that it has followed since, m/s⁴
        ("period", "f8"),  # for how long, s
    ],
    align=True,
)
SETTINGS_ROW, CARRIED_ROWS = np.zeros(0, dtype=SETTINGS), np.zeros(0, dtype=CARRIED)
PLANS, LED_PLANS, HALF_SPACES = (np.zeros(0, dtype=dtype) for dtype in (PLAN, LED_PLAN, HALF_SPACE))
PLAN_SIZE, VELOCITY_SIZE = PLAN.itemsize, 3 * FLOATS.itemsize
# Fewer rows than this are done one by one.
FEW = 3
# Among more bodies than this, those out of reach are not looked at; of one row alone, and in blocks.
MANY, MANY_IN_BLOCKS = 10, 64


class Width(NamedTuple):
    """A tube around a stored stop, of the vehicle and of what is known of it, m."""

    vehicle: float
    estimate: float


class Kind(NamedTuple):
    """Which limits a shield has beyond distances: 1, or None for what there is not, which is not compiled.

    ``blocks``: no limits but those of a flight, and rows enough to be looked at side by side. ``many``: no
    other limits, and so many bodies that those out of reach are not looked at. ``lag``: the vehicle is behind
    its flat state. It crosses into a kernel as a plain tuple, in a third of the time.
    """

    closing: int | None
    authority: int | None
    tube: int | None
    blocks: int | None
    many: int | None
    lag: int | None


class ShieldSettings(NamedTuple):
    """``SETTINGS`` as kernels use them; whether they are only distances; what there is not is None."""

    sampling: Sampling
    flight: FlightRules
    margin: float
    closing: tuple | None
    braking: tuple
    recovery: tuple
    is_free: bool
    tube: Width | None


class Remembered(NamedTuple):
    """Stored stops (N) ``PLAN``, with a lag ``LED_PLAN``; half-spaces chosen last (N, K) ``HALF_SPACE``."""

    plans: NDArray[np.void]
    half_spaces: NDArray[np.void]


class SampledMemory(NamedTuple):
    """Settings (1) ``SETTINGS``, what is remembered, and velocities of the bodies, m/s, which stand last.

    Until a body moves they are (1, K, 3) zeros, then (N, K, 3).
    """

    settings: NDArray[np.void]
    rows: Remembered
    velocities: NDArray[np.float64]


class TubeMemory(NamedTuple):
    """What a tube needs as well; without answers that are on their way, or lost, or late, M is 0, else N.

    Without a lag L is 0, else N.

    | field    | shape     | meaning                                                                  |
    |----------|-----------|--------------------------------------------------------------------------|
    | flats    | (M, 4, 3) | flat states when all that is on its way has been flown, SI               |
    | centers  | (M, K, 3) | centres of the spheres by then, m                                        |
    | radii    | (N, K)    | radii with the tube, m                                                   |
    | before   | (M,)      | the stops before the last answers                                        |
    | pending  | (N, d, 3) | the answers that are on their way, m/s⁴                                  |
    | late     | (M,)      | by how many periods the last answers were held too long; NaN: it is not told |
    | chains   | (M,)      | how many of the last answers were certified, without a break             |
    | behind   | (L, 3, 3) | r, a, j of the vehicles, of which ``flats`` are the leads, SI            |
    | carried  | (L,)      | ``CARRIED``                                                              |
    """

    flats: NDArray[np.float64]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    before: NDArray[np.void]
    pending: NDArray[np.float64]
    late: NDArray[np.float64]
    chains: NDArray[np.float64]
    behind: NDArray[np.float64]
    carried: NDArray[np.void]


@same_without
def led_stops(_stops, _lag):
    """Stops of leads in place of those of vehicles, where there is a lag."""
    return LED_PLANS


@register_jitable
def stops_of(lag):
    """Of which kind stored stops are, with a lag and without."""
    return led_stops(PLANS, lag)


@register_jitable
def sampled_memory(memory, n, k, stops):
    """The parts of a memory of N vehicles and K spheres, and the bytes behind the half-spaces."""
    settings, rest = taken(memory, SETTINGS_ROW, (1,))
    plans, rest = taken(rest, stops, (n,))
    half_spaces, rest = taken(rest, HALF_SPACES, (n, k))
    shape = (n if settings[0]["moves"] > 0 else 1, k, 3)
    velocities = carved(memory, memory.nbytes - shape[0] * k * VELOCITY_SIZE, FLOATS, shape)
    return SampledMemory(settings, Remembered(plans, half_spaces), velocities), rest


@register_jitable
def tube_memory(memory, n, k, ahead, stops):
    """The parts of the bytes behind a ``SampledMemory``; ``ahead``: the delay, and whether to look ahead."""
    delay, looks_ahead = ahead
    m, lagged = n if looks_ahead else 0, n if stops.itemsize > PLAN_SIZE else 0
    flats, memory = taken(memory, FLOATS, (m, 4, 3))
    centers, memory = taken(memory, FLOATS, (m, k, 3))
    radii, memory = taken(memory, FLOATS, (n, k))
    before, memory = taken(memory, stops, (m,))
    pending, memory = taken(memory, FLOATS, (n, delay, 3))
    late, memory = taken(memory, FLOATS, (m,))
    chains, memory = taken(memory, FLOATS, (m,))
    behind, memory = taken(memory, FLOATS, (lagged, 3, 3))
    carried, memory = taken(memory, CARRIED_ROWS, (lagged,))
    return TubeMemory(flats, centers, radii, before, pending, late, chains, behind, carried)


def with_velocities(memory: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The memory with velocities of every row, all 0 where there were none."""
    settings, _ = taken(memory, SETTINGS_ROW, (1,))
    if settings[0]["moves"]:
        return memory
    more = (settings[0]["rows"] - 1) * settings[0]["obstacles"] * VELOCITY_SIZE
    memory = np.concatenate([memory, np.zeros(more, dtype=np.uint8)])
    taken(memory, SETTINGS_ROW, (1,))[0][0]["moves"] = 1
    return memory


def recall(memory: NDArray[np.uint8], found: NDArray[np.uint8]) -> None:
    """Put another memory in place of one, but for the settings, which stand first: sizes are read from them."""
    memory[SETTINGS.itemsize :] = found[SETTINGS.itemsize :]


@kernel
def is_memory_of(memory, n, k, out):
    """Whether memory and answer are those of N vehicles and K spheres."""
    settings, _ = taken(memory, SETTINGS_ROW, (1,))
    return settings[0]["rows"] == n and settings[0]["obstacles"] == k and out.shape[0] == NUMBERS * n


@kernel
def settings_of(s, kind):
    """The settings of a record ``SETTINGS``; ``kind`` has the fields of ``Kind``."""
    # As an argument a field that is an array would be counted.
    a, c, e, w = s["authority"], s["closing"], s["easing"], s["tube"]
    t, b, r = s["tracking"], s["braking"], s["recovery"]
    closing = only_if(kind[0], (c[0], c[1], c[2]))
    authority = only_if(kind[1], Authority(a[0], a[1], a[2], a[3], a[4]))
    easing = Easing((e[0], e[1], e[2], e[3]), s["easing_left"], s["easing_within"])
    band = ThrustBand(s["specific_thrust_min"], s["specific_thrust_max"], s["gravity"])
    limits = FlightLimits(s["snap_max"], s["stop_snap_max"], s["jerk_max"], band)
    return ShieldSettings(
        Sampling(s["u_max"], s["gamma"], s["input_max"], s["period"], authority, easing),
        FlightRules(s["period"], limits, (t[0], t[1], t[2], t[3])),
        s["margin"],
        closing,
        (b[0], b[1], b[2]),
        (r[0], r[1], r[2]),
        closing is None and authority is None,
        only_if(kind[2], Width(w[0], w[1])),
    )


def sampled_size(n: int, k: int, stop: int = PLAN_SIZE) -> int:
    """Bytes of a ``SampledMemory`` with so many for a stop."""
    return SETTINGS.itemsize + n * stop + n * k * HALF_SPACE.itemsize + k * VELOCITY_SIZE


def tube_size(n: int, k: int, delay: int, looks_ahead: bool, stop: int = PLAN_SIZE) -> int:
    """Bytes of a ``TubeMemory``."""
    flat, center, radius, answer, late, chain, behind = 12, 3, 1, 3, 1, 1, 9
    ahead = stop + (flat + k * center + late + chain) * FLOATS.itemsize if looks_ahead else 0
    lagged = CARRIED.itemsize + behind * FLOATS.itemsize if stop > PLAN_SIZE else 0
    return n * (ahead + lagged + (k * radius + delay * answer) * FLOATS.itemsize)


def empty_memory(n: int, k: int, size: int, delay: int = 0, looks_ahead: bool = False) -> NDArray[np.uint8]:
    """Memory of so many bytes for N vehicles and K spheres that remembers nothing."""
    memory = np.zeros(size, dtype=np.uint8)
    settings, _ = taken(memory, SETTINGS_ROW, (1,))
    settings[0]["rows"], settings[0]["obstacles"] = n, k
    settings[0]["delay"], settings[0]["looks_ahead"] = delay, looks_ahead
    return memory


def write_settings(
    record: Any, settings: Mapping[str, Any], period: float, bounds: FlightBounds, tracking: NDArray[np.float64]
) -> None:
    """The settings of a shield at a control period, s, into a record ``SETTINGS``, but for the tube."""
    record["u_max"], record["input_max"], record["period"] = bounds.u_max, bounds.input_max, period
    record["gamma"], record["margin"] = -math.expm1(-settings["alpha"] * period), settings["margin"]
    record["snap_max"], record["stop_snap_max"], record["jerk_max"], band = bounds.limits
    record["specific_thrust_min"], record["specific_thrust_max"], record["gravity"] = band
    slow = (held_gains(3, pole, period) for pole in (BRAKING_POLE, RECOVERY_POLE))
    record["tracking"], (record["braking"], record["recovery"]) = tracking, slow
    record["easing"], record["easing_left"], record["easing_within"] = easing_at(period, settings["margin"])
    record["closing"] = closing_bounds(settings)
    record["authority"] = bounds.authority or UNREAD


def kind_of(settings: Mapping[str, Any], bounds: FlightBounds, has_tube: bool, size: tuple[int, int]) -> Kind:
    """Which limits a shield of these settings has, for N vehicles among K obstacles.

    Behind a lag rows are done one by one, with a look at every body.
    """
    lag = 1 if has_tube and settings["uncertainty"]["rotor_lag"] != 0.0 else None
    closes = None if max(closing_bounds(settings)) == -math.inf else 1
    authority = None if bounds.authority is None else 1
    free = 1 if closes is None and authority is None and lag is None else None
    blocks = None if size[0] < FEW else free
    most = MANY if blocks is None else MANY_IN_BLOCKS
    return Kind(closes, authority, 1 if has_tube else None, blocks, free if size[1] > most else None, lag)
