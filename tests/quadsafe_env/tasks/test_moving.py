"""Scenes of spheres and boxes that move: what is drawn, that it moves so, and what the shield makes of it."""

import gymnasium
import numpy as np
import pytest
from pilots import world_of

from quadsafe_env import Box, Sphere
from quadsafe_env.tasks.drawn_bodies import HEAD_START, MEETING, SPEEDS
from shields import VectorShieldWrapper

ROWS, STEPS = 128, 400


def straight_flights(is_shielded):
    """Ended episodes, violations, successes and the least clearance of a pilot that sees no obstacle."""
    env = plant = gymnasium.make_vec("QuadSafe/Moving-v0", ROWS)
    env = VectorShieldWrapper(env) if is_shielded else env
    env.reset(seed=0)
    ended, violations, successes, least = 0, 0, 0, np.inf
    for _ in range(STEPS):
        way = plant.unwrapped.goal - plant.unwrapped.state[:, :3]
        actions = np.pad(np.clip(1.5 * way, -1.0, 1.0), ((0, 0), (0, 1))).astype(np.float32)
        _, _, terminated, truncated, info = env.step(actions)
        ended += (terminated | truncated).sum()
        violations += info["violation"].sum()
        successes += info["is_success"].sum()
        least = min(least, info["clearance"].min())
    return ended, violations, successes, least


def test_what_is_drawn_leaves_the_start_free_and_meets_the_way():
    world = world_of("moving", range(400))
    starts, shapes = world.scenes.start, [list(row) for row in world.obstacles]
    drawn = [(start, shape) for start, row in zip(starts, shapes, strict=True) for shape in row]
    assert len(drawn) > 0.95 * 8 * 400
    assert {type(shape) for _, shape in drawn} == {Box, Sphere}
    assert 0.45 < np.mean([isinstance(shape, Box) for _, shape in drawn]) < 0.55
    gaps = np.array([shape.distance(start) - world.params.radius for start, shape in drawn])
    assert HEAD_START - 1e-9 <= gaps.min() < HEAD_START + 0.1
    speeds = np.array([np.linalg.norm(shape.velocity) for _, shape in drawn])
    assert SPEEDS[0] <= speeds.min() < 0.11 and 0.49 < speeds.max() <= SPEEDS[1]
    met = np.array([np.add(shape.center, MEETING * np.array(shape.velocity)) for _, shape in drawn])
    assert 1.9 < np.abs(met).max() <= 2.0 + 1e-9


def test_bodies_move_at_their_velocities_and_begin_anew_with_an_episode():
    env = gymnasium.make("QuadSafe/Moving-v0")
    env.reset(options={"scene": 5})
    before = list(env.unwrapped.obstacles)
    for _ in range(25):
        env.step(np.zeros(4, np.float32))
    for was, now in zip(before, env.unwrapped.obstacles, strict=True):
        np.testing.assert_allclose(now.center, np.add(was.center, was.velocity), atol=1e-9)
    env.reset(options={"scene": 6})
    assert list(env.unwrapped.obstacles) != before
    env.reset(options={"scene": 5})
    assert list(env.unwrapped.obstacles) == before


def test_walls_beside_what_moves_stand_still():
    env = gymnasium.make("QuadSafe/Moving-v0", bounds=[(-4, -4, -4), (4, 4, 4)])
    env.reset(seed=0)
    *movers, a, b, c, d, e, f = env.unwrapped.obstacles
    assert all(np.linalg.norm(shape.velocity) > 0.0 for shape in movers)
    assert not any(np.any(wall.velocity) for wall in (a, b, c, d, e, f))


@pytest.mark.slow
def test_straight_flights_collide_and_none_does_behind_the_shield():
    ended, violations, _, _ = straight_flights(is_shielded=False)
    assert violations > 0.2 * ended
    ended, violations, successes, least = straight_flights(is_shielded=True)
    assert ended > 200 and violations == 0 and least > 0.0
    assert successes > 0.95 * ended
