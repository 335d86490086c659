"""Sixteen rows among bodies of any kind: how near the lanes of a block come to them, step by step.

A body is measured where it may be nearer than what is nearest so far in the period, and exactly then. Since it
was measured last, its distance has changed by no more than the way that the vehicle and the body have gone.
"""

from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, from_lanes, lane_triple, new_block, store_triple
from quadsafe_core.kernels.vec3 import norm, vector, write3
from quadsafe_env.simulation.block import (
    CLEARANCE,
    DISTANCE,
    GOAL,
    HELD,
    IS_FLYING,
    LONGEST,
    MARKS,
    TABLE,
    fly_with_care,
)
from quadsafe_env.simulation.episode import close_lanes, record_period
from quadsafe_env.tasks.obstacles import NO_OBSTACLE
from quadsafe_env.tasks.scene_bodies import Bodies, bodies_in, gap_of, least_gap
from quadsafe_env.tasks.scene_columns import SceneColumns, columns_in
from quadsafe_env.tasks.way import go_on, next_opening
from quadsafe_env.vehicle.state import STATE_SIZE

# Lines of a lane: the least distance in the period, m, and its steps.
LEAST, STEPS = 0, 1
# Bounds are that much lower: far more than rounding is for positions up to 1e9 m.
SLACK = 1e-6  # m


class Around(NamedTuple):
    """Bodies around the rows of a block, and its lines."""

    bodies: Bodies
    lines: np.ndarray


@inline_kernel
def columns_among(scene_memory, body_memory):
    """The columns of the scenes, without spheres for blocks where there are bodies."""
    scenes = columns_in(borrowed(scene_memory))
    if body_memory is None:
        return scenes
    return SceneColumns(0, scenes.start, scenes.goal, scenes.center, scenes.radius)


@inline_kernel
def around_of(scene_memory, body_memory):
    """The bodies around a block; None among spheres at rest."""
    if body_memory is None:
        return None
    return Around(bodies_in(scene_memory, body_memory), new_block(I(2)))


@inline_kernel
def open_around(around, count):
    """Begin a period of the lanes."""
    if around is None:
        return
    lines = around.lines
    for i in range(U(count)):
        lines[i + U(LANES * LEAST)], lines[i + U(LANES * STEPS)] = NO_OBSTACLE, 0.0


@inline_kernel
def way_since(seen, r):
    """From where a row was seen last, m."""
    return norm((r[0] - seen[0], r[1] - seen[1], r[2] - seen[2]))


@kernel
def meet_bodies(around, row, i, r, dt):
    """Keep the least distance after a physics step of ``dt``, s, that brought lane i, a row, to r."""
    if around is None:
        return
    bodies, lines = around.bodies, around.lines
    bound, seen = bodies.bound[row], bodies.seen[row]
    way, steps, k = way_since(seen, r), lines[LANES * STEPS + i] + 1.0, int(seen[3])
    least = lines[LANES * LEAST + i]
    for _ in range(bound.size):
        k = k + 1 if k + 1 < bound.size else 0
        v = bodies.velocity[row, k]
        bound[k] -= way + dt * (abs(v[0]) + abs(v[1]) + abs(v[2]))
        if bound[k] <= least:
            gap = gap_of(bodies, row, k, r, steps * dt)
            bound[k] = gap - SLACK
            # The one that is asked first next time.
            seen[3] = k - 1 if gap < least else seen[3]
            least = min(least, gap)
    write3(seen, r)
    lines[LANES * LEAST + i], lines[LANES * STEPS + i] = least, steps


@kernel
def move_bodies(around, row, i, dt):
    """Put the bodies of a row where they are after the steps of its lane."""
    bodies, lines = around.bodies, around.lines
    time = dt * lines[LANES * STEPS + i]
    for k in range(bodies.radius.shape[1]):
        c, v = bodies.center[row, k], bodies.velocity[row, k]
        for axis in range(3):
            c[axis] += time * v[axis]


@inline_kernel
def fly_among(block, first, count, plant, rotors, around):
    """Hold snap and yaw acceleration for a control period; what crashes stays, and its bodies with it."""
    for _ in range(plant.substeps):
        fly_with_care(block, count, I(0), I(1), plant, rotors)
        for i in range(count):
            if block[LANES * (MARKS + IS_FLYING) + i] > 0.0:
                meet_bodies(around, first + i, i, lane_triple(block, U(i)), plant.dt)


@kernel
def follow_way(block, i, openings):
    """Lane i on its way: what is next is what it is paid to near; until that is the goal it has not arrived."""
    if openings.size == 0:
        return
    block[LANES * (TABLE + DISTANCE) + i] += go_on(openings, lane_triple(block, U(i)))
    g = next_opening(openings)
    if g < openings.size:
        store_triple(block, U(LANES * GOAL + i), vector(openings[g]["center"]))
        block[LANES * HELD + i], block[LANES * LONGEST + i] = 0.0, 0.0


@inline_kernel
def close_period_among(block, gaps, first, count, around, plant, rows):
    """As ``close_period``, among bodies: they too are then where they are after it."""
    from_lanes(block, I(0), rows.state, I(STATE_SIZE), first, count)
    for i in range(count):
        follow_way(block, i, around.bodies.openings[first + i])
    for i in range(U(count)):
        gaps[i] = around.lines[i + U(LANES * LEAST)]
    record_period(block, gaps, count, plant.dt)
    for i in range(count):
        move_bodies(around, first + i, i, plant.dt)


@inline_kernel
def close_step_among(block, gaps, first, count, around, plant):
    """As ``close_step``, among bodies; only of a row that did not move the present distance is asked for."""
    for i in range(count):
        if block[LANES * (TABLE + CLEARANCE) + i] == NO_OBSTACLE:
            gaps[i] = least_gap(around.bodies, first + i, lane_triple(block, U(i)))
    close_lanes(block, gaps, count, plant)
