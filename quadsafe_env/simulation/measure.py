"""The first half of a control period: from actions and states to desired snaps, the waist before the filter."""

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import (
    LANES,
    I,
    U,
    from_lanes,
    lane_triple,
    new_block,
    store_triple,
    to_lanes,
    wide_vectors,
)
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_env.simulation.block import (
    ARRIVES,
    CLEARANCE,
    CRASH,
    EFFORT,
    INVALID,
    IS_FLYING,
    SATURATED,
    SPINNING,
)
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import rows_in, size_of
from quadsafe_env.tasks.obstacles import NO_OBSTACLE
from quadsafe_env.vehicle.actions import attitude_law, rates_law, snap_law, velocity_law, wrench_law
from quadsafe_env.vehicle.flatness import flat_from_state
from quadsafe_env.vehicle.state import STATE_SIZE, lane_state

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
def lane_command(block, i):
    """The command of lane i as a tuple."""
    return (*lane_triple(block, i + U(LANES * COMMAND)), block[i + U(LANES * (COMMAND + 3))])


@inline_kernel
def load_actions(block, first, count, actions):
    """The actions of rows first … first + count into the lines of commands, as they are."""
    for k in range(U(4)):
        for i in range(U(count)):
            block[U(LANES) * (U(COMMAND) + k) + i] = actions[U(first) + i, k]


@inline_kernel
def open_rows(block, first, count, flies_anyway, rows):
    """Open a policy step under actions in the lines of commands; rows whose action is not finite are marked.

    A row with such an action is not stepped, unless it ``flies_anyway``: a shield is there to answer it.
    """
    table, flags, m = rows.table, rows.flags, U(size_of(rows))
    for i in range(U(count)):
        x, y, z, w = lane_command(block, i)
        is_finite = (abs(x) < math.inf) & (abs(y) < math.inf) & (abs(z) < math.inf) & (abs(w) < math.inf)
        a, b, c, d = clipped(x), clipped(y), clipped(z), clipped(w)
        at = U(first) + i
        table[m * U(EFFORT) + at] = a * a + b * b + c * c + d * d if is_finite else 0.0
        table[m * U(CLEARANCE) + at] = NO_OBSTACLE
        flags[m * U(INVALID) + at] = 0 if is_finite else 1
    for i in range(U(count)):
        at = U(first) + i
        flags[m * U(IS_FLYING) + at] = 1 if flies_anyway else 1 - flags[m * U(INVALID) + at]
    for k in (ARRIVES, CRASH, SATURATED, SPINNING):
        for i in range(U(count)):
            flags[m * U(k) + U(first) + i] = 0


@inline_kernel
def command_lanes(block, count, scale):
    """The actions in the lines of commands clipped to [−1, 1] and scaled; 0 for one that is not finite."""
    for i in range(U(count)):
        x, y, z, w = lane_command(block, i)
        is_finite = (abs(x) < math.inf) & (abs(y) < math.inf) & (abs(z) < math.inf) & (abs(w) < math.inf)
        a, b, c, d = clipped(x), clipped(y), clipped(z), clipped(w)
        moved = (scale[0] * a if is_finite else 0.0, scale[1] * b if is_finite else 0.0)
        turned = (scale[2] * c if is_finite else 0.0, scale[3] * d if is_finite else 0.0)
        store_triple(block, i + U(LANES * COMMAND), (moved[0], moved[1], turned[0]))
        block[i + U(LANES * (COMMAND + 3))] = turned[1]


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
def give_measured(block, first, count, rows, wishes):
    """Flat states and wishes of the lanes into their rows; an invalid action wishes no snap."""
    from_lanes(block, I(FLAT), wishes, I(12), first, count)
    snaps = wishes[12 * size_of(rows) :]
    from_lanes(block, I(WISH), snaps, I(3), first, count)
    refused, invalid = 0, size_of(rows) * INVALID + first
    for i in range(U(count)):
        rows.yaw_acceleration[U(first) + i] = block[U(LANES * (WISH + 3)) + i]
        refused += rows.flags[U(invalid) + i]
    for i in range(count if refused > 0 else 0):
        if rows.flags[invalid + i]:
            at = 3 * (first + i)
            snaps[at] = snaps[at + 1] = snaps[at + 2] = np.nan


@inline_kernel
def measure_rows(law, numbers, opens, is_shielded, memory, wishes, actions):
    """Flat states, desired snaps and yaw accelerations of every row under a law of ``vehicle.actions``.

    Args:
        law: (state, command, params, gains) → snap and yaw acceleration.
        numbers: a ``Plant``, raveled.
        opens: whether it is the first period of a policy step.
        is_shielded: whether rows fly though their action is not finite.
        memory: of the rows, see ``Rows``.
        wishes: the numbers of ``Wishes``.
        actions: (N, 4), float32.
    """
    plant, rows, block = unraveled(numbers, Plant), rows_in(borrowed(memory)), new_block(I(ENTRIES))
    asked = borrowed(wishes).reshape(-1)
    for first in range(0, actions.shape[0], LANES):
        count = min(LANES, actions.shape[0] - first)
        to_lanes(rows.state, I(STATE_SIZE), first, count, block, I(0))
        load_actions(block, first, count, actions)
        if opens:
            open_rows(block, first, count, is_shielded, rows)
        command_lanes(block, count, plant.scale)
        for i in range(U(count)):
            s, command = lane_state(block, i), lane_command(block, i)
            wish = law(s, command, plant.params, plant.gains)
            store_measured(block, i, flat_from_state(s, plant.params), wish)
        give_measured(block, first, count, rows, asked)


@kernel
def measure_velocity(numbers, opens, is_shielded, memory, wishes, actions):
    """``measure_rows`` under ``velocity_law``."""
    wide_vectors()
    measure_rows(velocity_law, numbers, opens, is_shielded, memory, wishes, actions)


@kernel
def measure_snap(numbers, opens, is_shielded, memory, wishes, actions):
    """``measure_rows`` under ``snap_law``."""
    wide_vectors()
    measure_rows(snap_law, numbers, opens, is_shielded, memory, wishes, actions)


@kernel
def measure_wrench(numbers, opens, is_shielded, memory, wishes, actions):
    """``measure_rows`` under ``wrench_law``."""
    wide_vectors()
    measure_rows(wrench_law, numbers, opens, is_shielded, memory, wishes, actions)


@kernel
def measure_rates(numbers, opens, is_shielded, memory, wishes, actions):
    """``measure_rows`` under ``rates_law``."""
    wide_vectors()
    measure_rows(rates_law, numbers, opens, is_shielded, memory, wishes, actions)


@kernel
def measure_attitude(numbers, opens, is_shielded, memory, wishes, actions):
    """``measure_rows`` under ``attitude_law``."""
    wide_vectors()
    measure_rows(attitude_law, numbers, opens, is_shielded, memory, wishes, actions)


class Measure(Protocol):
    """An action interface at work: from actions and states to what a filter is given, see ``measure_rows``."""

    def __call__(
        self,
        numbers: NDArray[np.float64],
        opens: bool,
        is_shielded: bool,
        memory: NDArray[np.float64],
        wishes: NDArray[np.float64],
        actions: NDArray[np.float32],
    ) -> None:
        """Write flat states and desired snaps into the wishes, yaw accelerations into the memory."""
        ...


MEASURES: Mapping[str, Measure] = {
    "velocity": measure_velocity,
    "snap": measure_snap,
    "wrench": measure_wrench,
    "rates": measure_rates,
    "attitude": measure_attitude,
}
