"""The safety filter of Section V-C, in closed form.

    minimise |U − U_des|   subject to   ℒg_i(U) + α g_i ≥ 0   for i = 1 … 4                        (33)

over the radial chain R, R1, R2, R3 with R4 = U. The set g_4 keeps R above the keep-out distance; g_3, g_2
and g_1 keep R1, R2 and R3 above bounds of their own. With ℒg_i(U) = (U − ū) t*^{i−1}/(i−1)! each of them is
a lower bound on U,

    t* > 0           U ≥ ū − α g_i (i−1)!/t*^{i−1}
    t* = 0, i ≥ 2    none
    i = 1            U ≥ −α g_1

so the solution is the largest of these and U_des: no programme is solved. Inside the sets it never exceeds ū.
Outside it does, without limit as t* → 0, and that brings the state back; it is capped at ``input_max``.
This is a statement about continuous time: held over a control period, the input can leave the sets.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import positive_number
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import dot
from shields.filtered import Measured, closing_bounds
from shields.integrator import lower1, lower2, lower3, lower4, required_input
from shields.radial import checked_rows, motion_about, shifted_snap, vector


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
def safe_snap(flat, center, distance, snap, bounds, limits):
    """Steps B, C and D of Section V for one sphere: the nearest safe snap, its U, and the least set value."""
    state, n, T = motion_about(flat, center)
    U_des = dot(n, snap) + T
    U, value = closest_input(state, U_des, distance, bounds, limits)
    return (snap if U_des == U else shifted_snap(snap, n, U - U_des)), U, value


@inline_kernel
def present_obstacle(radius):
    """Index of the only sphere with a radius above 0; −1 for none, −2 for several."""
    found = -1
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            found = k if found == -1 else -2
    return found


@kernel
def safe_snap_batch(flat, center, radius, desired, constants, snap, decisions):
    """Rows of ``safe_snap``; returns the first row with several spheres, or −1.

    ``constants``: keep-out distance per radius, then the entries of ``ClosingBounds`` and of ``Limits``.
    """
    bounds = ClosingBounds(constants[1], constants[2], constants[3])
    limits = Limits(constants[4], constants[5], constants[6])
    for i in range(flat.shape[0]):
        k, wanted = present_obstacle(radius[i]), vector(desired[i])
        if k == -2:
            return i
        u, U, value = wanted, -math.inf, math.inf
        if k >= 0:
            u, U, value = safe_snap(flat[i], center[i, k], constants[0] * radius[i, k], wanted, bounds, limits)
        decisions[i]["value"] = value
        if u != wanted:
            decisions[i]["obstacle"], decisions[i]["reserve"] = k, max(0.0, U / limits.u_max)
        for axis in range(3):
            snap[i, axis] = u[axis]
    return -1


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
    (states, inputs, distances), leading = checked_rows(
        state=(state, (4,)), desired=(desired, ()), distance=(distance, ())
    )
    U, value = np.empty(inputs.shape), np.empty(inputs.shape)
    closest_input_batch(states, inputs, distances, _checked_bounds(bounds), _checked_limits(limits), U, value)
    return U.reshape(leading), value.reshape(leading)


class CbfMethod:
    """Equation (33), one sphere per row; it needs no memory."""

    def __init__(self, settings: Mapping[str, Any]):
        bounds = closing_bounds(settings)
        u_max = settings["snap_max"]
        limits = Limits(u_max, settings["alpha"], settings["reserve"] * u_max)
        # One array crosses into the kernel faster than two named tuples, by 1 µs of 5.
        self._constants = np.array([1.0 + settings["margin"], *bounds, *limits])

    def allocate(self, rows: int, obstacles: int) -> None:
        """No memory."""

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """No memory."""

    def filter_rows(self, measured: Measured, desired: NDArray, period: float, snap, decisions) -> None:
        """Filter every row; several spheres in a row are an error, and so are moving ones."""
        flat, center, radius, velocity = measured
        if velocity.any():
            raise ValueError("velocity must be 0 with method 'cbf', got a moving sphere; that needs 'sampled'")
        crowded = safe_snap_batch(flat, center, radius, desired, self._constants, snap, decisions)
        if crowded >= 0:
            count = np.count_nonzero(radius[crowded])
            raise ValueError(
                f"method 'cbf' takes one obstacle, got {count} with radius > 0; several need method 'sampled'"
            )


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
