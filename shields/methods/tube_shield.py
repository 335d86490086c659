"""The sampled shield under declared errors: every path of the vehicle lies in a tube around its stored stop.

The shield works on the state predicted through the answers that are still on their way, with keep-out radii
larger by T_r, and stops that leave the feedback its share of the limits (``shields.settings.uncertainty``). So
the sampled shield's proof holds for the stop, and the vehicle is in the tube around it.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.authority import Authority
from quadsafe_core.kernels.borrow import borrowed, carved, one_row
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, subtract, triple, vector, write3
from shields.backup.arcs import CLEAR, HIT, look_at_arc
from shields.backup.certificate import ANY_THRUST
from shields.backup.stored_stop import PLAN, advance_stop, tracking_snap, within_ball
from shields.chains.flat_state import Flat, flat_of, flown, write_flat
from shields.interface.filtered import (
    BAD_SHAPES,
    DONE,
    FACTS,
    FLOATS,
    IS_CERTIFIED,
    IS_FALLBACK,
    Kernels,
    braking,
    checked_rows,
    velocities_or,
)
from shields.interface.records import MovingSpheres
from shields.methods.flight_bounds import FlightBounds, bounds_of
from shields.methods.nearest_snap import Width
from shields.methods.sampled_shield import (
    PLAN_BYTES,
    PLANS,
    SETTINGS,
    SampledMethod,
    joint_row,
    places,
    unpacked,
)
from shields.settings.uncertainty import Tube, checked_uncertainty, tightened, tube_of

FLAT_BYTES, POINT_BYTES, NUMBER_BYTES = 96, 24, 8


@inline_kernel
def tubed_places(n, k, delay):
    """Where in the memory, behind that of a sampled shield, begins what a tubed one has as well, and its size.

    The flat states, centres and radii that it works on, the stops before the last answers, the answers that are
    on their way, and how many of the last answers were certified, without a break.
    """
    flats = places(n, k)[3]
    centers = flats + FLAT_BYTES * n
    radii = centers + POINT_BYTES * n * k
    before = radii + NUMBER_BYTES * n * k
    pending = before + PLAN_BYTES * n
    chains = pending + POINT_BYTES * n * delay
    return flats, centers, radii, before, pending, chains, chains + NUMBER_BYTES * n


@kernel
def predicted(i, flat, pending, period):
    """The flat state of row i when every answer that is on its way has been flown."""
    x = Flat(triple(flat, i, 0), triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3))
    for answer in range(pending.shape[1]):
        x = flown(x, triple(pending, i, answer), period)
    return x


@kernel
def work_on(i, ahead, width, given, centers, radii):
    """Put down what the sampled shield works on: radii with the tube, everything as it will be."""
    center, velocity, radius = given
    for k in range(radius.shape[1]):
        write3(centers[i, k], combined(triple(center, i, k), ahead, triple(velocity, i, k)))
        # An absent sphere stays one.
        radii[i, k] = radius[i, k] + width.vehicle if radius[i, k] > 0.0 else 0.0


@kernel
def send(i, snap, pending):
    """Put the answer behind those that are on their way, the first of which has been flown."""
    last = pending.shape[1] - 1
    for answer in range(last):
        write3(pending[i, answer], triple(pending, i, answer + 1))
    if last >= 0:
        write3(pending[i, last], vector(snap[i]))


@kernel
def is_here_clear(i, flat, pending, chain, given, width, period):
    """Whether the vehicle as it is, not only as it will be, is where a certificate has it.

    Where all that is on its way was certified, no point of its path may lie in a sphere by more than errors do.
    Before that the path must be clear for sure.
    """
    center, velocity, radius = given
    error, delay, count = width.estimate - width.vehicle, pending.shape[1], radius.shape[1]
    x = Flat(triple(flat, i, 0), triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3))
    for k in range(count):
        if norm(subtract(x.r, triple(center, i, k))) < radius[i, k] - error:
            return False
    if delay == 0:
        return True
    is_chained, keep_out = chain[i] >= delay, np.zeros(count)
    for k in range(count):
        if radius[i, k] > 0.0:
            keep_out[k] = max(radius[i, k] - error, 0.0) if is_chained else radius[i, k] + error
    spheres = MovingSpheres(center[i], velocity[i], keep_out)
    for answer in range(delay):
        snap = triple(pending, i, answer)
        found = look_at_arc(x, snap, answer * period, period, spheres, ANY_THRUST)
        if found == HIT or (found != CLEAR and not is_chained):
            return False
        x = flown(x, snap, period)
    return True


@kernel
def withdraw(i, facts, is_here, chain):
    """No certificate where the vehicle is not where it has it; count those without a break."""
    if facts[i, IS_CERTIFIED] != 0.0 and not is_here:
        facts[i, IS_CERTIFIED], facts[i, IS_FALLBACK] = 0.0, 1.0
    chain[i] = chain[i] + 1.0 if facts[i, IS_CERTIFIED] != 0.0 else 0.0


@kernel
def tubed_batch(flat, center, radius, snap, velocity, memory, closing, authority, width, delay, out):
    """Rows of ``joint_row`` on what will be when the answer is flown; the first code that is not ``DONE``."""
    n, k = flat.shape[0], radius.shape[1]
    flats_at, centers_at, radii_at, before_at, pending_at, chains_at, size = tubed_places(n, k, delay)
    half_spaces_at, velocities_at, stops_at, _ = places(n, k)
    if not (memory.shape[0] == size and out.shape[0] == (3 + FACTS) * n):
        return BAD_SHAPES
    last, plans = carved(memory, half_spaces_at, FLOATS, (n, k, 4)), carved(memory, stops_at, PLANS, (n,))
    before, pending = carved(memory, before_at, PLANS, (n,)), carved(memory, pending_at, FLOATS, (n, delay, 3))
    flats, centers = carved(memory, flats_at, FLOATS, (n, 4, 3)), carved(memory, centers_at, FLOATS, (n, k, 3))
    radii, moving = (
        carved(memory, radii_at, FLOATS, (n, k)),
        velocities_or(velocity, memory, velocities_at, n, k),
    )
    safe, facts = carved(out, 0, FLOATS, (n, 3)), carved(out, 24 * n, FLOATS, (n, FACTS))
    settings = unpacked(carved(memory, 0, FLOATS, (SETTINGS,)), closing, authority, width)
    flat, center, radius = borrowed(flat), borrowed(center), borrowed(radius)
    period, chain = settings.sampling.period, carved(memory, chains_at, FLOATS, (n,))
    code = checked_rows(flat, center, radius, moving, snap, safe)
    for i in range(n):
        if code == DONE:
            is_here = is_here_clear(i, flat, pending, chain, (center, moving, radius), width, period)
            write_flat(flats[i], predicted(i, flat, pending, period))
            work_on(i, delay * period, width, (center, moving, radius), centers, radii)
            before[i] = plans[i]
            code = joint_row(i, flats, centers, radii, moving, snap, last, plans, settings, safe, facts)
            withdraw(i, facts, is_here, chain)
            send(i, safe, pending)
    return code


@kernel
def tubed_one(flat, center, radius, snap, velocity, memory, closing, authority, width, delay, out):
    """``tubed_batch`` of one vehicle without the leading axis."""
    flats, centers, radii, snaps = one_row(flat), one_row(center), one_row(radius), one_row(snap)
    return tubed_batch(flats, centers, radii, snaps, velocity, memory, closing, authority, width, delay, out)


@kernel
def backup_batch(mask, k, delay, memory, out):
    """Of the rows of ``mask`` the stop before the last answer is flown, and stored again, in its place.

    Without such a stop the row brakes.
    """
    n = mask.shape[0]
    flats_at, _, _, before_at, pending_at, _, _ = tubed_places(n, k, delay)
    flats, before = carved(memory, flats_at, FLOATS, (n, 4, 3)), carved(memory, before_at, PLANS, (n,))
    plans = carved(memory, places(n, k)[2], PLANS, (n,))
    pending = carved(memory, pending_at, FLOATS, (n, delay, 3))
    settings = unpacked(carved(memory, 0, FLOATS, (SETTINGS,)), None, None, None)
    period, snap_max = settings.sampling.period, settings.limits.snap_max
    for i in range(n):
        if mask[i]:
            x = flat_of(flats[i])
            plans[i] = before[i]
            if before[i]["is_stored"]:
                write3(out[i], tracking_snap(before[i], x, period, settings.gains, snap_max))
                advance_stop(plans[i], period)
            else:
                write3(out[i], within_ball(braking(x.v, x.a, x.j, settings.braking), snap_max))
            last = pending.shape[1] - 1
            if last >= 0:
                write3(pending[i, last], vector(out[i]))


class TubedMethod(SampledMethod):
    """The sampled shield that knows how wrong its knowledge may be."""

    def __init__(self, settings: Mapping[str, Any]):
        super().__init__(settings)
        uncertainty = checked_uncertainty(settings["uncertainty"])
        assert uncertainty is not None
        self._uncertainty = uncertainty

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row, in one array."""
        self._size = (rows, obstacles)
        self.memory = np.zeros(int(tubed_places(rows, obstacles, self._uncertainty.delay)[-1]), dtype=np.uint8)

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows; what was on its way to them is not flown."""
        super().forget(mask)
        (n, k), delay = self._size, self._uncertainty.delay
        *_, before_at, pending_at, chains_at, _ = (int(place) for place in tubed_places(n, k, delay))
        carved(self.memory, before_at, PLANS, (n,))[mask] = np.zeros((), dtype=PLAN)
        carved(self.memory, pending_at, FLOATS, (n, delay, 3))[mask] = 0.0
        carved(self.memory, chains_at, FLOATS, (n,))[mask] = 0.0

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Some rows fly other snaps than the last answer: their stops are void, what is on its way is not."""
        (n, _), delay = self._size, self._uncertainty.delay
        pending_at = int(tubed_places(*self._size, delay)[-3])
        pending = carved(self.memory, pending_at, FLOATS, (n, delay, 3))
        on_the_way = pending[mask]
        on_the_way[:, -1:] = snaps[:, None]
        self.forget(mask)
        pending[mask] = on_the_way

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        bounds = bounds_of(self._settings)
        if self._uncertainty.gain > 0.0 and bounds.limits.snap_max == math.inf:
            # A share of any snap whatever would be no bound.
            most = bounds.input_max
            bounds = bounds._replace(limits=bounds.limits._replace(snap_max=most))
        tube = tube_of(self._uncertainty, period, bounds.limits)
        width = Width(float(tube.deviation[0]), float(tube.deviation[0] + tube.error[0]))
        own = self._own(period, in_the(tube, bounds), tube.gains)
        return Kernels(tubed_batch, tubed_one, (*own, width, self._uncertainty.delay))

    def backup(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Snaps (N, 3) of the stops that the rows of ``mask`` fly in place of their last answer; else 0."""
        out = np.zeros((mask.shape[0], 3))
        backup_batch(mask, self._size[1], self._uncertainty.delay, self.memory, out)
        return out


def in_the(tube: Tube, bounds: FlightBounds) -> FlightBounds:
    """What half-spaces and stops count on, so that a vehicle in the tube keeps to the bounds."""
    limits = tightened(bounds.limits, tube)
    if bounds.authority is None:
        return bounds._replace(limits=limits)
    band = limits.band
    authority = Authority(limits.stop_snap_max, limits.jerk_max, band.least, band.most, band.gravity)
    return FlightBounds(authority.snap_max, bounds.input_max, limits, authority)
