"""The episode of each row: what happened to it, and the kernels that open, advance and close a policy step."""

import numpy as np

from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_env.counter_rng import Key, derived_key
from quadsafe_env.dynamics import axpy, derivative_kernel
from quadsafe_env.flatness import wrench_from_snap_kernel
from quadsafe_env.obstacles import NO_OBSTACLE, clearance
from quadsafe_env.rotors import limited_step
from quadsafe_env.state import THRUST, load, store
from quadsafe_env.task import GOAL_HOLD, distance_to_goal, held_time, reward, write_observation

# What happened to a row: since its reset (held to distance), and in the last policy step (the rest).
RECORD = np.dtype(
    [
        ("held", "f8"),
        ("has_arrived", "?"),
        ("has_violated", "?"),
        ("distance", "f8"),
        ("clearance", "f8"),
        ("arrives", "?"),
        ("violation", "?"),
        ("out_of_bounds", "?"),
        ("crash", "?"),
        ("invalid_action", "?"),
        ("saturated", "?"),
        ("is_active", "?"),
    ]
)


@inline_kernel
def is_sound(s, thrust_min):
    """Finite, and the thrust above the floor of the flat map."""
    total = 0.0
    for value in s:
        total += value
    return total - total == 0.0 and s[THRUST] > thrust_min


@inline_kernel
def clear_step(record, least):
    """Clear what belongs to a single step; the clearance so far is ``least``."""
    record["clearance"] = least
    record["arrives"] = False
    record["violation"] = False
    record["out_of_bounds"] = False
    record["crash"] = False
    record["invalid_action"] = False
    record["saturated"] = False
    record["is_active"] = True


@kernel
def start_batch(records):
    """Open a policy step of every row."""
    for i in range(records.shape[0]):
        clear_step(records[i], NO_OBSTACLE)


@inline_kernel
def held_wrench(s, snap, yaw_acceleration, params, dt):
    """(35) at the predicted middle of the step: held over it, the snap is met to second order in dt."""
    first = wrench_from_snap_kernel(s, snap, yaw_acceleration, params)
    middle = axpy(0.5 * dt, derivative_kernel(s, first, params), s)
    return wrench_from_snap_kernel(middle, snap, yaw_acceleration, params)


@kernel
def advance_batch(states, snap, yaw_acceleration, goal, center, radius, params, rotors, dt, substeps, records):
    """Hold snap and yaw acceleration for ``substeps`` RK4 steps; a row stops at its last sound state."""
    for i in range(states.shape[0]):
        record = records[i]
        if not record["is_active"]:
            continue
        s = load(states[i])
        u = (snap[i, 0], snap[i, 1], snap[i, 2])
        for _ in range(substeps):
            wrench = held_wrench(s, u, yaw_acceleration[i], params, dt)
            after, is_clipped = limited_step(s, wrench, params, rotors, dt)
            record["saturated"] |= is_clipped
            if not is_sound(after, params.thrust_min):
                record["crash"] = True
                record["is_active"] = False
                break
            s = after
            record["clearance"] = min(record["clearance"], clearance(s[0], s[1], s[2], center[i], radius[i]))
            record["held"] = held_time(record["held"], distance_to_goal(s, goal[i]), dt)
            # The sum of the steps falls short of the hold by rounding.
            if record["held"] >= GOAL_HOLD - 0.5 * dt and not record["has_arrived"]:
                record["has_arrived"] = True
                record["arrives"] = True
        store(states[i], s)


@kernel
def finish_batch(states, goal, center, radius, params, low, high, effort, records, rewards, observations):
    """Close a policy step: violation, bounds, reward, observation."""
    for i in range(states.shape[0]):
        s, record = load(states[i]), records[i]
        if record["clearance"] == NO_OBSTACLE:
            # A row that did not move has the clearance of where it stands.
            record["clearance"] = clearance(s[0], s[1], s[2], center[i], radius[i])
        record["violation"] = record["clearance"] < 0.0
        record["has_violated"] |= record["violation"]
        for axis in range(3):
            record["out_of_bounds"] |= not low[axis] <= s[axis] <= high[axis]
        before, after = record["distance"], distance_to_goal(s, goal[i])
        record["distance"] = after
        rewards[i] = reward(before, after, effort[i], record["arrives"])
        write_observation(observations[i], states[i], goal[i], center[i], radius[i], params)


@kernel
def begin_rows(rows, states, goal, center, radius, params, records, observations):
    """Records and observation of rows that were just placed at their start."""
    for i in rows:
        s, record = load(states[i]), records[i]
        record["held"] = 0.0
        record["has_arrived"] = False
        record["has_violated"] = False
        record["distance"] = distance_to_goal(s, goal[i])
        clear_step(record, clearance(s[0], s[1], s[2], center[i], radius[i]))
        write_observation(observations[i], states[i], goal[i], center[i], radius[i], params)


@kernel
def command_batch(actions, scale, is_shielded, commands, effort, records):
    """Clip actions to [−1, 1], scale them to commands, and mark the rows whose action is not finite.

    A row with such an action is not stepped, unless a shield is there to answer it.
    """
    for i in range(actions.shape[0]):
        effort[i] = 0.0
        is_finite = True
        for entry in range(actions.shape[1]):
            value = float(actions[i, entry])
            is_finite &= value - value == 0.0
            value = min(1.0, max(-1.0, value))
            commands[i, entry] = scale[entry] * value
            effort[i] += value * value
        if not is_finite:
            commands[i] = 0.0
            effort[i] = 0.0
            records[i]["invalid_action"] = True
            records[i]["is_active"] = is_shielded


@kernel
def spoil_invalid(records, snap, yaw_acceleration):
    """An action that is not finite asks for no snap that a filter could take for a wish."""
    for i in range(records.shape[0]):
        if records[i]["invalid_action"]:
            snap[i] = np.nan
            yaw_acceleration[i] = 0.0


@kernel
def next_words(seeds, episodes, rows, words):
    """The scene integer of each row's episode: the seed itself first, then a hash of (seed, episode)."""
    for i in rows:
        words[i, 0], words[i, 1] = seeds[i, 0], seeds[i, 1]
        if episodes[i] > 0:
            key = derived_key(Key(seeds[i, 0], seeds[i, 1]), episodes[i])
            words[i, 0], words[i, 1] = key.low, key.high
