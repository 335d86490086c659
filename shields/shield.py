"""The shield: settings and memory around a method that turns desired snaps into safe ones."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.authority import Authority
from quadsafe_core.checks import keywords_known_to, one_of
from quadsafe_core.kernels.jit import compiling
from quadsafe_core.shapes import Obstacles
from shields.interface.arguments import (
    as_array,
    as_cores,
    as_obstacles,
    checked_mask,
    control_period,
    goes_on,
    measurement_error,
    positive_rows,
    shape_error,
    size_of,
    velocity_rows,
)
from shields.interface.filtered import NUMBERS, Filtered
from shields.interface.row_checks import DONE
from shields.interface.snapshots import Snapshots
from shields.methods.cbf_shield import CbfMethod
from shields.methods.method import FilterKernel, Method
from shields.methods.sampled_shield import SampledMethod
from shields.methods.tube_shield import TubeMethod
from shields.settings.shield_settings import checked_settings
from shields.settings.uncertainty import Uncertainty

METHODS = {"sampled": SampledMethod, "cbf": CbfMethod}


class Shield(Snapshots):
    """Turns desired snaps into safe ones: one memory for one plant, or for N plants flown together.

    Each plant is held at least a keep-out distance away from every obstacle: sphere, capsule, cylinder, box,
    hull, ellipsoid or half-space, at rest or at constant velocity. Where no correction is needed, the desired
    snap comes back bit for bit.

    Method "sampled" holds under a snap held for the period, at any rate, for any number of obstacles, between
    samples too. It projects the desired snap onto one half-space per obstacle, and flies the result if a stop
    after it is certified: a stored manoeuvre to rest that clears every obstacle and keeps the specific thrust
    ‖r̈ + g e3‖ at its floor. Otherwise it flies a part of the way to it, or the stored stop, which is also its
    answer to a desired snap that is not finite. From a state without any stop, recovery is best effort. Inside
    an obstacle the pilot is not asked: the vehicle leaves by the nearest exit, from rest at no more than 1 m/s.

    Method "cbf" is the filter (33) of the paper for one sphere, a statement about continuous time: held over
    a period it can be violated. It answers a desired snap that is not finite by braking, filtered. It does not
    recover: at rest inside the sphere (33) asks for nothing, and ``in_set`` is False.

    With an ``authority`` ("sampled") every flight also keeps to what a vehicle can give. No snap is longer than
    the authority's. A snap is flown only if the specific thrust and the jerk keep to the authority for the
    period and along a stop after it; the stop counts on 95 % of the authority, and the rest is the feedback's
    that holds the vehicle on it. So what is desired is limited to what can still be stopped. The half-spaces
    are those of the braking set, with ū, x̄_1 and x̄_2 from the authority along each direction.

    With an ``uncertainty`` all this holds for the vehicle as it is, not as it is known, as long as every error
    is within its bound: a tube around each stored stop holds them all, and is kept out of the obstacles and
    within the limits (``shields.settings.tube``). Then ``value`` is that of the radius with the tube.

    Every departure is reported in ``Filtered``.

    Args:
        method: "sampled" or "cbf".
        snap_max: ū, snap along the line of sight that the invariant sets count on, m/s⁴; 200 by default.
        reserve: U_max/ū ≥ 1, how far beyond ū a state outside its set may be pushed back, and a stop go; 3.
        held_snap_max: longest snap that is flown, m/s⁴ ("sampled"); None for no limit.
        jerk_max: largest jerk of a certified flight, m/s³ ("sampled"); None for no limit.
        alpha: α, how fast a set value may decay, 1/s.
        margin: how far outside the keep-out radius the set ends, as a fraction of that radius; of shapes other
            than spheres, which may be thin, as a fraction of half a metre.
        specific_thrust_min: least specific thrust that a certified flight keeps, m/s² ("sampled"); 1.
        specific_thrust_max: largest specific thrust of a certified flight, m/s² ("sampled"); None for no limit.
        gravity: g, m/s² ("sampled"); 9.81.
        authority: what the vehicle can give, an ``Authority`` or a mapping of its fields, in place of the
            settings above but alpha and margin; None for those.
        uncertainty: bounds of what the shield does not know, an ``Uncertainty`` or a mapping of its fields, or
            the name of a file of ``calibrate``, ending in .json ("sampled"); None for none.
        max_closing_speed: bound of −Ṙ, m/s, or None. "sampled" keeps this and the next two in a period that
            begins within them, along the line of sight at its sample, where the snap is not ``refused``: not
            along a line of sight that turns, nor in a stop. ``certified`` says nothing about them.
        max_closing_acceleration: bound of −R̈, m/s², or None.
        max_closing_jerk: bound of −R⃛, m/s³, or None.

    Raises:
        ValueError: for a setting out of its range, or one of "sampled" only with another method.

    Reference: Section V, equation (33); for "sampled" see ``shields.filters.sampled``,
    ``shields.methods.halfspace`` and ``shields.backup.certificate``.
    """

    @keywords_known_to("Shield")
    def __init__(
        self,
        *,
        method: str = "sampled",
        snap_max: float | None = None,
        reserve: float | None = None,
        held_snap_max: float | None = None,
        jerk_max: float | None = None,
        alpha: float = 2.0,
        margin: float = 0.005,
        specific_thrust_min: float | None = None,
        specific_thrust_max: float | None = None,
        gravity: float | None = None,
        authority: Authority | Mapping[str, float] | None = None,
        uncertainty: Uncertainty | Mapping[str, Any] | str | None = None,
        max_closing_speed: float | None = None,
        max_closing_acceleration: float | None = None,
        max_closing_jerk: float | None = None,
    ):
        self._settings = checked_settings(
            method=one_of("method", method, tuple(METHODS)),
            snap_max=snap_max,
            reserve=reserve,
            held_snap_max=held_snap_max,
            jerk_max=jerk_max,
            alpha=alpha,
            margin=margin,
            specific_thrust_min=specific_thrust_min,
            specific_thrust_max=specific_thrust_max,
            gravity=gravity,
            authority=authority,
            uncertainty=uncertainty,
            max_closing_speed=max_closing_speed,
            max_closing_acceleration=max_closing_acceleration,
            max_closing_jerk=max_closing_jerk,
        )
        has_errors = self._settings["uncertainty"] is not None
        self._method: Method = (TubeMethod if has_errors else METHODS[method])(self._settings)
        self._size: tuple[int, int] | None = None
        self._period, self._moves = math.nan, None
        self._kernel: FilterKernel
        self._cores: NDArray[np.uint8] | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """The keyword arguments that make this shield again; JSON can hold them."""
        return dict(self._settings)

    def __repr__(self) -> str:
        return f"Shield({', '.join(f'{key}={value!r}' for key, value in self._settings.items())})"

    def filter(
        self, flat: ArrayLike, obstacles: Obstacles | Sequence[Any], snap: ArrayLike, period: float
    ) -> Filtered:
        """The safe snaps of one control period.

        The number of plants and of obstacles is fixed at the first call, until ``reset()``.

        Args:
            flat: (N, 4, 3) position m, velocity m/s, acceleration m/s², jerk m/s³, world frame.
            obstacles: ``Obstacles`` of N worlds, keep-out included, such as
                ``Obstacles.spheres(center, radius)``; for one plant also a list of shapes, mappings or rows
                [x, y, z, radius].
            snap: (N, 3) desired snaps, m/s⁴; for one plant leave N out everywhere.
            period: for how long the snap is held, s; 1e-9 to 1: milliseconds are none.

        Returns:
            ``Filtered``.

        Raises:
            TypeError: for what is no number: strings and booleans are none.
            ValueError: for wrong shapes, measurements that are not finite or not below 1e100, radius < 0,
                period < 1e-9 or > 1, or obstacles that the method does not take.
        """
        if period == self._period:
            try:
                packed: Any = obstacles
                if packed.cores is self._cores and goes_on(packed.velocity, self._moves, *self._moving):
                    out = np.empty(self._numbers)
                    code = self._kernel(flat, packed.center, packed.radius, snap, *self._own, out)
                    if code == DONE:
                        return Filtered(out, self._leading)
            except (TypeError, AttributeError):
                # The careful way makes them arrays of float64 in C order, or says what is wrong.
                pass
        return self._filter_checked(flat, as_obstacles(obstacles), snap, period)

    def _filter_checked(self, flat, obstacles: Obstacles, snap, period) -> Filtered:
        given = flat, obstacles.center, obstacles.radius, snap
        flats, centers, radii, snaps = map(as_array, given)
        is_single = flats.ndim == 2
        size = size_of(*(x[None] if is_single else x for x in (flats, centers, radii, snaps)))
        if size is None:
            raise shape_error(*given)
        # The quick way is for what a call has ended well with.
        self._moves = None
        self._begin(size, is_single, control_period(period))
        self._cores, moving = as_cores(obstacles.cores, size), velocity_rows(obstacles.velocity, (*size, 3))
        self._moves = moving is not None
        self._method.move(0.0 if moving is None else moving)
        self._own = self._method.memory, (*self._kernels.kind, self._cores)
        self._moving = self._method.memory, (*self._leading, size[1], 3)
        out = np.empty(self._numbers)
        with compiling(self._kernels.batch, self._kernels.one):
            code = self._kernel(flats, centers, radii, snaps, *self._own, out)
        if code != DONE:
            raise measurement_error(code, flats, centers, radii, moving)
        return Filtered(out, self._leading)

    def _begin(self, size: tuple[int, int], is_single: bool, period: float) -> None:
        """Memory at the first call, the kernel for these shapes and this period."""
        if self._size is None:
            self._method.allocate(*size)
            self._size, self._period = size, math.nan
        if size != self._size:
            raise ValueError(
                f"flat and obstacles must keep their N and K until reset(), got {size} after {self._size}"
            )
        if period != self._period:
            self._kernels, self._period = self._method.at(period), period
        self._leading = () if is_single else size[:1]
        self._kernel = self._kernels.one if is_single else self._kernels.batch
        self._numbers = NUMBERS * size[0]

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget the rows of ``mask``, (N,) booleans, or without one everything, the number of plants too.

        Raises:
            ValueError: for another shape or type.
        """
        if mask is None:
            self._size, self._period = None, math.nan
            return
        rows = checked_mask(mask, self._size and self._size[:1])
        if self._size is not None:
            self._method.forget(rows)

    def backup(self, mask: ArrayLike) -> NDArray[np.float64]:
        """What the vehicle flies where the last answer was lost: the stop that was stored before it.

        Call it after ``filter`` of the same period. The shield then goes on from that stop.

        Args:
            mask: (N,) booleans, the rows whose answer was lost; one boolean for one plant.

        Returns:
            (N, 3) snaps, m/s⁴, 0 in the other rows; (3,) for one plant.

        Raises:
            ValueError: for a shield whose ``uncertainty`` has no ``losses``, before the first call of
                ``filter``, or for another shape or type.
        """
        if not self.can_lose:
            raise ValueError(
                "uncertainty.losses must be True for a shield whose answers may be lost, got False"
            )
        if self._size is None:
            raise ValueError("backup must follow a call of filter, got none since the last reset()")
        rows = checked_mask(mask, self._leading).reshape(self._size[0])
        return cast(TubeMethod, self._method).backup(rows).reshape(*self._leading, 3)

    def check_period(self, period: float) -> None:
        """Raise a ValueError if declared errors leave no tube at a control period, s."""
        if self._settings["uncertainty"] is not None:
            cast(TubeMethod, self._method).tube(control_period(period))

    def held_for(self, seconds: ArrayLike) -> None:
        """Tell for how long the last answers were held, (N,) or one number, s, before the next ``filter``.

        Where ``uncertainty.jitter`` is declared it has to be told, else it is the period.

        Raises:
            ValueError: for a shield without, before the first call of ``filter``, or for no such times.
        """
        declared = self._settings["uncertainty"]
        if declared is None or declared["jitter"] == 0.0:
            raise ValueError("uncertainty.jitter must be > 0 for answers held too long or too short, got 0")
        if self._size is None:
            raise ValueError("held_for must follow a call of filter, got none since the last reset()")
        cast(TubeMethod, self._method).held_for(
            positive_rows("seconds", seconds, self._size[:1]) / self._period
        )

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """The rows of ``mask`` (N,) fly these snaps (M, 3), not the last answer: their stops are void."""
        self._method.override(mask, snaps)

    @property
    def delay(self) -> int:
        """For how many periods an answer is on its way."""
        declared = self._settings["uncertainty"]
        return 0 if declared is None else declared["delay"]

    @property
    def can_lose(self) -> bool:
        """Whether ``backup`` may be asked."""
        declared = self._settings["uncertainty"]
        return declared is not None and declared["losses"]
