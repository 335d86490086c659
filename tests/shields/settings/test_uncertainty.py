"""Declared errors: the tube that holds them, the shield that counts on it, and attacks within the bounds."""

import importlib
import json
from math import comb

import gymnasium
import numpy as np
import pytest
from house import ROOT

from quadsafe_core.authority import Authority
from quadsafe_core.shapes import Obstacles
from shields import Shield, ShieldWrapper, Uncertainty, VectorShieldWrapper
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.chain import chain_over, control_points
from shields.settings.tube import MOST_TAKEN, predicted_error, share_taken, tube_at, tube_of, wrong_in
from shields.settings.uncertainty import checked_uncertainty

LIMITS = FlightLimits(600.0, 600.0, np.inf, ThrustBand(1.0, np.inf, 9.81))
VEHICLE = Authority(
    snap_max=380.0, jerk_max=44.0, specific_thrust_min=5.2, specific_thrust_max=20.0, gravity=9.81
)
ALL = Uncertainty(0.003, 0.01, 0.05, 0.3, 5.0, 0.02, 0.1, 1, True)
KINDS = {
    "estimate": Uncertainty(position=0.01, velocity=0.03, acceleration=0.1, jerk=0.5),
    "snap": Uncertainty(snap=20.0),
    "gain": Uncertainty(gain=0.05),
    "wind": Uncertainty(wind=0.3),
    "delay": Uncertainty(delay=1),
    "losses": Uncertainty(losses=True),
    "lag": Uncertainty(rotor_lag=0.072),
    "lag in an interval": Uncertainty(rotor_lag=(0.036, 0.039)),
    "pushes": Uncertainty(impulse=0.2, impulse_gap=0.5),
    "jitter": Uncertainty(jitter=0.1),
    "all": ALL,
    "all late": ALL._replace(rotor_lag=0.0375),
}


@pytest.fixture(scope="module")
def flights():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        yield importlib.import_module("uncertain.chain_flights")


def moved(x, snap, t):
    """Flat states (…, 4, 3) after a time."""
    step, b = chain_over(t)
    return np.einsum("ij,...jk->...ik", step, x) + b[:, None] * np.asarray(snap)[..., None, :]


@pytest.mark.interpreted
def test_control_points_are_those_of_the_path():
    rng = np.random.default_rng(0)
    of_state, of_snap = control_points(0.05)
    x, snap = rng.normal(size=4), 100.0
    for share in (0.0, 0.3, 1.0):
        after = moved(x[:, None] * np.ones(3), np.full(3, snap), 0.05 * share)[:, 0] if share else x
        for derivative, (s, u) in enumerate(zip(of_state, of_snap, strict=True)):
            degree = len(u) - 1
            bernstein = [comb(degree, i) * share**i * (1 - share) ** (degree - i) for i in range(degree + 1)]
            assert np.dot(bernstein, s @ x + u * snap) == pytest.approx(after[derivative], rel=1e-12)


def deviations(tube, period, noise, push, wind):
    """Deviations (looks, M, 4) of M chains, period by period: one without feedback, then with it."""
    times = np.linspace(0.0, period, 9)
    steps, inputs = zip(*(chain_over(t) for t in times[1:]), strict=True)
    e = -noise[0]
    for m in range(len(noise)):
        u = -(e + noise[m]) @ tube.gains if m else np.zeros(len(e))
        drift = np.stack([times**2 / 2, times, 0 * times, 0 * times], axis=1)[:, None] * wind[m][:, None]
        held = [e @ step.T + np.multiply.outer(u + push[m], b) for step, b in zip(steps, inputs, strict=True)]
        path = np.array([e, *held]) + drift
        yield path
        e = path[-1]


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.02, 0.005])
@pytest.mark.parametrize("kind", ["estimate", "snap", "wind", "all"])
def test_no_error_within_the_bounds_leaves_the_tube_and_the_worst_reach_its_side(kind, period):
    uncertainty, rng = KINDS[kind]._replace(delay=0, gain=0.0), np.random.default_rng(1)
    tube, steps = tube_of(uncertainty, period, LIMITS), round(2.0 / period)
    sizes = np.array([*uncertainty[:5], uncertainty.wind])
    signs = rng.choice([-1.0, 1.0], (steps, 60, 6))
    signs[:, ::2] = signs[0, ::2]
    errors = sizes * signs
    paths = deviations(tube, period, errors[..., :4], errors[..., 4], errors[..., 5])
    largest = np.max([np.abs(path).max(axis=(0, 1)) for path in paths], axis=0)
    assert (largest <= tube.deviation * (1 + 1e-9)).all()
    # The worst signs, for every derivative: what each error of each period does alone to the last period.
    alone = np.zeros((steps, steps, 6, 6))
    alone[np.arange(steps), np.arange(steps)] = np.eye(6)
    alone = alone.reshape(steps, 6 * steps, 6)
    *_, last = deviations(tube, period, alone[..., :4], alone[..., 4], alone[..., 5])
    reached = np.einsum("lmek,e->lk", np.abs(last).reshape(-1, steps, 6, 4), sizes).max(axis=0)
    assert (reached <= tube.deviation * (1 + 1e-9)).all()
    # The sides are those of control points, and of a push that may change within a period.
    assert reached[0] >= 0.99 * tube.deviation[0] and (reached >= 0.7 * tube.deviation).all()


@pytest.mark.interpreted
def test_the_error_ahead_is_that_of_the_chain():
    bounds, period = Uncertainty(0.01, 0.02, 0.3, 4.0, snap=10.0, gain=0.1, wind=0.2, delay=3), 0.02
    error, added = predicted_error(bounds, period, 50.0)
    # The chain is monotone: the largest error is that of the largest entries.
    x = np.array(bounds[:4])[:, None] * np.ones(3)
    for _ in range(3):
        x = moved(x, np.full(3, 15.0), period) + 0.2 * np.array([period**2 / 2, period, 0, 0])[:, None]
    np.testing.assert_allclose(error, x[:, 0], rtol=1e-12)
    np.testing.assert_allclose(added[3], 15.0 * period, rtol=1e-12)


@pytest.mark.parametrize("declared", [Uncertainty(), {}, {"wind": 0.0, "rotor_lag": 0.0}, None])
def test_no_uncertainty_is_the_same_shield_bit_for_bit(declared, flights):
    assert Shield(uncertainty=declared).settings == Shield().settings
    plain, told = (
        flights.fly(given, Uncertainty(), 50, 20, 0) for given in (None, Uncertainty(position=1e-300))
    )
    assert plain.violated_steps == told.violated_steps == 0
    if declared is not None:
        same = flights.fly(checked_uncertainty(declared), Uncertainty(), 50, 20, 0)
        assert same.clearance.tobytes() == plain.clearance.tobytes()


@pytest.mark.parametrize("rate", [50, 200])
@pytest.mark.parametrize("kind", KINDS)
def test_attacks_within_the_bounds_find_nothing(kind, rate, flights):
    found = flights.fly(KINDS[kind], KINDS[kind], rate, 40, 3)
    assert (found.violated_steps, found.uncertified) == (0, 0)
    # It was attacked: the shield had to act, and some came near.
    assert found.changed > 0.2 * found.steps and found.clearance.min() < 0.1


@pytest.mark.parametrize("kind", ["estimate", "delay", "losses", "lag", "lag in an interval", "pushes", "all"])
def test_a_shield_that_is_not_told_lets_them_through(kind, flights):
    assert flights.fly(None, KINDS[kind], 50, 100, 0).violated_episodes > 0


def test_errors_six_times_as_large_as_declared_get_through(flights):
    actual = flights.scaled(KINDS["estimate"], 6.0)
    assert flights.fly(KINDS["estimate"], actual, 50, 100, 0).violated_episodes > 0


def test_within_an_authority_the_vehicle_keeps_to_it_despite_the_errors():
    bounds, period, rng = Uncertainty(0.002, 0.01, 0.05, 0.3, snap=5.0), 0.01, np.random.default_rng(4)
    shield, n = Shield(authority=VEHICLE, uncertainty=bounds), 24
    x = np.zeros((n, 4, 3))
    x[:, 0, 0] = -2.0
    center, radius = np.zeros((n, 1, 3)), np.full((n, 1), 0.5)
    up = np.array([0.0, 0.0, VEHICLE.gravity])
    for _ in range(400):
        signs = rng.choice([-1.0, 1.0], (n, 5, 1)) * (rng.normal(size=(n, 1, 3)) @ np.eye(3))
        signs /= np.linalg.norm(signs, axis=2, keepdims=True)
        wish = 400 * (np.array([2.0, 0, 0]) - x[:, 0]) - 320 * x[:, 1] - 96 * x[:, 2] - 14 * x[:, 3]
        estimate = x + np.array(bounds[:4])[:, None] * signs[:, :4]
        answer = shield.filter(estimate, Obstacles.spheres(center, radius), 10 * wish, period)
        assert answer.certified.all()
        assert np.linalg.norm(answer.snap, axis=1).max() <= VEHICLE.snap_max * (1 + 1e-12)
        x = moved(x, answer.snap + bounds.snap * signs[:, 4], period)
        thrust = np.linalg.norm(x[:, 2] + up, axis=1)
        assert VEHICLE.specific_thrust_min <= thrust.min() and thrust.max() <= VEHICLE.specific_thrust_max
        assert np.linalg.norm(x[:, 3], axis=1).max() <= VEHICLE.jerk_max
        assert np.linalg.norm(x[:, 0], axis=1).min() >= 0.5


@pytest.mark.interpreted
@pytest.mark.parametrize("delay", [1, 3])
def test_with_a_delay_the_answer_is_that_for_the_state_at_which_it_is_flown(delay):
    rng, period = np.random.default_rng(5), 0.05
    delayed, prompt = Shield(uncertainty={"delay": delay}), Shield()
    x = np.zeros((6, 4, 3))
    x[:, 0] = rng.normal(size=(6, 3)) + np.array([2.0, 0, 0])
    center, radius = np.zeros((6, 2, 3)), np.array([[0.5, 0.3]] * 6)
    center[:, 1] = [0.0, 1.0, 0.0]
    velocity = np.zeros((6, 2, 3))
    velocity[:, 1] = [0.1, 0.0, -0.2]
    queue, later = [np.zeros((6, 3))] * delay, x
    for _ in range(delay):
        later = moved(later, np.zeros((6, 3)), period)
    for step in range(60):
        wish = (
            -80 * later[:, 0]
            - 100 * later[:, 1]
            - 48 * later[:, 2]
            - 10 * later[:, 3]
            + rng.normal(size=(6, 3)) * 50
        )
        now = delayed.filter(
            x, Obstacles.spheres(center + step * period * velocity, radius, velocity), wish, period
        )
        ahead = center + (step + delay) * period * velocity
        then = prompt.filter(later, Obstacles.spheres(ahead, radius, velocity), wish, period)
        np.testing.assert_allclose(now.snap, then.snap, rtol=1e-6, atol=1e-6)
        queue.append(now.snap)
        x, later = moved(x, queue.pop(0), period), moved(later, now.snap, period)
    assert now.certified.all() and np.linalg.norm(x[:, 0], axis=1).max() < 5.0


@pytest.mark.interpreted
def test_lost_for_good_the_vehicle_stops_and_rests():
    shield, period = Shield(uncertainty={"losses": True}), 0.02
    x, center, radius = np.zeros((4, 3)), np.array([[1.5, 0.0, 0.0]]), np.array([0.5])
    for step in range(400):
        answer = shield.filter(
            x, Obstacles.spheres(center, radius), np.array([150.0, 20.0, 0.0]) - 10 * x[1] - 5 * x[3], period
        )
        is_lost = step >= 60
        x = moved(x, shield.backup(np.True_) if is_lost else answer.snap, period)
        assert np.linalg.norm(x[0] - center[0]) >= 0.5 and answer.certified
        if step == 59:
            assert np.linalg.norm(x[1]) > 0.3
    assert np.abs(x[1:]).max() < 1e-9


@pytest.mark.parametrize("wanted", [-100.0, np.nan])
def test_a_start_with_more_jerk_than_the_vehicle_has_is_not_certified_until_it_has_gone(wanted):
    shield, period, certified = Shield(authority=VEHICLE, uncertainty={"wind": 1e-3}), 0.05, []
    x, center, radius = np.zeros((4, 3)), np.full((1, 3), 50.0), np.array([0.5])
    x[3, 0] = 50.0
    for _ in range(20):
        answer = shield.filter(x, Obstacles.spheres(center, radius), np.full(3, wanted), period)
        certified.append(bool(answer.certified))
        assert not answer.certified or np.linalg.norm(x[3]) <= VEHICLE.jerk_max
        x = moved(x, answer.snap, period)
    assert not certified[0] and certified[-1] and certified == sorted(certified)


def test_with_a_gain_no_backup_is_longer_than_the_snap_that_its_bound_counts_on():
    shield = Shield(uncertainty={"gain": 0.05, "losses": True})
    x, args = np.zeros((4, 3)), (Obstacles.spheres(np.full((1, 3), 50.0), np.array([0.5])), np.zeros(3), 0.02)
    shield.filter(x, *args)
    # Far off its stop, by an error beyond the bounds.
    x[0] = 1.0
    shield.filter(x, *args)
    assert np.linalg.norm(shield.backup(np.True_)) <= 600.0 * (1 + 1e-12)


@pytest.mark.interpreted
def test_losses_of_one_row_do_not_touch_another():
    shields = [Shield(uncertainty={"losses": True}) for _ in range(2)]
    x = np.zeros((2, 4, 3))
    x[:, 0] = [[-1.0, 0, 0], [0, 1.2, 0]]
    center, radius, snap = np.zeros((2, 1, 3)), np.full((2, 1), 0.4), np.array([[90.0, 0, 0], [0, -90.0, 3.0]])
    for step in range(40):
        one, both = (shield.filter(x, Obstacles.spheres(center, radius), snap, 0.02) for shield in shields)
        np.testing.assert_array_equal(one.snap[1], both.snap[1])
        mask = np.array([step % 3 == 1, False])
        instead = shields[1].backup(mask)
        assert not instead[1].any()
        x = np.stack(
            [moved(x[0], instead[0] if mask[0] else both.snap[0], 0.02), moved(x[1], both.snap[1], 0.02)]
        )
    assert both.certified.all()


@pytest.mark.interpreted
def test_a_vehicle_that_was_told_nothing_yet_rests_or_brakes():
    shield = Shield(uncertainty={"losses": True, "delay": 2})
    shield.filter(
        np.zeros((4, 3)), Obstacles.spheres(np.full((1, 3), 2.0), np.array([0.5])), np.full(3, 50.0), 0.02
    )
    assert not shield.backup(np.True_).any()
    x, center, radius = np.zeros((4, 3)), np.full((1, 3), 50.0), np.array([0.5])
    x[1, 0] = 3.0
    late = Shield(uncertainty={"losses": True})
    for _ in range(300):
        late.reset()
        late.filter(x, Obstacles.spheres(center, radius), np.full(3, 50.0), 0.02)
        x = moved(x, late.backup(np.True_), 0.02)
    assert np.linalg.norm(x[1]) < 0.01


@pytest.mark.interpreted
def test_a_second_backup_in_a_period_is_the_same():
    once, twice = Shield(uncertainty=ALL), Shield(uncertainty=ALL)
    x, center, radius = np.zeros((4, 3)), np.full((1, 3), 2.0), np.array([0.5])
    for step in range(30):
        for shield in (once, twice):
            shield.filter(x, Obstacles.spheres(center, radius), np.full(3, 50.0), 0.02)
        if step % 3 == 2:
            first = once.backup(np.True_)
            twice.backup(np.True_)
            np.testing.assert_array_equal(twice.backup(np.True_), first)
    np.testing.assert_array_equal(once.snapshot()["memory"], twice.snapshot()["memory"])


@pytest.mark.interpreted
def test_reset_forgets_what_was_on_its_way():
    spheres = Obstacles.spheres(np.full((2, 1, 3), 2.0), np.full((2, 1), 0.5))
    args = (np.zeros((2, 4, 3)), spheres, np.full((2, 3), 50.0), 0.02)
    shield, fresh = Shield(uncertainty=ALL), Shield(uncertainty=ALL)
    for _ in range(3):
        shield.filter(*args)
    used = shield.snapshot()
    shield.reset(np.array([True, False]))
    first, again = fresh.filter(*args), shield.filter(*args)
    np.testing.assert_array_equal(first.snap[0], again.snap[0])
    other = Shield(uncertainty=ALL)
    other.restore(used)
    shield.restore(used)
    np.testing.assert_array_equal(other.filter(*args).numbers, shield.filter(*args).numbers)


@pytest.mark.interpreted
def test_errors_far_beyond_the_bounds_end_the_certificate_and_nothing_else():
    shield, rng = Shield(uncertainty=KINDS["estimate"]), np.random.default_rng(6)
    center, radius, certified = np.zeros((1, 3)), np.array([0.5]), []
    for _ in range(50):
        x = np.zeros((4, 3))
        x[0] = rng.normal(size=3)
        x[1] = 5 * rng.normal(size=3)
        answer = shield.filter(x, Obstacles.spheres(center, radius), -300 * x[0], 0.02)
        assert np.isfinite(answer.snap).all()
        certified.append(answer.certified)
    assert not all(certified)


@pytest.mark.interpreted
def test_a_start_within_the_tube_is_not_certified_until_it_is_left():
    shield, period = Shield(uncertainty=KINDS["estimate"]), 0.02
    x, center, radius, certified = np.zeros((4, 3)), np.zeros((1, 3)), np.array([0.5]), []
    x[0, 0] = 0.51
    for _ in range(100):
        answer = shield.filter(x, Obstacles.spheres(center, radius), np.zeros(3), period)
        certified.append(bool(answer.certified))
        x = moved(x, answer.snap, period)
        assert np.linalg.norm(x[0]) >= 0.5
    assert not certified[0] and certified[-1]
    assert certified == sorted(certified)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"position": -1.0}, "uncertainty.position must be"),
        ({"gain": 1.0}, "uncertainty.gain must be < 1, got 1.0"),
        ({"wind": np.nan}, "uncertainty.wind must be"),
        ({"delay": 1.5}, "uncertainty.delay must be a whole number from 0 to 100, got 1.5"),
        ({"delay": True}, "uncertainty.delay must be a whole number"),
        ({"delay": 101}, "uncertainty.delay must be a whole number from 0 to 100, got 101"),
        ({"losses": 1}, "uncertainty.losses must be True or False, got 1"),
        ({"rotor_lag": -0.01}, "uncertainty.rotor_lag must be a finite number >= 0, got -0.01"),
        ({"rotor_lag": (0.02, 0.01)}, "uncertainty.rotor_lag must be a number, or (least, greatest) with"),
        ({"rotor_lag": (0.0, 0.01)}, "uncertainty.rotor_lag must be a number, or (least, greatest) with"),
        ({"rotor_lag": (0.01,)}, "uncertainty.rotor_lag must"),
        ({"impulse": 0.1}, "uncertainty.impulse and uncertainty.impulse_gap must both be 0 or both be > 0"),
        ({"noise": 1.0}, "a field of uncertainty must be one of 'position', 'velocity'"),
        (0.1, "uncertainty must be an Uncertainty or a mapping"),
    ],
)
def test_a_bad_bound_gets_one_sentence(given, sentence):
    with pytest.raises((TypeError, ValueError)) as raised:
        Shield(uncertainty=given)
    assert str(raised.value).startswith(sentence)


@pytest.mark.interpreted
def test_more_than_half_of_the_vehicle_is_refused():
    for bound in ({"jerk": 500.0}, {"position": 1e308}):
        shield = Shield(uncertainty=bound)
        with np.errstate(all="ignore"), pytest.raises(ValueError, match="must leave half of snap, jerk"):
            shield.filter(
                np.zeros((4, 3)), Obstacles.spheres(np.full((1, 3), 2.0), np.array([0.5])), np.zeros(3), 0.02
            )
    for period in (1e-5, 2.1, 1e200):
        with pytest.raises(
            ValueError, match=r"period must be (from 0\.0001 to 1 s where errors|in seconds and)"
        ):
            Shield(uncertainty={"delay": 1}).filter(
                np.zeros((4, 3)), Obstacles.spheres(np.full((1, 3), 2.0), np.array([0.5])), np.zeros(3), period
            )
    with pytest.raises(ValueError, match="needs method 'sampled', got 'cbf'"):
        Shield(method="cbf", uncertainty={"wind": 0.1})


def test_the_slot_offers_a_backup_where_losses_are_declared():
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), uncertainty={"losses": True})
    env.reset(seed=0)
    _, _, _, _, info = env.step(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32))
    assert not info["shield"]["stopped"]
    instead = env.unwrapped.snap_filter.backup(np.array([True]))
    told = env.unwrapped.snap_filter.summary_of_one()
    assert told["stopped"] and (told["snap_applied"] == instead[0]).all()
    plain = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"))
    assert plain.unwrapped.snap_filter.backup is None


MET = {
    "position_noise": 0.003,
    "velocity_noise": 0.005,
    "position_bias": 0.002,
    "acceleration_noise": 0.05,
    "jerk_noise": 0.2,
    "delay": 1,
    "loss": 0.1,
    "wind": 0.1,
    "turbulence": 0.02,
    "gain": 0.01,
    "mass_error": 0.005,
}


def test_the_plant_has_the_bounds_of_its_conditions():
    env = gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=MET | {"drag": 0.1, "inertia_error": 0.2})
    found = Uncertainty(**env.unwrapped.uncertainty())
    thrust = env.unwrapped.params.thrust_max / env.unwrapped.params.mass
    assert found.wind == pytest.approx(0.1 + 3 * 0.02 + 0.1 * 5.0 + 0.005 / 0.995 * thrust, rel=1e-12)
    assert found[:5] == pytest.approx((0.005, 0.005, 0.05, 0.2, 15.0))
    assert found.gain == pytest.approx(1.01 / 0.8 - 1.0)
    assert (found.delay, found.losses) == (1, True)
    shielded = ShieldWrapper(
        gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=MET), uncertainty="conditions"
    )
    again = gymnasium.make(shielded.spec)
    assert again.get_wrapper_attr("shield").settings == shielded.shield.settings
    for met, sentence in (
        ({"rotor_lag": 0.01}, 'lag_compensation must be "told" for bounds'),
        ({"impulse": 0.1, "impulse_rate": 1.0}, "impulse_gap must be > 0 for bounds"),
        ({"rotor_lag": 0.01, "rotor_rise": 0.01, "rotor_fall": 0.02}, "rotor_lag must be 0 where rotor_rise"),
    ):
        beyond = gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=met)
        with pytest.raises(ValueError, match=sentence):
            ShieldWrapper(beyond, uncertainty="conditions")
    with pytest.raises(
        ValueError,
        match=r"must be 'conditions', 'plant', a file ending in \.json, Uncertainty, a",
    ):
        ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), uncertainty="weather")


@pytest.mark.parametrize(
    ("met", "told"),
    [
        ({"rotor_lag": 0.0375}, {"rotor_lag": 0.0375}),
        ({"rotor_lag": [0.037, 0.038]}, {"rotor_lag": (0.037, 0.038)}),
        ({"rotor_rise": 0.03, "rotor_fall": 0.05}, {"rotor_lag": 0.05}),
        # Periods of five physics steps: four to six.
        ({"jitter": 0.25}, {"jitter": 0.2}),
        (
            {"impulse": 0.1, "impulse_rate": 2.0, "impulse_gap": 0.5},
            {"impulse": 0.1, "impulse_gap": 0.5},
        ),
    ],
)
def test_what_lags_and_what_pushes_is_among_the_bounds(met, told):
    plant = {"conditions": met, "lag_compensation": "told"}
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", **plant), uncertainty="conditions")
    found = env.shield.settings["uncertainty"]
    assert {name: found[name] for name in told} == told
    assert collisions({"uncertainty": "conditions"}, n=50, **plant) == (0, 0)


def test_an_inner_loop_that_is_told_another_lag_has_an_error_that_grows_with_the_difference():
    errors = []
    for width in (0.0, 1e-4, 2e-4):
        met = {"rotor_lag": [0.0375 - width, 0.0375 + width]}
        env = gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=met, lag_compensation="told")
        errors.append(env.unwrapped.flight_model.snap_error(300.0, 30.0, 5.0, 500))
    assert errors[0] < errors[1] < errors[2] and errors[2] - errors[1] > 0.9 * (errors[1] - errors[0])


def collisions(settings, seed=0, n=200, **plant):
    """Violated flights straight at the goal, through the sphere, under these conditions; steps uncertified."""
    plant = {"conditions": MET, **plant}
    env = gymnasium.make_vec("quadsafe_env:QuadSafe/Avoid-v0", n, max_episode_steps=200, **plant)
    env = env if settings is None else VectorShieldWrapper(env, **settings)
    observations, _ = env.reset(seed=seed)
    violated, open_flights, uncertified = np.zeros(n, bool), np.ones(n, bool), 0
    for _ in range(200):
        actions = np.zeros((n, 4), dtype=np.float32)
        actions[:, :3] = np.clip(3.0 * observations[:, :3], -1, 1)
        observations, _, terminated, truncated, info = env.step(actions)
        violated |= info["violation"] & open_flights
        if settings is not None:
            uncertified += int((~info["shield"]["certified"] & open_flights).sum())
        open_flights &= ~(terminated | truncated)
    return int(violated.sum()), uncertified


def test_in_the_rigid_body_conditions_within_the_bounds_find_nothing():
    assert collisions({"uncertainty": "conditions"}) == (0, 0)
    assert collisions(None)[0] > 100


@pytest.mark.interpreted
def test_backup_is_only_for_a_shield_that_counts_on_losses():
    with pytest.raises(ValueError, match=r"uncertainty\.losses must be True"):
        Shield().backup(np.True_)
    shield = Shield(uncertainty={"losses": True})
    with pytest.raises(ValueError, match="must follow a call of filter"):
        shield.backup(np.True_)
    shield.filter(
        np.zeros((2, 4, 3)),
        Obstacles.spheres(np.full((2, 1, 3), 2.0), np.full((2, 1), 0.5)),
        np.zeros((2, 3)),
        0.02,
    )
    with pytest.raises(ValueError, match=r"mask must be booleans of shape \(2,\)"):
        shield.backup([1, 0])


def test_the_chosen_tube_leaves_half_and_no_other_pole_is_better():
    uncertainty, period = KINDS["estimate"], 0.02
    tube = tube_of(uncertainty, period, LIMITS)
    assert share_taken(tube, LIMITS) <= MOST_TAKEN
    wrong = wrong_in(uncertainty, period, LIMITS.snap_max)
    for pole in (2.0, 3.0, 5.0, 8.0, 12.0):
        other = tube_at(pole, wrong, period)
        cost = other.deviation[0] + 0.1 * share_taken(other, LIMITS)
        assert cost >= 0.98 * (tube.deviation[0] + 0.1 * share_taken(tube, LIMITS))


def test_settings_are_plain_and_make_the_shield_again():
    settings = Shield(uncertainty=ALL, authority=VEHICLE).settings
    assert Shield(**json.loads(json.dumps(settings))).settings == settings
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), uncertainty={"wind": 0.1})
    assert gymnasium.make(env.spec).get_wrapper_attr("shield").settings["uncertainty"]["wind"] == 0.1
