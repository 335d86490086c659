"""Which of many bodies matter to a vehicle whose snap is not refused: those within reach.

In a period and the stop after it a vehicle stays within S of where it is, and its distance from a body at rest
falls by no more than D before ū has turned it, by (8) in the worst of all directions, whatever snap up to w:

    D = −g_4(−(‖j‖ + (ū + w)Δ), −‖a‖, −‖v‖, 0),   t_star = T                                             (W1)

A body at rest that is farther away than 3 S, than D + (ū + w) Δ T³ / 6γ, and than the easing reaches, asks
for nothing: along the line of sight the snap is admitted, and one plane keeps the stop away. Its set value is
no less than its distance less D, and so not the least where another distance is less than that. The proof is
in ``docs/theory/reach.md``.

Of a body that is not looked at the gap from its centre is kept, and made a direction when that is needed.
"""

import math
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.borrow import one_row
from quadsafe_core.kernels.choice import entry_at, none_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import dot, norm, subtract, triple, vector, write3
from quadsafe_core.shapes.cores import CORE, HALF_SPACE, Cores, axis_of, halves
from shields.backup.stop_hull import POSITION
from shields.backup.stored_stop import NOTHING
from shields.chains.lower_bound import lower4
from shields.filters.easing import REACH
from shields.interface.bodies import is_there, look_at, widened
from shields.interface.records import Bodies, velocity_of
from shields.methods.memory import HALF_SPACE as REMEMBERED

# In place of the least input along a direction: the direction is a gap, from the centre of a body, m.
UNSEEN = -math.inf
# What a reach is made longer by, as a share and in m, and its rounding, of the positions.
SLACK, LEAST_SLACK, ROUNDING = 1.01, 1e-6, 1e-12
# The largest weights of v h, a h² and j h³ in the control points of a stop.
FARTHEST = tuple(float(weight) for weight in np.abs(POSITION).max(axis=0))


class Near(NamedTuple):
    """Room for the bodies of one vehicle that are within reach, and how far all of them are.

    Which they are (C), their centres, velocities, radii and cores, what is remembered of them (C)
    ``HALF_SPACE``; the least distance of each body (K), m, beyond what is to be kept.
    """

    index: np.ndarray
    center: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    cores: Cores | None
    half_spaces: np.ndarray
    apart: np.ndarray


@none_without
def room_for_cores(cores, count):
    """Room for so many cores of the same hulls."""
    return Cores(np.empty(count, dtype=CORE), cores.numbers)


@kernel
def room_among(bodies):
    """``Near`` for half of the bodies: where more are within reach, there is nothing to gain."""
    places = bodies.radius.shape[1]
    count = places // 2
    cores, index = room_for_cores(bodies.cores, count), np.empty(count, dtype=np.int64)
    center, velocity = np.empty((count, 3)), np.empty((count, 3))
    return Near(
        index, center, velocity, np.empty(count), cores, np.empty(count, dtype=REMEMBERED), np.empty(places)
    )


@kernel
def reach_of(x, u, h, sampling):
    """D of (W1), and how near a body has to be to matter, m, to snaps up to u and a stop in segments of h."""
    u_max, t, gains = sampling.u_max, sampling.period, sampling.easing.feedback
    v, a, j = norm(x.v), norm(x.a), norm(x.j)
    push = (u_max + u) * t
    value, late = lower4(-(j + push), -a, -v, 0.0, u_max, 0.0)
    along_sight = push * late * late * late / (6.0 * sampling.gamma) - value
    at_border = REACH * u_max / gains[0] + t * (1.5 * v + t * (11 / 12 * a + t / 4 * j))
    after_v, after_a, after_j = v + t * (a + t / 2 * (j + t / 3 * u)), a + t * (j + t / 2 * u), j + t * u
    stop = h * (FARTHEST[0] * after_v + h * (FARTHEST[1] * after_a + h * FARTHEST[2] * after_j))
    stop += t * (v + t / 2 * (a + t / 3 * (j + t / 4 * u)))
    return -value, max(along_sight, at_border, 3.0 * stop, -value)


@inline_kernel
def distance_between(core, gap):
    """A distance from a core that is surely no more, and one that is surely no less, m."""
    far = norm(gap)
    if core is None:
        return far - ROUNDING * far, far
    if core[0]["kind"] == HALF_SPACE:
        height = dot(axis_of(core[0]), gap)
        return height - ROUNDING * far, height
    size = norm(halves(core[0]))
    return far - size - ROUNDING * (far + size), far + size


@kernel
def least_apart(i, x, bodies, margin, apart):
    """How far every body of row i is at least, beyond what is to be kept; how far the nearest is at most, m.

    −inf for one that moves, inf for none.
    """
    nearest = math.inf
    for k in range(apart.shape[0]):
        core, radius = entry_at(bodies.cores, (i, k)), bodies.radius[i, k]
        least, most = distance_between(core, subtract(x.r, triple(bodies.center, i, k)))
        keep, is_body = widened(core, radius, margin), is_there(core, radius)
        is_still = velocity_of(i, k, bodies) == NOTHING
        distance = least - keep - ROUNDING * keep if is_still else -math.inf
        apart[k] = distance if is_body else math.inf
        nearest = min(nearest, most - keep) if is_body else nearest
    return nearest


@kernel
def look_around(i, x, u, h, bodies, settings, near):
    """How near a body of row i has to be to matter to snaps up to u, m; the room gets how near they are."""
    drop, reach = reach_of(x, u, h, settings.sampling)
    nearest = least_apart(i, x, bodies, settings.margin, near.apart)
    size = abs(x.r[0]) + abs(x.r[1]) + abs(x.r[2])
    return SLACK * max(reach, nearest + drop) + LEAST_SLACK + ROUNDING * size


@kernel
def copy_core(cores, place, room, c):
    """Put one core into a room for them, if there are any."""
    if cores is not None:
        room.core[c] = cores.core[place]


@kernel
def last_direction(core, half_space):
    """The direction that is remembered, made of the gap where the body was not looked at."""
    # As an argument a field that is an array would be counted.
    n = half_space["n"]
    if half_space["least"] == UNSEEN:
        return look_at(core, vector(n))[1]
    return (n[0], n[1], n[2])


@kernel
def bodies_within(i, bodies, half_spaces, reach, near):
    """Put the bodies of row i that are no farther than that into the room; how many, −1 if it is too small."""
    count = 0
    for k in range(near.apart.shape[0]):
        if near.apart[k] <= reach:
            if count == near.index.shape[0]:
                return -1
            core = entry_at(bodies.cores, (i, k))
            near.index[count], near.radius[count] = k, bodies.radius[i, k]
            write3(near.center[count], triple(bodies.center, i, k))
            write3(near.velocity[count], velocity_of(i, k, bodies))
            copy_core(bodies.cores, (i, k), near.cores, count)
            n = near.half_spaces[count]["n"]
            n[0], n[1], n[2] = last_direction(core, half_spaces[i, k])
            count += 1
    return count


@none_without
def first_cores(cores, count):
    """The first cores of a room as those of a batch of one."""
    return Cores(one_row(cores.core[:count]), cores.numbers)


@kernel
def as_bodies(near, count):
    """The first bodies of the room as those of a batch of one."""
    center, velocity, radius = near.center[:count], near.velocity[:count], near.radius[:count]
    return Bodies(one_row(center), one_row(velocity), one_row(radius), first_cores(near.cores, count))


@kernel
def remember(i, x, bodies, half_spaces, reach, near):
    """Write back what was found of the bodies within reach, and the gaps of the others."""
    count = 0
    for k in range(near.apart.shape[0]):
        if near.apart[k] <= reach:
            half_spaces[i, k] = near.half_spaces[count]
            count += 1
        elif near.apart[k] < math.inf:
            n = half_spaces[i, k]["n"]
            n[0], n[1], n[2] = subtract(x.r, triple(bodies.center, i, k))
            half_spaces[i, k]["least"] = UNSEEN


@kernel
def recall_directions(i, bodies, half_spaces):
    """Turn every gap of row i into the direction it stands for."""
    for k in range(half_spaces.shape[1]):
        if half_spaces[i, k]["least"] == UNSEEN:
            n = half_spaces[i, k]["n"]
            n[0], n[1], n[2] = last_direction(entry_at(bodies.cores, (i, k)), half_spaces[i, k])
            half_spaces[i, k]["least"] = 0.0


@inline_kernel
def name_body(fact, near):
    """Name the body of the room that asked for most by its number among all."""
    if fact["obstacle"] >= 0.0:
        fact["obstacle"] = near.index[int(fact["obstacle"])]
