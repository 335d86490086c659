"""The episode of each row: what happened to it, and the kernels that begin it, fly and close a policy step.

What is told of the rows is kept in lanes, block by block, see ``quadsafe_env.simulation.block``. A policy step
closes with its outcome, the lines REWARD, COST and CLEARANCE, (3, N), and with the flags below, (FLAGS, N).
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, from_lanes, new_block, to_lanes
from quadsafe_core.maths.counter_rng import Key, derived_key
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
    are_sound,
    block_of,
    fill_spheres,
    fly,
    fly_with_care,
    measure_gaps,
    measure_here,
    observe,
)
from quadsafe_env.simulation.plant import unpacked
from quadsafe_env.tasks.obstacles import NO_OBSTACLE, distance_to
from quadsafe_env.tasks.reward import GOAL_HOLD, OWN_ENTRIES, SPHERE_ENTRIES, reward
from quadsafe_env.vehicle.state import OMEGA, STATE_SIZE, THRUST, lane_triple
from quadsafe_env.vehicle.yaw import is_spinning, limited_yaw

IS_SUCCESS, VIOLATION, OUT_OF_BOUNDS, CRASHES, IS_INVALID, IS_SATURATED, IS_SPINNING, TERMINATED = range(8)
FLAGS = 8


@inline_kernel
def flat_rows(states, goal, center, radius):
    """The arrays of a world, flat."""
    return states.reshape(-1), goal.reshape(-1), center.reshape(-1), radius.reshape(-1)


@inline_kernel
def load_rows(block, first, count, spheres, rows):
    """State, goal and spheres of the rows of flat arrays into a block."""
    to_lanes(rows[0], I(STATE_SIZE), first, count, block, I(0))
    to_lanes(rows[1], I(3), first, count, block, I(GOAL))
    fill_spheres(block, first, count, spheres, rows[2], rows[3])


@inline_kernel
def load_wishes(block, first, count, snap, yaw_acceleration, table, hold):
    """What the rows are to fly in this period, their yaw within its range, and what is told of them so far."""
    for k in range(U(LANES * LINES)):
        block[U(LANES * TABLE) + k] = table[U(first * LINES) + k]
    for axis in range(3):
        for i in range(U(count)):
            block[U(LANES * (SNAP + axis)) + i] = snap[U(first) + i, axis]
    for i in range(U(count)):
        block[U(LANES * YAW) + i] = yaw_acceleration[U(first) + i]
    for i in range(U(count)):
        is_invalid, rate = told(block, i, I(INVALID)) > 0.0, block[U(LANES * (OMEGA + 2)) + i]
        asked = 0.0 if is_invalid else block[U(LANES * YAW) + i]
        block[U(LANES * YAW) + i] = limited_yaw(rate, asked, hold)
        tell(block, i, I(SPINNING), 1.0 if is_spinning(rate, hold) else told(block, i, I(SPINNING)))
        block[U(LANES * LONGEST) + i], block[U(LANES * LEAST_THRUST) + i] = 0.0, math.inf


@inline_kernel
def told(block, i, line):
    """An entry of the table, of lane i."""
    return block[i + U(LANES) * U(TABLE + line)]


@inline_kernel
def tell(block, i, line, value):
    """Write an entry of the table, of lane i."""
    block[i + U(LANES) * U(TABLE + line)] = value


@inline_kernel
def record_period(block, gaps, count, dt):
    """What happened to the lanes in the period."""
    # The sum of the steps falls short of the hold by rounding.
    hold = GOAL_HOLD - 0.5 * dt
    for i in range(U(count)):
        tell(block, i, I(CLEARANCE), min(told(block, i, I(CLEARANCE)), gaps[i]))
        arrives = (block[i + U(LANES * LONGEST)] >= hold) & (told(block, i, I(HAS_ARRIVED)) == 0.0)
        tell(block, i, I(ARRIVES), 1.0 if arrives else told(block, i, I(ARRIVES)))
        tell(block, i, I(HAS_ARRIVED), 1.0 if arrives else told(block, i, I(HAS_ARRIVED)))


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
        least = told(block, i, I(CLEARANCE))
        # A row that did not move has the clearance of where it stands.
        least = gaps[i] if least == NO_OBSTACLE else least
        x, y, z = lane_triple(block, i)
        is_inside = between(low[0], x, high[0]) & between(low[1], y, high[1]) & between(low[2], z, high[2])
        violates, arrived = least < 0.0, told(block, i, I(HAS_ARRIVED)) > 0.0
        has_violated = violates | (told(block, i, I(HAS_VIOLATED)) > 0.0)
        crashes, is_invalid = told(block, i, I(CRASH)), told(block, i, I(INVALID))
        is_refused = (is_invalid > 0.0) & (told(block, i, I(IS_FLYING)) == 0.0)
        ends = is_refused | (crashes > 0.0) | (violates & (plant.terminate_on_violation > 0.0))
        ends = ends | (arrived & (plant.ends_at_goal > 0.0)) | (not is_inside)
        before, after = (
            told(block, i, I(DISTANCE)),
            distance_to(x, y, z, lane_triple(block, i + U(LANES * GOAL))),
        )
        paid = reward(before, after, told(block, i, I(EFFORT)), told(block, i, I(ARRIVES)) > 0.0)
        tell(block, i, I(CLEARANCE), least)
        tell(block, i, I(COST), 1.0 if violates else 0.0)
        tell(block, i, I(HAS_VIOLATED), 1.0 if has_violated else 0.0)
        tell(block, i, I(DISTANCE), after)
        tell(block, i, I(REWARD), paid)
        flags[i + U(LANES * IS_SUCCESS)] = 1.0 if arrived & (not has_violated) else 0.0
        flags[i + U(LANES * VIOLATION)] = 1.0 if violates else 0.0
        flags[i + U(LANES * OUT_OF_BOUNDS)] = 0.0 if is_inside else 1.0
        flags[i + U(LANES * CRASHES)], flags[i + U(LANES * IS_INVALID)] = crashes, is_invalid
        flags[i + U(LANES * IS_SATURATED)] = told(block, i, I(SATURATED))
        flags[i + U(LANES * IS_SPINNING)] = told(block, i, I(SPINNING))
        flags[i + U(LANES * TERMINATED)] = 1.0 if ends else 0.0


@inline_kernel
def store_closed(block, flag_block, first, count, outcome, flags):
    """Reward, cost and clearance, and the flags, of the lanes into their lines."""
    for line in range(outcome.shape[0]):
        for i in range(U(count)):
            outcome[line, U(first) + i] = told(block, i, line)
    for line in range(flags.shape[0]):
        for i in range(U(count)):
            flags[line, U(first) + i] = flag_block[U(LANES) * U(line) + i] > 0.0


@kernel
def narrow(numbers, count, out, first):
    """The first numbers as float32 into ``out`` from ``first`` on."""
    # Not in wide vectors: a load of 512 bits waits for two stores of 256.
    for k in range(U(count)):
        out[U(first) + k] = numbers[k]


@inline_kernel
def write_rows(seen, scratch, first, count, size, rows):
    """Observations in lanes into the rows first … first + count of a flat array."""
    from_lanes(seen, I(0), scratch, size, I(0), count)
    narrow(scratch, count * size, rows, first * size)


@inline_kernel
def slots_of(observations):
    """How many spheres an observation has."""
    return (observations.shape[1] - OWN_ENTRIES) // SPHERE_ENTRIES


@kernel
def restore(block, first, count, spheres, rows, snap, yaw_acceleration, table, hold):
    """The block as it was before it was flown."""
    load_rows(block, first, count, spheres, rows)
    load_wishes(block, first, count, snap, yaw_acceleration, table, hold)


@kernel
def advance_batch(
    constants,
    rotors,
    substeps,
    closes,
    states,
    snap,
    yaw_acceleration,
    goal,
    center,
    radius,
    table,
    outcome,
    flags,
    observations,
):
    """Hold snap and yaw acceleration for a control period; the last one of a policy step closes it.

    A block is flown at once. Where a row crashes or does not fly it is flown again, with care.
    """
    plant, spheres, size = unpacked(constants), radius.shape[1], observations.shape[1]
    block, gaps, flag_block = block_of(spheres), new_block(I(1)), new_block(I(FLAGS))
    seen, scratch = new_block(size + 8), new_block(size)
    rows, seen_rows = flat_rows(states, goal, center, radius), observations.reshape(-1)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        load_rows(block, first, count, spheres, rows)
        load_wishes(block, first, count, snap, yaw_acceleration, table, plant.yaw)
        fly(block, count, spheres, substeps, plant, rotors)
        if not are_sound(block, count, plant.params.thrust_min):
            restore(block, first, count, spheres, rows, snap, yaw_acceleration, table, plant.yaw)
            fly_with_care(block, count, spheres, substeps, plant, rotors)
        from_lanes(block, I(0), rows[0], I(STATE_SIZE), first, count)
        measure_gaps(block, count, spheres, gaps)
        record_period(block, gaps, count, plant.dt)
        if closes:
            measure_here(block, count, spheres, gaps)
            close_lanes(block, gaps, count, plant, flag_block)
            store_closed(block, flag_block, first, count, outcome, flags)
            observe(block, count, spheres, slots_of(observations), plant.params, seen)
            write_rows(seen, scratch, first, count, size, seen_rows)
        for k in range(U(LANES * LINES)):
            table[U(first * LINES) + k] = block[U(LANES * TABLE) + k]


@kernel
def begin_rows(rows, constants, states, goal, center, radius, table, outcome, flags):
    """What is told of rows whose episode begins."""
    spheres = radius.shape[1]
    block, gaps, rows_of = block_of(spheres), new_block(I(1)), flat_rows(states, goal, center, radius)
    for row in rows:
        load_rows(block, row, I(1), spheres, rows_of)
        measure_here(block, I(1), spheres, gaps)
        at = row // LANES * LANES * LINES + row % LANES
        for line in range(LINES):
            table[at + LANES * line] = 0.0
        for line in range(FLAGS):
            flags[line, row] = False
        table[at + LANES * IS_FLYING] = 1.0
        table[at + LANES * DISTANCE] = distance_to(block[0], block[LANES], block[2 * LANES], goal[row])
        outcome[REWARD, row], outcome[COST, row], outcome[CLEARANCE, row] = 0.0, 0.0, gaps[0]


@kernel
def place_rows(rows, constants, start, states):
    """Rows at rest at their start, upright, thrust equal to weight."""
    params = unpacked(constants).params
    for row in rows:
        states[row] = 0.0
        for axis in range(3):
            states[row, axis] = start[row, axis]
            states[row, 6 + 4 * axis] = 1.0
        states[row, THRUST] = params.mass * params.gravity


@kernel
def observe_rows(rows, constants, states, goal, center, radius, observations):
    """Observations of the given rows."""
    spheres, size = radius.shape[1], observations.shape[1]
    block, gaps, rows_of = block_of(spheres), new_block(I(1)), flat_rows(states, goal, center, radius)
    seen_rows = observations.reshape(-1)
    seen, scratch, params = new_block(size + 8), new_block(size), unpacked(constants).params
    for row in rows:
        load_rows(block, row, I(1), spheres, rows_of)
        measure_here(block, I(1), spheres, gaps)
        observe(block, I(1), spheres, slots_of(observations), params, seen)
        write_rows(seen, scratch, row, I(1), size, seen_rows)


@kernel
def next_words(seeds, episodes, rows, words):
    """The scene integer of each row's episode: the seed itself first, then a hash of (seed, episode)."""
    for i in rows:
        words[i, 0], words[i, 1] = seeds[i, 0], seeds[i, 1]
        if episodes[i] > 0:
            key = derived_key(Key(seeds[i, 0], seeds[i, 1]), episodes[i])
            words[i, 0], words[i, 1] = key.low, key.high
