"""Letters in pictures: none touches another, none leaves the picture."""

from itertools import combinations

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.pictures.render import LEAST_LABELLED, labels_of, readings_of
from quadsafe_env.pictures.sprites import pygame
from quadsafe_env.pictures.trail import NO_PAST
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import STATE_SIZE, THRUST


def boxes(size, state, gap, steps, caption):
    past = NO_PAST._replace(steps=steps, time=steps / 25)
    readings = readings_of(state, np.zeros(3), np.array([gap]), PRESETS["crazyflie"], past)
    labels = labels_of(size, readings, acts=True, caption=caption)
    return [pygame.Rect(label.left, label.top, *label.image.get_size()) for label in labels]


@pytest.mark.parametrize("size", [120, 160, 240, 299, 300, 480, 1080])
def test_labels_never_touch_and_never_leave_the_picture(size):
    rng = np.random.default_rng(size)
    for _ in range(30):
        state = rng.normal(size=STATE_SIZE) * 10.0 ** rng.integers(-3, 9)
        state[THRUST] = abs(state[THRUST])
        caption = " ".join(["arm"] * int(rng.integers(0, 60))) + "x" * int(rng.integers(0, 60))
        found = boxes(
            size, state, rng.normal() * 10.0 ** rng.integers(-3, 9), int(rng.integers(10**6)), caption
        )
        assert len(found) == 7 + bool(caption)
        assert all(pygame.Rect(0, 0, size, size).contains(box) for box in found)
        assert not any(one.colliderect(other) for one, other in combinations(found, 2))


def test_labels_can_be_read_where_numbers_are_usual():
    state = np.zeros(STATE_SIZE)
    for size in (160, 480, 1080):
        assert min(box.height for box in boxes(size, state, 0.4, 250, "shield, seed 0")) >= 8
    assert boxes(LEAST_LABELLED - 1, state, 0.4, 250, "shield, seed 0") == []


def test_time_and_step_of_the_episode_are_told():
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", policy_hz=50)
    env.reset(seed=0)
    for _ in range(7):
        env.step(np.zeros(4, dtype=np.float32))
    past = env.unwrapped._world.past(0)
    assert (past.steps, past.time) == (7, 0.14)
    told = [
        words
        for words, _ in readings_of(env.unwrapped.state, np.zeros(3), np.zeros(0), env.unwrapped.params, past)
    ]
    assert told[0] == "time 0.14 s" and told[3] == "step 7" and told[5] == "no obstacle"
    env.reset(seed=0)
    assert env.unwrapped._world.past(0).steps == 0


def test_a_caption_is_a_keyword_and_in_the_picture():
    frames = []
    for caption in ("", "shield, seed 0"):
        env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", caption=caption)
        env.reset(seed=0)
        frames.append(env.render())
    rows, columns = np.nonzero((frames[0] != frames[1]).any(axis=-1))
    assert rows.max() < 60 and columns.min() > 240
    with pytest.raises(TypeError, match=r"caption must be a string, got 7"):
        gymnasium.make("QuadSafe/Avoid-v0", caption=7)
