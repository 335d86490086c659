"""The safety filter of Section V-C with control barrier functions (CBF), in closed form.

    minimise |U − U_des|   subject to   ℒg_i(U) + α g_i ≥ 0   for i = 1 … 4                        (33)

over the radial chain R, R1, R2, R3 with R4 = U. The set g_4 keeps R above the keep-out distance; g_3, g_2
and g_1 keep R1, R2 and R3 above bounds of their own. With ℒg_i(U) = (U − ū) t*^{i−1}/(i−1)! each of them is
a lower bound on U,

    t* > 0           U ≥ ū − α g_i (i−1)!/t*^{i−1}
    t* = 0, i ≥ 2    none
    i = 1            U ≥ −α g_1

so the solution is the largest of these and U_des: no programme is solved. Inside the sets it never exceeds ū.
Outside it does, without limit as t* → 0, and that brings the state back; it is capped at ``input_max``.
This is a statement about continuous time: held over a control period, the input can leave the sets. At rest
inside the sphere t* = 0, and nothing is asked for: no way out is flown, only a value below 0 says where it is.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import argument_rows, positive_number
from quadsafe_core.kernels.borrow import one_row, taken
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import dot, subtract, triple, vector
from quadsafe_core.maths.feedback import held_gains
from shields.chains.integrator import required_input
from shields.chains.lower_bound import lower1, lower2, lower3, lower4
from shields.chains.radial import radial_motion, shifted_snap
from shields.interface.filtered import NUMBERS
from shields.interface.records import Bodies, Measured
from shields.interface.row_checks import (
    BAD_SHAPES,
    BRAKING_POLE,
    CROWDED,
    DONE,
    FLOATS,
    MOVING,
    NO_SPHERES,
    TOO_LARGE,
    answer,
    answers_in,
    checked_rows,
    flat_of_row,
    wanted_snap,
)
from shields.methods.flight_bounds import closing_bounds
from shields.methods.method import Kernels

CBF_SETTINGS = np.dtype(
    [
        ("rows", "i8"),  # N
        ("obstacles", "i8"),  # K
        ("distance", "f8"),  # to keep, in radii
        ("closing", "f8", (3,)),  # the fields of ``ClosingBounds``
        ("u_max", "f8"),  # m/s⁴
        ("alpha", "f8"),  # 1/s
        ("input_max", "f8"),  # m/s⁴
        ("braking", "f8", (3,)),  # gains on (v, a, j)
    ],
    align=True,
)
SETTINGS_ROW = np.zeros(0, dtype=CBF_SETTINGS)


class ClosingBounds(NamedTuple):
    """Lower bounds of R1 (m/s), R2 (m/s²) and R3 (m/s³); −inf, which never binds, where there is none."""

    speed: float = -math.inf
    acceleration: float = -math.inf
    jerk: float = -math.inf


class Limits(NamedTuple):
    """ū, the input that the sets count on; α, 1/s; U_max, where the required input is capped."""

    u_max: float
    alpha: float
    input_max: float


@inline_kernel
def least_input(state, distance, bounds, limits):
    """(33): the least U that every bound allows, and the least of their values."""
    R, R1, R2, R3 = state
    u_max, alpha = limits.u_max, limits.alpha
    g4, t4 = lower4(R3, R2, R1, R, u_max, distance)
    g3, t3 = lower3(R3, R2, R1, u_max, bounds.speed)
    g2, t2 = lower2(R3, R2, u_max, bounds.acceleration)
    g1, t1 = lower1(R3, bounds.jerk)
    least = max(
        required_input(4, t4, g4, u_max, alpha),
        required_input(3, t3, g3, u_max, alpha),
        required_input(2, t2, g2, u_max, alpha),
        required_input(1, t1, g1, u_max, alpha),
    )
    return least, min(g4, g3, g2, g1)


@inline_kernel
def closest_input(state, U_des, distance, bounds, limits):
    """(33): the input nearest to ``U_des`` that every bound allows, capped, and the least set value."""
    least, value = least_input(state, distance, bounds, limits)
    return max(U_des, min(least, limits.input_max)), value


@inline_kernel
def safe_snap(x, center, distance, snap, bounds, limits):
    """Steps B, C and D of Section V for one sphere: the nearest safe snap, its U, and the least set value."""
    r, v, a, j = x
    state, n, T = radial_motion(subtract(r, center), v, a, j)
    U_des = dot(n, snap) + T
    U, value = closest_input(state, U_des, distance, bounds, limits)
    return (snap if U_des == U else shifted_snap(snap, n, U - U_des)), U, value


@inline_kernel
def present_obstacle(i, radius):
    """Index of the only sphere of row i with a radius above 0; −1 for none, −2 for several."""
    found = -1
    for k in range(radius.shape[1]):
        if radius[i, k] > 0.0:
            found = k if found == -1 else -2
    return found


@register_jitable
def cbf_memory(memory, n, k):
    """The parts of a memory of N vehicles and K spheres: settings (1), velocities (N, K, 3), m/s."""
    settings, memory = taken(memory, SETTINGS_ROW, (1,))
    velocities, memory = taken(memory, FLOATS, (n, k, 3))
    return settings, velocities


@kernel
def cbf_row(i, measured, settings, answers):
    """Filter row i of what was measured; ``DONE``, or what is wrong with it. ``settings``: ``CBF_SETTINGS``."""
    x, fact = flat_of_row(i, measured.flat), answers.facts[i]
    center, velocity, radius = measured.bodies.center, measured.bodies.velocity, measured.bodies.radius
    gains, low = settings["braking"], settings["closing"]
    wanted = wanted_snap(x, vector(measured.snap[i]), (gains[0], gains[1], gains[2]), fact)
    u, k = wanted, present_obstacle(i, radius)
    if k == -2:
        return CROWDED
    if k >= 0:
        if triple(velocity, i, k) != (0.0, 0.0, 0.0):
            return MOVING
        bounds = ClosingBounds(low[0], low[1], low[2])
        limits = Limits(settings["u_max"], settings["alpha"], settings["input_max"])
        distance = settings["distance"] * radius[i, k]
        u, U, fact["value"] = safe_snap(x, triple(center, i, k), distance, wanted, bounds, limits)
        if u != wanted:
            fact["obstacle"], fact["reserve"] = k, max(0.0, U / limits.u_max)
    return DONE if answer(i, wanted, u, answers) else TOO_LARGE


@kernel
def cbf_batch(flat, center, radius, snap, memory, kind, out):
    """Rows of ``cbf_row``; the first code that is not ``DONE``. See ``method.FilterKernel``."""
    if kind[-1] is not None:
        return NO_SPHERES
    n, k = flat.shape[0], radius.shape[1]
    first, _ = taken(memory, SETTINGS_ROW, (1,))
    if not (first[0]["rows"] == n and first[0]["obstacles"] == k and out.shape[0] == NUMBERS * n):
        return BAD_SHAPES
    settings, velocities = cbf_memory(memory, n, k)
    measured, answers = Measured(flat, Bodies(center, velocities, radius, None), snap, None), answers_in(out, n)
    code = checked_rows(measured, n, k)
    for i in range(n):
        if code == DONE:
            code = cbf_row(i, measured, settings[0], answers)
    return code


@kernel
def cbf_one(flat, center, radius, snap, memory, kind, out):
    """``cbf_batch`` of one vehicle without the leading axis."""
    return cbf_batch(one_row(flat), one_row(center), one_row(radius), one_row(snap), memory, kind, out)


@kernel
def closest_input_batch(state, U_des, distance, bounds, limits, U, value):
    """Rows of ``closest_input``."""
    for i in range(state.shape[0]):
        x = (state[i, 0], state[i, 1], state[i, 2], state[i, 3])
        U[i], value[i] = closest_input(x, U_des[i], distance[i], bounds, limits)


def filtered_input(
    state: ArrayLike, desired: ArrayLike, distance: ArrayLike, bounds: ClosingBounds, limits: Limits
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The radial input nearest to the desired one that satisfies (33) for every bound.

    U = max(U_des, min(U_max, max_i(ū − α g_i (i−1)!/t*^{i−1})))

    Args:
        state: (…, 4) R m, R1 m/s, R2 m/s², R3 m/s³.
        desired: (…) U_des, m/s⁴.
        distance: (…) keep-out distance, the lower bound of R, m.
        bounds: lower bounds of R1, R2, R3; ``ClosingBounds()`` for none.
        limits: ū in m/s⁴, α in 1/s, U_max in m/s⁴ (``math.inf`` for no cap).

    Returns:
        U (…) in m/s⁴, and the least set value (…), at least 0 inside every set.

    Raises:
        ValueError: for wrong shapes or numbers.

    Reference: equation (33), Lemmas 1 and 2.
    """
    (states, inputs, distances), leading = argument_rows(
        state=(state, (4,)), desired=(desired, ()), distance=(distance, ())
    )
    U, value = np.empty(inputs.shape), np.empty(inputs.shape)
    closest_input_batch(states, inputs, distances, _checked_bounds(bounds), _checked_limits(limits), U, value)
    return U.reshape(leading), value.reshape(leading)


class CbfMethod:
    """Equation (33), one sphere per row; it remembers nothing."""

    def __init__(self, settings: Mapping[str, Any]):
        self._settings = settings

    def allocate(self, rows: int, obstacles: int) -> None:
        """Room for the settings, and velocities of 0."""
        self._size, velocities = (rows, obstacles), 3 * rows * obstacles * FLOATS.itemsize
        self.memory = np.zeros(CBF_SETTINGS.itemsize + velocities, dtype=np.uint8)
        record = cbf_memory(self.memory, rows, obstacles)[0][0]
        record["rows"], record["obstacles"] = rows, obstacles

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget."""

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Nothing to forget."""

    def move(self, velocity: NDArray[np.float64] | float) -> None:
        """Obstacles move at velocities (N, K, 3), m/s, or all at 0; those that do are refused."""
        cbf_memory(self.memory, *self._size)[1][:] = velocity

    def recall(self, found: NDArray[np.uint8]) -> None:
        """Go on from the memory of an equal method."""
        self.memory[CBF_SETTINGS.itemsize :] = found[CBF_SETTINGS.itemsize :]

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        record, kept = cbf_memory(self.memory, *self._size)[0][0], self._settings
        record["distance"], record["closing"] = 1.0 + kept["margin"], closing_bounds(kept)
        record["u_max"], record["alpha"] = kept["snap_max"], kept["alpha"]
        record["input_max"] = kept["reserve"] * kept["snap_max"]
        record["braking"] = held_gains(3, BRAKING_POLE, period)
        return Kernels(cbf_batch, cbf_one, ())


def _checked_bounds(bounds: ClosingBounds) -> ClosingBounds:
    numbers = ClosingBounds(*map(float, bounds))
    if not all(x < math.inf for x in numbers):
        raise ValueError(f"bounds must be finite numbers or -inf, got {tuple(bounds)}")
    return numbers


def _checked_limits(limits: Limits) -> Limits:
    u_max, alpha = positive_number("u_max", limits.u_max), positive_number("alpha", limits.alpha)
    if not limits.input_max >= u_max:
        raise ValueError(f"input_max must be at least u_max, got {limits.input_max} and {u_max}")
    return Limits(u_max, alpha, float(limits.input_max))
