"""Sixteen rows of a world in lanes: how they are laid out, flown, measured against spheres, and observed.

| entries   | of a lane                                                              |
|-----------|------------------------------------------------------------------------|
| 0:20      | state                                                                  |
| 20:23, 23 | snap and yaw acceleration that are held                                |
| 24:27     | goal                                                                   |
| 27        | longest time at the goal in the period, s                              |
| 28        | least thrust in the period, N                                          |
| 29:46     | what is told of the row: five numbers and twelve flags, 0 or 1         |
| 46 + 5k   | of sphere k: centre, keep-out radius, and least squared distance in    |
|           | the period, from ``measure_gaps`` on the distance to its surface       |

Of a block are flown the lanes ``0:count``, rows ``first … first + count`` of a world; ``spheres`` is the number
K, ``plant`` a ``Plant``, ``rotors`` the fields of ``Rotors`` or None. Gaps are a line of sixteen numbers, m.
"""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, new_block, store_triple, wide_vectors
from quadsafe_core.kernels.vec3 import subtract
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, comes_after, squared_distance
from quadsafe_env.tasks.reward import OWN_ENTRIES, SPHERE_ENTRIES, held_time, own_entries, sphere_entries
from quadsafe_env.vehicle.inner_loop import held_wrench
from quadsafe_env.vehicle.rotors import limited_step
from quadsafe_env.vehicle.state import LARGEST, STATE_SIZE, THRUST, lane_state, store_lane

# Numbers of the last policy step, then of the episode.
REWARD, CLEARANCE, EFFORT, TIME_AT_GOAL, DISTANCE = range(5)
NUMBERS = 5
# Flags, whose lines stand behind those of the numbers. The first eight are told of a policy step, and of these
# the first four are found where it closes.
TERMINATED, IS_SUCCESS, VIOLATION, OUT_OF_BOUNDS, CRASH, INVALID, SATURATED, SPINNING = range(8)
HAS_ARRIVED, HAS_VIOLATED, ARRIVES, IS_FLYING = range(8, 12)
FOUND_LAST, TOLD_FLAGS, FLAGS = 4, 8, 12

SNAP = STATE_SIZE
YAW = SNAP + 3
GOAL = YAW + 1
LONGEST = GOAL + 3
LEAST_THRUST = LONGEST + 1
TABLE = LEAST_THRUST + 1
MARKS = TABLE + NUMBERS
HELD, CLIPPED = TABLE + TIME_AT_GOAL, MARKS + SATURATED
SPHERES = MARKS + FLAGS
PER_SPHERE = 5


@inline_kernel
def block_of(spheres):
    """Memory for sixteen rows among so many spheres."""
    return new_block(SPHERES + PER_SPHERE * spheres)


@inline_kernel
def sphere_at(k):
    """Where the entries of sphere k begin."""
    return U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k


@inline_kernel
def fill_spheres(block, first, count, scenes):
    """The spheres of rows first … first + count; no distance to them so far."""
    spheres = U(scenes.sphere_count)
    for k in range(spheres):
        at, place = sphere_at(k), U(first) * spheres + k
        for i in range(U(count)):
            block[at + i] = scenes.center[U(3) * place]
            block[at + i + U(LANES)] = scenes.center[U(3) * place + U(1)]
            block[at + i + U(2 * LANES)] = scenes.center[U(3) * place + U(2)]
            block[at + i + U(LANES * 3)], block[at + i + U(LANES * 4)] = scenes.radius[place], math.inf
            place += spheres


@kernel
def fly(block, count, spheres, substeps, plant, rotors):
    """Hold snap and yaw acceleration for ``substeps`` RK4 steps in every lane, whatever becomes of it."""
    wide_vectors()
    params, dt = plant.params, plant.dt
    for _ in range(substeps):
        for i in range(U(count)):
            s = lane_state(block, i)
            wrench = held_wrench(
                s, lane_triple(block, i + U(LANES * SNAP)), block[i + U(LANES * YAW)], params, dt
            )
            s, is_clipped = limited_step(s, wrench, params, rotors, dt)
            store_lane(block, i, s)
            squared = squared_distance(s[0], s[1], s[2], lane_triple(block, i + U(LANES * GOAL)))
            held = held_time(block[i + U(LANES * HELD)], squared, dt)
            block[i + U(LANES * HELD)] = held
            block[i + U(LANES * LONGEST)] = max(block[i + U(LANES * LONGEST)], held)
            block[i + U(LANES * LEAST_THRUST)] = min(block[i + U(LANES * LEAST_THRUST)], s[THRUST])
            block[i + U(LANES * CLIPPED)] = 1.0 if is_clipped else block[i + U(LANES * CLIPPED)]
        approach(block, count, spheres)


@inline_kernel
def approach(block, count, spheres):
    """Keep the least squared distance to each sphere."""
    for k in range(U(spheres)):
        at = sphere_at(k)
        for i in range(U(count)):
            squared = squared_distance(
                block[i], block[i + U(LANES)], block[i + U(2 * LANES)], lane_triple(block, at + i)
            )
            block[at + i + U(LANES * 4)] = min(block[at + i + U(LANES * 4)], squared)


@inline_kernel
def is_sound(block, i, thrust_min):
    """Not grown beyond a flight, and the thrust always above the floor of the flat map."""
    s = lane_state(block, i)
    total = s[0] + s[1] + s[2] + s[3] + s[4] + s[5] + s[6] + s[7] + s[8] + s[9]
    total += s[10] + s[11] + s[12] + s[13] + s[14] + s[15] + s[16] + s[17] + s[18] + s[19]
    return (abs(total) < LARGEST) & (block[i + U(LANES * LEAST_THRUST)] > thrust_min)


@inline_kernel
def are_sound(block, count, thrust_min):
    """Whether every lane is flying, and sound."""
    others = 0
    for i in range(U(count)):
        is_flying = block[i + U(LANES * (MARKS + IS_FLYING))] > 0.0
        others += 0 if is_sound(block, i, thrust_min) & is_flying else 1
    return others == 0


@kernel
def fly_with_care(block, count, spheres, substeps, plant, rotors):
    """As ``fly``, substep by substep: a lane that crashes, or is not flying, stays in its last sound state."""
    before = np.empty_like(block)
    for _ in range(substeps):
        for k in range(block.size):
            before[k] = block[k]
        fly(block, count, spheres, I(1), plant, rotors)
        for i in range(count):
            is_flying = before[LANES * (MARKS + IS_FLYING) + i] > 0.0
            if is_flying and is_sound(block, U(i), plant.params.thrust_min):
                continue
            if is_flying:
                before[LANES * (MARKS + IS_FLYING) + i], before[LANES * (MARKS + CRASH) + i] = 0.0, 1.0
                before[LANES * CLIPPED + i] = block[LANES * CLIPPED + i]
            for k in range(i, block.size, LANES):
                block[k] = before[k]


@inline_kernel
def measure_gaps(block, count, spheres, out):
    """Distances to the keep-out surfaces in place of their squares; the least of each lane into ``out``."""
    for i in range(U(count)):
        out[i] = NO_OBSTACLE
    for k in range(U(spheres)):
        at = sphere_at(k)
        for i in range(U(count)):
            radius = block[at + i + U(LANES * 3)]
            gap = math.sqrt(block[at + i + U(LANES * 4)]) - radius
            gap = gap if radius > 0.0 else NO_OBSTACLE
            block[at + i + U(LANES * 4)] = gap
            out[i] = min(out[i], gap)


@inline_kernel
def measure_here(block, count, spheres, out):
    """Distances to the keep-out surfaces from the present positions, and the least of each lane."""
    for k in range(spheres):
        at = LANES * (SPHERES + PER_SPHERE * k + 4)
        block[at : at + LANES] = math.inf
    approach(block, count, spheres)
    measure_gaps(block, count, spheres, out)


@inline_kernel
def observe(block, count, spheres, slots, params, seen):
    """Observations of the lanes into the block ``seen``; the gaps of the spheres must be present ones.

    Behind the observation ``seen`` has eight entries to search with: gap and index of the last sphere, gap,
    index, centre and radius of the next one.
    """
    last = U(LANES * OWN_ENTRIES) + U(LANES * SPHERE_ENTRIES) * U(slots)
    best = last + U(2 * LANES)
    for i in range(U(count)):
        s, goal = lane_state(block, i), lane_triple(block, i + U(LANES * GOAL))
        goal_way, v, a, j, yaw = own_entries(s, goal, params)
        store_triple(seen, i, goal_way)
        store_triple(seen, i + U(LANES * 3), v)
        store_triple(seen, i + U(LANES * 6), a)
        store_triple(seen, i + U(LANES * 9), j)
        store_triple(seen, i + U(LANES * 12), yaw)
    for i in range(U(count)):
        seen[last + i], seen[last + i + U(LANES)] = -NO_OBSTACLE, -1.0
    for slot in range(U(slots)):
        find_next(block, count, spheres, seen, last, best)
        at = U(LANES * OWN_ENTRIES) + U(LANES * SPHERE_ENTRIES) * slot
        for i in range(U(count)):
            seen[last + i], seen[last + i + U(LANES)] = seen[best + i], seen[best + i + U(LANES)]
            way = subtract(lane_triple(seen, best + i + U(LANES * 2)), lane_triple(block, i))
            is_there = seen[best + i + U(LANES)] >= 0.0
            x, y, z, size, presence = sphere_entries(way, seen[best + i + U(LANES * 5)], is_there)
            store_triple(seen, at + i, (x, y, z))
            seen[at + i + U(LANES * 3)], seen[at + i + U(LANES * 4)] = size, presence


@inline_kernel
def chosen(is_first, a, b):
    """One of two triples."""
    return (a[0] if is_first else b[0], a[1] if is_first else b[1], a[2] if is_first else b[2])


@inline_kernel
def find_next(block, count, spheres, seen, last, best):
    """Gap, index, centre and radius of the nearest sphere after the last one; index −1 when there is none."""
    for i in range(U(count)):
        seen[best + i], seen[best + i + U(LANES)] = NO_OBSTACLE, -1.0
    for k in range(U(spheres)):
        at, index = sphere_at(k), float(k)
        for i in range(U(count)):
            gap, gap_before = block[at + i + U(LANES * 4)], seen[best + i]
            is_next = comes_after(gap, index, seen[last + i], seen[last + i + U(LANES)]) & (gap < gap_before)
            x, y, z = lane_triple(block, at + i)
            kept, rest = lane_triple(seen, best + i), lane_triple(seen, best + i + U(LANES * 3))
            store_triple(seen, best + i, chosen(is_next, (gap, index, x), kept))
            others = (y, z, block[at + i + U(LANES * 3)])
            store_triple(seen, best + i + U(LANES * 3), chosen(is_next, others, rest))
