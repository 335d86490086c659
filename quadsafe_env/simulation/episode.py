"""The episode of each row: how a control period begins, what happened in it, and the end of a policy step.

What is told of the rows is kept in lanes, block by block, see ``quadsafe_env.simulation.block``. A policy step
closes with its outcome, the lines REWARD, COST and CLEARANCE, (3, N), and with the flags below, (FLAGS, N).
Kernels are given what those of ``block`` are; ``rows`` are ``Rows``, and ``scenes`` ``SceneColumns``.
"""

import math

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import LANES, I, U, from_lanes, lane_triple, to_lanes
from quadsafe_env.simulation.block import (
    ARRIVES,
    CLEARANCE,
    COST,
    CRASH,
    DISTANCE,
    EFFORT,
    GOAL,
    HAS_ARRIVED,
    HAS_VIOLATED,
    INVALID,
    IS_FLYING,
    LEAST_THRUST,
    LINES,
    LONGEST,
    REWARD,
    SATURATED,
    SNAP,
    SPINNING,
    TABLE,
    YAW,
    fill_spheres,
    measure_gaps,
    measure_here,
)
from quadsafe_env.simulation.rows import FLAGS, OUTCOMES
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, distance_to
from quadsafe_env.tasks.reward import GOAL_HOLD, reward
from quadsafe_env.vehicle.state import OMEGA, STATE_SIZE
from quadsafe_env.vehicle.yaw import is_spinning, limited_yaw

IS_SUCCESS, VIOLATION, OUT_OF_BOUNDS, CRASHES, IS_INVALID, IS_SATURATED, IS_SPINNING, TERMINATED = range(8)
# The lines of the outcomes behind the reward, then those of the flags before the end.
INFO_KEYS = (
    "cost",
    "clearance",
    "is_success",
    "violation",
    "out_of_bounds",
    "crash",
    "invalid_action",
    "saturated",
    "spinning",
)


def outcome_of(
    outcomes: NDArray[np.float64], flags: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], dict[str, NDArray]]:
    """Rewards, ends and the info of N rows, views of these lines (3, N) and (FLAGS, N)."""
    rewards, cost, clearance = outcomes
    *told, terminated = flags
    return rewards, terminated, dict(zip(INFO_KEYS, (cost, clearance, *told), strict=True))


@inline_kernel
def load_rows(block, first, count, states, scenes):
    """State, goal and spheres of the rows into a block; ``states`` and ``scenes`` are flat."""
    to_lanes(states, I(STATE_SIZE), first, count, block, I(0))
    to_lanes(scenes.goal, I(3), first, count, block, I(GOAL))
    fill_spheres(block, first, count, scenes)


@inline_kernel
def load_snaps(block, first, count, snap, yaw_acceleration):
    """What the rows are to fly in this period: snaps (N, 3) and yaw accelerations (N,)."""
    for axis in range(3):
        for i in range(U(count)):
            block[U(LANES * (SNAP + axis)) + i] = snap[U(first) + i, axis]
    for i in range(U(count)):
        block[U(LANES * YAW) + i] = yaw_acceleration[U(first) + i]


@inline_kernel
def open_period(block, first, count, table, hold):
    """The table of the rows so far, and their yaw within its range; an invalid action asks for none."""
    for k in range(U(LANES * LINES)):
        block[U(LANES * TABLE) + k] = table[U(first * LINES) + k]
    for i in range(U(count)):
        is_invalid, rate = line(block, i, I(INVALID)) > 0.0, block[U(LANES * (OMEGA + 2)) + i]
        asked = 0.0 if is_invalid else block[U(LANES * YAW) + i]
        block[U(LANES * YAW) + i] = limited_yaw(rate, asked, hold)
        write_line(block, i, I(SPINNING), 1.0 if is_spinning(rate, hold) else line(block, i, I(SPINNING)))
        block[U(LANES * LONGEST) + i], block[U(LANES * LEAST_THRUST) + i] = 0.0, math.inf


@inline_kernel
def line(block, i, k):
    """Line k of the table, of lane i."""
    return block[i + U(LANES) * U(TABLE + k)]


@inline_kernel
def write_line(block, i, k, value):
    """Write line k of the table, of lane i."""
    block[i + U(LANES) * U(TABLE + k)] = value


@inline_kernel
def record_period(block, gaps, count, dt):
    """What happened to the lanes in the period."""
    # The sum of the steps falls short of the hold by rounding.
    hold = GOAL_HOLD - 0.5 * dt
    for i in range(U(count)):
        write_line(block, i, I(CLEARANCE), min(line(block, i, I(CLEARANCE)), gaps[i]))
        arrives = (block[i + U(LANES * LONGEST)] >= hold) & (line(block, i, I(HAS_ARRIVED)) == 0.0)
        write_line(block, i, I(ARRIVES), 1.0 if arrives else line(block, i, I(ARRIVES)))
        write_line(block, i, I(HAS_ARRIVED), 1.0 if arrives else line(block, i, I(HAS_ARRIVED)))


@inline_kernel
def between(low, value, high):
    """``low <= value <= high`` without a branch."""
    return (low <= value) & (value <= high)


@inline_kernel
def close_lanes(block, gaps, count, plant, flags):
    """Close the policy step: violation, bounds, end, reward. ``gaps`` are the present clearances.

    ``flags`` is a block with the lines of the flags, as 0 and 1.
    """
    low, high = plant.low, plant.high
    for i in range(U(count)):
        least = line(block, i, I(CLEARANCE))
        # A row that did not move has the clearance of where it stands.
        least = gaps[i] if least == NO_OBSTACLE else least
        x, y, z = lane_triple(block, i)
        is_inside = between(low[0], x, high[0]) & between(low[1], y, high[1]) & between(low[2], z, high[2])
        violates, arrived = least < 0.0, line(block, i, I(HAS_ARRIVED)) > 0.0
        has_violated = violates | (line(block, i, I(HAS_VIOLATED)) > 0.0)
        crashes, is_invalid = line(block, i, I(CRASH)), line(block, i, I(INVALID))
        is_refused = (is_invalid > 0.0) & (line(block, i, I(IS_FLYING)) == 0.0)
        ends = is_refused | (crashes > 0.0) | (violates & (plant.terminate_on_violation > 0.0))
        ends = ends | (arrived & (plant.ends_at_goal > 0.0)) | (not is_inside)
        before, after = (
            line(block, i, I(DISTANCE)),
            distance_to(x, y, z, lane_triple(block, i + U(LANES * GOAL))),
        )
        paid = reward(before, after, line(block, i, I(EFFORT)), line(block, i, I(ARRIVES)) > 0.0)
        write_line(block, i, I(CLEARANCE), least)
        write_line(block, i, I(COST), 1.0 if violates else 0.0)
        write_line(block, i, I(HAS_VIOLATED), 1.0 if has_violated else 0.0)
        write_line(block, i, I(DISTANCE), after)
        write_line(block, i, I(REWARD), paid)
        flags[i + U(LANES * IS_SUCCESS)] = 1.0 if arrived & (not has_violated) else 0.0
        flags[i + U(LANES * VIOLATION)] = 1.0 if violates else 0.0
        flags[i + U(LANES * OUT_OF_BOUNDS)] = 0.0 if is_inside else 1.0
        flags[i + U(LANES * CRASHES)], flags[i + U(LANES * IS_INVALID)] = crashes, is_invalid
        flags[i + U(LANES * IS_SATURATED)] = line(block, i, I(SATURATED))
        flags[i + U(LANES * IS_SPINNING)] = line(block, i, I(SPINNING))
        flags[i + U(LANES * TERMINATED)] = 1.0 if ends else 0.0


@inline_kernel
def store_closed(block, flag_block, first, count, rows):
    """Reward, cost and clearance, and the flags, of the lanes into their lines."""
    m = rows.yaw_acceleration.size
    for k in range(OUTCOMES):
        for i in range(U(count)):
            rows.outcome[U(m) * U(k) + U(first) + i] = line(block, i, k)
    for k in range(FLAGS):
        for i in range(U(count)):
            rows.flags[U(m) * U(k) + U(first) + i] = flag_block[U(LANES) * U(k) + i] > 0.0


@inline_kernel
def close_period(block, gaps, first, count, spheres, plant, rows):
    """Where the lanes are after the period, and what happened to them in it; ``gaps`` is room for a line."""
    from_lanes(block, I(0), rows.state, I(STATE_SIZE), first, count)
    measure_gaps(block, count, spheres, gaps)
    record_period(block, gaps, count, plant.dt)


@inline_kernel
def close_step(block, room, first, count, spheres, plant, rows):
    """Close the policy step of the lanes; the gaps are present ones after it."""
    gaps, flag_block = room
    measure_here(block, count, spheres, gaps)
    close_lanes(block, gaps, count, plant, flag_block)
    store_closed(block, flag_block, first, count, rows)


@inline_kernel
def store_table(block, first, table):
    """What is told of the rows, for the next period."""
    for k in range(U(LANES * LINES)):
        table[U(first * LINES) + k] = block[U(LANES * TABLE) + k]
