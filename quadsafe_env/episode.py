"""The episode of each row: what happened to it, and the kernels that open, fly and close a policy step.

What is told of rows is kept in two tables with one line a quantity, so that a line is an array (N,).
"""

import math

import numpy as np

from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.lanes import LANES, I, U, from_lanes, new_block, to_lanes, wide_vectors
from quadsafe_env.actions import snap_law, velocity_law, wrench_law
from quadsafe_env.block import (
    CLIPPED,
    GOAL,
    HELD,
    LEAST_THRUST,
    LONGEST,
    PER_SPHERE,
    SNAP,
    SPHERES,
    YAW,
    count_unsound,
    fill_spheres,
    fly,
    fly_with_care,
    measure_gaps,
    measure_here,
    observe,
)
from quadsafe_env.counter_rng import Key, derived_key
from quadsafe_env.flatness import flat_from_state
from quadsafe_env.obstacles import NO_OBSTACLE, distance_to
from quadsafe_env.plant import unpacked
from quadsafe_env.state import STATE_SIZE, THRUST, lane_state, lane_triple, store_triple
from quadsafe_env.task import GOAL_HOLD, reward

# Lines of the table of numbers: in the last policy step, and since the reset.
REWARD, COST, CLEARANCE, EFFORT, TIME_AT_GOAL, DISTANCE = range(6)
NUMBERS = 6
# Lines of the table of flags: in the last policy step (but for success, arrival and violation before).
SUCCESS, VIOLATION, OUT_OF_BOUNDS, CRASH, INVALID, SATURATED, TERMINATED = range(7)
ARRIVES, IS_FLYING, HAS_ARRIVED, HAS_VIOLATED = range(7, 11)
FLAGS = 11


@inline_kernel
def clear_step(numbers, flags, i):
    """Clear what belongs to a single step."""
    numbers[COST, i], numbers[CLEARANCE, i] = 0.0, NO_OBSTACLE
    for flag in range(SUCCESS, IS_FLYING):
        flags[flag, i] = False
    flags[IS_FLYING, i] = True


@kernel
def command_batch(actions, constants, is_shielded, commands, numbers, flags):
    """Open a policy step: actions clipped to [−1, 1] and scaled, rows whose action is not finite marked.

    A row with such an action is not stepped, unless a shield is there to answer it.
    """
    scale = unpacked(constants).scale
    for i in range(actions.shape[0]):
        clear_step(numbers, flags, i)
        effort, total = 0.0, 0.0
        for entry in range(4):
            asked = float(actions[i, entry])
            total += asked
            value = min(1.0, max(-1.0, asked))
            commands[i, entry] = scale[entry] * value
            effort += value * value
        if total - total != 0.0:
            commands[i] = 0.0
            effort = 0.0
            flags[INVALID, i], flags[IS_FLYING, i] = True, is_shielded
        numbers[EFFORT, i] = effort


@inline_kernel
def load_measured(block, first, states, commands):
    """States and commands of up to sixteen rows into a block, entries 0 to 24; their number."""
    count = min(LANES, states.shape[0] - first)
    to_lanes(states.reshape(-1), I(STATE_SIZE), first, count, block, I(0))
    to_lanes(commands.reshape(-1), I(4), first, count, block, I(20))
    return count


@inline_kernel
def store_wish(block, i, wish):
    """Desired snap and yaw acceleration into entries 36 to 40 of lane i."""
    store_triple(block, i + U(LANES * 36), wish[0:3])
    block[i + U(LANES * 39)] = wish[3]


@kernel
def give_measured(block, first, count, params, flags, flat, snap, yaw_acceleration):
    """Flat states and wishes of the lanes into their rows; an invalid action wishes no snap."""
    wide_vectors()
    for i in range(U(count)):
        r, v, a, j = flat_from_state(lane_state(block, i), params)
        store_triple(block, i + U(LANES * 24), r)
        store_triple(block, i + U(LANES * 27), v)
        store_triple(block, i + U(LANES * 30), a)
        store_triple(block, i + U(LANES * 33), j)
    from_lanes(block, I(24), flat.reshape(-1), I(12), first, count)
    from_lanes(block, I(36), snap.reshape(-1), I(3), first, count)
    from_lanes(block, I(39), yaw_acceleration, I(1), first, count)
    for i in range(first, first + count):
        if flags[INVALID, i]:
            snap[i] = np.nan


@kernel
def measure_velocity(constants, states, commands, flags, flat, snap, yaw_acceleration):
    """Flat states, desired snaps and yaw accelerations; see ``velocity_law``."""
    wide_vectors()
    plant, block = unpacked(constants), new_block(I(40))
    for first in range(0, states.shape[0], LANES):
        count = load_measured(block, first, states, commands)
        for i in range(U(count)):
            s, command = (
                lane_state(block, i),
                (*lane_triple(block, i + U(LANES * 20)), block[i + U(LANES * 23)]),
            )
            store_wish(block, i, velocity_law(s, command, plant))
        give_measured(block, first, count, plant.params, flags, flat, snap, yaw_acceleration)


@kernel
def measure_snap(constants, states, commands, flags, flat, snap, yaw_acceleration):
    """Flat states, desired snaps and yaw accelerations; see ``snap_law``."""
    wide_vectors()
    plant, block = unpacked(constants), new_block(I(40))
    for first in range(0, states.shape[0], LANES):
        count = load_measured(block, first, states, commands)
        for i in range(U(count)):
            s, command = (
                lane_state(block, i),
                (*lane_triple(block, i + U(LANES * 20)), block[i + U(LANES * 23)]),
            )
            store_wish(block, i, snap_law(s, command, plant))
        give_measured(block, first, count, plant.params, flags, flat, snap, yaw_acceleration)


@kernel
def measure_wrench(constants, states, commands, flags, flat, snap, yaw_acceleration):
    """Flat states, desired snaps and yaw accelerations; see ``wrench_law``."""
    wide_vectors()
    plant, block = unpacked(constants), new_block(I(40))
    for first in range(0, states.shape[0], LANES):
        count = load_measured(block, first, states, commands)
        for i in range(U(count)):
            s, command = (
                lane_state(block, i),
                (*lane_triple(block, i + U(LANES * 20)), block[i + U(LANES * 23)]),
            )
            store_wish(block, i, wrench_law(s, command, plant))
        give_measured(block, first, count, plant.params, flags, flat, snap, yaw_acceleration)


MEASURES = {"velocity": measure_velocity, "snap": measure_snap, "wrench": measure_wrench}


@inline_kernel
def load_rows(block, first, count, states, goal, center, radius):
    """State, goal and spheres of the rows into a block."""
    to_lanes(states.reshape(-1), I(STATE_SIZE), first, count, block, I(0))
    to_lanes(goal.reshape(-1), I(3), first, count, block, I(GOAL))
    fill_spheres(block, first, count, center, radius)


@inline_kernel
def load_wishes(block, first, count, snap, yaw_acceleration, numbers, flags):
    """What the rows are to fly in this period, and what is counted in it."""
    for i in range(U(count)):
        row = U(first) + i
        store_triple(block, i + U(LANES * SNAP), (snap[row, 0], snap[row, 1], snap[row, 2]))
        block[i + U(LANES * YAW)] = 0.0 if flags[INVALID, row] else yaw_acceleration[row]
        block[i + U(LANES * HELD)] = numbers[TIME_AT_GOAL, row]
    block[LANES * LONGEST : LANES * LEAST_THRUST] = 0.0
    block[LANES * LEAST_THRUST : LANES * CLIPPED] = math.inf
    block[LANES * CLIPPED : LANES * SPHERES] = 0.0


@kernel
def record_period(block, gaps, first, count, plant, numbers, flags):
    """What happened to the rows in the period."""
    # The sum of the steps falls short of the hold by rounding.
    hold = GOAL_HOLD - 0.5 * plant.dt
    for i in range(U(count)):
        row = U(first) + i
        numbers[CLEARANCE, row] = min(numbers[CLEARANCE, row], gaps[i])
        numbers[TIME_AT_GOAL, row] = block[i + U(LANES * HELD)]
        arrives = (block[i + U(LANES * LONGEST)] >= hold) & (not flags[HAS_ARRIVED, row])
        flags[ARRIVES, row] |= arrives
        flags[HAS_ARRIVED, row] |= arrives
        flags[SATURATED, row] |= block[i + U(LANES * CLIPPED)] > 0.0


@kernel
def close_rows(block, gaps, first, count, plant, numbers, flags):
    """Close the policy step of the lanes: violation, bounds, end, reward; ``gaps`` are present clearances."""
    low, high = plant.low, plant.high
    for i in range(U(count)):
        row = U(first) + i
        least = numbers[CLEARANCE, row]
        # A row that did not move has the clearance of where it stands.
        least = gaps[i] if least == NO_OBSTACLE else least
        x, y, z = lane_triple(block, i)
        is_inside = (
            (low[0] <= x) & (x <= high[0]) & (low[1] <= y) & (y <= high[1]) & (low[2] <= z) & (z <= high[2])
        )
        violates = least < 0.0
        numbers[CLEARANCE, row], numbers[COST, row] = least, 1.0 if violates else 0.0
        flags[VIOLATION, row], flags[OUT_OF_BOUNDS, row] = violates, not is_inside
        flags[HAS_VIOLATED, row] |= violates
        flags[SUCCESS, row] = flags[HAS_ARRIVED, row] & (not flags[HAS_VIOLATED, row])
        is_refused = flags[INVALID, row] & (not flags[IS_FLYING, row])
        at_goal = (plant.ends_at_goal > 0.0) & flags[HAS_ARRIVED, row]
        is_stopped = (plant.terminate_on_violation > 0.0) & violates
        flags[TERMINATED, row] = (not is_inside) | flags[CRASH, row] | is_refused | at_goal | is_stopped
        before, after = numbers[DISTANCE, row], distance_to(x, y, z, lane_triple(block, i + U(LANES * GOAL)))
        numbers[DISTANCE, row] = after
        numbers[REWARD, row] = reward(before, after, numbers[EFFORT, row], flags[ARRIVES, row])


@inline_kernel
def write_rows(seen, scratch, first, count, observations):
    """Observations in lanes into the rows first … first + count."""
    size = observations.shape[1]
    from_lanes(seen, I(0), scratch, size, I(0), count)
    flat = observations.reshape(-1)
    for k in range(U(count * size)):
        flat[U(first * size) + k] = scratch[k]


@inline_kernel
def all_true(line):
    """Whether every flag of a line is set."""
    for flag in line:
        if not flag:
            return False
    return True


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
    numbers,
    flags,
    observations,
):
    """Hold snap and yaw acceleration for a control period; the last one of a policy step closes it.

    A block is flown at once. Where a row crashes or does not fly it is flown again, with care.
    """
    wide_vectors()
    plant, spheres, size = unpacked(constants), radius.shape[1], observations.shape[1]
    block, seen, gaps = new_block(SPHERES + PER_SPHERE * spheres), new_block(size), new_block(I(1))
    scratch = new_block(size)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        load_rows(block, first, count, states, goal, center, radius)
        load_wishes(block, first, count, snap, yaw_acceleration, numbers, flags)
        fly(block, count, spheres, substeps, plant, rotors)
        is_flying, crashes = flags[IS_FLYING, first : first + count], flags[CRASH, first : first + count]
        if count_unsound(block, count, plant.params.thrust_min) > 0 or not all_true(is_flying):
            load_rows(block, first, count, states, goal, center, radius)
            load_wishes(block, first, count, snap, yaw_acceleration, numbers, flags)
            fly_with_care(block, count, spheres, substeps, plant, rotors, is_flying, crashes)
        from_lanes(block, I(0), states.reshape(-1), I(STATE_SIZE), first, count)
        measure_gaps(block, count, spheres, gaps)
        record_period(block, gaps, first, count, plant, numbers, flags)
        if closes:
            measure_here(block, count, spheres, gaps)
            close_rows(block, gaps, first, count, plant, numbers, flags)
            observe(block, count, spheres, plant.params, seen)
            write_rows(seen, scratch, first, count, observations)


@kernel
def begin_rows(rows, constants, states, goal, center, radius, numbers, flags):
    """Tables of rows whose episode begins."""
    spheres = radius.shape[1]
    block, gaps = new_block(SPHERES + PER_SPHERE * spheres), new_block(I(1))
    for row in rows:
        load_rows(block, row, I(1), states, goal, center, radius)
        measure_here(block, I(1), spheres, gaps)
        clear_step(numbers, flags, row)
        flags[HAS_ARRIVED, row], flags[HAS_VIOLATED, row] = False, False
        numbers[CLEARANCE, row], numbers[TIME_AT_GOAL, row] = gaps[0], 0.0
        numbers[DISTANCE, row] = distance_to(block[0], block[LANES], block[2 * LANES], goal[row])


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
    block, gaps = new_block(SPHERES + PER_SPHERE * spheres), new_block(I(1))
    seen, scratch, params = new_block(size), new_block(size), unpacked(constants).params
    for row in rows:
        load_rows(block, row, I(1), states, goal, center, radius)
        measure_here(block, I(1), spheres, gaps)
        observe(block, I(1), spheres, params, seen)
        write_rows(seen, scratch, row, I(1), observations)


@kernel
def next_words(seeds, episodes, rows, words):
    """The scene integer of each row's episode: the seed itself first, then a hash of (seed, episode)."""
    for i in rows:
        words[i, 0], words[i, 1] = seeds[i, 0], seeds[i, 1]
        if episodes[i] > 0:
            key = derived_key(Key(seeds[i, 0], seeds[i, 1]), episodes[i])
            words[i, 0], words[i, 1] = key.low, key.high
