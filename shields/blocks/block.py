"""Sixteen vehicles side by side, where nothing has to be corrected: quick, and what ``sampled_row`` answers.

Most rows of a period are the same work: a direction for each sphere along which the snap is uncut, and a stop
after it with one plane for each sphere. Here this is done in vector lanes, without branches, as by
``sampled_row``: a *calm* row gets its answer bit for bit. Any other row is left to ``sampled_row``, which takes
what was found for single spheres, and for the stop.

| lines     | of a lane                                                                        |
|-----------|----------------------------------------------------------------------------------|
| 0:12      | flat state                                                                       |
| 12:15     | desired snap                                                                     |
| 15        | length of a segment of the stop, s                                               |
| 16        | 1 while the row is calm, else 0                                                  |
| 17        | least set value so far                                                           |
| 18:30     | flat state after the period                                                      |
| 30:38     | the first lines of the sphere that is looked at                                  |
| 38        | 1 where the line of sight to it is cut                                           |
| 39:45     | the last lines of it                                                             |
| 45        | 1 where the stop is sure to keep every limit                                     |
| 46 + 10k  | of sphere k: centre, radius (0: absent), last direction, and 1 if it is at rest; |
|           | in place of the last four when it was looked at: direction, ``n·u`` along it, 1  |
|           | where the snap is admitted, set value                                            |

Only spheres at rest, and only limits of snap, jerk and thrust: what there is beyond that is never calm.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, new_block, store_triple, to_lanes
from quadsafe_core.kernels.vec3 import triple, vector
from shields.backup.stored_stop import NOTHING, periods_of
from shields.chains.flat_state import Flat
from shields.interface.row_checks import is_finite

NO_SNAP = (math.nan, math.nan, math.nan)
SNAP, LENGTH, CALM, VALUE, AFTER, SEEN, CUT, FOUND, STOPS, SPHERES = 12, 15, 16, 17, 18, 30, 38, 39, 45, 46
PER_SPHERE, FIRST, LAST = 10, 8, 6
# Among the lines that were found of a sphere, after its direction.
ALONG, ADMITTED, SET_VALUE = 3, 4, 5


@inline_kernel
def block_for(spheres):
    """Memory for sixteen rows among so many spheres."""
    return new_block(SPHERES + PER_SPHERE * spheres)


@inline_kernel
def sphere_at(k):
    """Where the lines of sphere k begin."""
    return U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k


@inline_kernel
def lane_flat(block, i):
    """The flat state whose lines begin at a place."""
    return Flat(
        lane_triple(block, i),
        lane_triple(block, i + U(LANES * 3)),
        lane_triple(block, i + U(LANES * 6)),
        lane_triple(block, i + U(LANES * 9)),
    )


@inline_kernel
def store_lane_flat(block, i, x):
    """Write a flat state into lines from a place on."""
    store_triple(block, i, x.r)
    store_triple(block, i + U(LANES * 3), x.v)
    store_triple(block, i + U(LANES * 6), x.a)
    store_triple(block, i + U(LANES * 9), x.j)


@kernel
def fill(block, first, count, measured, remembered, period):
    """Rows first … first + count as they are measured; no set value so far, all of them calm."""
    to_lanes(measured.flat.reshape(-1), 12, first, count, block, I(0))
    for i in range(count):
        row = first + i
        snap = vector(measured.snap[row])
        # NaN for an infinity too: both fail every test, NaN without a warning where it is interpreted.
        store_triple(block, U(LANES * SNAP + i), snap if is_finite(snap) else NO_SNAP)
        block[LANES * LENGTH + i] = periods_of(int(remembered.plans[row]["choice"]), period) * period
        block[LANES * CALM + i], block[LANES * VALUE + i], block[LANES * STOPS + i] = 1.0, math.inf, 1.0
    fill_spheres(block, first, count, measured, remembered.half_spaces)


@inline_kernel
def fill_spheres(block, first, count, measured, half_spaces):
    """The spheres of rows first … first + count; one that moves is left to ``sampled_row``, and the stop.

    So is every sphere of a row whose desired snap is not finite: there another snap takes its place.
    """
    bodies = measured.bodies
    for k in range(bodies.radius.shape[1]):
        at = LANES * (SPHERES + PER_SPHERE * k)
        for i in range(count):
            row = first + i
            x, y, z = triple(bodies.center, row, k)
            block[at + i], block[at + LANES + i], block[at + 2 * LANES + i] = x, y, z
            block[at + 3 * LANES + i] = bodies.radius[row, k]
            n = half_spaces[row, k]["n"]
            block[at + 4 * LANES + i], block[at + 5 * LANES + i], block[at + 6 * LANES + i] = n[0], n[1], n[2]
            is_still = triple(bodies.velocity, row, k) == NOTHING
            block[at + 7 * LANES + i] = 1.0 if is_still and is_finite(vector(measured.snap[row])) else 0.0
            if not is_still:
                block[LANES * STOPS + i] = 0.0


@inline_kernel
def copy_lines(block, source, target, lines):
    """Copy lines from one place to another.

    A loop over lanes that reads at a place known only when it runs, and writes elsewhere, is not vectorised.
    """
    for i in range(U(LANES) * U(lines)):
        block[target + i] = block[source + i]


@inline_kernel
def is_taken(found, k, half_space, fact):
    """Whether sphere k of a lane is settled; what was found of it is then written down.

    ``found``: the block, the lane, and whether its block was looked at; or None.
    """
    if found is None:
        return False
    block, i, is_looked_at = found
    if not is_looked_at:
        return False
    at = LANES * (SPHERES + PER_SPHERE * k + FIRST - 4) + i
    if not block[at + LANES * ADMITTED] > 0.0:
        return False
    n = half_space["n"]
    n[0], n[1], n[2] = block[at], block[at + LANES], block[at + 2 * LANES]
    half_space["least"] = block[at + LANES * ALONG]
    fact["value"] = min(fact["value"], block[at + LANES * SET_VALUE])
    return True
