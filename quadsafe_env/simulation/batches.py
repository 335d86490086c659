"""The loops over the rows of a world: they begin episodes, fly a control period, close a policy step, observe.

Each is given the memory of the rows and that of their scenes as they are: ``quadsafe_env.simulation.rows.Rows``
and ``quadsafe_env.tasks.scene_columns.Scenes`` have fields, shapes and units. ``indices`` are of rows, and
``numbers`` are a ``Plant``, raveled.
"""

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, from_lanes, lane_triple, new_block
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_core.maths.counter_rng import Key, derived_key
from quadsafe_env.simulation.block import (
    CLEARANCE,
    DISTANCE,
    FLAGS,
    GOAL,
    IS_FLYING,
    NUMBERS,
    are_sound,
    block_of,
    fly,
    fly_with_care,
    measure_here,
    observe,
)
from quadsafe_env.simulation.episode import (
    close_period,
    close_step,
    load_rows,
    load_snaps,
    open_period,
    store_told,
)
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import rows_in, size_of
from quadsafe_env.tasks.obstacles import distance_to
from quadsafe_env.tasks.reward import OWN_ENTRIES, SPHERE_ENTRIES
from quadsafe_env.tasks.scene_columns import columns_in
from quadsafe_env.vehicle.state import ATTITUDE, STATE_SIZE, THRUST


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


@inline_kernel
def load_lanes(block, first, count, rows, scenes, snap, hold):
    """Rows first … first + count, as they are before the period, into a block."""
    load_rows(block, first, count, rows.state, scenes)
    load_snaps(block, first, count, snap, rows.yaw_acceleration)
    open_period(block, first, count, rows, hold)


@kernel
def reload_lanes(block, first, count, rows, scenes, snap, hold):
    """``load_lanes`` again, which is rare: a call of its own, out of the way of what always runs."""
    load_lanes(block, first, count, rows, scenes, snap, hold)


@kernel
def advance_batch(numbers, rotors, closes, memory, scene_memory, snap, observations):
    """Hold snaps and the rows' yaw accelerations for a control period.

    Args:
        rotors: the fields of ``Rotors``, or None without limits.
        closes: whether it is the last period of a policy step, which writes outcome, flags and observations.
        snap: (N, 3), m/s⁴.
        observations: (N, 15 + 5 k), float32.

    A block is flown at once. Where a row crashes or does not fly it is flown again, with care.
    """
    plant, rows = unraveled(numbers, Plant), rows_in(borrowed(memory))
    scenes = columns_in(borrowed(scene_memory))
    spheres, size = scenes.sphere_count, observations.shape[1]
    block, gaps = block_of(spheres), new_block(I(1))
    seen, scratch, seen_rows = new_block(size + 8), new_block(size), observations.reshape(-1)
    for first in range(0, observations.shape[0], LANES):
        count = min(LANES, observations.shape[0] - first)
        load_lanes(block, first, count, rows, scenes, snap, plant.yaw)
        fly(block, count, spheres, plant.substeps, plant, rotors)
        if not are_sound(block, count, plant.params.thrust_min):
            reload_lanes(block, first, count, rows, scenes, snap, plant.yaw)
            fly_with_care(block, count, spheres, plant.substeps, plant, rotors)
        close_period(block, gaps, first, count, spheres, plant, rows)
        if closes:
            close_step(block, gaps, count, spheres, plant)
            observe(block, count, spheres, slots_of(observations), plant.params, seen)
            write_rows(seen, scratch, first, count, size, seen_rows)
        store_told(block, first, count, closes, rows)


@inline_kernel
def begin_row(rows, row, distance, gap):
    """What is told of a row that begins, this far from its goal and its nearest obstacle, m."""
    m = size_of(rows)
    for k in range(NUMBERS):
        rows.table[m * k + row] = 0.0
    for k in range(FLAGS):
        rows.flags[m * k + row] = 0
    rows.table[m * DISTANCE + row], rows.table[m * CLEARANCE + row] = distance, gap
    rows.flags[m * IS_FLYING + row] = 1


@kernel
def begin_rows(indices, memory, scene_memory):
    """What is told of rows whose episode begins, at these indices; see ``advance_batch``."""
    rows, scenes = rows_in(memory), columns_in(scene_memory)
    block, gaps = block_of(scenes.sphere_count), new_block(I(1))
    for row in indices:
        load_rows(block, row, I(1), rows.state, scenes)
        measure_here(block, I(1), scenes.sphere_count, gaps)
        distance = distance_to(block[0], block[LANES], block[2 * LANES], lane_triple(block, U(LANES * GOAL)))
        begin_row(rows, row, distance, gaps[0])


@kernel
def place_rows(indices, numbers, memory, scene_memory):
    """Rows at rest at their start, upright, thrust equal to weight; see ``advance_batch``."""
    params, states = unraveled(numbers, Plant).params, rows_in(memory).state
    start = columns_in(scene_memory).start
    for row in indices:
        at = STATE_SIZE * row
        states[at : at + STATE_SIZE] = 0.0
        for axis in range(3):
            states[at + axis] = start[3 * row + axis]
            states[at + ATTITUDE + 4 * axis] = 1.0
        states[at + THRUST] = params.mass * params.gravity


@kernel
def observe_rows(indices, numbers, states, scene_memory, observations):
    """Observations of rows from states (N, 20), those that are or others; see ``advance_batch``."""
    scenes, size = columns_in(scene_memory), observations.shape[1]
    block, gaps, state_rows = block_of(scenes.sphere_count), new_block(I(1)), states.reshape(-1)
    seen_rows, params = observations.reshape(-1), unraveled(numbers, Plant).params
    seen, scratch = new_block(size + 8), new_block(size)
    for row in indices:
        load_rows(block, row, I(1), state_rows, scenes)
        measure_here(block, I(1), scenes.sphere_count, gaps)
        observe(block, I(1), scenes.sphere_count, slots_of(observations), params, seen)
        write_rows(seen, scratch, row, I(1), size, seen_rows)


@kernel
def next_words(seeds, episodes, rows, words):
    """The scene integer of each row's episode: the seed itself first, then a hash of (seed, episode)."""
    for i in rows:
        words[i, 0], words[i, 1] = seeds[i, 0], seeds[i, 1]
        if episodes[i] > 0:
            key = derived_key(Key(seeds[i, 0], seeds[i, 1]), episodes[i])
            words[i, 0], words[i, 1] = key.low, key.high
