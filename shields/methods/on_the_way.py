"""What is between an answer and the vehicle: answers that are on their way, and the snap behind a lag.

Position, velocity, acceleration and jerk are measured, the snap s that the vehicle is at is not. From 0 after
a reset it follows what is flown: over a period s becomes u + (s − u) e^(−Δ/T). Without a lag none is carried.
"""

import math

import numpy as np

from quadsafe_core.kernels.choice import entry_at, none_without, same_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, triple, vector, write3
from shields.backup.arcs import CLEAR, HIT, look_at_arc
from shields.backup.certificate import ANY_THRUST
from shields.backup.stored_stop import shift_stop
from shields.chains.flat_state import behind_of, flown, lead, write_flat
from shields.interface.bodies import bodies_of_row, is_there
from shields.interface.records import BehindRows, MovingBodies
from shields.interface.row_checks import flat_of_row


@none_without
def carry(lag, i, carried):
    """Move s of row i on by what it has followed since the last sample."""
    last, s = carried[i]["flown"], carried[i]["lagged"]
    left = math.exp(-carried[i]["period"] / lag)
    for axis in range(3):
        s[axis] = last[axis] + (s[axis] - last[axis]) * left
    # What has been followed once is not followed again.
    carried[i]["period"] = 0.0


@none_without
def note_flown(lag, i, snap, period, carried):
    """Put down what s of row i follows until the next sample."""
    u = carried[i]["flown"]
    u[0], u[1], u[2] = snap
    carried[i]["period"] = period


@inline_kernel
def flown_now(snap, pending):
    """What is flown until the next sample: the first of what is on its way, or the answer itself."""
    return vector(pending[0]) if pending.shape[0] > 0 else vector(snap)


@same_without
def led(x, lag, i, carried):
    """The lead of a vehicle, row i."""
    s = carried[i]["lagged"]
    return lead(x, (s[0], s[1], s[2]), lag)


@inline_kernel
def front_of_row(i, measured, lag, carried):
    """The flat state of row i; with a lag its lead."""
    return led(flat_of_row(i, measured.flat), lag, i, carried)


@none_without
def write_behind(behind, i, places):
    """Store the vehicle behind a lead in row i of (N, 3, 3)."""
    write3(places[i, 0], behind.r)
    write3(places[i, 1], behind.a)
    write3(places[i, 2], behind.j)


@none_without
def behind_rows(lag, places):
    """The vehicles behind their leads."""
    return BehindRows(places, lag)


@same_without
def later(time, lag):
    """When bodies are where the lead has them: by the lag later than for the vehicle."""
    return time + lag


@inline_kernel
def predicted(x, pending, period):
    """The flat state when every answer that is on its way, (d, 3), has been flown."""
    for answer in range(pending.shape[0]):
        x = flown(x, vector(pending[answer]), period)
    return x


@kernel
def look_ahead(measured, delay, lag, held, tubes):
    """Put down every row, or its lead, as it will be when the answer is flown, and its stop before that."""
    center, velocity, period = measured.bodies.center, measured.bodies.velocity, held.settings[0]["period"]
    for i in range(measured.flat.shape[0]):
        if tubes.late[i] != 0.0:
            shift_stop(held.rows.plans[i], period, tubes.late[i])
        carry(lag, i, tubes.carried)
        x = predicted(front_of_row(i, measured, lag, tubes.carried), tubes.pending[i], period)
        write_flat(tubes.flats[i], x)
        write_behind(behind_of(x), i, tubes.behind)
        for k in range(center.shape[1]):
            ahead = later(delay * period, lag)
            write3(tubes.centers[i, k], combined(triple(center, i, k), ahead, triple(velocity, i, k)))
        tubes.before[i] = held.rows.plans[i]


@inline_kernel
def send(snap, pending):
    """Put the answer behind those that are on their way, the first of which has been flown."""
    last = pending.shape[0] - 1
    for answer in range(last):
        write3(pending[answer], vector(pending[answer + 1]))
    if last >= 0:
        write3(pending[last], vector(snap))


@kernel
def is_way_clear(i, x, bodies, tubes, error, times):
    """Whether what is on its way to row i keeps clear of the bodies; ``times``: the period and the lag.

    Where all of it was certified, no point of its path may lie in a body by more than errors do. Before that
    the path must be clear for sure.
    """
    own, delay, (period, lag) = bodies_of_row(i, bodies), tubes.pending.shape[1], times
    is_chained, keep_out = tubes.chains[i] >= delay, np.zeros(own.keep_out.shape[0])
    for k in range(keep_out.shape[0]):
        radius = own.keep_out[k]
        if is_there(entry_at(own.cores, k), radius):
            keep_out[k] = max(radius - error, 0.0) if is_chained else radius + error
    kept = MovingBodies(own.center, own.velocity, keep_out, own.cores)
    for answer in range(delay):
        snap, start = triple(tubes.pending, i, answer), later(answer * period, lag)
        found = look_at_arc(x, snap, start, period, kept, ANY_THRUST)
        if found == HIT or (found != CLEAR and not is_chained):
            return False
        x = flown(x, snap, period)
    return True
