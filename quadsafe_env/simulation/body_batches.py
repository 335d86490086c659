"""The loops over the rows of a world among bodies of any kind, at rest or moving; see ``batches``.

``body_memory`` is the memory of ``quadsafe_env.tasks.scene_bodies.SceneBodies``.
"""

import math

import numpy as np

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, new_block
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_core.kernels.vec3 import dot, scale, vector, write3
from quadsafe_env.simulation.batches import begin_row, load_lanes
from quadsafe_env.simulation.block import block_of
from quadsafe_env.simulation.bodies import (
    around_of,
    close_period_among,
    close_step_among,
    columns_among,
    fly_among,
    open_around,
    way_since,
)
from quadsafe_env.simulation.episode import store_told
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import rows_in
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, distance_to
from quadsafe_env.tasks.reward import (
    OWN_ENTRIES,
    SPHERE_ENTRIES,
    SURFACE_ENTRIES,
    own_entries,
    sphere_entries,
    surface_entries,
)
from quadsafe_env.tasks.scene_bodies import bodies_in, least_gap, sight_of
from quadsafe_env.tasks.scene_columns import columns_in, point
from quadsafe_env.tasks.way import begin_way, target_of
from quadsafe_env.vehicle.state import STATE_SIZE, load


@kernel
def advance_among(numbers, rotors, closes, memory, scene_memory, body_memory, snap):
    """Hold snaps and yaw accelerations for a control period, as ``advance_batch``; nothing is observed."""
    plant, rows = unraveled(numbers, Plant), rows_in(borrowed(memory))
    scenes, around = columns_among(scene_memory, body_memory), around_of(scene_memory, body_memory)
    block, gaps = block_of(I(0)), new_block(I(1))
    for first in range(0, snap.shape[0], LANES):
        count = min(LANES, snap.shape[0] - first)
        load_lanes(block, first, count, rows, scenes, snap, plant.yaw)
        open_around(around, count)
        fly_among(block, first, count, plant, rotors, around)
        close_period_among(block, gaps, first, count, around, plant, rows)
        if closes:
            close_step_among(block, gaps, first, count, around, plant)
        store_told(block, first, count, closes, rows)


@kernel
def begin_among(indices, memory, scene_memory, body_memory):
    """What is told of rows whose episode begins, among bodies that begin where the scene has them."""
    rows, bodies = rows_in(memory), bodies_in(scene_memory, body_memory)
    goals = columns_in(scene_memory).goal
    for row in indices:
        bodies.center[row], bodies.bound[row] = bodies.home[row], -math.inf
        at = STATE_SIZE * row
        r = (rows.state[at], rows.state[at + 1], rows.state[at + 2])
        begin_way(bodies.openings[row], r)
        distance = distance_to(r[0], r[1], r[2], target_of(bodies.openings[row], point(goals, row)))
        begin_row(rows, row, distance, least_gap(bodies, row, r))


@inline_kernel
def center_entries(gap, n, radius):
    """Entries of a body as if of a sphere: about the point of its core that is nearest."""
    return sphere_entries(scale(-max(gap + radius, 0.0), n), radius, True)


@inline_kernel
def outline_entries(gap, n, radius):
    """Entries of the nearest point of a body's keep-out surface."""
    return surface_entries(gap, n)


@kernel
def nearest_left(bodies, row, r, bound, normals):
    """The nearest body not given yet, −1 when there is none, and its distance, m; its normal is written.

    ``bound`` (K,) is below its distance where a normal is 0, and else the distance.
    """
    while True:
        best = 0
        for k in range(1, bound.size):
            best = k if bound[k] < bound[best] else best
        if bound.size == 0 or bound[best] == NO_OBSTACLE:
            return -1, NO_OBSTACLE
        n, gap = normals[best], bound[best]
        if dot(n, n) > 0.0:
            bound[best] = NO_OBSTACLE
            return best, gap
        bound[best], found = sight_of(bodies, row, best, r, 0.0)
        write3(n, found)


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
    bound = np.empty(bodies.radius.shape[1])
    normals = np.empty((bound.size, 3))
    for row in indices:
        s, seen = load(states[row]), observations[row]
        r = (s[0], s[1], s[2])
        write_own(s, target_of(bodies.openings[row], point(goals, row)), params, seen)
        seen[OWN_ENTRIES:], normals[:] = 0.0, 0.0
        way = way_since(bodies.seen[row], r)
        for k in range(bound.size):
            bound[k] = bodies.bound[row, k] - way
        for at in range(OWN_ENTRIES, seen.size, size):
            k, gap = nearest_left(bodies, row, r, bound, normals)
            if k < 0:
                break
            entries = entries_of(gap, vector(normals[k]), bodies.radius[row, k])
            for i in range(size):
                seen[at + i] = entries[i]


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
