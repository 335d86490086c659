"""Filters of others behind the door of the shield, and what they keep at their own model."""

from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest

from agents.experiment.arms import ARMS
from agents.experiment.command_line import Evaluate
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import make_vector_env, of_arm
from agents.experiment.files import read_json
from agents.experiment.runs import create_run
from agents.measure.evaluate import fly, held_out_scenes
from agents.methods import predictive
from agents.methods.geometric import GeometricFilter, braking_law, with_stop
from agents.methods.halfspaces import bodies_of, halfspace
from agents.methods.hocbf_qp import HocbfFilter
from agents.methods.horizon import BLOCK
from agents.methods.predictive import PredictiveFilter
from agents.methods.wrapper import METHODS, FilterWrapper, make_filter
from agents.policies.commands import evaluate_behind_filter
from quadsafe_core.shapes import Box, HalfSpace, Obstacles, Sphere
from shields import Shield, ShieldWrapper

PERIOD = 0.01
SETTINGS = Shield(
    held_snap_max=1000.0, jerk_max=59.0, specific_thrust_min=3.9, specific_thrust_max=22.0
).settings
needs_solver = pytest.mark.skipif(
    find_spec("daqp") is None, reason='needs daqp: pip install "quadsafe[methods]"'
)
NAMES = ("geometric", *(pytest.param(name, marks=needs_solver) for name in ("hocbf", "predictive")))
SPHERE = Obstacles.pack([[Sphere((0.0, 0.0, 0.0), 0.4)]], keep_out=0.1)


class Attack:
    """Flies at the middle of the sphere."""

    def __init__(self, env):
        self._plant = env.unwrapped

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        away = self._plant.obstacles.center[:, 0] - self._plant.flat_state()[:, 0]
        actions = np.zeros((len(away), 4), dtype=np.float32)
        actions[:, :3] = away / np.linalg.norm(away, axis=1)[:, None]
        return actions, None


def attacked(settings):
    """Episodes of two seconds of attacks, and the env."""
    scenes = held_out_scenes(4)
    experiment = Experiment(shield=settings, env_kwargs={"max_episode_steps": 50})
    env = make_vector_env(experiment, len(scenes), settings is not None)
    return fly(Attack(env), env, scenes), env


@pytest.mark.parametrize("name", NAMES)
def test_an_attack_ends_at_the_filter_and_without_it_in_the_sphere(name):
    episodes, env = attacked({"filter": name})
    assert not episodes["violation"].any() and (episodes["interventions"] > 0).all()
    counts = env.shield.counts()
    # Of one sphere the HOCBF-QP is known in closed form, and braking needs no solver.
    assert counts["calls"] >= 800 and (counts["solver_calls"] > 0) == (name == "predictive")
    assert counts["solver_failures"] <= 0.01 * counts["calls"] and counts["solver_calls"] <= counts["calls"]
    assert (counts["microseconds_per_call"] is None) == (counts["solver_calls"] == 0)


def test_without_a_filter_the_same_attack_collides():
    assert attacked(None)[0]["violation"].all()


@pytest.mark.parametrize("name", NAMES)
def test_is_told_as_the_shield_is(name):
    def told(wrapper, *given):
        env = wrapper(gymnasium.make("QuadSafe/Avoid-v0"), *given)
        env.reset(seed=0)
        return env.step(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32))[4]["shield"]

    own, shield = told(FilterWrapper, name), told(ShieldWrapper)
    assert own.keys() == shield.keys() and {key: type(value) for key, value in own.items()} == {
        key: type(value) for key, value in shield.items()
    }
    assert shield["certified"] and not own["certified"] and own["fallbacks"] == 0 and own["in_set"]


@pytest.mark.parametrize("name", NAMES)
def test_a_snap_that_needs_no_correction_comes_back_bit_for_bit(name):
    snap = np.array([[0.1, -0.2, 0.3]])
    answer = METHODS[name](SETTINGS).filter(at((-3.0, 0.0, 0.0)), SPHERE, snap, PERIOD)
    assert answer.snap.tobytes() == snap.tobytes() and not answer.intervened[0]
    assert answer.value[0] == pytest.approx(2.5) and answer.obstacle[0] == -1


@pytest.mark.parametrize("name", NAMES)
def test_flies_among_the_bodies_of_a_room_and_goes_on_from_a_snapshot(name):
    env = gymnasium.make_vec("QuadSafe/Rooms-v0", 2)
    env.reset(seed=3)
    plant = env.unwrapped
    flat = plant.flat_state()
    flat[:, 1] = [[1.0, 0.5, 0.0], [-1.0, 0.0, 0.2]]
    flown = make_filter(name, plant, {})
    for _ in range(5):
        flown.filter(flat, plant.obstacles, np.full((2, 3), 50.0), PERIOD)
    other = make_filter(name, plant, {})
    other.restore(flown.snapshot())
    both = [one.filter(flat, plant.obstacles, np.full((2, 3), 90.0), PERIOD).numbers for one in (flown, other)]
    assert np.array_equal(*both) and flown.counts().keys() == other.counts().keys()


def test_an_answer_that_is_on_its_way_is_known_to_who_is_told():
    """With three periods of delay who is not told brakes too late."""
    least, snap = {}, np.array([[50.0, 0.0, 0.0]])
    for delay in (0, 3):
        told = Shield(uncertainty={"delay": delay, "snap": 1.0}).settings
        found, state = GeometricFilter(told, pole=4.0, margin=0.0), at((-2.0, 0.0, 0.0), v=(1.5, 0.0, 0.0))[0]
        line, gaps = [np.zeros(3)] * 3, []
        for _ in range(250):
            line.append(found.filter(state[None], SPHERE, snap, PERIOD).snap[0])
            state = reflown(state, line.pop(0)[None])[-1]
            gaps.append(np.linalg.norm(state[0]) - 0.5)
        least[delay] = min(gaps)
    assert least[0] < -0.01 and 0.0 < least[3] < 0.1


def test_a_snap_that_is_no_number_is_answered_by_braking():
    flat = at((-3.0, 0.0, 0.0), v=(1.0, 0.0, 0.0))
    answer = GeometricFilter(SETTINGS).filter(flat, SPHERE, np.full((1, 3), np.nan), PERIOD)
    assert answer.fallback[0] and answer.snap[0, 0] < 0.0 and not answer.snap[0, 1:].any()
    with pytest.raises(ValueError, match="flat and obstacles must be finite"):
        GeometricFilter(SETTINGS).filter(np.full((1, 4, 3), np.nan), SPHERE, np.zeros((1, 3)), PERIOD)


def test_half_spaces_are_those_at_the_nearest_point_of_a_body_where_it_will_be():
    box, ball = Box((1.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Sphere((0.0, 3.0, 0.0), 0.5, velocity=(0.0, -1.0, 0.0))
    bodies = bodies_of(Obstacles.pack([[box, ball]], keep_out=0.1))
    point = (-1.0, 0.0, 0.0)
    n, c = halfspace(bodies, 0, 0, point, 2.0)
    assert n == pytest.approx((-1.0, 0.0, 0.0)) and c == pytest.approx(-0.5 + 0.1)
    # In two seconds the ball is at (0, 1, 0).
    n, c = halfspace(bodies, 0, 1, point, 2.0)
    assert np.dot(n, point) - c == pytest.approx(np.sqrt(2.0) - 0.6)


@needs_solver
def test_hocbf_of_a_wall_is_what_a_hand_computes():
    """p = 2, h = 1, v = −1: u ≥ −(4 p³ v + p⁴ h) = 32 − 16."""
    wall = Obstacles.pack([[HalfSpace((1.0, 0.0, 0.0), 0.0)]])
    found = HocbfFilter(SETTINGS, gain=2.0, margin=0.0)
    answer = found.filter(at((1.0, 0.0, 0.0), v=(-1.0, 0.0, 0.0)), wall, np.array([[0.0, 5.0, -7.0]]), PERIOD)
    assert answer.snap[0] == pytest.approx([16.0, 5.0, -7.0], abs=1e-5) and found.solver_failures == 0


@needs_solver
def test_hocbf_keeps_its_constraint_for_spheres_that_move():
    """(d/dt + p)⁴ h of h(t) = ‖ρ(t)‖² − D², by the coefficients of the polynomial."""
    rng, p, D = np.random.default_rng(0), 4.0, 0.5 + 0.01
    found, kept, asked = HocbfFilter(SETTINGS, gain=p, margin=0.01), [], []
    for _ in range(50):
        flat = np.stack([rng.normal(size=3) * scale for scale in (1.0, 1.0, 2.0, 5.0)])
        flat[0] *= max(1.0, 0.6 / np.linalg.norm(flat[0]))
        velocity, snap = rng.normal(size=3), 100.0 * rng.normal(size=3)
        moving = Obstacles.pack([[Sphere((0.0, 0.0, 0.0), 0.4, velocity=tuple(velocity))]], keep_out=0.1)
        before = found.solver_failures
        answer = found.filter(flat[None], moving, snap[None], PERIOD)
        asked.append(barrier(flat, velocity, snap, (p, D)))
        if found.solver_failures == before:
            kept.append(barrier(flat, velocity, answer.snap[0], (p, D)))
    assert min(kept) > -1e-2 and min(asked) < -100.0 and len(kept) > 30


@needs_solver
def test_hocbf_without_a_solution_is_counted_and_violates_least():
    found = HocbfFilter(SETTINGS)
    flat = at((-0.6, 0.0, 0.0))
    flat[0, 3, 0] = 1000.0
    answer = found.filter(flat, SPHERE, np.zeros((1, 3)), PERIOD)
    assert found.solver_failures == 1 and answer.fallback[0]
    assert answer.snap[0, 0] == pytest.approx(-found.largest)


@needs_solver
def test_the_plan_of_the_predictive_filter_is_free_and_ends_at_rest():
    found = PredictiveFilter(SETTINGS)
    flat, snap = at((-1.3, 0.05, 0.0), v=(1.2, 0.0, 0.0)), np.array([[300.0, 0.0, 0.0]])
    for _ in range(40):
        answer = found.filter(flat, SPHERE, snap, PERIOD)
        plan = found.plans[0]
        assert plan[0] == pytest.approx(answer.snap[0], abs=1e-9)
        states = reflown(flat[0], plan)
        assert np.abs(plan).max() <= found.limits.snap * (1.0 + 1e-4)
        assert np.abs(states[-1, 1:]).max() < 1e-5
        assert np.linalg.norm(states[:, 0], axis=1).min() > 0.5
        assert np.abs(states[:, 2]).max() <= found.limits.acceleration + 0.05
        flat = reflown(flat[0], plan[:1])[-1:]
    assert found.solver_calls > 10 and found.solver_failures == 0
    # The counter-case: what is desired leads in.
    states = reflown(at((-1.3, 0.05, 0.0), v=(1.2, 0.0, 0.0))[0], np.tile(snap, (60, 1)))
    assert np.linalg.norm(states[:, 0], axis=1).min() < 0.5


@needs_solver
@pytest.mark.parametrize("lie", [None, 1e3])
def test_where_the_solver_fails_or_lies_the_plan_before_is_flown(lie, monkeypatch):
    found, flat = PredictiveFilter(SETTINGS), at((-1.3, 0.0, 0.0), v=(1.2, 0.0, 0.0))
    snap = np.array([[300.0, 0.0, 0.0]])
    for _ in range(40):
        answer = found.filter(flat, SPHERE, snap, PERIOD)
        before = found.plans[0].copy()
        flat = reflown(flat[0], answer.snap)[-1:]
    assert found.solver_calls > 0 and found.solver_failures == 0
    monkeypatch.setattr(
        predictive, "solved", lambda H, f, *bounds: None if lie is None else np.full(len(f), lie)
    )
    for periods in range(1, 2 * BLOCK):
        answer = found.filter(flat, SPHERE, snap, PERIOD)
        assert found.solver_failures == periods and answer.fallback[0]
        assert answer.snap[0] == pytest.approx(before[periods], abs=1e-6 * found.limits.snap)
        flat = reflown(flat[0], answer.snap)[-1:]


@needs_solver
def test_no_plan_to_rest_is_counted():
    found = PredictiveFilter(SETTINGS)
    answer = found.filter(at((-0.7, 0.0, 0.0), v=(9.0, 0.0, 0.0)), SPHERE, np.zeros((1, 3)), PERIOD)
    assert found.solver_failures == 1 and answer.fallback[0] and np.isfinite(answer.snap).all()


def test_braking_ends_where_the_geometric_backup_says():
    flat = np.stack([[0.0, 1.0, 2.0], [1.0, -2.0, 0.5], [0.3, 2.0, -1.0], [4.0, -3.0, 0.0]])[None]
    gains, distance = braking_law(4.0, PERIOD)
    stop, state = with_stop(flat, distance)[0, 1], flat[0]
    for _ in range(600):
        state = reflown(state, -(gains @ state[1:])[None])[-1]
    assert state[0] == pytest.approx(stop, abs=1e-6) and np.abs(state[1:]).max() < 1e-5


@pytest.mark.parametrize("name", ["hocbf", "predictive", "geometric"])
def test_the_arm_of_a_filter_flies_with_it_and_is_told_what_a_shield_is(name):
    experiment = Experiment(shield={"alpha": 4.0, "inner_loop": "measured", "method": "sampled"})
    found = of_arm(experiment, ARMS[name])
    assert found.shield == {"filter": name, "inner_loop": "measured"} and ARMS[name].is_shielded


def test_the_agents_of_a_run_are_flown_behind_a_filter_that_they_did_not_learn_with(tmp_path):
    run = create_run(Experiment(arms=("random",), eval_episodes=4), Options(log_folder=tmp_path), {})
    told = evaluate_behind_filter(Evaluate(run=str(run.folder), filter="geometric"))
    assert told.splitlines()[0] == "4 held-out scenes behind geometric"
    assert told.splitlines()[2].split()[:5] == ["random", "actions", "geometric", "0", "of"]
    folder = run.folder_of("random", 0)
    assert {path.name for path in folder.iterdir()} == {"flights_geometric.csv", "solver_geometric.json"}
    counts = read_json(folder / "solver_geometric.json")
    assert counts["calls"] > counts["solver_calls"] and counts["solver_failures"] == 0


def test_a_filter_that_there_is_not_is_refused():
    with pytest.raises(
        ValueError, match="filter must be one of 'hocbf', 'predictive', 'geometric', got 'hcbf'"
    ):
        make_vector_env(Experiment(shield={"filter": "hcbf"}), 1, True)
    with pytest.raises(ValueError, match="threads must be 1 behind a filter, got 2"):
        make_vector_env(Experiment(shield={"filter": "geometric"}, env_kwargs={"threads": 2}), 32, True)


def at(r, v=(0.0, 0.0, 0.0)):
    """The flat state (1, 4, 3) of a vehicle without acceleration."""
    return np.array([[r, v, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]])


def reflown(state, snaps):
    """States (T, 4, 3) at the ends of the periods of snaps (T, 3)."""
    states = []
    for u in snaps:
        r, v, a, j = state
        t = PERIOD
        state = np.stack(
            [
                r + t * v + t**2 / 2 * a + t**3 / 6 * j + t**4 / 24 * u,
                v + t * a + t**2 / 2 * j + t**3 / 6 * u,
                a + t * j + t**2 / 2 * u,
                j + t * u,
            ]
        )
        states.append(state)
    return np.array(states)


def barrier(flat, velocity, snap, tuned):
    """(d/dt + p)⁴ of ‖ρ‖² − D² at 0, over twice the length of ρ."""
    p, D = tuned
    h = np.polynomial.Polynomial([-D * D])
    for i in range(3):
        along = np.polynomial.Polynomial(
            [flat[0, i], flat[1, i] - velocity[i], flat[2, i] / 2, flat[3, i] / 6, snap[i] / 24]
        )
        h = h + along**2
    for _ in range(4):
        h = h.deriv() + p * h
    return h(0.0) / (2.0 * np.linalg.norm(flat[0]))
