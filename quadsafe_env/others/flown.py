"""What plants of others did in a control period, taken over row by row."""

import numpy as np

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import LANES, I, U, new_block
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_env.disturbances.disturbed_flight import is_state_sound, record_step
from quadsafe_env.simulation.batches import load_lanes
from quadsafe_env.simulation.block import CLIPPED, CRASH, IS_FLYING, MARKS, block_of
from quadsafe_env.simulation.bodies import (
    around_of,
    close_period_among,
    close_step_among,
    columns_among,
    open_around,
)
from quadsafe_env.simulation.episode import close_period, close_step, store_told
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import rows_in
from quadsafe_env.vehicle.state import STATE_SIZE, load, store_lane

# Of a row: the state after the period, its whole steps, and whether a rotor was at its stop.
PERIOD = np.dtype([("state", float, STATE_SIZE), ("steps", int), ("is_clipped", np.bool_)])


@kernel
def take_period(block, lane, row, among, told, m):
    """What a row's plant did in a period, in a lane: ``paths`` (N, S, 3), and ``m``, a record of ``PERIOD``.

    ``among`` are the number of spheres and the ``Around`` of bodies, or None; ``told`` a ``Plant`` and paths.
    """
    plant, paths = told
    for k in range(m["steps"]):
        r = (paths[row, k, 0], paths[row, k, 1], paths[row, k, 2])
        record_step(block, lane, row, among, r, plant.dt)
    if m["is_clipped"]:
        block[LANES * CLIPPED + lane] = 1.0
    s = load(m["state"])
    if is_state_sound(s, plant.params.thrust_min):
        store_lane(block, U(lane), s)
    else:
        block[LANES * (MARKS + IS_FLYING) + lane], block[LANES * (MARKS + CRASH) + lane] = 0.0, 1.0


@kernel
def take_batch(numbers, closes, memory, scene_memory, body_memory, snap, flown):
    """Take over what plants did in a control period, as ``advance_batch``; nothing is observed.

    ``body_memory`` is that of ``SceneBodies``, or None among spheres at rest; ``flown`` are the paths
    (N, S, 3), m, and records (N,) of ``PERIOD``.
    """
    plant, rows, (paths, periods) = unraveled(numbers, Plant), rows_in(borrowed(memory)), flown
    scenes, around = columns_among(scene_memory, body_memory), around_of(scene_memory, body_memory)
    spheres = scenes.sphere_count
    block, gaps = block_of(spheres), new_block(I(1))
    for first in range(0, snap.shape[0], LANES):
        count = min(LANES, snap.shape[0] - first)
        load_lanes(block, first, count, rows, scenes, snap, plant.yaw)
        open_around(around, count)
        for lane in range(count):
            if block[LANES * (MARKS + IS_FLYING) + lane] > 0.0:
                take_period(block, lane, first + lane, (spheres, around), (plant, paths), periods[first + lane])
        if body_memory is None:
            close_period(block, gaps, first, count, spheres, plant, rows)
            if closes:
                close_step(block, gaps, count, spheres, plant)
        else:
            close_period_among(block, gaps, first, count, around, plant, rows)
            if closes:
                close_step_among(block, gaps, first, count, around, plant)
        store_told(block, first, count, closes, rows)
