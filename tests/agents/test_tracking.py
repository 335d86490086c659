"""Minimum-snap flights and the agent that tracks them."""

from itertools import pairwise
from math import factorial

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss

import quadsafe_env  # noqa: F401 - registers the ids
from agents.tracking import MinimumSnap, Tracker, chord_times
from quadsafe_env.vehicle.state import OMEGA, VELOCITY, hover_state

WAYPOINTS = np.array([[0.0, -1.0, 0.0], [1.0, 0.5, 2.0], [2.0, -0.5, 1.0], [4.0, 1.0, 4.0]])
TIMES = np.array([0.5, 1.7, 2.6, 4.5])


def cost(path, times, perturbation=None):
    """∫ ‖r⁗ + δ⁗‖² dt by Gauss–Legendre, exact for the degrees used here."""
    return inner(path, times, perturbation, perturbation)


def inner(path, times, first, second):
    nodes, weights = leggauss(24)
    total = 0.0
    for a, b in pairwise(times):
        t = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        snap = path.at(t)[:, 4] if path is not None else 0.0
        left, right = snap + snap_of(first, t), snap + snap_of(second, t)
        total += 0.5 * (b - a) * np.sum(weights[:, None] * left * right)
    return total


def snap_of(perturbation, t):
    if perturbation is None:
        return 0.0
    return np.stack([axis.deriv(4)(t) for axis in perturbation], axis=-1)


def admissible(coefficients, times):
    """Perturbations, one polynomial an axis, that vanish at the waypoints and to third order at the ends."""
    frame = Polynomial.fromroots([*[times[0]] * 4, *times[1:-1], *[times[-1]] * 4])
    return [frame * Polynomial(c) for c in np.reshape(coefficients, (3, -1))]


def quadratic_programme(points, times):
    """Monomial coefficients (M, 8) that minimise ∫ snap² with three continuous derivatives, by KKT."""
    M = len(times) - 1
    H, rows, right = np.zeros((8 * M, 8 * M)), [], []

    def derivative(segment, order, h):
        row = np.zeros(8 * M)
        for k in range(order, 8):
            row[8 * segment + k] = factorial(k) / factorial(k - order) * h ** (k - order)
        return row

    for i, h in enumerate(np.diff(times)):
        for k in range(4, 8):
            for m in range(4, 8):
                weight = factorial(k) * factorial(m) / factorial(k - 4) / factorial(m - 4)
                H[8 * i + k, 8 * i + m] = weight * h ** (k + m - 7) / (k + m - 7)
        rows += [derivative(i, 0, 0.0), derivative(i, 0, h)]
        right += [points[i], points[i + 1]]
        for order in (1, 2, 3):
            if i + 1 < M:
                rows.append(derivative(i, order, h) - derivative(i + 1, order, 0.0))
                right.append(0.0)
    for order in (1, 2, 3):
        rows += [derivative(0, order, 0.0), derivative(M - 1, order, times[-1] - times[-2])]
        right += [0.0, 0.0]
    A = np.array(rows)
    system = np.block([[H, A.T], [A, np.zeros((len(A), len(A)))]])
    return np.linalg.solve(system, np.concatenate([np.zeros(8 * M), right]))[: 8 * M].reshape(M, 8)


def test_between_two_points_the_path_is_the_septic_polynomial():
    septic = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
    start, goal, T = WAYPOINTS[0], WAYPOINTS[-1], 3.0
    t = np.linspace(0.0, T, 41)
    motion = MinimumSnap([start, goal], [0.0, T]).at(t)
    for order in range(5):
        way = (septic.deriv(order) if order else septic)(t / T) / T**order
        expected = way[:, None] * (goal - start) + (start if order == 0 else 0.0)
        # Rounding of a degree-7 basis, relative to the largest coefficient, 840.
        np.testing.assert_allclose(motion[:, order], expected, atol=1e-10)


def test_the_path_passes_the_waypoints_and_rests_at_both_ends():
    path = MinimumSnap(WAYPOINTS, TIMES)
    np.testing.assert_allclose(path.at(TIMES)[:, 0], WAYPOINTS, atol=1e-12)
    np.testing.assert_allclose(path.at(TIMES[[0, -1]])[:, 1:4], 0.0, atol=1e-9)


def test_before_and_after_the_flight_the_path_rests():
    motion = MinimumSnap(WAYPOINTS, TIMES).at([-3.0, 0.4, 4.6, 100.0])
    np.testing.assert_allclose(motion[:, 0], WAYPOINTS[[0, 0, -1, -1]], atol=1e-12)
    assert (motion[:, 1:] == 0.0).all()


def test_derivatives_up_to_the_sixth_are_continuous_at_inner_waypoints():
    path = MinimumSnap(WAYPOINTS, TIMES)
    for i in (1, 2):
        left = fitted_snap(path, TIMES[i - 1], TIMES[i])
        right = fitted_snap(path, TIMES[i], TIMES[i + 1])
        for order in range(3):
            scale = max(abs(f.deriv(order)(TIMES[i])) for f in left) + 1.0
            for a, b in zip(left, right, strict=True):
                # Fit of a cubic through snap values: about 1e-12 of its size for each derivative taken.
                assert abs(a.deriv(order)(TIMES[i]) - b.deriv(order)(TIMES[i])) < 1e-8 * scale
        # The seventh jumps: were it continuous too, the path would be a single polynomial.
        assert max(abs(a.deriv(3)(0.0) - b.deriv(3)(0.0)) for a, b in zip(left, right, strict=True)) > 1.0
    before, after = path.at(TIMES[1:-1] - 1e-9), path.at(TIMES[1:-1])
    np.testing.assert_allclose(before[:, :4], after[:, :4], atol=1e-5)  # 1e-9 s times a snap of 1e3 m/s⁴


def fitted_snap(path, start, end):
    """The snap of one segment as three cubics; between waypoints r⁽⁸⁾ = 0 (Euler–Lagrange)."""
    t = np.linspace(start + 1e-6, end - 1e-6, 12)
    snap = path.at(t)[:, 4]
    cubics = [Polynomial.fit(t, axis, 3) for axis in snap.T]
    for cubic, axis in zip(cubics, snap.T, strict=True):
        np.testing.assert_allclose(cubic(t), axis, atol=1e-9 * (1.0 + abs(axis).max()))
    return cubics


def test_the_path_solves_the_quadratic_programme():
    path = MinimumSnap(WAYPOINTS, TIMES)
    for axis in range(3):
        coefficients = quadratic_programme(WAYPOINTS[:, axis], TIMES)
        for i in range(len(TIMES) - 1):
            h = np.linspace(0.0, 0.999, 9) * (TIMES[i + 1] - TIMES[i])
            expected = Polynomial(coefficients[i])(h)
            # The KKT matrix has a condition number of about 1e8.
            np.testing.assert_allclose(path.at(TIMES[i] + h)[:, 0, axis], expected, atol=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_no_admissible_perturbation_lowers_the_cost(coefficients):
    path = MinimumSnap(WAYPOINTS, TIMES)
    delta = admissible(coefficients, TIMES)
    least, extra = cost(path, TIMES), cost(None, TIMES, delta)
    # ∫ r⁗·δ⁗ = 0, so the costs add up; the tolerance is rounding of the sum.
    assert cost(path, TIMES, delta) == pytest.approx(least + extra, rel=1e-8)
    assert cost(path, TIMES, delta) >= least * (1.0 - 1e-8)


def test_flights_side_by_side_are_the_flights_one_by_one():
    rng = np.random.default_rng(0)
    points, time = rng.normal(size=(2, 3, 4, 3)), rng.uniform(0.0, 5.0, size=(2, 3))
    times = np.cumsum(rng.uniform(0.5, 1.5, size=(2, 3, 4)), axis=-1)
    together = MinimumSnap(points, times).at(time)
    for i in np.ndindex(2, 3):
        np.testing.assert_array_equal(together[i], MinimumSnap(points[i], times[i]).at(time[i]))


def test_chord_times_share_the_duration_by_length():
    np.testing.assert_allclose(chord_times([[0, 0, 0], [1, 0, 0], [1, 3, 0]], 8.0), [0.0, 2.0, 8.0])
    np.testing.assert_allclose(chord_times([[1, 1, 1], [1, 1, 1]], 2.0), [0.0, 2.0])


@pytest.mark.parametrize(
    ("waypoints", "times", "sentence"),
    [
        ([[0, 0, 0]], [0.0], "waypoints must be at least two"),
        ([[0, 0, 0], [1, 0, 0]], [1.0, 1.0], "times must increase"),
        ([[0, 0, 0], [1, 0, 0]], [0.0, 1.0, 2.0], "times must have shape"),
        ([[0, 0], [1, 0]], [0.0, 1.0], "waypoints must have shape"),
        ([[0, 0, np.nan], [1, 0, 0]], [0.0, 1.0], "waypoints must be finite"),
    ],
)
def test_bad_paths_are_refused(waypoints, times, sentence):
    with pytest.raises(ValueError, match=sentence):
        MinimumSnap(waypoints, times)


def flight_env(policy_hz=100, **keywords):
    env = gym.make(
        "QuadSafe/Flight-v0",
        action="snap",
        policy_hz=policy_hz,
        control_hz=policy_hz,
        terminate_on_violation=False,
        max_episode_steps=20 * policy_hz,
        **keywords,
    )
    env.reset(seed=0)
    return env


def fly(env, tracker, seconds):
    """Largest distance to the planned position, largest action, and the last flat state."""
    plant, period = env.unwrapped, 1.0 / env.unwrapped.metadata["render_fps"]
    observation, distance, action = np.zeros(20, np.float32), 0.0, 0.0
    for step in range(round(seconds / period)):
        command = tracker(observation)
        action = max(action, np.abs(command).max())
        observation = env.step(command)[0]
        planned = tracker.path.at((step + 1) * period)[0, 0]
        distance = max(distance, np.linalg.norm(plant.flat_state()[0] - planned))
    return distance, action, plant.flat_state()


@pytest.mark.parametrize("hz", [50, 100, 250, 500])
def test_tracker_follows_the_path_at_every_rate(hz):
    env = flight_env(hz)
    tracker = Tracker(env, 4.0)
    distance, action, flat = fly(env, tracker, 5.0)
    assert distance < 1e-3  # m; measured 9e-5 at 50 Hz, where the held snap is coarsest
    assert action < 1.0
    np.testing.assert_allclose(flat[0], env.unwrapped.goal, atol=1e-3)


def test_tracker_follows_a_path_through_waypoints():
    env = flight_env()
    tracker = Tracker(env, 6.0, via=[[1.0, -1.0, 2.0], [3.0, 0.0, 3.5]])
    assert fly(env, tracker, 6.5)[0] < 1e-3


@pytest.mark.parametrize("pole", [2.0, 3.0, 5.0])
def test_tracker_converges_from_beside_the_path(pole):
    env = flight_env()
    plant = env.unwrapped
    tracker = Tracker(env, 6.0, pole=pole)
    state = hover_state([0.15, -0.9, 0.1], plant.params)
    state[VELOCITY : VELOCITY + 3] = (0.1, -0.2, 0.1)
    state[OMEGA + 2] = 1.0
    plant.state = state
    _, _, flat = fly(env, tracker, 9.0)
    # e^(−2·9)(2·9)³/6 of a few tenths of a metre is below 1e-5; the yaw rate decays faster.
    np.testing.assert_allclose(flat[0], plant.goal, atol=1e-4)
    np.testing.assert_allclose(flat[1:], 0.0, atol=1e-3)
    assert abs(plant.state[OMEGA + 2]) < 1e-3


def test_the_error_decays_as_the_fourfold_pole_says():
    env = flight_env()
    plant = env.unwrapped
    plant.state = hover_state(plant.goal, plant.params)
    tracker = Tracker(env, 1.0, pole=3.0)
    plant.state = hover_state(plant.goal + np.array([0.0, 0.0, 0.2]), plant.params)
    observation = np.zeros(20, np.float32)
    for _ in range(100):
        observation = env.step(tracker(observation))[0]
    x = 3.0  # pole times one second
    left = np.exp(-x) * sum(x**k / factorial(k) for k in range(4))
    # Of a 4-fold pole, starting from an offset at rest; held at 100 Hz it differs by about half a period.
    assert plant.flat_state()[0, 2] - plant.goal[2] == pytest.approx(0.2 * left, rel=0.03)


def test_a_flight_that_is_too_fast_is_clipped_and_lags():
    env = flight_env()
    distance, action, _ = fly(env, Tracker(env, 1.5), 1.0)
    assert action > 1.0
    assert distance > 0.01


def test_rows_of_a_vector_env_fly_as_single_envs_do():
    vector = gym.make_vec("QuadSafe/Avoid-v0", 3, action="snap", policy_hz=50)
    observations, _ = vector.reset(seed=7)
    together = Tracker(vector, 3.0)
    envs = [gym.make("QuadSafe/Avoid-v0", action="snap", policy_hz=50) for _ in range(3)]
    singles = []
    for i, env in enumerate(envs):
        env.reset(seed=7 + i)
        singles.append(Tracker(env, 3.0))
    for _ in range(20):
        actions = together(observations)
        assert actions.shape == (3, 4)
        for i, env in enumerate(envs):
            action = singles[i](observations[i])
            np.testing.assert_allclose(action, actions[i], atol=1e-6)  # one rounding to float32
            env.step(action)
        observations = vector.step(actions)[0]


def test_rows_that_start_anew_are_planned_anew():
    vector = gym.make_vec("QuadSafe/Avoid-v0", 2, action="snap")
    observations, _ = vector.reset(seed=0)
    tracker = Tracker(vector, 3.0)
    for _ in range(10):
        observations = vector.step(tracker(observations))[0]
    goals = vector.unwrapped.goal
    observations, _ = vector.reset(options={"scene": [5, 6], "reset_mask": np.array([False, True])})
    action, state = tracker.predict(observations, episode_start=np.array([False, True]))
    assert action.shape == (2, 4) and state is None
    end = tracker.path.at(100.0)[:, 0]
    np.testing.assert_allclose(end, vector.unwrapped.goal, atol=1e-9)
    np.testing.assert_allclose(end[0], goals[0], atol=1e-9)
    assert np.abs(end[1] - goals[1]).max() > 1e-3


def test_one_env_behind_a_leading_axis_of_one():
    env = flight_env()
    action, _ = Tracker(env).predict(np.zeros((1, 20), np.float32), episode_start=np.array([True]))
    assert action.shape == (1, 4) and action.dtype == np.float32


def test_in_track_it_follows_the_reference():
    n, errors = 4, {}
    for reference in ("figure-eight", "minimum-snap"):
        env = gym.make_vec("QuadSafe/Track-v0", n, action="snap", reference=reference, obstacles=[])
        env.reset(seed=0)
        tracker = Tracker(env)
        for _ in range(500):
            *_, info = env.step(tracker.predict(np.zeros((n, 1)))[0])
        errors[reference] = info["final_info"]["rms_error"]
        assert info["final_info"]["is_success"].all()
    # What a snap held for a period leaves over.
    assert np.max(list(errors.values())) < 2e-3
    for name, value in (("duration", 8.0), ("via", [[0.0, 0.0, 1.0]])):
        with pytest.raises(ValueError, match=f"{name} must be left out in Track"):
            Tracker(env, **{name: value})


@pytest.mark.parametrize("action", ["velocity", "wrench"])
def test_other_interfaces_are_refused(action):
    env = gym.make("QuadSafe/Avoid-v0", action=action)
    with pytest.raises(ValueError, match="env must be a QuadSafe environment with action='snap'"):
        Tracker(env)


@pytest.mark.parametrize(("keywords", "name"), [({"duration": 0.0}, "duration"), ({"pole": -1.0}, "pole")])
def test_bad_settings_are_refused(keywords, name):
    with pytest.raises(ValueError, match=f"{name} must be"):
        Tracker(flight_env(), **keywords)
