"""The loops over the rows of a world among bodies of any kind, at rest or moving; see ``batches``.

``body_memory`` is the memory of ``quadsafe_env.tasks.scene_bodies.SceneBodies``.
"""

import numpy as np

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, new_block
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_core.kernels.vec3 import scale, subtract
from quadsafe_core.shapes.distance import nearest_point, signed_distance
from quadsafe_env.simulation.batches import begin_row, load_lanes
from quadsafe_env.simulation.block import block_of
from quadsafe_env.simulation.bodies import (
    around_of,
    close_period_among,
    close_step_among,
    columns_among,
    fly_among,
    open_around,
)
from quadsafe_env.simulation.episode import store_table
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import FLAGS, rows_in
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, comes_after, distance_to
from quadsafe_env.tasks.reward import (
    OWN_ENTRIES,
    SPHERE_ENTRIES,
    SURFACE_ENTRIES,
    own_entries,
    sphere_entries,
    surface_entries,
)
from quadsafe_env.tasks.scene_bodies import bodies_in, from_center, gap_of, least_gap
from quadsafe_env.tasks.scene_columns import columns_in, point
from quadsafe_env.tasks.way import begin_way, target_of
from quadsafe_env.vehicle.state import STATE_SIZE, load


@kernel
def advance_among(numbers, rotors, closes, memory, scene_memory, body_memory, snap):
    """Hold snaps and yaw accelerations for a control period, as ``advance_batch``; nothing is observed."""
    plant, rows = unraveled(numbers, Plant), rows_in(borrowed(memory))
    scenes, around = columns_among(scene_memory, body_memory), around_of(scene_memory, body_memory)
    block, gaps, flag_block = block_of(I(0)), new_block(I(1)), new_block(I(FLAGS))
    for first in range(0, snap.shape[0], LANES):
        count = min(LANES, snap.shape[0] - first)
        load_lanes(block, first, count, rows, scenes, snap, plant.yaw)
        open_around(around, block, count)
        fly_among(block, first, count, plant, rotors, around)
        close_period_among(block, gaps, first, count, around, plant, rows)
        if closes:
            close_step_among(block, (gaps, flag_block), first, count, around, plant, rows)
        store_table(block, first, rows.table)


@kernel
def begin_among(indices, memory, scene_memory, body_memory):
    """What is told of rows whose episode begins, among bodies that begin where the scene has them."""
    rows, bodies, m = rows_in(memory), bodies_in(scene_memory, body_memory), memory.shape[1]
    goals = columns_in(scene_memory).goal
    for row in indices:
        bodies.center[row] = bodies.home[row]
        at = STATE_SIZE * row
        r = (rows.state[at], rows.state[at + 1], rows.state[at + 2])
        begin_way(bodies.openings[row], r)
        distance = distance_to(r[0], r[1], r[2], target_of(bodies.openings[row], point(goals, row)))
        begin_row(rows, row, m, distance, least_gap(bodies, row, r))


@inline_kernel
def center_entries(bodies, row, k, r):
    """Entries of a body as if of a sphere: about the point of its core that is nearest to r."""
    x = from_center(bodies, row, k, r, 0.0)
    nearest = nearest_point(bodies.core[row, k], bodies.numbers, x)
    return sphere_entries(subtract(nearest, x), bodies.radius[row, k], True)


@inline_kernel
def outline_entries(bodies, row, k, r):
    """Entries of the point of a body's keep-out surface that is nearest to r."""
    x = from_center(bodies, row, k, r, 0.0)
    d, n = signed_distance(bodies.core[row, k], bodies.numbers, x)
    return surface_entries(scale(bodies.radius[row, k] - d, n), n)


@kernel
def next_nearest(gaps, last):
    """The nearest body after the last one in the order of gaps; −1 when there is none."""
    best, least = -1, NO_OBSTACLE
    for k in range(gaps.size):
        is_after = last < 0 or comes_after(gaps[k], k, gaps[last], last)
        if is_after and gaps[k] < least:
            best, least = k, gaps[k]
    return best


@inline_kernel
def write_own(s, goal, params, seen):
    """The vehicle's own entries of an observation."""
    triples = own_entries(s, goal, params)
    for i in range(5):
        for axis in range(3):
            seen[3 * i + axis] = triples[i][axis]


@inline_kernel
def observe_among(entries_of, size, indices, numbers, states, places, observations):
    """As ``observe_rows``, among bodies, which have so many entries each."""
    params, (scene_memory, body_memory) = unraveled(numbers, Plant).params, places
    bodies, goals = bodies_in(scene_memory, body_memory), columns_in(scene_memory).goal
    gaps = np.empty(bodies.radius.shape[1])
    for row in indices:
        s, seen = load(states[row]), observations[row]
        r = (s[0], s[1], s[2])
        write_own(s, target_of(bodies.openings[row], point(goals, row)), params, seen)
        seen[OWN_ENTRIES:] = 0.0
        for k in range(gaps.size):
            gaps[k] = gap_of(bodies, row, k, r, 0.0)
        at, k = OWN_ENTRIES, next_nearest(gaps, -1)
        while at < seen.size and k >= 0:
            entries = entries_of(bodies, row, k, r)
            for i in range(size):
                seen[at + i] = entries[i]
            at, k = at + size, next_nearest(gaps, k)


@kernel
def observe_centers(indices, numbers, states, scene_memory, body_memory, observations):
    """``observe_among`` in the layout "spheres"."""
    observe_among(
        center_entries,
        I(SPHERE_ENTRIES),
        indices,
        numbers,
        states,
        (scene_memory, body_memory),
        observations,
    )


@kernel
def observe_outlines(indices, numbers, states, scene_memory, body_memory, observations):
    """``observe_among`` in the layout "surfaces"."""
    observe_among(
        outline_entries,
        I(SURFACE_ENTRIES),
        indices,
        numbers,
        states,
        (scene_memory, body_memory),
        observations,
    )
