"""The sampled shield under declared errors: every path of the vehicle lies in a tube around its stored stop.

The shield works on the state predicted through the answers that are still on their way, with keep-out radii
larger by T_r, and stops that leave the feedback its share of the limits (``shields.settings.tube``). So
the sampled shield's proof holds for the stop, and the vehicle is in the tube around it.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed, one_row, taken
from quadsafe_core.kernels.choice import entry_at, only_if
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import subtract, triple, vector, write3
from shields.backup.stored_stop import advance_stop, check_stops, tracking_snap, within_ball
from shields.chains.flat_state import flat_of
from shields.interface.bodies import (
    are_cores_of,
    distance_from,
    is_there,
    unpacked,
)
from shields.interface.records import Bodies, Measured
from shields.interface.row_checks import (
    BAD_SHAPES,
    DONE,
    UNTIMED,
    answers_in,
    braking,
    checked_rows,
    flat_of_row,
)
from shields.methods.flight_bounds import bounds_in_tube, bounds_under
from shields.methods.memory import (
    CARRIED,
    HALF_SPACE,
    SETTINGS_ROW,
    SampledMemory,
    TubeMemory,
    empty_memory,
    is_memory_of,
    kind_of,
    recall,
    sampled_memory,
    sampled_size,
    settings_of,
    stops_of,
    tube_memory,
    tube_size,
    with_velocities,
    write_settings,
)
from shields.methods.method import Kernels
from shields.methods.on_the_way import (
    behind_rows,
    flown_now,
    front_of_row,
    is_way_clear,
    look_ahead,
    note_flown,
    send,
)
from shields.methods.sampled_row import sampled_rows
from shields.settings.tube import Tube, tube_of
from shields.settings.uncertainty import checked_uncertainty, lag_told


@kernel
def widen(bodies, width, radii):
    """Radii larger by the tube; an absent sphere stays one."""
    for i in range(radii.shape[0]):
        for k in range(radii.shape[1]):
            radius = bodies.radius[i, k]
            is_body = is_there(entry_at(bodies.cores, (i, k)), radius)
            radii[i, k] = radius + width.vehicle if is_body else 0.0


@inline_kernel
def is_outside(i, x, bodies, error):
    """Whether x is in no body of row i by more than errors do."""
    for k in range(bodies.radius.shape[1]):
        core, radius = entry_at(bodies.cores, (i, k)), bodies.radius[i, k]
        gap = subtract(x.r, triple(bodies.center, i, k))
        if is_there(core, radius) and distance_from(core, gap) < radius - error:
            return False
    return True


@kernel
def close_rows(measured, answers, tubes, settings, lag):
    """Withdraw certificates where the vehicle is not where they have it; send the answers on their way."""
    width, period = settings.tube, settings.flight.period
    error, delay, bodies = width.estimate - width.vehicle, tubes.pending.shape[1], measured.bodies
    for i in range(measured.flat.shape[0]):
        is_here = is_outside(i, flat_of_row(i, measured.flat), bodies, error)
        note_flown(lag, i, flown_now(answers.safe[i], tubes.pending[i]), period, tubes.carried)
        if delay > 0:
            x = front_of_row(i, measured, lag, tubes.carried)
            is_here = is_here and is_way_clear(i, x, bodies, tubes, error, (period, lag))
            send(answers.safe[i], tubes.pending[i])
        withdraw(i, answers.facts[i], is_here, tubes.chains)


@inline_kernel
def withdraw(i, fact, is_here, chains):
    """No certificate where the vehicle is not where it has it; count those without a break."""
    if fact["certified"] != 0.0 and not is_here:
        fact["certified"], fact["fallback"] = 0.0, 1.0
    if chains.size > 0:
        chains[i] = chains[i] + 1.0 if fact["certified"] != 0.0 else 0.0


@kernel
def is_untimed(late):
    """Whether of some row it was not told for how long the last answer was held."""
    for i in range(late.shape[0]):
        if math.isnan(late[i]):
            return True
    return False


@kernel
def tube_batch(flat, center, radius, snap, memory, kind, out):
    """Rows of ``sampled_row`` on what will be when the answer is flown; the first code that is not ``DONE``.

    See ``method.FilterKernel``.
    """
    n, k, cores = flat.shape[0], radius.shape[1], kind[-1]
    if not (is_memory_of(memory, n, k, out) and are_cores_of(cores, n, k)):
        return BAD_SHAPES
    stops = stops_of(kind[5])
    held, rest = sampled_memory(memory, n, k, stops)
    delay, looks_ahead = held.settings[0]["delay"], held.settings[0]["looks_ahead"] > 0
    tubes, lag = tube_memory(rest, n, k, (delay, looks_ahead), stops), only_if(kind[5], held.settings[0]["lag"])
    settings, answers = settings_of(held.settings[0], kind), answers_in(out, n)
    if is_untimed(tubes.late):
        return UNTIMED
    bodies = Bodies(borrowed(center), held.velocities, borrowed(radius), unpacked(cores, n, k))
    measured = Measured(borrowed(flat), bodies, borrowed(snap), None)
    code = checked_rows(measured, n, k)
    if code != DONE:
        return code
    flats, centers = measured.flat, bodies.center
    if looks_ahead:
        look_ahead(measured, delay, lag, held, tubes)
        flats, centers = tubes.flats, tubes.centers
    widen(bodies, settings.tube, tubes.radii)
    ahead = Measured(
        flats,
        Bodies(centers, bodies.velocity, tubes.radii, bodies.cores),
        measured.snap,
        behind_rows(lag, tubes.behind),
    )
    code = sampled_rows(cores, kind[3], kind[4], ahead, held.rows, settings, answers)
    if code == DONE:
        close_rows(measured, answers, tubes, settings, lag)
        if held.settings[0]["jitter"] > 0.0:
            # For how long this answer is held has to be told.
            tubes.late[:] = math.nan
    return code


@kernel
def tube_one(flat, center, radius, snap, memory, kind, out):
    """``tube_batch`` of one vehicle without the leading axis."""
    flats, centers, radii, snaps = one_row(flat), one_row(center), one_row(radius), one_row(snap)
    return tube_batch(flats, centers, radii, snaps, memory, kind, out)


@kernel
def backup_row(i, held, tubes, settings, lag, out):
    """Row i flies the stop before the last answer in its place, and stores it again; without one it brakes."""
    x, flight = flat_of(tubes.flats[i]), settings.flight
    period, snap_max = flight.period, flight.limits.snap_max
    held.rows.plans[i] = tubes.before[i]
    if tubes.before[i]["is_stored"]:
        write3(out[i], tracking_snap(tubes.before[i], x, period, flight.gains, snap_max))
        advance_stop(held.rows.plans[i], period)
    else:
        write3(out[i], within_ball(braking(x.v, x.a, x.j, settings.braking), snap_max))
    last = tubes.pending.shape[1] - 1
    if last >= 0:
        write3(tubes.pending[i, last], vector(out[i]))
    else:
        note_flown(lag, i, vector(out[i]), period, tubes.carried)


@kernel
def backup_batch(mask, memory, mark, out):
    """Rows of ``backup_row`` where ``mask`` (N,) is True, into snaps (N, 3); ``mark``: ``Kind.lag``."""
    first, _ = taken(memory, SETTINGS_ROW, (1,))
    n, k, delay, stops = first[0]["rows"], first[0]["obstacles"], first[0]["delay"], stops_of(mark)
    held, rest = sampled_memory(memory, n, k, stops)
    tubes, lag = tube_memory(rest, n, k, (delay, True), stops), only_if(mark, first[0]["lag"])
    settings = settings_of(held.settings[0], (None, None, None))
    for i in range(n):
        if mask[i]:
            backup_row(i, held, tubes, settings, lag, out)


class TubeMethod:
    """The sampled shield that knows how wrong its knowledge may be."""

    def __init__(self, settings: Mapping[str, Any]):
        uncertainty = checked_uncertainty(settings["uncertainty"])
        assert uncertainty is not None
        self._settings, self._uncertainty, lag = settings, uncertainty, lag_told(uncertainty).told
        # The delay, and whether answers may be on their way, or lost.
        self._mark = 1 if lag > 0.0 else None
        is_late = uncertainty.delay > 0 or uncertainty.losses or lag > 0.0 or uncertainty.jitter > 0.0
        self._ahead, self._stops = (uncertainty.delay, is_late), stops_of(self._mark)

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row."""
        self._size = rows, obstacles
        stop = self._stops.itemsize
        size = sampled_size(rows, obstacles, stop) + tube_size(rows, obstacles, *self._ahead, stop)
        self.memory = empty_memory(rows, obstacles, size, *self._ahead)

    def _parts(self) -> tuple[SampledMemory, TubeMemory]:
        """Made when they are used: a copy of this object has a memory of its own."""
        return self._parts_of(self.memory)

    def _parts_of(self, memory: NDArray[np.uint8]) -> tuple[SampledMemory, TubeMemory]:
        held, rest = sampled_memory(memory, *self._size, self._stops)
        return held, tube_memory(rest, *self._size, self._ahead, self._stops)

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows; what was on its way to them is not flown."""
        held, tubes = self._parts()
        held.rows.half_spaces[mask] = np.zeros((), dtype=HALF_SPACE)
        nothing = np.zeros((), dtype=self._stops.dtype)
        held.rows.plans[mask] = nothing
        tubes.pending[mask] = 0.0
        if self._ahead[1]:
            tubes.before[mask], tubes.chains[mask], tubes.late[mask] = nothing, 0.0, 0.0
        if self._mark:
            tubes.carried[mask] = np.zeros((), dtype=CARRIED)

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Some rows fly other snaps than the last answer: their stops are void, what is on its way is not."""
        tubes = self._parts()[1]
        on_the_way, carried = tubes.pending[mask], tubes.carried[mask if self._mark else []]
        on_the_way[:, -1:] = snaps[:, None]
        self.forget(mask)
        tubes.pending[mask] = on_the_way
        if self._mark:
            if not self._ahead[0]:
                carried["flown"] = snaps
            tubes.carried[mask] = carried

    def held_for(self, share: NDArray[np.float64] | float) -> None:
        """The last answers were held for so many periods (N,)."""
        tubes = self._parts()[1]
        tubes.late[:] = share - 1.0
        if self._mark:
            tubes.carried["period"] *= share

    def move(self, velocity: NDArray[np.float64] | float) -> None:
        """Obstacles move at velocities (N, K, 3), m/s, or all at 0."""
        if isinstance(velocity, np.ndarray):
            self.memory = with_velocities(self.memory)
        self._parts()[0].velocities[:] = velocity

    def recall(self, found: NDArray[np.uint8]) -> None:
        """Go on from the memory of an equal method."""
        held, tubes = self._parts_of(found)
        check_stops(held.rows.plans)
        check_stops(tubes.before)
        recall(self.memory, found)

    def tube(self, period: float) -> Tube:
        """The tube at a period; a ValueError where there is none."""
        return tube_of(self._uncertainty, period, bounds_under(self._uncertainty, self._settings).limits)

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        bounds, tube = bounds_under(self._uncertainty, self._settings), self.tube(period)
        bounds, held = bounds_in_tube(tube.deviation, tube.feedback, bounds), self._parts()[0]
        # A stop is stored in whole periods: of another length it would be another stop.
        held.rows.plans["is_stored"] = False
        write_settings(held.settings[0], self._settings, period, bounds, tube.gains)
        held.settings[0]["lag"] = lag_told(self._uncertainty).told
        held.settings[0]["jitter"] = self._uncertainty.jitter
        held.settings[0]["tube"] = tube.deviation[0], tube.deviation[0] + tube.error[0]
        kind = kind_of(self._settings, bounds, has_tube=True, size=self._size)
        return Kernels(tube_batch, tube_one, tuple(kind))

    def backup(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Snaps (N, 3) of the stops that the rows of ``mask`` fly in place of their last answer; else 0."""
        out = np.zeros((mask.shape[0], 3))
        backup_batch(mask, self.memory, self._mark, out)
        return out
