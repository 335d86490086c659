"""Faults: whatever comes in, what goes out is finite, and the fault is told (docs/robustness.md)."""

import math

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import quadsafe_env  # noqa: F401
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, VELOCITY, hover_state
from shields import Shield, ShieldWrapper, VectorShieldWrapper
from shields.chains.braking_arcs import BrakingBounds
from shields.filters.braking_backup import rising_periods
from shields.filters.held_rest import HeldBox, climbing_periods
from shields.methods.memory import PLANS, sampled_memory, tube_memory
from shields.slot.recorder import Recorder

NAME = "QuadSafe/Avoid-v0"
AUTHORITY = {
    "snap_max": 300.0,
    "jerk_max": 60.0,
    "specific_thrust_min": 3.0,
    "specific_thrust_max": 18.0,
    "gravity": 9.81,
}
ERRORS = {"position": 1e-3, "velocity": 1e-2, "gain": 0.01, "delay": 1, "losses": True}
SHIELDS = {
    "sampled": {},
    "cbf": {"method": "cbf"},
    "authority": {"authority": AUTHORITY},
    "told": {"uncertainty": ERRORS},
}
BAD = (math.nan, math.inf, -math.inf)
few = settings(derandomize=True, deadline=None, max_examples=60)
some = settings(derandomize=True, deadline=None, max_examples=300)


def inside(flat, center, radius):
    """Whether a vehicle is nearer to a centre than the keep-out radius."""
    return any(math.dist(flat[0], c) < r for c, r in zip(center, radius, strict=True) if r > 0.0)


def check(answer, flat, center, radius, snap, name):
    """What holds of every answer, whatever was asked."""
    assert np.isfinite(answer.snap).all()
    assert answer.in_set == (answer.value >= -1e-9)
    assert answer.intervened or np.array_equal(answer.snap, snap) or not np.isfinite(snap).all()
    assert answer.fallback or np.isfinite(snap).all()
    if name == "cbf":
        assert not answer.certified
    else:
        assert not (answer.certified and inside(flat, center, radius))
        assert answer.certified or answer.fallback
    if name == "authority":
        assert math.hypot(*answer.snap) <= AUTHORITY["snap_max"] * (1 + 1e-9)


numbers = st.floats(-1.0, 1.0)
sizes = st.sampled_from([0.0, 1e-300, 1e-12, 1e-3, 1.0, 10.0, 1e3, 1e6])


@st.composite
def triples(draw):
    return [draw(sizes) * draw(numbers) for _ in range(3)]


@st.composite
def questions(draw):
    """States and spheres of any size: at the centre, coincident, overlapping, vanishing, absent."""
    flat = np.array([draw(triples()) for _ in range(4)])
    places = st.one_of(triples(), st.just(flat[0].tolist()), st.just([1.0, 0.0, 0.0]))
    center = np.array([draw(places) for _ in range(draw(st.integers(0, 3)))]).reshape(-1, 3)
    radius = np.array([abs(draw(sizes) * draw(numbers)) for _ in center])
    snap = np.array(draw(triples()))
    if draw(st.booleans()):
        snap[draw(st.integers(0, 2))] = draw(st.sampled_from(BAD))
    velocity = np.array([draw(triples()) for _ in center]).reshape(-1, 3) if draw(st.booleans()) else None
    return flat, center, radius, snap, draw(st.sampled_from([1e-6, 1e-3, 0.02, 0.5, 1.0])), velocity


@some
@given(questions(), st.sampled_from(list(SHIELDS)))
def test_whatever_is_asked_the_answer_is_finite_and_claims_nothing_inside_a_sphere(question, name):
    flat, center, radius, snap, period, velocity = question
    if name == "cbf":
        center, radius, velocity = center[:1], radius[:1], None
    if name == "told":
        period = min(max(period, 1e-3), 0.05)
    shield = Shield(**SHIELDS[name])
    for _ in range(2):
        answer = shield.filter(flat, Obstacles.spheres(center, radius, velocity), snap, period)
        check(answer, flat, center, radius, snap, name)


@few
@given(st.lists(questions(), min_size=2, max_size=4), st.sampled_from(["sampled", "authority", "told"]))
def test_a_fault_in_one_row_is_no_fault_of_another(asked, name):
    flat, snap = np.array([q[0] for q in asked]), np.array([q[3] for q in asked])
    center, radius = np.zeros((len(asked), 3, 3)), np.zeros((len(asked), 3))
    for i, (_, own, radii, *_) in enumerate(asked):
        center[i, : len(own)], radius[i, : len(radii)] = own, radii
    together = Shield(**SHIELDS[name]).filter(flat, Obstacles.spheres(center, radius), snap, 0.02)
    for i in range(len(asked)):
        alone = Shield(**SHIELDS[name]).filter(flat[i], Obstacles.spheres(center[i], radius[i]), snap[i], 0.02)
        assert alone.snap.tobytes() == together.snap[i].tobytes()
        assert alone.facts.tobytes() == together.facts[i].tobytes()


def ask(each, flat, center, radius, snap, period=0.02):
    """The answer of a shield, or of a slot, to what was measured."""
    return each.filter(flat, Obstacles.spheres(center, radius), snap, period)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", SHIELDS)
@pytest.mark.parametrize("what", ["flat", "center", "radius"])
def test_a_measurement_that_is_not_finite_is_named_and_changes_nothing(what, name, bad):
    shield, twin = (Shield(**SHIELDS[name]) for _ in range(2))
    good = {"flat": np.zeros((4, 3)), "center": np.array([[1.0, 0, 0]]), "radius": np.array([0.5])}
    wrong = {key: array.copy() for key, array in good.items()}
    wrong[what].flat[-1] = bad
    for each in (shield, twin):
        ask(each, **good, snap=[10.0, 0, 0])
    with pytest.raises(ValueError, match=f"{what} must be finite"):
        ask(shield, **wrong, snap=[10.0, 0, 0])
    after, expected = (ask(each, **good, snap=[20.0, 0, 0]) for each in (shield, twin))
    assert after.numbers.tobytes() == expected.numbers.tobytes()


@pytest.mark.parametrize("name", SHIELDS)
@pytest.mark.parametrize("what", ["flat", "center", "radius"])
def test_a_measurement_beyond_float64_is_named(what, name):
    # Of 1e200 m the square is infinite, and from an infinite distance every sphere would be clear.
    good = {"flat": np.zeros((4, 3)), "center": np.array([[1.0, 0, 0]]), "radius": np.array([0.5])}
    good[what].flat[-1] = 1e200
    with pytest.raises(
        ValueError, match=rf"{what} must be small enough for float64 arithmetic, got up to 1e\+200"
    ):
        ask(Shield(**SHIELDS[name]), **good, snap=[10.0, 0, 0])


@pytest.mark.parametrize("period", [1e-320, 1e-120, 1e120, 1e300])
@pytest.mark.parametrize("name", SHIELDS)
def test_a_period_beyond_float64_is_named(name, period):
    with pytest.raises(ValueError, match=r"period must be (at least 1e-09 s|from 0\.0001 to 1 s|.* at most 1)"):
        Shield(**SHIELDS[name]).filter(
            np.zeros((4, 3)), Obstacles.spheres(np.zeros((0, 3)), []), np.zeros(3), period
        )


def test_gains_are_finite_or_refused_at_every_period():
    for exponent in range(-320, 309):
        try:
            gains = held_gains(4, 30.0, float(f"1e{exponent}"))
        except ValueError:
            assert not -60 < exponent < 60
        else:
            assert np.isfinite(gains).all()


def test_a_state_beyond_reason_is_answered_and_not_searched_for_ever():
    # So many periods of u_max that not every whole number of them is a float.
    bounds = BrakingBounds(1.0, 60.0, 10.0, -300.0, 300.0)
    assert rising_periods(-1e12, 0.0, bounds, 1e-9) <= 2.0**52
    none = (-math.inf,) * 3
    box = HeldBox(none, (60.0, 10.0, 1.0), -300.0, 300.0, 1e-9)
    assert climbing_periods(False, -1e12, -1e300, box) <= 2.0**52
    flat = np.array([[2.0, 0, 0], [1e16, 0, 0], [-1e20, 0, 0], [1e12, 0, 0]])
    center, radius = np.zeros((1, 3)), np.ones(1)
    answer = Shield(authority=AUTHORITY).filter(flat, Obstacles.spheres(center, radius), [100.0, 0, 0], 1e-8)
    check(answer, flat, center, radius, np.array([100.0, 0, 0]), "authority")


@pytest.mark.parametrize("name", ["sampled", "authority"])
def test_a_sphere_that_jumps_onto_the_vehicle_takes_the_certificate_with_it(name):
    shield, flat, snap = Shield(**SHIELDS[name]), np.zeros((4, 3)), np.zeros(3)
    away, here, radius = np.array([[3.0, 0, 0]]), np.array([[0.1, 0, 0]]), np.array([0.5])
    assert shield.filter(flat, Obstacles.spheres(away, radius), snap, 0.02).certified
    caught = shield.filter(flat, Obstacles.spheres(here, radius), snap, 0.02)
    assert not caught.certified and caught.fallback and not caught.in_set and caught.snap[0] < 0.0
    assert shield.filter(flat, Obstacles.spheres(away, radius), snap, 0.02).certified


@pytest.mark.parametrize("name", ["sampled", "authority"])
def test_a_sphere_that_overtakes_is_claimed_to_be_clear_only_where_it_is(name):
    shield, flat, snap = Shield(**SHIELDS[name]), np.zeros((4, 3)), np.zeros(3)
    center, velocity, radius = np.array([[-2.0, 0, 0]]), np.array([[40.0, 0, 0]]), np.array([0.5])
    told = []
    for _ in range(20):
        answer = shield.filter(flat, Obstacles.spheres(center, radius, velocity), snap, 0.02)
        check(answer, flat, center, radius, snap, name)
        told.append(bool(answer.certified))
        powers = [0.02**k / math.factorial(k) for k in range(5)]
        rows = [*flat, answer.snap]
        flat = np.array([sum(rows[i + k] * powers[k] for k in range(5 - i)) for i in range(4)])
        center = center + 0.02 * velocity
    # 40 m/s from 1.5 m away cannot be avoided; once it is past there is a stop again.
    assert not told[0] and told[-1]


def shielded(**keywords):
    return ShieldWrapper(gymnasium.make(NAME, **keywords))


def flown(env, scene, steps=5):
    """The observations of a short flight from a reset."""
    observations = [env.reset(options={"scene": scene})[0]]
    for step in range(steps):
        observations.append(env.step(np.array([1.0, -0.5, 0.25 * step, 0.1], dtype=np.float32))[0])
    return np.array(observations).tobytes()


FRESH = shielded()
CLEAN = flown(FRESH, 7)
entries = st.one_of(st.floats(-2.0, 2.0, width=32), st.sampled_from([*BAD, 3e38, -3e38, 1e-45]))


@few
@given(st.lists(st.lists(entries, min_size=4, max_size=4), min_size=1, max_size=8), st.integers(0, 99))
def test_a_pilot_that_gives_no_numbers_loses_no_episode(actions, scene):
    env = FRESH
    env.reset(options={"scene": scene})
    for action in actions:
        observation, reward, terminated, _, info = env.step(np.array(action, dtype=np.float32))
        is_bad, told = not np.isfinite(action).all(), info["shield"]
        assert (
            np.isfinite(observation).all() and math.isfinite(reward) and np.isfinite(told["snap_applied"]).all()
        )
        assert info["invalid_action"] == is_bad and not info["violation"] and not info["crash"]
        # All four control periods of the step are answered by the backup, and counted.
        assert told["fallbacks"] == 4 if is_bad else told["fallbacks"] <= 4
        assert told["fallback"] == (told["fallbacks"] > 0) and told["certified"]
        if terminated:
            break
    assert flown(env, 7) == CLEAN


@few
@given(st.lists(st.lists(entries, min_size=4, max_size=4), min_size=6, max_size=6))
def test_a_row_without_numbers_is_told_and_the_others_fly_on(actions):
    env, calm = (VectorShieldWrapper(gymnasium.make_vec(NAME, 6)) for _ in range(2))
    actions = np.array(actions, dtype=np.float32)
    good = np.isfinite(actions).all(axis=1)
    quiet = np.where(good[:, None], actions, np.float32(0.0))
    env.reset(seed=0), calm.reset(seed=0)
    for _ in range(3):
        observations, rewards, terminated, _, info = env.step(actions)
        expected = calm.step(quiet)
        assert np.isfinite(observations).all() and np.isfinite(rewards).all() and not terminated.any()
        np.testing.assert_array_equal(info["invalid_action"], ~good)
        np.testing.assert_array_equal(info["shield"]["fallbacks"][~good], 4)
        np.testing.assert_array_equal(observations[good], expected[0][good])


def test_without_a_shield_a_pilot_without_numbers_is_refused_before_the_step():
    env = gymnasium.make(NAME)
    env.reset(seed=0)
    before = env.unwrapped.state
    with pytest.raises(ValueError, match="action must be finite"):
        env.step(np.array([math.nan, 0, 0, 0], dtype=np.float32))
    np.testing.assert_array_equal(env.unwrapped.state, before)


@pytest.mark.parametrize(
    "action",
    [
        [1, 0, 0, 0],
        np.array([1, 0, 0, 0]),
        np.array([1.0, 0, 0, 0]),
        np.array([1.0, 0, 0, 0], dtype=object),
        np.array([1e300, 0, 0, 0]),
        [10**300, 0, 0, 0],
        np.array([1.0, 9, 0, 9, 0, 9, 0, 9], dtype=np.float32)[::2],
    ],
    ids=["list", "int", "float64", "object", "1e300", "large int", "strided"],
)
def test_actions_of_any_kind_of_number_are_the_same_action(action):
    env, other = (gymnasium.make(NAME).unwrapped for _ in range(2))
    env.reset(seed=0), other.reset(seed=0)
    expected = other.step(np.array([1.0, 0, 0, 0], dtype=np.float32))[0]
    np.testing.assert_array_equal(env.step(action)[0], expected)


@pytest.mark.parametrize("action", [[10**400, 0, 0, 0], "left", [0, 0, 0], np.zeros((1, 4)), [1j] * 4])
def test_what_is_no_action_is_refused_in_a_sentence(action):
    env = shielded().unwrapped
    env.reset(seed=0)
    with pytest.raises((TypeError, ValueError), match=r"^action must"):
        env.step(action)
    assert flown(env, 7) == flown(shielded().unwrapped, 7)


POSES = {
    "upright": np.eye(3),
    "on its side": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "inverted": np.diag([1.0, -1.0, -1.0]),
    "in free fall": np.eye(3),
}
SPOTS = {
    "free": ([-2.0, 0, 0], [0.0, 0, 0]),
    "outside the set": ([-0.75, 0, 0], [3.0, 0, 0]),
    "inside": ([0.1, 0, 0], [0.0, 0, 0]),
    "at the centre": ([0.0, 0, 0], [0.0, 0, 0]),
}


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("spot", SPOTS)
@pytest.mark.parametrize("settings_of", ["sampled", "authority"])
def test_wherever_and_however_it_starts_it_is_told_what_can_be_claimed(pose, spot, settings_of):
    # Two spheres at the same place, one that overlaps them, one with hardly a radius.
    spheres = [[0, 0, 0, 0.5], [0, 0, 0, 0.5], [0.2, 0, 0, 0.5], [0, 1.0, 0, 1e-6]]
    keywords = {"obstacles": spheres, "terminate_on_violation": False}
    env = ShieldWrapper(gymnasium.make(NAME, **keywords), **SHIELDS[settings_of])
    plant = env.unwrapped
    env.reset(seed=0)
    position, velocity = SPOTS[spot]
    state = hover_state(np.array(position), plant.params)
    state[VELOCITY : VELOCITY + 3], state[ATTITUDE:OMEGA] = velocity, POSES[pose].ravel()
    if pose == "in free fall":
        # A hair above the thrust at which a vehicle counts as crashed.
        state[THRUST] = 1.001 * plant.params.specific_thrust_min
    plant.state = state
    is_inside, over = spot in ("inside", "at the centre"), False
    for step in range(12):
        observation, reward, over, _, info = env.step(np.zeros(4, dtype=np.float32))
        assert np.isfinite(observation).all() and math.isfinite(reward)
        told = info["shield"]
        assert np.isfinite(told["snap_applied"]).all() and (told["certified"] or told["fallback"])
        if step == 0 and is_inside:
            assert info["cost"] == 1.0 and not told["certified"] and not told["in_set"]
        assert info["cost"] == float(info["clearance"] < 0.0)
        if over:
            break
    fresh = ShieldWrapper(gymnasium.make(NAME, **keywords), **SHIELDS[settings_of])
    assert flown(env, 7) == flown(fresh, 7)


def slot_of(name, n):
    """The slot of a shielded vector env that has flown a step, and what it is asked."""
    env = VectorShieldWrapper(gymnasium.make_vec(NAME, n), **SHIELDS[name])
    env.reset(seed=0)
    env.step(np.full((n, 4), 0.5, dtype=np.float32))
    plant = env.unwrapped
    asked = (plant.flat_state(), plant.obstacles.center, plant.obstacles.radius)
    return env, plant.snap_filter, asked, plant.control_period


@pytest.mark.parametrize("what", [0, 1, 2])
@pytest.mark.parametrize("bad", [*BAD, 1e200, -1e200])
@pytest.mark.parametrize("name", SHIELDS)
def test_a_row_that_is_measured_without_numbers_brakes_alone(name, bad, what):
    (env, slot, asked, period), (_, twin, good, _) = slot_of(name, 3), slot_of(name, 3)
    asked[what][1].flat[-1] = bad
    snap = np.full((3, 3), 5.0)
    with pytest.warns(RuntimeWarning, match="^row 1 brakes: (flat|center|radius) must be"):
        answer = ask(slot, *asked, snap, period)
    expected, others = ask(twin, *good, snap, period), [0, 2]
    assert answer.snap[others].tobytes() == expected.snap[others].tobytes()
    assert answer.facts[others].tobytes() == expected.facts[others].tobytes()
    assert np.isfinite(answer.snap).all() and answer.fallback[1] and not answer.certified[1]
    assert answer.value[1] == -np.inf and answer.obstacle[1] == -1
    # It is named once; the others go on, bit for bit, and the row is answered again when it is measured again.
    again, expected = ask(slot, *asked, snap, period), ask(twin, *good, snap, period)
    assert again.snap[others].tobytes() == expected.snap[others].tobytes()
    back = ask(slot, *good, snap, period)
    assert np.isfinite(back.snap[1]).all() and (back.certified[1] or name == "cbf")
    slot.reset(np.array([False, True, False]))
    with pytest.warns(RuntimeWarning, match="^row 1 brakes"):
        ask(slot, *asked, snap, period)
    assert np.isfinite(env.step(np.zeros((3, 4), dtype=np.float32))[0]).all()


def test_at_the_first_call_too_only_the_row_that_is_at_fault_brakes():
    env, fresh = (VectorShieldWrapper(gymnasium.make_vec(NAME, 2)) for _ in range(2))
    env.reset(seed=0), fresh.reset(seed=0)
    plant, snap = env.unwrapped, np.full((2, 3), 5.0)
    flat, center, radius = plant.flat_state(), plant.obstacles.center, plant.obstacles.radius
    expected = ask(fresh.unwrapped.snap_filter, flat, center, radius, snap, plant.control_period)
    wrong = flat.copy()
    wrong[0, 2] = np.nan
    with pytest.warns(RuntimeWarning, match="^row 0 brakes: flat must be finite"):
        answer = ask(plant.snap_filter, wrong, center, radius, snap, plant.control_period)
    assert answer.snap[1].tobytes() == expected.snap[1].tobytes() and answer.certified.tolist() == [False, True]


def test_with_a_delay_what_is_on_its_way_to_a_row_that_brakes_is_still_predicted():
    shield = Shield(uncertainty={"position": 1e-3, "delay": 2})
    recorder = Recorder(shield, 2)
    flat, center, radius = np.zeros((2, 4, 3)), np.full((2, 1, 3), 3.0), np.full((2, 1), 0.5)
    flat[:, 1, 0] = 0.5
    recorder.filter(flat, Obstacles.spheres(center, radius), np.full((2, 3), 7.0), 0.02)
    wrong = flat.copy()
    wrong[1, 0] = np.nan
    with pytest.warns(RuntimeWarning, match="^row 1 brakes"):
        braked = recorder.filter(wrong, Obstacles.spheres(center, radius), np.full((2, 3), 7.0), 0.02)
    rest = sampled_memory(shield.snapshot()["memory"], 2, 1, PLANS)[1]
    pending = tube_memory(rest, 2, 1, (2, True), PLANS).pending
    np.testing.assert_array_equal(pending[1], [[7.0] * 3, braked.snap[1]])


class Slot:
    """A filter that is not ours; ``answers`` gives its snaps, or raises."""

    def __init__(self, answers):
        self.snap, self._answers = None, answers

    def filter(self, flat, obstacles, snap, period):
        self.snap = self._answers(snap)
        return self

    def reset(self, mask):
        pass


def broken(snap):
    raise ArithmeticError("the filter of the user is broken")


@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize(
    ("answers", "error", "sentence"),
    [
        (broken, ArithmeticError, "the filter of the user is broken"),
        (lambda snap: snap[:, :2].copy(), ValueError, "snap of the filter in the slot must have shape"),
        (lambda snap: np.zeros((7, 3)), ValueError, "snap of the filter in the slot must have shape"),
        (lambda snap: snap[0], ValueError, "snap of the filter in the slot must have shape"),
        (lambda snap: None, (TypeError, ValueError), "snap of the filter in the slot must"),
    ],
)
def test_a_broken_filter_in_the_slot_is_named_and_the_next_episode_is_clean(answers, error, sentence, n):
    env = gymnasium.make_vec(NAME, n)
    env.reset(seed=0)
    env.unwrapped.snap_filter = Slot(answers)
    with pytest.raises(error, match=sentence):
        env.step(np.zeros((n, 4), dtype=np.float32))
    env.unwrapped.snap_filter, fresh = Slot(np.copy), gymnasium.make_vec(NAME, n)
    np.testing.assert_array_equal(env.reset(seed=5)[0], fresh.reset(seed=5)[0])
    actions = np.full((n, 4), 0.5, dtype=np.float32)
    np.testing.assert_array_equal(env.step(actions)[0], fresh.step(actions)[0])


@pytest.mark.parametrize("n", [1, 4])
def test_a_shield_that_raises_loses_no_episode(n, monkeypatch):
    def raises(*_, **__):
        raise FloatingPointError("out of luck")

    env = VectorShieldWrapper(gymnasium.make_vec(NAME, n, terminate_on_violation=False))
    env.reset(seed=0)
    actions = np.full((n, 4), 0.5, dtype=np.float32)
    for _ in range(10):
        env.step(actions)
    speed = np.linalg.norm(env.unwrapped.state[:, 3:6], axis=1)
    with monkeypatch.context() as broken:
        broken.setattr(env.shield, "filter", raises)
        for _ in range(60):
            with pytest.warns(RuntimeWarning, match="the shield raised .*out of luck.*every row brakes"):
                observations, rewards, terminated, _, info = env.step(actions)
            told = info["shield"]
            assert np.isfinite(observations).all() and np.isfinite(rewards).all() and not terminated.any()
            assert np.isfinite(told["snap_applied"]).all() and np.isfinite(told["correction"]).all()
            assert told["fallback"].all() and (told["fallbacks"] == 4).all() and told["intervened"].all()
            assert not told["certified"].any() and not told["in_set"].any()
            assert (told["value"] == -np.inf).all()
    assert (np.linalg.norm(env.unwrapped.state[:, 3:6], axis=1) < 0.5 * speed).all()
    # It goes on, and in the next episode what went wrong is over.
    env.step(actions)
    env.reset(seed=2)
    assert all(env.step(actions)[4]["shield"]["certified"].all() for _ in range(3))
    # At its first call something is wrong with its settings.
    env.reset(seed=1)
    fresh = VectorShieldWrapper(gymnasium.make_vec("quadsafe_env:QuadSafe/Forest-v0", n), method="cbf")
    fresh.reset(seed=0)
    with pytest.raises(ValueError, match="method 'cbf' takes one obstacle"):
        fresh.step(actions)


@pytest.mark.parametrize("bad", [*BAD, 1e300])
def test_a_filter_that_answers_no_numbers_crashes_its_row_and_no_other(bad):
    def answers(snap):
        out = snap.copy()
        out[1] = bad
        return out

    env, calm = (gymnasium.make_vec(NAME, 3) for _ in range(2))
    env.reset(seed=0), calm.reset(seed=0)
    env.unwrapped.snap_filter = Slot(answers)
    observations, rewards, terminated, _, info = env.step(np.zeros((3, 4), dtype=np.float32))
    expected = calm.step(np.zeros((3, 4), dtype=np.float32))
    assert terminated.tolist() == info["crash"].tolist() == [False, True, False]
    assert np.isfinite(observations).all() and np.isfinite(rewards).all()
    np.testing.assert_array_equal(observations[[0, 2]], expected[0][[0, 2]])


@pytest.mark.parametrize("kind", [np.float32, np.int64, object])
def test_a_filter_may_answer_with_numbers_of_any_kind(kind):
    env, plain = (gymnasium.make_vec(NAME, 2) for _ in range(2))
    env.reset(seed=0), plain.reset(seed=0)
    env.unwrapped.snap_filter = Slot(lambda snap: np.ones(snap.shape).astype(kind))
    plain.unwrapped.snap_filter = Slot(lambda snap: np.ones(snap.shape))
    actions = np.zeros((2, 4), dtype=np.float32)
    np.testing.assert_array_equal(env.step(actions)[0], plain.step(actions)[0])
