"""The first half of a control period: from actions and states to desired snaps, the waist before the filter."""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, from_lanes, new_block, to_lanes, wide_vectors
from quadsafe_env.simulation.block import (
    ARRIVES,
    CLEARANCE,
    CRASH,
    EFFORT,
    INVALID,
    IS_FLYING,
    LINES,
    SATURATED,
    SPINNING,
)
from quadsafe_env.simulation.plant import unpacked
from quadsafe_env.tasks.obstacles import NO_OBSTACLE
from quadsafe_env.vehicle.actions import snap_law, velocity_law, wrench_law
from quadsafe_env.vehicle.flatness import flat_from_state
from quadsafe_env.vehicle.state import STATE_SIZE, lane_state, lane_triple, store_triple

# Entries of a lane: state, command, flat state, desired snap and yaw acceleration.
COMMAND = STATE_SIZE
FLAT = COMMAND + 4
WISH = FLAT + 12
ENTRIES = WISH + 4


@inline_kernel
def clipped(asked):
    """An entry of an action within [−1, 1]."""
    return min(1.0, max(-1.0, asked))


@inline_kernel
def command_rows(block, first, count, actions, plant, is_shielded, commands, table):
    """Open a policy step: actions clipped to [−1, 1] and scaled, rows whose action is not finite marked.

    A row with such an action is not stepped, unless a shield is there to answer it.
    """
    for k in range(U(4)):
        for i in range(U(count)):
            block[U(LANES) * (U(COMMAND) + k) + i] = actions[U(first) + i, k]
    scale, flies_anyway, at = plant.scale, 1.0 if is_shielded else 0.0, U(first * LINES)
    for i in range(U(count)):
        x, y, z = lane_triple(block, i + U(LANES * COMMAND))
        w = block[i + U(LANES * (COMMAND + 3))]
        is_finite = (abs(x) < math.inf) & (abs(y) < math.inf) & (abs(z) < math.inf) & (abs(w) < math.inf)
        a, b, c, d = clipped(x), clipped(y), clipped(z), clipped(w)
        moved = (scale[0] * a if is_finite else 0.0, scale[1] * b if is_finite else 0.0)
        turned = (scale[2] * c if is_finite else 0.0, scale[3] * d if is_finite else 0.0)
        store_triple(block, i + U(LANES * COMMAND), (moved[0], moved[1], turned[0]))
        block[i + U(LANES * (COMMAND + 3))] = turned[1]
        table[at + U(LANES * EFFORT) + i] = a * a + b * b + c * c + d * d if is_finite else 0.0
        table[at + U(LANES * INVALID) + i] = 0.0 if is_finite else 1.0
        table[at + U(LANES * IS_FLYING) + i] = 1.0 if is_finite else flies_anyway
        table[at + U(LANES * CLEARANCE) + i] = NO_OBSTACLE
        table[at + U(LANES * ARRIVES) + i] = 0.0
        table[at + U(LANES * CRASH) + i], table[at + U(LANES * SATURATED) + i] = 0.0, 0.0
        table[at + U(LANES * SPINNING) + i] = 0.0
    for k in range(U(4 * LANES)):
        commands[U(4 * first) + k] = block[U(LANES * COMMAND) + k]


@inline_kernel
def load_measured(block, first, count, opens, is_shielded, actions, plant, rows, commands, table):
    """States and commands of rows first … first + count into a block."""
    to_lanes(rows, I(STATE_SIZE), first, count, block, I(0))
    if opens:
        command_rows(block, first, count, actions, plant, is_shielded, commands, table)
    else:
        for k in range(U(4 * LANES)):
            block[U(LANES * COMMAND) + k] = commands[U(4 * first) + k]


@inline_kernel
def lane_command(block, i):
    """The command of lane i as a tuple."""
    return (*lane_triple(block, i + U(LANES * COMMAND)), block[i + U(LANES * (COMMAND + 3))])


@inline_kernel
def store_measured(block, i, flat, wish):
    """Flat state, desired snap and yaw acceleration of lane i."""
    store_triple(block, i + U(LANES * FLAT), flat[0])
    store_triple(block, i + U(LANES * (FLAT + 3)), flat[1])
    store_triple(block, i + U(LANES * (FLAT + 6)), flat[2])
    store_triple(block, i + U(LANES * (FLAT + 9)), flat[3])
    store_triple(block, i + U(LANES * WISH), wish[0:3])
    block[i + U(LANES * (WISH + 3))] = wish[3]


@inline_kernel
def give_measured(block, first, count, table, flat, snap, yaw_acceleration):
    """Flat states and wishes of the lanes into rows of flat arrays; an invalid action wishes no snap."""
    from_lanes(block, I(FLAT), flat, I(12), first, count)
    from_lanes(block, I(WISH), snap, I(3), first, count)
    refused = 0
    for i in range(U(count)):
        yaw_acceleration[U(first) + i] = block[U(LANES * (WISH + 3)) + i]
        refused += 1 if table[U(first * LINES + LANES * INVALID) + i] > 0.0 else 0
    for i in range(count if refused > 0 else 0):
        if table[first * LINES + LANES * INVALID + i] > 0.0:
            snap[3 * (first + i)] = snap[3 * (first + i) + 1] = snap[3 * (first + i) + 2] = np.nan


@kernel
def measure_velocity(
    constants, opens, is_shielded, actions, states, commands, table, flat, snap, yaw_acceleration
):
    """Flat states, desired snaps and yaw accelerations, see ``velocity_law``; the first period opens a step."""
    wide_vectors()
    plant, block, rows = unpacked(constants), new_block(I(ENTRIES)), states.reshape(-1)
    flat_rows, snap_rows = flat.reshape(-1), snap.reshape(-1)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        load_measured(block, first, count, opens, is_shielded, actions, plant, rows, commands, table)
        for i in range(U(count)):
            s, command = lane_state(block, i), lane_command(block, i)
            store_measured(block, i, flat_from_state(s, plant.params), velocity_law(s, command, plant))
        give_measured(block, first, count, table, flat_rows, snap_rows, yaw_acceleration)


@kernel
def measure_snap(constants, opens, is_shielded, actions, states, commands, table, flat, snap, yaw_acceleration):
    """Flat states, desired snaps and yaw accelerations, see ``snap_law``; the first period opens a step."""
    wide_vectors()
    plant, block, rows = unpacked(constants), new_block(I(ENTRIES)), states.reshape(-1)
    flat_rows, snap_rows = flat.reshape(-1), snap.reshape(-1)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        load_measured(block, first, count, opens, is_shielded, actions, plant, rows, commands, table)
        for i in range(U(count)):
            s, command = lane_state(block, i), lane_command(block, i)
            store_measured(block, i, flat_from_state(s, plant.params), snap_law(s, command, plant))
        give_measured(block, first, count, table, flat_rows, snap_rows, yaw_acceleration)


@kernel
def measure_wrench(
    constants, opens, is_shielded, actions, states, commands, table, flat, snap, yaw_acceleration
):
    """Flat states, desired snaps and yaw accelerations, see ``wrench_law``; the first period opens a step."""
    wide_vectors()
    plant, block, rows = unpacked(constants), new_block(I(ENTRIES)), states.reshape(-1)
    flat_rows, snap_rows = flat.reshape(-1), snap.reshape(-1)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        load_measured(block, first, count, opens, is_shielded, actions, plant, rows, commands, table)
        for i in range(U(count)):
            s, command = lane_state(block, i), lane_command(block, i)
            store_measured(block, i, flat_from_state(s, plant.params), wrench_law(s, command, plant))
        give_measured(block, first, count, table, flat_rows, snap_rows, yaw_acceleration)


MEASURES = {"velocity": measure_velocity, "snap": measure_snap, "wrench": measure_wrench}
