"""Flights among bodies of any kind, at rest and moving: what is measured is what the shapes themselves say."""

import copy
import math
import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from random_shapes import KINDS, random_shape
from scipy.spatial.transform import Rotation

import quadsafe_env
from quadsafe_core.shapes import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Obstacles,
    Sphere,
    shape_from,
)
from quadsafe_env.settings import TASKS
from quadsafe_env.vehicle.state import hover_state

MOVING = [kind for kind in KINDS if kind != "half_space"]
# One of each kind about the origin, where an Avoid flight starts 1.5 m away or more, most of them moving.
BODIES = [
    Sphere((0.6, 0.2, 0.1), 0.3, velocity=(0.1, 0.2, -0.1)),
    Capsule((-0.5, 0.5, -0.4), (-0.3, 0.6, 0.4), 0.1, velocity=(-0.2, 0.0, 0.1)),
    Cylinder((0.1, -0.6, -0.3), (0.1, -0.6, 0.4), 0.15),
    Box((-0.4, -0.4, 0.2), (0.3, 0.2, 0.4), Rotation.from_euler("z", 0.4), velocity=(0.3, -0.1, 0.0)),
    Hull([(0.2, 0.5, 0), (0.6, 0.7, 0), (0.3, 0.9, 0.1), (0.3, 0.6, 0.5)], 0.05, velocity=(0.0, 0.3, 0.2)),
    Ellipsoid((0.3, -0.2, -0.6), (0.1, 0.2, 0.3), velocity=(0.05, 0.0, -0.3)),
    HalfSpace((0.0, 0.0, 1.0), -2.8),
]
# One physics step between two answers.
STEPWISE = {"policy_hz": 100, "control_hz": 100, "physics_hz": 100, "terminate_on_violation": False}


def plant(name="QuadSafe/Avoid-v0", **keywords):
    return gymnasium.make(name, max_episode_steps=10**6, **keywords).unwrapped


def rows_of(n, name="QuadSafe/Avoid-v0", **keywords):
    return gymnasium.make_vec(name, n, **keywords).unwrapped


def placed(shape, shift, velocity=(0.0, 0.0, 0.0)):
    """The same body elsewhere, or moving."""
    body = shape.body()
    return type(shape).of_body(body._replace(center=body.center + shift), velocity)


def gap(shapes, r, keep_out):
    return min(float(shape.distance(r)) for shape in shapes) - keep_out


class Spy:
    """A filter that keeps what it is given, and changes nothing."""

    def __init__(self):
        self.asked, self.centers, self.velocities = [], [], []

    def filter(self, flat, obstacles, snap, period):
        self.asked.append(obstacles)
        self.centers.append(obstacles.center.copy())
        self.velocities.append(None if obstacles.velocity is None else obstacles.velocity.copy())
        return quadsafe_env.simulation.world.Passed(snap)

    def reset(self, mask):
        pass


def check_flight(env, rng, steps):
    """Fly at random; the clearances, each compared with what the shapes say of where vehicle and bodies are."""
    keep_out, found = env.params.radius, []
    for _ in range(steps):
        info = env.step(rng.uniform(-1, 1, 4).astype(np.float32))[4]
        r, shapes = env.state[:3], list(env.obstacles)
        # Sums of lengths of metres, in another order.
        assert info["clearance"] == pytest.approx(gap(shapes, r, keep_out), abs=1e-12)
        assert info["violation"] == (info["clearance"] < 0.0) and info["cost"] == float(info["violation"])
        found.append(info["clearance"])
    return np.array(found)


@pytest.mark.interpreted
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.2, -0.1, 0.3)])
@pytest.mark.parametrize("kind", KINDS)
def test_clearance_is_the_signed_distance_to_a_shape_at_every_substep(kind, velocity):
    rng = np.random.default_rng(KINDS.index(kind))
    shape, away = random_shape(rng, kind), np.full(3, 7.0)
    if kind == "half_space":
        velocity, away = (0.0, 0.0, 0.0), -8.0 * np.array(shape.normal)
    # Elsewhere than where the scene starts, and then from within the body.
    env = plant(obstacles=[placed(shape, away, velocity)], blocked=0, **STEPWISE)
    env.reset(seed=1)
    assert env.obstacles.velocity is None or any(velocity)
    for start in (env.obstacles.center[0], env.obstacles.center[0] + 2.0 * rng.normal(size=3)):
        env.state = hover_state(start, env.params)
        for _ in range(3):
            check_flight(env, rng, 5)


@pytest.mark.parametrize("name", ["QuadSafe/Avoid-v0", "QuadSafe/Forest-v0"])
def test_clearance_among_seven_kinds_is_that_of_the_nearest(name):
    env = plant(name, obstacles=BODIES, **STEPWISE)
    assert env.reset(seed=2)[1]["clearance"] == pytest.approx(
        gap(BODIES, env.state[:3], env.params.radius), abs=1e-12
    )
    rng, found = np.random.default_rng(3), []
    for _ in range(10):
        env.state = hover_state(rng.uniform(-0.8, 0.8, 3), env.params)
        found.extend(check_flight(env, rng, 40))
    # Both outside and inside.
    assert min(found) < -0.02 and max(found) > 0.05


def test_shapes_stand_where_their_velocity_has_brought_them():
    env = plant(obstacles=BODIES, physics_hz=300, control_hz=100, terminate_on_violation=False)
    env.reset(seed=0)
    assert list(env.obstacles) == BODIES and env.obstacles.keep_out == env.params.radius
    for _ in range(50):
        env.step(np.zeros(4, dtype=np.float32))
    assert env.unwrapped._world.rates.policy == 25
    for now, then in zip(env.obstacles, BODIES, strict=True):
        np.testing.assert_allclose(
            now.body().center, then.body().center + 2.0 * np.array(then.velocity), atol=1e-12
        )
        assert now.velocity == pytest.approx(then.velocity) and now.name == then.name


def test_the_slot_is_told_where_the_bodies_are_at_the_beginning_of_each_period():
    env, spy = plant(obstacles=BODIES, control_hz=50), Spy()
    env.snap_filter = spy
    env.reset(seed=0)
    start = env.obstacles.center
    for _ in range(5):
        env.step(np.zeros(4, dtype=np.float32))
    assert len(spy.asked) == 10 and all(asked is spy.asked[0] for asked in spy.asked)
    velocity = np.array([shape.velocity for shape in BODIES])
    for k, (center, told) in enumerate(zip(spy.centers, spy.velocities, strict=True)):
        np.testing.assert_allclose(center[0], start + k * 0.02 * velocity, atol=1e-12)
        np.testing.assert_array_equal(told[0], velocity)
    assert spy.asked[0].cores is not None and spy.asked[0].keep_out == env.params.radius


def test_moving_box_catches_a_vehicle_that_hovers_and_one_at_rest_does_not():
    def flown(velocity):
        env = plant(obstacles=[Box((1.5, 0, 0), (0.4, 3.0, 3.0), velocity=velocity)])
        env.reset(options={"scene": 5})
        env.state = hover_state([0.0, 0.0, 0.0], env.params)
        for step in range(1, 100):
            _, _, terminated, _, info = env.step(np.zeros(4, dtype=np.float32))
            if terminated:
                assert info["violation"] and info["cost"] == 1.0 and info["clearance"] < 0.0
                return step
        return None

    # Its face is 1.3 m away, and the vehicle less its radius.
    time = (1.3 - plant().params.radius) / 0.5
    assert flown((-0.5, 0.0, 0.0)) == math.ceil(time * 25)
    assert flown((0.0, 0.0, 0.0)) is None and flown((0.5, 0.0, 0.0)) is None


@pytest.mark.parametrize("layout", ["spheres", "surfaces"])
@pytest.mark.parametrize("conditions", [None, "randomised"])
def test_row_among_shapes_is_the_single_env_bit_for_bit(layout, conditions, monkeypatch):
    monkeypatch.setitem(TASKS, "forest", replace(TASKS["forest"], layout=layout))
    keywords = {
        "obstacles": BODIES,
        "bounds": [[-3.5] * 3, [3.5] * 3],
        "conditions": conditions,
        "terminate_on_violation": False,
    }
    n = 19  # more than a block
    rows = rows_of(n, "QuadSafe/Forest-v0", **keywords)
    singles = {i: plant("QuadSafe/Forest-v0", **keywords) for i in (0, 7, 18)}
    seen, rng = rows.reset(seed=3)[0], np.random.default_rng(4)
    for i, env in singles.items():
        np.testing.assert_array_equal(seen[i], env.reset(seed=3 + i)[0])
    for _ in range(40):
        actions = rng.uniform(-1, 1, (n, 4)).astype(np.float32)
        seen, paid, ends, _, info = rows.step(actions)
        for i, env in list(singles.items()):
            observation, reward, terminated, _, single = env.step(actions[i])
            assert (paid[i], ends[i], info["clearance"][i]) == (reward, terminated, single["clearance"])
            if terminated:
                del singles[i]
                continue
            np.testing.assert_array_equal(seen[i], observation)
            np.testing.assert_array_equal(rows.obstacles.center[i], env.obstacles.center)
    assert singles


# From within a body there is none.
@pytest.mark.filterwarnings("ignore:no way around the obstacles:UserWarning")
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.8, -0.5, 0.3)])
def test_bodies_that_are_not_measured_are_never_the_nearest(velocity, monkeypatch):
    # Starts among the bodies will do.
    monkeypatch.setattr("quadsafe_env.tasks.sources.FREE_SPACE", -math.inf)
    rng = np.random.default_rng(8)
    shapes = [random_shape(rng, kind) for kind in rng.permutation(MOVING * 3)]
    shapes = [placed(shape, 2.0 * rng.normal(size=3), velocity) for shape in shapes]
    keywords = {"obstacles": shapes, "terminate_on_violation": False}
    rows, others = rows_of(40, **keywords), rows_of(40, **keywords)
    rows.reset(seed=1)
    others.reset(seed=1)
    bound = others._world._source._parts(40).bound
    for _ in range(60):
        actions = rng.uniform(-1, 1, (40, 4)).astype(np.float32)
        # What was seen before is forgotten: all are measured.
        bound[:] = -np.inf
        expected, found = others.step(actions), rows.step(actions)
        np.testing.assert_array_equal(found[4]["clearance"], expected[4]["clearance"])
        np.testing.assert_array_equal(found[0], expected[0])
    assert not found[2].any() and np.isfinite(bound).all()


def test_spheres_at_rest_alone_fly_as_before_and_moving_ones_keep_no_cores():
    rest, moving = plant(obstacles=[[0, 0, 0, 0.4]]), plant(obstacles=[Sphere((0, 0, 0), 0.4, (0.1, 0, 0))])
    assert rest._world._source.bodies is None and moving._world._source.bodies is not None
    for env in (rest, moving):
        env.reset(seed=0)
        assert env.obstacles.cores is None
    assert rest.obstacles.velocity is None
    np.testing.assert_array_equal(moving.obstacles.velocity, [[0.1, 0, 0]])


def test_among_spheres_the_two_ways_to_fly_agree():
    rng = np.random.default_rng(1)
    spheres = [[*row, 0.25] for row in rng.uniform(-2, 2, (9, 3))]
    keywords = {"terminate_on_violation": False, "action": "snap"}
    plain = plant("QuadSafe/Forest-v0", obstacles=spheres, **keywords)
    # A wall far below is the farthest of ten, of which eight are seen.
    bodies = plant("QuadSafe/Forest-v0", obstacles=[*spheres, HalfSpace((0, 0, 1), -40.0)], **keywords)
    seen, same = plain.reset(seed=6)[0], bodies.reset(seed=6)[0]
    for _ in range(40):
        np.testing.assert_allclose(same, seen, atol=1e-6)
        action = rng.uniform(-1, 1, 4).astype(np.float32)
        (seen, *_, info), (same, *_, other) = plain.step(action), bodies.step(action)
        assert other.pop("clearance") == pytest.approx(info.pop("clearance"), abs=1e-12)
        assert other == info
    np.testing.assert_array_equal(plain.state, bodies.state)


@pytest.mark.interpreted
def test_observation_of_surfaces_is_the_way_to_them_and_their_normals(monkeypatch):
    monkeypatch.setitem(TASKS, "forest", replace(TASKS["forest"], layout="surfaces", observed_count=9))
    env = plant("QuadSafe/Forest-v0", obstacles=BODIES, terminate_on_violation=False)
    assert env.observation_space.shape == (15 + 7 * 9,)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    within = [shape.body().center for shape in BODIES[:6]]
    for r in [*within, *rng.uniform(-1.5, 1.5, (10, 3))]:
        env.state = hover_state(r, env.params)
        seen = env._world.observed()[0, 15:].reshape(9, 7).astype(float)
        order = np.argsort([float(shape.distance(r)) for shape in BODIES])
        for entries, k in zip(seen, order, strict=False):
            shape, keep_out = BODIES[k], env.params.radius
            distance = float(shape.distance(r)) - keep_out
            nearness = np.clip(1.0 - distance, 0.0, 1.0)
            assert entries[6] == pytest.approx(nearness, abs=1e-6)
            if nearness < 1e-3:
                np.testing.assert_allclose(entries, 0.0, atol=1e-3)
                continue
            way, n = 4.0 * entries[:3] / nearness, entries[3:6] / nearness
            assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-4)
            np.testing.assert_allclose(way, np.clip(-distance * n, -4.0, 4.0), atol=1e-3)
            way = -distance * n
            # Where it leads is as far from the body as is kept, and the normal leads away.
            assert shape.distance(r + way) == pytest.approx(keep_out, abs=1e-3)
            assert shape.distance(r + way + 0.01 * n) == pytest.approx(keep_out + 0.01, abs=1e-3)
        assert not seen[len(BODIES) :].any()


@pytest.mark.interpreted
def test_observation_of_bodies_as_spheres_is_about_the_nearest_point_of_the_core():
    env = plant("QuadSafe/Forest-v0", obstacles=BODIES, terminate_on_violation=False)
    env.reset(seed=0)
    keep_out, r = env.params.radius, np.array([0.9, -0.8, 0.7])
    env.state = hover_state(r, env.params)
    seen = env._world.observed()[0, 15:].reshape(8, 5)
    order = np.argsort([float(shape.distance(r)) for shape in BODIES])
    for entries, k in zip(seen, order, strict=False):
        distance, nearest = float(BODIES[k].distance(r)), BODIES[k].nearest(r)
        n, ball = (r - nearest) / distance, BODIES[k].body().radius
        np.testing.assert_allclose(4.0 * entries[:3], nearest - ball * n - r, atol=1e-5)
        assert 2.0 * entries[3] == pytest.approx(ball + keep_out, abs=1e-6) and entries[4] == 1.0
    assert not seen[7].any()


def test_bounds_are_six_walls_beside_the_task_s_own_obstacles():
    low, high = np.array([-2.2, -2.1, -1.2]), np.array([2.3, 2.4, 1.3])
    free, bounded = plant(), plant(bounds=(low, high), terminate_on_violation=False)
    keep_out, redrawn = bounded.params.radius, 0
    for scene in range(60):
        free.reset(options={"scene": scene}), bounded.reset(options={"scene": scene})
        sphere, *walls = bounded.obstacles
        assert [wall.name for wall in walls] == ["half_space"] * 6 and isinstance(sphere, Sphere)
        for r in (bounded.state[:3], bounded.goal):
            assert min((r - low).min(), (high - r).min()) >= keep_out + 0.15
        is_same = (free.goal == bounded.goal).all()
        redrawn += not is_same
        if is_same:
            np.testing.assert_array_equal(bounded.obstacles.center[0], free.obstacles.center[0])
            np.testing.assert_array_equal(bounded.obstacles.radius[0], free.obstacles.radius[0])
    assert 0 < redrawn < 60
    for axis in range(3):
        for sign in (-1.0, 1.0):
            bounded.state = hover_state(np.zeros(3), bounded.params)
            clearance = [
                bounded.step(np.array([*(sign * np.eye(3)[axis]), 0.0]))[4]["clearance"] for _ in range(60)
            ]
            r = bounded.state[:3]
            assert clearance[-1] == pytest.approx(min((r - low).min(), (high - r).min()) - keep_out, abs=1e-9)
            assert clearance[-1] < 0.0


def test_a_box_too_small_for_start_and_goal_is_refused_at_the_first_reset():
    for env in (plant(bounds=[[-1] * 3, [1] * 3]), rows_of(2, bounds=[[-1] * 3, [1] * 3])):
        with pytest.raises(ValueError, match=r"must leave start and goal 0\.15 m clear"):
            env.reset(seed=0)
    for make in (plant, lambda **keywords: rows_of(2, **keywords)):
        with pytest.raises(ValueError, match=r"must leave start and goal 0\.15 m clear"):
            make(bounds=[[-9] * 3, [9] * 3], obstacles=[[0, 0, 0, 5]])
    with pytest.raises(ValueError, match="obstacles and bounds must leave start and goal"):
        plant("QuadSafe/Flight-v0", bounds=[[-1, -2, -1], [4.1, 2, 5]]).reset()


def test_start_and_goal_are_redrawn_until_clear_of_shapes():
    slab = Box((0, 0, 0), (9, 9, 0.2))
    env = plant(obstacles=[slab])
    for scene in range(40):
        env.reset(options={"scene": scene})
        for r in (env.state[:3], env.goal):
            assert slab.distance(r) >= env.params.radius + 0.15


def test_gymnasium_checker_has_no_complaint_among_shapes_that_are_packed():
    packed = Obstacles.pack(BODIES)
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=packed, bounds=[[-4] * 3, [4] * 3])
    check_env(env.unwrapped, skip_render_check=True)
    assert env.spec is not None and env.spec.kwargs["obstacles"] == [shape.as_dict() for shape in BODIES]


def test_mixtures_of_shapes_mappings_rows_and_arrays_are_the_same_world():
    shapes = [Sphere((0, 0, 0), 0.3), Box((0.5, 0, 1), (1, 1, 0.2)), HalfSpace((0, 0, 1), -3)]
    mixed = [
        np.array([0, 0, 0, 0.3]),
        {"shape": "box", "center": [0.5, 0, 1], "size": np.array([1, 1, 0.2])},
        shapes[2],
    ]
    envs = [plant(obstacles=given) for given in (shapes, mixed, [shape.as_dict() for shape in shapes])]
    flights = []
    for env in envs:
        env.reset(seed=3)
        assert list(env.obstacles) == shapes
        flights.append([env.step(np.full(4, 0.3, dtype=np.float32))[0] for _ in range(10)])
    np.testing.assert_array_equal(flights[0], flights[1])
    np.testing.assert_array_equal(flights[0], flights[2])


@pytest.mark.parametrize("is_vector", [False, True])
def test_spec_with_shapes_goes_to_json_and_back(is_vector):
    turned = {"shape": "box", "center": (0, 1, 2), "size": [1, 1, 1], "rotation": Rotation.from_euler("x", 0.3)}
    keywords = {"obstacles": [*BODIES, [0, 0, 1.5, 0.1], turned], "bounds": (np.full(3, -4.0), np.full(3, 4.0))}
    env = rows_of(2, **keywords) if is_vector else plant(**keywords)
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec.kwargs == env.spec.kwargs
    assert [shape_from(value) for value in spec.kwargs["obstacles"]][: len(BODIES)] == BODIES
    rebuilt = (gymnasium.make_vec(spec, num_envs=2) if is_vector else gymnasium.make(spec)).unwrapped
    flights = []
    for made in (env, rebuilt):
        made.reset(seed=2)
        actions = np.full(made.action_space.shape, 0.4, dtype=np.float32)
        flights.append([made.step(actions)[0] for _ in range(20)])
        assert made.obstacles == env.obstacles
    np.testing.assert_array_equal(*flights)


def test_snapshot_holds_where_moving_bodies_are():
    rows = rows_of(5, obstacles=BODIES, conditions="randomised", terminate_on_violation=False)
    rows.reset(seed=0)
    rng = np.random.default_rng(0)
    before, after = rng.uniform(-1, 1, (2, 12, 5, 4)).astype(np.float32)

    def fly(env, actions):
        return [(*env.step(a)[:2], env.obstacles.center) for a in actions]

    fly(rows, before)
    kept, copied, pickled = rows.snapshot(), copy.deepcopy(rows), pickle.loads(pickle.dumps(rows))
    moved = rows.obstacles.center
    expected = fly(rows, after)
    assert not np.array_equal(moved, rows.obstacles.center)
    other = rows_of(5, obstacles=BODIES, conditions="randomised", terminate_on_violation=False)
    other.restore(kept)
    rows.restore(kept)
    np.testing.assert_array_equal(rows.obstacles.center, moved)
    for env in (rows, other, copied, pickled):
        for found, wanted in zip(fly(env, after), expected, strict=True):
            for a, b in zip(found, wanted, strict=True):
                np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="snapshot must be one of 5 rows in equal scenes"):
        rows_of(5, obstacles=BODIES[:6], conditions="randomised").restore(kept)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
def test_every_episode_begins_with_the_bodies_where_the_scene_has_them(mode):
    rows = rows_of(3, obstacles=BODIES, max_episode_steps=7, autoreset_mode=mode)
    home = np.array([shape.body().center for shape in BODIES])
    velocity = np.array([shape.velocity for shape in BODIES])
    rows.reset(seed=0)
    np.testing.assert_array_equal(rows.obstacles.center[1], home)
    for _ in range(6):
        assert not rows.step(np.zeros((3, 4), dtype=np.float32))[2].any()
    np.testing.assert_allclose(rows.obstacles.center[1], home + 6 / 25 * velocity, atol=1e-12)
    assert rows.step(np.zeros((3, 4), dtype=np.float32))[3].all()
    if mode == "NextStep":
        rows.step(np.zeros((3, 4), dtype=np.float32))
    if mode == "Disabled":
        rows.reset(options={"reset_mask": np.array([True, True, False])})
    np.testing.assert_array_equal(rows.obstacles.center[1], home)
    rows.state = rows.state
    np.testing.assert_array_equal(rows.obstacles.center[2], home)


def test_under_jitter_bodies_move_for_as_long_as_the_periods_last():
    rows = rows_of(6, obstacles=BODIES, conditions={"jitter": 0.6, "wind": 0.2}, terminate_on_violation=False)
    rows.reset(seed=0)
    home = np.array([shape.body().center for shape in BODIES])
    velocity = np.array([shape.velocity for shape in BODIES])
    for _ in range(20):
        info = rows.step(np.zeros((6, 4), dtype=np.float32))[4]
    flown = rows._world._weather["steps"] / 500
    assert len(set(flown)) > 1
    np.testing.assert_allclose(rows.obstacles.center, home + flown[:, None, None] * velocity, atol=1e-12)
    for i, shapes in enumerate(rows.obstacles):
        assert info["clearance"][i] <= gap(shapes, rows.state[i, :3], rows.params.radius) + 1e-12


def test_conditions_measure_the_true_distances_at_every_substep():
    keywords = {**STEPWISE, "conditions": {"position_noise": 0.05, "wind": 0.5, "delay": 1}}
    env = plant(obstacles=BODIES, **keywords)
    env.reset(seed=4)
    env.state = hover_state([0.7, 0.0, 0.0], env.params)
    found = check_flight(env, np.random.default_rng(1), 200)
    assert found.min() < 0.0 < found.max()


def test_a_row_that_crashes_leaves_its_bodies_where_they_were():
    class Wild(Spy):
        def filter(self, flat, obstacles, snap, period):
            answer = super().filter(flat, obstacles, snap, period)
            answer.snap[1] = np.nan
            return answer

    rows = rows_of(3, obstacles=BODIES, autoreset_mode="Disabled")
    rows.snap_filter = Wild()
    rows.reset(seed=0)
    info = rows.step(np.zeros((3, 4), dtype=np.float32))[4]
    assert info["crash"].tolist() == [False, True, False]
    home, now = np.array([shape.body().center for shape in BODIES]), rows.obstacles.center
    np.testing.assert_array_equal(now[1], home)
    assert not np.array_equal(now[0], home)
    assert info["clearance"][1] == pytest.approx(gap(BODIES, rows.state[1, :3], rows.params.radius), abs=1e-12)


def test_obstacles_of_an_env_are_copies():
    env = plant(obstacles=BODIES)
    env.reset(seed=0)
    before = env.obstacles
    for array in (before.center, before.radius, before.velocity, before.cores):
        array[:] = 0
    assert list(env.obstacles) == BODIES
