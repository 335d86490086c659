"""The episode of each row: how a control period begins, what happened in it, and the end of a policy step.

What is told of the rows are numbers and flags, line by line, see ``quadsafe_env.simulation.block``.
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
    CRASH,
    DISTANCE,
    EFFORT,
    FLAGS,
    FOUND_LAST,
    GOAL,
    HAS_ARRIVED,
    HAS_VIOLATED,
    INVALID,
    IS_FLYING,
    IS_SUCCESS,
    LEAST_THRUST,
    LONGEST,
    MARKS,
    NUMBERS,
    OUT_OF_BOUNDS,
    REWARD,
    SNAP,
    SPINNING,
    TABLE,
    TERMINATED,
    TOLD_FLAGS,
    VIOLATION,
    YAW,
    fill_spheres,
    measure_gaps,
    measure_here,
)
from quadsafe_env.simulation.rows import size_of
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, distance_to
from quadsafe_env.tasks.reward import GOAL_HOLD, reward
from quadsafe_env.vehicle.state import OMEGA, STATE_SIZE
from quadsafe_env.vehicle.yaw import is_spinning, limited_yaw

U8 = np.uint8
# Cost and clearance, then the flags that are told behind the end, in their order.
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
    table: NDArray[np.float64], flags: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], dict[str, NDArray]]:
    """Rewards, ends and the info of N rows, fresh arrays, from their numbers and flags, (…, N)."""
    terminated, *told = flags[:TOLD_FLAGS].copy()
    values = flags[VIOLATION].astype(np.float64), table[CLEARANCE].copy(), *told
    return table[REWARD].copy(), terminated, dict(zip(INFO_KEYS, values, strict=True))


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
def whole(count):
    """All lanes: there is memory for whole blocks. LLVM makes no vectors of a loop whose length it knows."""
    return (U(count) + U(LANES - 1)) // U(LANES) * U(LANES)


@inline_kernel
def load_told(block, first, count, rows):
    """The numbers and flags of the rows so far."""
    m, lanes = U(size_of(rows)), whole(count)
    for k in range(NUMBERS):
        for i in range(lanes):
            block[U(LANES * TABLE) + U(LANES) * U(k) + i] = rows.table[m * U(k) + U(first) + i]
    for k in range(FOUND_LAST, FLAGS):
        for i in range(lanes):
            block[U(LANES * MARKS) + U(LANES) * U(k) + i] = rows.flags[m * U(k) + U(first) + i]


@inline_kernel
def open_period(block, first, count, rows, hold):
    """What is told of the rows so far, and their yaw within its range; an invalid action asks for none."""
    load_told(block, first, count, rows)
    for i in range(U(count)):
        is_invalid, rate = mark(block, i, I(INVALID)), block[U(LANES * (OMEGA + 2)) + i]
        asked = 0.0 if is_invalid else block[U(LANES * YAW) + i]
        block[U(LANES * YAW) + i] = limited_yaw(rate, asked, hold)
        write_mark(block, i, I(SPINNING), is_spinning(rate, hold) | mark(block, i, I(SPINNING)))
        block[U(LANES * LONGEST) + i], block[U(LANES * LEAST_THRUST) + i] = 0.0, math.inf


@inline_kernel
def line(block, i, k):
    """Number k of lane i."""
    return block[i + U(LANES) * U(TABLE + k)]


@inline_kernel
def write_line(block, i, k, value):
    """Write number k of lane i."""
    block[i + U(LANES) * U(TABLE + k)] = value


@inline_kernel
def mark(block, i, k):
    """Flag k of lane i."""
    return block[i + U(LANES) * U(MARKS + k)] > 0.0


@inline_kernel
def write_mark(block, i, k, does):
    """Write flag k of lane i."""
    block[i + U(LANES) * U(MARKS + k)] = 1.0 if does else 0.0


@inline_kernel
def record_period(block, gaps, count, dt):
    """What happened to the lanes in the period."""
    # The sum of the steps falls short of the hold by rounding.
    hold = GOAL_HOLD - 0.5 * dt
    for i in range(U(count)):
        write_line(block, i, I(CLEARANCE), min(line(block, i, I(CLEARANCE)), gaps[i]))
        has_arrived = mark(block, i, I(HAS_ARRIVED))
        arrives = (block[i + U(LANES * LONGEST)] >= hold) & (not has_arrived)
        write_mark(block, i, I(ARRIVES), arrives | mark(block, i, I(ARRIVES)))
        write_mark(block, i, I(HAS_ARRIVED), arrives | has_arrived)


@inline_kernel
def between(low, value, high):
    """``low <= value <= high`` without a branch."""
    return (low <= value) & (value <= high)


@inline_kernel
def close_lanes(block, gaps, count, plant):
    """Close the policy step: violation, bounds, end, reward. ``gaps`` are the present clearances."""
    low, high = plant.low, plant.high
    for i in range(U(count)):
        least = line(block, i, I(CLEARANCE))
        # A row that did not move has the clearance of where it stands.
        least = gaps[i] if least == NO_OBSTACLE else least
        x, y, z = lane_triple(block, i)
        is_inside = between(low[0], x, high[0]) & between(low[1], y, high[1]) & between(low[2], z, high[2])
        violates, arrived = least < 0.0, mark(block, i, I(HAS_ARRIVED))
        has_violated = violates | mark(block, i, I(HAS_VIOLATED))
        is_refused = mark(block, i, I(INVALID)) & (not mark(block, i, I(IS_FLYING)))
        ends = is_refused | mark(block, i, I(CRASH)) | (violates & (plant.terminate_on_violation > 0.0))
        ends = ends | (arrived & (plant.ends_at_goal > 0.0)) | (not is_inside)
        before, after = (
            line(block, i, I(DISTANCE)),
            distance_to(x, y, z, lane_triple(block, i + U(LANES * GOAL))),
        )
        paid = reward(before, after, line(block, i, I(EFFORT)), mark(block, i, I(ARRIVES)))
        write_line(block, i, I(CLEARANCE), least)
        write_line(block, i, I(DISTANCE), after)
        write_line(block, i, I(REWARD), paid)
        write_mark(block, i, I(HAS_VIOLATED), has_violated)
        write_mark(block, i, I(IS_SUCCESS), arrived & (not has_violated))
        write_mark(block, i, I(VIOLATION), violates)
        write_mark(block, i, I(OUT_OF_BOUNDS), not is_inside)
        write_mark(block, i, I(TERMINATED), ends)


@inline_kernel
def close_period(block, gaps, first, count, spheres, plant, rows):
    """Where the lanes are after the period, and what happened to them in it; ``gaps`` is room for a line."""
    from_lanes(block, I(0), rows.state, I(STATE_SIZE), first, count)
    measure_gaps(block, count, spheres, gaps)
    record_period(block, gaps, count, plant.dt)


@inline_kernel
def close_step(block, gaps, count, spheres, plant):
    """Close the policy step of the lanes; the gaps are present ones after it."""
    measure_here(block, count, spheres, gaps)
    close_lanes(block, gaps, count, plant)


@inline_kernel
def store_told(block, first, count, closes, rows):
    """What is told of the rows, for the next period; whether it ``closes`` the policy step."""
    m, lanes = U(size_of(rows)), whole(count)
    for k in range(NUMBERS):
        for i in range(lanes):
            rows.table[m * U(k) + U(first) + i] = block[U(LANES * TABLE) + U(LANES) * U(k) + i]
    for k in range(0 if closes else FOUND_LAST, FLAGS):
        for i in range(lanes):
            # Not as a number: in lanes without a row there may be any.
            rows.flags[m * U(k) + U(first) + i] = U8(block[U(LANES * MARKS) + U(LANES) * U(k) + i] > 0.0)
