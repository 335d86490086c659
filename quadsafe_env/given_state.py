"""States that come from outside: what the model can fly from is taken, all else is refused in a sentence."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import exact_array
from quadsafe_env.split_world import AnyWorld
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, STATE_SIZE, THRUST

# An attitude that far from a rotation, in its worst entry, is a rotation with rounding errors of someone
# else's, and is put right; below ``ROUNDING`` it is one of ours, and stays as it came, bit for bit.
NEARLY, ROUNDING = 1e-6, 1e-12
# Up to such a turn in a step the Runge–Kutta step keeps attitudes on SO(3) to 1e-9: ``dynamics.step``.
LARGEST_TURN = 0.3  # rad


def given_states(value: ArrayLike, leading: tuple[int, ...], world: AnyWorld) -> NDArray[np.float64]:
    """States (…, 20) to fly from, a fresh array.

    An attitude Q = U S Vᵀ is taken if no entry is further than 1e-6 from the nearest rotation,
    U diag(1, 1, ±1) Vᵀ, and is then replaced by that; a rotation to 1e-12 stays bit for bit.

    Args:
        value: the states, laid out as in ``quadsafe_env.vehicle.state``.
        leading: their leading shape, () or (N,).
        world: that shall fly on from them.

    Raises:
        TypeError, ValueError: for another shape, numbers that are not finite, an attitude that is no rotation,
            a thrust that is not above ``thrust_min`` or with rotor limits above ``thrust_max``, or body rates
            that turn the vehicle by 0.3 rad or more in a physics step; of N rows the first at fault is named.
    """
    states = exact_array("state", value, (*leading, STATE_SIZE)).copy()
    rows = states.reshape(-1, STATE_SIZE)
    _put_on_rotations(rows, leading)
    most = world.params.thrust_max if world.rotor_limits else np.inf
    _check_thrust(rows[:, THRUST], leading, world.params.thrust_min, most)
    _check_turn(rows[:, OMEGA:THRUST], leading, 1.0 / world.rates.physics)
    return states


def nearest_rotations(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations nearest to matrices (N, 3, 3) in the Frobenius norm."""
    left, _, right = np.linalg.svd(matrices)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, np.newaxis]
    return left @ right


def _put_on_rotations(rows: NDArray[np.float64], leading: tuple[int, ...]) -> None:
    attitudes = rows[:, ATTITUDE:OMEGA].reshape(-1, 3, 3)
    nearest = nearest_rotations(attitudes)
    off = np.abs(attitudes - nearest).max(axis=(1, 2))
    wrong = np.flatnonzero(~(off <= NEARLY))
    if wrong.size:
        i = wrong[0]
        raise ValueError(
            f"{_name(leading, i)} must have a rotation as its attitude, to {NEARLY:g} in every entry, "
            f"got {attitudes[i].tolist()}, which is {off[i]:.3g} from the nearest"
        )
    rough = off > ROUNDING
    rows[rough, ATTITUDE:OMEGA] = nearest[rough].reshape(-1, 9)


def _check_thrust(thrusts: NDArray[np.float64], leading: tuple[int, ...], least: float, most: float) -> None:
    wrong = np.flatnonzero(~((thrusts > least) & (thrusts <= most)))
    if wrong.size:
        i, ceiling = wrong[0], f" and at most thrust_max, {most:g} N" if most < np.inf else ""
        raise ValueError(
            f"{_name(leading, i)} must have a thrust above thrust_min, {least:g} N{ceiling}, got {thrusts[i]:g}"
        )


def _check_turn(rates: NDArray[np.float64], leading: tuple[int, ...], dt: float) -> None:
    # By the largest entry first: squares of large numbers overflow.
    largest = np.maximum(np.abs(rates).max(axis=1), 1.0)
    turns = largest * np.linalg.norm(rates / largest[:, np.newaxis], axis=1) * dt
    wrong = np.flatnonzero(~(turns < LARGEST_TURN))
    if wrong.size:
        i = wrong[0]
        raise ValueError(
            f"{_name(leading, i)} must turn by less than {LARGEST_TURN:g} rad in a physics step of {dt:g} s, "
            f"got body rates {rates[i].tolist()} rad/s, which turn by {turns[i]:.4g}"
        )


def _name(leading: tuple[int, ...], i: np.intp) -> str:
    return f"state[{i}]" if leading else "state"
