"""The memory of a world: its columns share no number and leave none out, and a copy of a world is a world."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.simulation.rows import memory_of, rows_of
from quadsafe_env.tasks.scene_columns import columns_of, scene_memory, scenes_of
from quadsafe_env.vehicle.state import STATE_SIZE


@pytest.mark.interpreted
@pytest.mark.parametrize("n", [1, 16, 17])
def test_columns_are_the_memory_without_gap_and_overlap(n):
    memory = memory_of(n)
    blocks = memory.shape[1] // 16
    assert blocks * 16 - 16 < n <= blocks * 16 and not memory.any()
    parts = rows_of(memory)
    assert [part.nbytes for part in parts] == [8 * 16 * blocks * k for k in (STATE_SIZE, 1, 5, 2)]
    for number, part in enumerate(parts):
        part.view(np.uint8)[:] = number + 1
    assert memory.view(np.uint8).min() > 0
    for number, part in enumerate(parts):
        assert (part.view(np.uint8) == number + 1).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("k", [0, 1, 10])
def test_scenes_are_their_memory_without_gap_and_overlap(k):
    memory = scene_memory(3, k)
    scenes = scenes_of(memory)
    for number, part in enumerate(scenes):
        part[:] = number + 1.0
    assert columns_of(memory).sphere_count == k
    assert [part.shape for part in scenes] == [(3, 3), (3, 3), (3, k, 3), (3, k)]
    assert memory.sum() == 9 * 1 + 9 * 2 + 9 * k * 3 + 3 * k * 4
    assert all((part == number + 1.0).all() for number, part in enumerate(scenes))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("settings", [{}, {"conditions": "randomised"}])
def test_a_copy_flies_on_by_itself(copied, settings):
    rows = gymnasium.make_vec("QuadSafe/Forest-v0", 3, **settings).unwrapped
    rows.reset(seed=5)
    rng = np.random.default_rng(0)
    first, second = rng.uniform(-1, 1, (2, 3, 4)).astype(np.float32)
    rows.step(first)
    twin = copied(rows)
    before = rows.state
    told = twin.step(second)[0]
    assert not np.array_equal(twin.state, before)
    np.testing.assert_array_equal(rows.state, before)
    np.testing.assert_array_equal(rows.step(second)[0], told)
    np.testing.assert_array_equal(twin._world.states, rows._world.states)
