"""What a vehicle can always give: bounds of snap, jerk and specific thrust that plant and shield agree on."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import (
    checked_when_made,
    finite_array,
    non_negative_number,
    one_of,
    positive_number,
)
from quadsafe_core.kernels.jit import kernel


def _checked(found: "Authority") -> "Authority":
    """Every number a float above 0, and hover within the band."""
    numbers = [positive_number(f"authority.{field}", value) for field, value in found._asdict().items()]
    _, _, least, most, gravity = numbers
    if not least < gravity < most:
        raise ValueError(
            "authority must have specific_thrust_min < gravity < specific_thrust_max, "
            f"got {least:g}, {gravity:g} and {most:g}"
        )
    return Authority._make(numbers)


@checked_when_made(_checked)
class Authority(NamedTuple):
    """What a vehicle can always give, whatever its attitude.

    Whoever hands one out promises: a flight within these numbers never asks the rotors for more than they have.
    An authority with a number not above 0, or with hover out of its band, cannot be made.

    | field               | unit | meaning                                              |
    |---------------------|------|------------------------------------------------------|
    | snap_max            | m/s⁴ | bound of ‖r⁗‖                                        |
    | jerk_max            | m/s³ | bound of ‖r⃛‖                                        |
    | specific_thrust_min | m/s² | lower end of the band of specific thrust ‖r̈ + g e3‖ |
    | specific_thrust_max | m/s² | upper end of that band                               |
    | gravity             | m/s² | g                                                    |
    """

    snap_max: float
    jerk_max: float
    specific_thrust_min: float
    specific_thrust_max: float
    gravity: float

    def acceleration_along(self, direction: ArrayLike) -> NDArray[np.float64]:
        """Greatest λ for which the accelerations from 0 to λ n keep the specific thrust in the band.

        With ``‖λ n + g e3‖² = λ² + 2 λ g n_z + g²`` it is the first positive root at an end of the band.

        Args:
            direction: (…, 3), not zero; n is it over its length.

        Returns:
            λ, (…), m/s².

        Raises:
            ValueError: for a wrong shape, non-finite numbers or a direction without length.
        """
        d = finite_array("direction", direction, (3,))
        length = np.linalg.norm(d, axis=-1)
        if not (length > 0.0).all():
            raise ValueError("direction must be longer than 0, got a vector of zeros")
        upward = np.divide(d[..., 2], length)
        out = np.empty(upward.size)
        acceleration_along_batch(np.ravel(upward), self, out)
        return out.reshape(upward.shape)

    def less(self, share: float) -> "Authority":
        """Without a share of the snap, of the jerk, and of both ways from hover to the ends of the band.

        Raises:
            ValueError: for a share not in [0, 1).
        """
        if non_negative_number("share", share) >= 1.0:
            raise ValueError(f"share must be in [0, 1), got {share!r}")
        kept = 1.0 - share
        return Authority(
            kept * self.snap_max,
            kept * self.jerk_max,
            self.gravity + kept * (self.specific_thrust_min - self.gravity),
            self.gravity + kept * (self.specific_thrust_max - self.gravity),
            self.gravity,
        )


@kernel
def acceleration_along(n_z, authority):
    """Greatest acceleration along a unit vector with that z entry which keeps the thrust in the band."""
    upward, lift = authority.gravity * n_z, authority.gravity * authority.gravity
    inside = upward * upward + authority.specific_thrust_min * authority.specific_thrust_min - lift
    # Only downwards, within a cone, does the thrust fall to the lower end at all.
    if upward < 0.0 and inside >= 0.0:
        return -upward - math.sqrt(inside)
    return (
        math.sqrt(upward * upward + authority.specific_thrust_max * authority.specific_thrust_max - lift)
        - upward
    )


@kernel
def acceleration_along_batch(n_z, authority, out):
    """Rows of ``acceleration_along``."""
    for i in range(n_z.shape[0]):
        out[i] = acceleration_along(n_z[i], authority)


def checked_authority(name: str, value: Any) -> Authority:
    """``value``, an Authority or a mapping of its fields, with every number checked.

    Raises:
        TypeError, ValueError: naming the field, what was expected and what came.
    """
    fields = Authority._fields
    table = value._asdict() if isinstance(value, Authority) else value
    for field in table if isinstance(table, Mapping) else ():
        one_of(f"a field of {name}", field, fields)
    if not isinstance(table, Mapping) or len(table) < len(fields):
        raise TypeError(f"{name} must be an Authority or a mapping of {', '.join(fields)}, got {value!r}")
    return Authority(**table)
