"""Sixteen rows of a world in lanes: how they are laid out, flown, measured against spheres, and observed.

| entries   | of a lane                                                              |
|-----------|------------------------------------------------------------------------|
| 0:20      | state                                                                  |
| 20:23, 23 | snap and yaw acceleration that are held                                |
| 24:27     | goal                                                                   |
| 27, 28    | time at the goal, and its largest value in the period, s               |
| 29        | least thrust in the period, N                                          |
| 30        | 1.0 once a rotor was at a stop                                         |
| 31 + 5k   | of sphere k: centre, keep-out radius, and least squared distance in    |
|           | the period, from ``measure_gaps`` on the distance to its surface       |
"""

import math

import numpy as np

from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.lanes import LANES, I, U, new_block, wide_vectors
from quadsafe_env.dynamics import axpy, derivative_kernel
from quadsafe_env.flatness import wrench_from_snap_kernel
from quadsafe_env.obstacles import NO_OBSTACLE, comes_after, squared_distance
from quadsafe_env.rotors import limited_step
from quadsafe_env.state import STATE_SIZE, THRUST, lane_state, lane_triple, store_lane, store_triple
from quadsafe_env.task import OWN_ENTRIES, SPHERE_ENTRIES, held_time, own_entries, sphere_entries

SNAP = STATE_SIZE
YAW = SNAP + 3
GOAL = YAW + 1
HELD, LONGEST = GOAL + 3, GOAL + 4
LEAST_THRUST = LONGEST + 1
CLIPPED = LEAST_THRUST + 1
SPHERES = CLIPPED + 1
PER_SPHERE = 5


@inline_kernel
def fill_spheres(block, first, count, center, radius):
    """The spheres of rows first … first + count, flat (N K 3) and (N K); no distance to them so far."""
    spheres = radius.shape[1]
    for i in range(count):
        for k in range(spheres):
            at = LANES * (SPHERES + PER_SPHERE * k) + i
            for axis in range(3):
                block[at + LANES * axis] = center[first + i, k, axis]
            block[at + LANES * 3] = radius[first + i, k]
            block[at + LANES * 4] = math.inf


@inline_kernel
def held_wrench(s, snap, yaw_acceleration, params, dt):
    """(35) at the predicted middle of the step: held over it, the snap is met to second order in dt."""
    first = wrench_from_snap_kernel(s, snap, yaw_acceleration, params)
    middle = axpy(0.5 * dt, derivative_kernel(s, first, params), s)
    return wrench_from_snap_kernel(middle, snap, yaw_acceleration, params)


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
        at = U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k
        for i in range(U(count)):
            squared = squared_distance(
                block[i], block[i + U(LANES)], block[i + U(2 * LANES)], lane_triple(block, at + i)
            )
            block[at + i + U(LANES * 4)] = min(block[at + i + U(LANES * 4)], squared)


@inline_kernel
def is_sound(block, i, thrust_min):
    """Finite, and the thrust always above the floor of the flat map."""
    s = lane_state(block, i)
    total = s[0] + s[1] + s[2] + s[3] + s[4] + s[5] + s[6] + s[7] + s[8] + s[9]
    total += s[10] + s[11] + s[12] + s[13] + s[14] + s[15] + s[16] + s[17] + s[18] + s[19]
    return (total - total == 0.0) & (block[i + U(LANES * LEAST_THRUST)] > thrust_min)


@kernel
def count_unsound(block, count, thrust_min):
    """How many lanes are not sound."""
    wide_vectors()
    unsound = 0
    for i in range(U(count)):
        unsound += 0 if is_sound(block, i, thrust_min) else 1
    return unsound


@kernel
def fly_with_care(block, count, spheres, substeps, plant, rotors, is_flying, crashes):
    """As ``fly``, substep by substep: a lane that crashes, or is not flying, stays in its last sound state."""
    before = np.empty_like(block)
    for _ in range(substeps):
        for k in range(block.size):
            before[k] = block[k]
        fly(block, count, spheres, I(1), plant, rotors)
        for i in range(count):
            if is_flying[i] and not is_sound(block, U(i), plant.params.thrust_min):
                is_flying[i], crashes[i] = False, True
                before[LANES * CLIPPED + i] = block[LANES * CLIPPED + i]
            if not is_flying[i]:
                for k in range(i, block.size, LANES):
                    block[k] = before[k]


@kernel
def measure_gaps(block, count, spheres, out):
    """Distances to the keep-out surfaces in place of their squares; the least of each lane into ``out``."""
    wide_vectors()
    for i in range(U(count)):
        out[i] = NO_OBSTACLE
    for k in range(U(spheres)):
        at = U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k
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


@kernel
def observe(block, count, spheres, params, seen):
    """Observations of the lanes into the block ``seen``; the gaps of the spheres must be present ones."""
    wide_vectors()
    for i in range(U(count)):
        goal_way, v, a, j, yaw = own_entries(
            lane_state(block, i), lane_triple(block, i + U(LANES * GOAL)), params
        )
        store_triple(seen, i, goal_way)
        store_triple(seen, i + U(LANES * 3), v)
        store_triple(seen, i + U(LANES * 6), a)
        store_triple(seen, i + U(LANES * 9), j)
        store_triple(seen, i + U(LANES * 12), yaw)
    last, best = new_block(I(2)), new_block(I(6))
    last[:LANES], last[LANES:] = -NO_OBSTACLE, -1.0
    for slot in range((seen.shape[0] // LANES - OWN_ENTRIES) // SPHERE_ENTRIES):
        find_next(block, count, spheres, last, best)
        at = U(LANES * OWN_ENTRIES) + U(LANES * SPHERE_ENTRIES) * U(slot)
        for i in range(U(count)):
            last[i], last[i + U(LANES)] = best[i], best[i + U(LANES)]
            is_there = best[i + U(LANES)] >= 0.0
            center = lane_triple(best, i + U(LANES * 2))
            between = (
                center[0] - block[i],
                center[1] - block[i + U(LANES)],
                center[2] - block[i + U(2 * LANES)],
            )
            x, y, z, size, presence = sphere_entries(between, best[i + U(LANES * 5)], is_there)
            store_triple(seen, at + i, (x, y, z))
            seen[at + i + U(LANES * 3)], seen[at + i + U(LANES * 4)] = size, presence


@inline_kernel
def chosen(is_first, a, b):
    """One of two triples."""
    return (a[0] if is_first else b[0], a[1] if is_first else b[1], a[2] if is_first else b[2])


@inline_kernel
def find_next(block, count, spheres, last, best):
    """Gap, index, centre and radius of the nearest sphere after the last one; index −1 when there is none."""
    best[:LANES], best[LANES:] = NO_OBSTACLE, -1.0
    for k in range(U(spheres)):
        at = U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k
        index = float(k)
        for i in range(U(count)):
            gap = block[at + i + U(LANES * 4)]
            is_new = comes_after(gap, index, last[i], last[i + U(LANES)]) & (gap < best[i])
            kept, new = lane_triple(best, i), lane_triple(block, at + i)
            store_triple(best, i, chosen(is_new, (gap, index, new[0]), kept))
            kept, radius = lane_triple(best, i + U(LANES * 3)), block[at + i + U(LANES * 3)]
            store_triple(best, i + U(LANES * 3), chosen(is_new, (new[1], new[2], radius), kept))
