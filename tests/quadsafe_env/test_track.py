"""Track: smooth references, spheres on them, and errors that are counted."""

import copy

import gymnasium
import numpy as np
import pytest

from quadsafe_core.maths.counter_rng import Key
from quadsafe_env import Box
from quadsafe_env.references.curves import NUMBERS, REFERENCES, SEGMENTS, Course, curve_at, write_curve
from quadsafe_env.references.track import APART
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.scenes import FREE_SPACE
from shields import ShieldWrapper, VectorShieldWrapper
from tests.helpers.pilots import world_of

ID = "QuadSafe/Track-v0"
each_reference = pytest.mark.parametrize("reference", REFERENCES)


def curve_of(reference, scene=7):
    curve, course = np.zeros(NUMBERS), Course(REFERENCES.index(reference))
    write_curve(Key(scene, 0), course, curve)
    return course, curve


def follow(plant):
    """An action that follows the reference and sees no obstacle."""
    reference, flat = plant.reference, plant.flat_state()
    velocity = reference[..., 1, :] + 2.0 * (reference[..., 0, :] - flat[..., 0, :])
    action = np.zeros((*velocity.shape[:-1], 4), dtype=np.float32)
    action[..., :3] = velocity / plant.action_scale[:3]
    return action


@each_reference
@pytest.mark.interpreted
def test_every_order_is_the_derivative_of_the_one_before(reference):
    course, curve = curve_of(reference)
    h = 1e-4
    # The snap of the spline jumps in its slope at the knots: differences are taken away from them.
    for t in (0.3, 1.1, 1.9, 4.2, 11.3):
        low, here, high = (np.array(curve_at(course.kind, curve, t + d)) for d in (-h, 0.0, h))
        np.testing.assert_allclose((high - low)[:4] / (2.0 * h), here[1:], atol=1e-4)


@each_reference
@pytest.mark.interpreted
def test_references_begin_at_rest_and_are_smooth(reference):
    course, curve = curve_of(reference)
    np.testing.assert_allclose(curve_at(course.kind, curve, 0.0)[:4], 0.0, atol=1e-9)
    knots = [2.0, *np.arange(1, SEGMENTS + 1) * course.period / 4]
    for t in knots:
        before, after = (np.array(curve_at(course.kind, curve, t + d)) for d in (-1e-9, 1e-9))
        np.testing.assert_allclose(before[:4], after[:4], atol=1e-6)


def test_the_spline_has_the_least_snap():
    course, curve = curve_of("minimum-snap")
    times = (np.arange(16000) + 0.5) * 20.0 / 16000
    snap = np.array([curve_at(course.kind, curve, t)[4] for t in times])
    # A bump between waypoints: smooth, zero at every knot of the first two segments and its slope.
    u = times / 5.0
    inside = (times < 5.0)[:, None]
    h = 1e-3

    def bump(x):
        return (x * (1 - x)) ** 5 * (x - 0.5)

    fourth = (bump(u - 2 * h) - 4 * bump(u - h) + 6 * bump(u) - 4 * bump(u + h) + bump(u + 2 * h)) / (
        5.0 * h
    ) ** 4
    change = np.where(inside, fourth[:, None], 0.0) * [1.0, -1.0, 0.5]
    # Stationary: no such change of the path lowers the integral of the square.
    assert abs((snap * change).sum()) < 1e-3 * np.linalg.norm(snap) * np.linalg.norm(change)


@each_reference
def test_scenes_leave_a_way_and_block_the_reference(reference):
    n = 50
    world = world_of("track", range(n), reference=reference)
    center, radius = world.scenes.center, world.scenes.radius
    assert (radius > 0.0).mean() > 0.98
    from_start = np.linalg.norm(center - world.scenes.start[:, None], axis=2) - radius
    assert from_start[radius > 0.0].min() >= FREE_SPACE
    for i in range(n):
        there = np.flatnonzero(radius[i])
        line = world._following.line(world._scene_memory, i, np.linspace(0.0, 20.0, 1001))
        gaps = np.linalg.norm(center[i, there, None] - line, axis=2).min(axis=1) - radius[i, there]
        assert gaps.max() < -0.4 * radius[i, there].min()
        for j in there:
            others = there[there > j]
            apart = np.linalg.norm(center[i, others] - center[i, j], axis=1) - radius[i, others] - radius[i, j]
            assert (apart >= APART - 1e-12).all()


@each_reference
def test_blind_following_violates_without_the_shield_and_never_with_it(reference):
    n, violated = 20, {}
    for is_shielded in (False, True):
        plant = gymnasium.make_vec(ID, n, reference=reference, terminate_on_violation=False)
        env = VectorShieldWrapper(plant) if is_shielded else plant
        env.reset(seed=100)
        seen = np.zeros(n, dtype=np.bool_)
        for _ in range(500):
            *_, info = env.step(follow(plant.unwrapped))
            seen |= info["violation"]
        violated[is_shielded] = int(seen.sum())
        final = info["final_info"]
        assert (final["rms_error"] <= final["max_error"]).all()
        # Without the shield it is on the reference, which is no success where it violates.
        assert not final["is_success"][seen].any()
    assert violated[False] >= 0.9 * n and violated[True] == 0


def line_of(plant, times):
    world = plant.unwrapped._world
    return world._following.line(world._scene_memory, 0, np.array(times))


@each_reference
def test_among_given_obstacles_the_reference_leads_there(reference):
    start, scene = (1.0, -0.5, 0.7), {"scene": 3}
    keywords = {"reference": reference, "start": start, "terminate_on_violation": False}
    free = gymnasium.make(ID, obstacles=[], **keywords)
    free.reset(options=scene)
    first, second = line_of(free, [4.0, 7.0])
    on_it = [[*first, 0.25], Box(second, (0.15, 0.2, 0.25), velocity=(0.0, 0.02, 0.0))]
    least, off = {}, {}
    for name, obstacles in (("free", []), ("among", on_it), ("shield", on_it)):
        plant = gymnasium.make(ID, obstacles=obstacles, **keywords)
        env = ShieldWrapper(plant) if name == "shield" else plant
        env.reset(options=scene)
        np.testing.assert_allclose(plant.unwrapped.reference[0], start, atol=1e-12)
        np.testing.assert_array_equal(line_of(plant, [4.0, 7.0]), [first, second])
        told = [env.step(follow(plant.unwrapped))[4] for _ in range(220)]
        least[name], off[name] = min(info["clearance"] for info in told), told[-1]["rms_error"]
    # On the reference it is inside; off it, it is clear.
    assert least["free"] == np.inf and least["among"] < -0.1 and least["shield"] > 0.0
    assert off["free"] == off["among"] < off["shield"] < 1.5


@pytest.mark.parametrize("action", ["velocity", "snap", "wrench", "rates", "attitude"])
def test_rows_are_the_single_env_bit_for_bit(action):
    n, keywords = 3, {"action": action, "reference": "minimum-snap", "terminate_on_violation": False}
    rows = VectorShieldWrapper(gymnasium.make_vec(ID, n, max_episode_steps=15, **keywords))
    singles = [ShieldWrapper(gymnasium.make(ID, max_episode_steps=15, **keywords)) for _ in range(n)]
    observations, _ = rows.reset(seed=5)
    np.testing.assert_array_equal(observations, [env.reset(seed=5 + i)[0] for i, env in enumerate(singles)])
    rng = np.random.default_rng(0)
    for k in range(20):
        actions = rng.uniform(-1, 1, (n, 4)).astype(np.float32)
        observations, rewards, *_, info = rows.step(actions)
        for i, env in enumerate(singles):
            seen, paid, _, truncated, told = env.step(actions[i])
            assert truncated == (k == 14) and paid == rewards[i]
            for key in ("tracking_error", "rms_error", "max_error", "is_success"):
                assert told[key] == info[key][i]
            if truncated:
                seen, _ = env.reset()
            np.testing.assert_array_equal(seen, observations[i])


def test_error_and_reward_are_those_of_the_documentation():
    env = gymnasium.make(ID).unwrapped
    env.reset(seed=1)
    errors = []
    for _ in range(30):
        action = env.action_space.sample()
        observation, reward, *_, info = env.step(action)
        way = env.reference[0] - env.flat_state()[0]
        errors.append(np.linalg.norm(way))
        assert info["tracking_error"] == pytest.approx(errors[-1], abs=1e-12)
        effort = float(np.square(action.astype(np.float64)).sum())
        assert reward == pytest.approx(0.1 / (1.0 + errors[-1] / 0.3) - 0.005 * effort, abs=1e-9)
        np.testing.assert_allclose(observation[:3], way / 4.0, atol=1e-6)
    assert info["rms_error"] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    assert info["max_error"] == pytest.approx(max(errors))


def test_a_snapshot_and_a_copy_go_on_alike():
    env = gymnasium.make_vec(ID, 2).unwrapped
    env.reset(seed=0)
    env.step(np.ones((2, 4), dtype=np.float32))
    other, twin = gymnasium.make_vec(ID, 2).unwrapped, copy.deepcopy(env)
    other.restore(env.snapshot())
    ahead = [one.step(np.zeros((2, 4), dtype=np.float32)) for one in (env, other, twin)]
    for one in ahead[1:]:
        np.testing.assert_array_equal(one[0], ahead[0][0])
        np.testing.assert_array_equal(one[4]["rms_error"], ahead[0][4]["rms_error"])


def test_the_reference_is_drawn():
    frames = []
    for reference in REFERENCES:
        env = gymnasium.make(ID, reference=reference, render_mode="rgb_array", render_size=96)
        env.reset(seed=0)
        frames.append(env.render())
    assert (frames[0] != frames[1]).any()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"task": "avoid", "reference": "figure-eight"}, "reference must be left out for task 'avoid'"),
        ({"task": "track", "reference": "circle"}, "reference must be one of"),
        ({"task": "track", "size": 0.1}, r"size must be in \[0.5, 10\] m, got 0.1"),
        ({"task": "track", "period": 0.0}, r"period must be in \[2, 600\] s, got 0"),
        ({"task": "track", "obstacles": [], "goal": [1, 0, 0]}, "goal must be left out for task 'track'"),
    ],
)
def test_what_is_no_reference_is_refused(keywords, message):
    with pytest.raises(ValueError, match=message):
        build_world(1, **keywords)


def test_only_track_has_a_reference():
    with pytest.raises(ValueError, match="reference must be asked of QuadSafe/Track-v0"):
        _ = gymnasium.make("QuadSafe/Avoid-v0").unwrapped.reference
