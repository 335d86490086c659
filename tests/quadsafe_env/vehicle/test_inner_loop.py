"""The inner loop: its wrench is right to second order, and its bound holds at every corner of a flight."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.kernels.jit import kernel
from quadsafe_env.vehicle.actions import INTERFACES
from quadsafe_env.vehicle.flatness import flat_from_state, snap_from_wrench_kernel, wrench_from_snap_kernel
from quadsafe_env.vehicle.inner_loop import crackle, held_wrench
from quadsafe_env.vehicle.inner_loop_error import Flight, snap_error
from quadsafe_env.vehicle.params import PRESETS, params_from
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.state import to_body, to_world
from quadsafe_env.vehicle.yaw import TURN, YawRange, is_spinning, limited_yaw, yaw_hold
from shields import ShieldWrapper, VectorShieldWrapper

CRAZYFLIE = PRESETS["crazyflie"]
VEHICLES = {
    "crazyflie": CRAZYFLIE,
    "hummingbird": PRESETS["hummingbird"],
    "unequal": params_from({"inertia": [1.4e-5, 1.0e-5, 2.0e-5]}),
    "flat": params_from({"inertia": [1.0e-5, 1.4e-5, 2.3e-5]}),
    "moon": params_from({"gravity": 1.62}),
}
RATES = [(1000, 1000), (500, 500), (500, 100), (500, 20), (250, 50), (100, 100), (100, 20), (50, 50), (25, 25)]


@kernel
def after_step(s, wrench, params, dt, parts):
    """The state after a wrench that is held for a step, in so many Runge–Kutta steps."""
    for _ in range(parts):
        s = rk4_step(s, wrench, params, dt / parts)
    return s


@kernel
def off_chain(now, begin, snap, axis, t):
    """How far (r, v, a, j) along an axis are off (9) with the snap held for t since the beginning."""
    r, v, a, j, u = begin[0][axis], begin[1][axis], begin[2][axis], begin[3][axis], snap[axis]
    return (
        now[0][axis] - (r + t * (v + t * (a / 2 + t * (j / 6 + t * u / 24)))),
        now[1][axis] - (v + t * (a + t * (j / 2 + t * u / 6))),
        now[2][axis] - (a + t * (j + t * u / 2)),
        now[3][axis] - (j + t * u),
    )


@kernel
def share_of(now, begin, snap, t, most):
    """The largest share of ``most`` that the deviations from the chain are long."""
    x, y, z = (
        off_chain(now, begin, snap, 0, t),
        off_chain(now, begin, snap, 1, t),
        off_chain(now, begin, snap, 2, t),
    )
    share = 0.0
    for i in range(4):
        share = max(share, np.sqrt(x[i] ** 2 + y[i] ** 2 + z[i] ** 2) / (most[i] + 1e-12))
    return share


@kernel
def watched(s, snap, yaw_acceleration, believed, vehicle, dt, steps, parts, allowed):
    """A control period, finely: the largest share of d̄Δ⁴/24, …, d̄Δ that a deviation takes at any instant.

    Also the least thrust, the largest jerk and the largest |ω_z| on the way.
    """
    T = dt * steps
    most = (allowed * T**4 / 24, allowed * T**3 / 6, allowed * T**2 / 2, allowed * T)
    begin, share, thrust, jerk, spin = flat_from_state(s, believed), 0.0, s[18], 0.0, abs(s[17])
    for k in range(steps):
        wrench = held_wrench(s, snap, yaw_acceleration, believed, dt)
        for part in range(1, parts + 1):
            s = rk4_step(s, wrench, vehicle, dt / parts)
            now = flat_from_state(s, believed)
            share = max(share, share_of(now, begin, snap, (k + part / parts) * dt, most))
            jerk = max(jerk, np.sqrt(now[3][0] ** 2 + now[3][1] ** 2 + now[3][2] ** 2))
            thrust, spin = min(thrust, s[18]), max(spin, abs(s[17]))
    return share, thrust / believed.mass, jerk, spin


@kernel
def flown(s, snap, yaw_acceleration, believed, vehicle, dt, steps):
    """The state after so many steps of the inner loop, and the least thrust and largest jerk on the way."""
    least, most = np.inf, 0.0
    for _ in range(steps):
        jerk = flat_from_state(s, believed)[3]
        most = max(most, np.sqrt(jerk[0] ** 2 + jerk[1] ** 2 + jerk[2] ** 2))
        least = min(least, s[18] / believed.mass)
        s = after_step(s, held_wrench(s, snap, yaw_acceleration, believed, dt), vehicle, dt, 1)
    jerk = flat_from_state(s, believed)[3]
    most = max(most, np.sqrt(jerk[0] ** 2 + jerk[1] ** 2 + jerk[2] ** 2))
    return s, min(least, s[18] / believed.mass), most


def unit(rng):
    x = rng.normal(size=3)
    return x / np.linalg.norm(x)


def worst(rng, most):
    """A number up to ``most``, mostly ``most`` itself."""
    return most * rng.choice([1.0, 1.0, rng.random()])


def random_flight(rng, flight, params):
    """A state within a flight, a snap and a yaw acceleration, mostly at its corners."""
    thrust = flight.thrust * (1.0 + rng.choice([0.0, 0.02, 0.5]) * rng.exponential())
    jerk, snap = worst(rng, flight.jerk) * unit(rng), worst(rng, flight.snap) * unit(rng)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    s = np.zeros(20)
    s[6:15] = (Q * np.sign(np.linalg.det(Q))).reshape(-1)
    yaw = rng.choice([-1.0, 1.0]) * worst(rng, flight.yaw.rate)
    s[15:18] = -jerk[1] / thrust, jerk[0] / thrust, yaw
    s[18:20] = params.mass * thrust, params.mass * jerk[2]
    spin = rng.choice([-1.0, 1.0]) * worst(rng, flight.yaw.acceleration)
    return tuple(s.tolist()), tuple(snap.tolist()), float(spin)


def flat_of(s, params):
    return np.array(flat_from_state(s, params))


def held(flat, snap, t):
    """(9): the chain under a held snap."""
    r, v, a, j = flat
    snap = np.array(snap)
    return np.array(
        [
            r + t * (v + t * (a / 2 + t * (j / 6 + t * snap / 24))),
            v + t * (a + t * (j / 2 + t * snap / 6)),
            a + t * (j + t * snap / 2),
            j + t * snap,
        ]
    )


def ratios(s, after, snap, params, t, error):
    """How far position, velocity, acceleration and jerk are off, over what the bound allows."""
    off = np.linalg.norm(flat_of(after, params) - held(flat_of(s, params), snap, t), axis=1)
    return off / (error * np.array([t**4 / 24, t**3 / 6, t**2 / 2, t]) + 1e-12)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", VEHICLES)
def test_the_crackle_is_the_slope_of_the_snap(name):
    params, rng, h = VEHICLES[name], np.random.default_rng(0), 1e-5
    for _ in range(20):
        s, snap, spin = random_flight(rng, Flight(300.0, 40.0, 4.0, YawRange(10.0, 40.0)), params)
        wrench = wrench_from_snap_kernel(s, snap, spin, params)
        later, before = after_step(s, wrench, params, h, 1), after_step(s, wrench, params, -h, 1)
        difference = np.subtract(
            snap_from_wrench_kernel(later, wrench, params), snap_from_wrench_kernel(before, wrench, params)
        )
        found = to_world(s, crackle(s, to_body(s, snap), spin, params)[0])
        np.testing.assert_allclose(found, difference / (2 * h), rtol=1e-5, atol=0.5)


@pytest.mark.parametrize("name", VEHICLES)
def test_the_snap_of_a_step_is_right_to_second_order_and_without_the_lead_to_first(name):
    params, rng = VEHICLES[name], np.random.default_rng(1)
    errors = {law: np.zeros(2) for law in ("held", "naive")}
    for _ in range(300):
        s, snap, spin = random_flight(rng, Flight(200.0, 20.0, 3.0, YawRange(10.0, 40.0)), params)
        for k, dt in enumerate((1e-3, 5e-4)):
            wrenches = {
                "held": held_wrench(s, snap, spin, params, dt),
                "naive": wrench_from_snap_kernel(s, snap, spin, params),
            }
            for law, wrench in wrenches.items():
                gain = flat_of(after_step(s, wrench, params, dt, 4), params)[3] - flat_of(s, params)[3]
                errors[law][k] += np.linalg.norm(gain / dt - snap)
    assert 3.5 < errors["held"][0] / errors["held"][1] < 4.5
    assert 1.8 < errors["naive"][0] / errors["naive"][1] < 2.2
    assert errors["held"][0] < 0.1 * errors["naive"][0]


def numbers_at(physics, control, params):
    """The flight that the wrapper chooses at these rates, and the error that it counts on."""
    env = gymnasium.make(
        "QuadSafe/Avoid-v0", params=params, physics_hz=physics, control_hz=control, policy_hz=control
    )
    settings = ShieldWrapper(env).shield.settings
    kept = env.unwrapped._world.yaw_hold_at(1.0 / physics).range
    flight = Flight(settings["held_snap_max"], settings["jerk_max"], settings["specific_thrust_min"], kept)
    return flight, settings["uncertainty"]["snap"]


@pytest.mark.parametrize("rates", RATES, ids=str)
@pytest.mark.parametrize("name", VEHICLES)
def test_no_flight_within_the_numbers_is_off_by_more_than_the_bound(name, rates):
    params, rng, (physics, control) = VEHICLES[name], np.random.default_rng(2), rates
    flight, error = numbers_at(*rates, params)
    dt, steps, most, flights = 1.0 / physics, physics // control, np.zeros(4), 0
    for _ in range(400):
        s, snap, spin = random_flight(rng, flight, params)
        s, snap = tuple(s), tuple(u * rng.choice([1.0, 0.3]) for u in snap)
        after, thrust, jerk = flown(s, snap, spin, params, params, dt, steps)
        if thrust >= 0.99 * flight.thrust and jerk <= 1.01 * flight.jerk:
            flights += 1
            most = np.maximum(most, ratios(s, after, snap, params, dt * steps, error))
    assert flights > 30
    assert most.max() <= 1.0


def test_beyond_the_numbers_the_bound_is_exceeded():
    flight, error = numbers_at(500, 100, CRAZYFLIE)
    rng, most = np.random.default_rng(3), 0.0
    beyond = flight._replace(jerk=5.0 * flight.jerk, yaw=YawRange(100.0, 40.0))
    for _ in range(300):
        s, snap, spin = random_flight(rng, beyond, CRAZYFLIE)
        after, _, _ = flown(s, snap, spin, CRAZYFLIE, CRAZYFLIE, 0.002, 5)
        most = max(most, ratios(s, after, snap, CRAZYFLIE, 0.01, error).max())
    assert most > 1.0


@pytest.mark.parametrize("wrong", [-0.05, 0.05])
@pytest.mark.parametrize("name", ["crazyflie", "unequal", "flat"])
def test_with_an_inertia_that_is_off_the_bound_and_a_gain_hold(name, wrong):
    params, rng, iota = VEHICLES[name], np.random.default_rng(4), 0.05
    vehicle = params._replace(inertia=tuple((1.0 + wrong) * moment for moment in params.inertia))
    flight = Flight(300.0, 30.0, 4.0, YawRange(10.0, 40.0))
    error, gain = snap_error(flight, params, 0.002, 0.01, iota), iota / (1.0 - iota)
    for _ in range(1500):
        s, snap, spin = random_flight(rng, flight, params)
        after, thrust, jerk = flown(s, snap, spin, params, vehicle, 0.002, 5)
        if thrust >= 0.99 * flight.thrust and jerk <= 1.01 * flight.jerk:
            allowed = error + gain * np.linalg.norm(snap)
            assert ratios(s, after, snap, params, 0.01, allowed).max() <= 1.0


def finely(rng, flight, params, vehicle, rates, error, gain, count):
    """Largest shares of the bound and of w among flights that keep to the limits, and how many did."""
    (physics, control), share, spin, flights = rates, 0.0, 0.0, 0
    hold = yaw_hold(flight.yaw, 1.0 / physics, 1.0 / control, 0.0, 1.0 - 1.0 / (1.0 + gain))
    for _ in range(count):
        s, snap, asked = random_flight(rng, flight, params)
        # Without a pull, or without a snap, a flight stays at its corner for longer.
        s = (*s[:18], s[18] * rng.choice([1.0, 1.5]), s[19] * rng.choice([0.0, 1.0]))
        snap = tuple(u * rng.choice([1.0, 0.1, 0.0]) for u in snap)
        asked = limited_yaw(s[17], asked, hold)
        allowed = error + gain * float(np.linalg.norm(snap))
        found, thrust, jerk, turned = watched(
            s, snap, asked, params, vehicle, 1.0 / physics, physics // control, 8, allowed
        )
        if thrust >= flight.thrust / 1.01 and jerk <= 1.01 * flight.jerk:
            share, spin, flights = max(share, found), max(spin, turned / flight.yaw.rate), flights + 1
    return share, spin, flights


@pytest.mark.parametrize("rates", [(500, 500), (500, 100), (500, 20), (100, 20), (25, 25)], ids=str)
@pytest.mark.parametrize("name", ["crazyflie", "unequal"])
def test_at_every_instant_of_a_period_the_bound_holds(name, rates):
    params, rng = VEHICLES[name], np.random.default_rng(6)
    flight, error = numbers_at(*rates, params)
    share, spin, flights = finely(rng, flight, params, params, rates, error, 0.0, 2000)
    assert flights > 200
    assert 0.02 < share <= 1.0
    assert spin <= 1.01


@pytest.mark.parametrize(("rates", "reached"), [((500, 100), 0.18), ((25, 25), 0.33)], ids=str)
def test_what_the_worst_of_twenty_thousand_periods_takes_of_the_bound(rates, reached):
    flight, error = numbers_at(*rates, CRAZYFLIE)
    share, _, flights = finely(
        np.random.default_rng(11), flight, CRAZYFLIE, CRAZYFLIE, rates, error, 0.0, 20_000
    )
    assert flights > 10_000
    assert share == pytest.approx(reached, abs=0.02)


PLANK = params_from({"inertia": [1e-5, 5e-5, 5.5e-5]})
IOTA = 0.1


def plank_flight(jerk, control):
    """A flight with moments that differ much, what is kept of the yaw motion, and the bound."""
    hold = yaw_hold(YawRange(10.0, np.inf), 0.002, 1.0 / control, 0.0, IOTA)
    flight = Flight(10.0 * jerk, jerk, 3.924, hold.range)
    return flight, snap_error(flight, PLANK, 0.002, 1.0 / control, IOTA)


def plank_flown(jerk, control, count):
    flight, error = plank_flight(jerk, control)
    gain, found = IOTA / (1.0 - IOTA), []
    for wrong in (-IOTA, IOTA):
        vehicle = PLANK._replace(inertia=tuple((1.0 + wrong) * moment for moment in PLANK.inertia))
        rng = np.random.default_rng(7)
        found.append(finely(rng, flight, PLANK, vehicle, (500, control), error, gain, count))
    return np.max(found, axis=0)


def test_where_an_unknown_inertia_turns_the_body_out_of_its_yaw_range_there_is_no_bound():
    """ω_x ω_y turns a body with J_x ≠ J_y, and a torque for another inertia does not hold that."""
    assert plank_flight(50.0, 20)[1] == np.inf
    assert plank_flown(50.0, 20, 4000)[1] > 1.01
    assert plank_flight(15.0, 100)[1] < np.inf
    share, spin, flights = plank_flown(15.0, 100, 2000)
    assert flights > 200
    assert share <= 1.0
    assert spin <= 1.01


def test_a_yaw_acceleration_that_does_not_hold_the_body_is_no_bound():
    params = VEHICLES["unequal"]
    strong = Flight(500.0, 40.0, 4.0, YawRange(10.0, 40.0))
    assert snap_error(strong, params, 0.002, 0.02) < np.inf
    assert snap_error(strong._replace(yaw=YawRange(10.0, 1e-4)), params, 0.002, 0.02) == np.inf
    assert snap_error(strong._replace(yaw=YawRange(10.0, 1e-4)), CRAZYFLIE, 0.002, 0.02) < np.inf


@pytest.mark.interpreted
def test_the_coefficients_of_the_crackle_are_upper_bounds():
    p = np.linspace(0.0, 1.0, 100_001)
    cubic = p * (2.0 * p - 6.0 * (1.0 - p)) ** 2 + 9.0 * (1.0 - p) * p**2
    assert 4.4 < cubic.max() <= 5.0
    # What the zigzag of the jerk adds: at most its mean slope from the second integral on, not in the first.
    t = np.linspace(0.0, 1.0, 10_001)
    first = t * t * (1.0 / 4.0 - t / 6.0)
    assert (first > t / 12.0).any() and first.max() <= 1.0 / 12.0 + 1e-12
    assert (t**3 / 12.0 - t**4 / 24.0 <= t * t / 24.0 + 1e-12).all()


@pytest.mark.parametrize("physics", [500, 25])
def test_a_runge_kutta_step_is_the_body_s_own_motion(physics):
    """What the plant's step is off the motion of (29) is far below what the bound is about."""
    rng, dt = np.random.default_rng(5), 1.0 / physics
    flight, error = numbers_at(physics, physics, CRAZYFLIE)
    for _ in range(200):
        s, snap, spin = random_flight(rng, flight, CRAZYFLIE)
        wrench = held_wrench(s, snap, spin, CRAZYFLIE, dt)
        ends = [flat_of(after_step(s, wrench, CRAZYFLIE, dt, parts), CRAZYFLIE) for parts in (1, 16)]
        off = np.linalg.norm(ends[0] - ends[1], axis=1)
        assert (off <= 0.1 * error * np.array([dt**4 / 24, dt**3 / 6, dt**2 / 2, dt]) + 1e-11).all()


# Yaw ----------------------------------------------------------------------------------------------------------


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.001, 0.01, 0.2])
def test_limited_yaw_keeps_to_its_range_and_returns_to_it(period):
    hold, rng = yaw_hold(YawRange(2.0, 15.0), 0.001, period, 0.0, 0.0), np.random.default_rng(3)
    inside, outside = rng.uniform(-2.0, 2.0), 9.0
    for _ in range(round(2.0 / period)):
        asked = 100.0 * rng.normal()
        assert abs(limited_yaw(inside, asked, hold)) <= 15.0
        inside += period * limited_yaw(inside, asked, hold)
        outside += period * limited_yaw(outside, asked, hold)
        assert abs(inside) <= 2.0 + 1e-12
        assert limited_yaw(inside, 0.0, hold) == pytest.approx(0.0, abs=1e-12 / period)
    assert abs(outside) <= 2.0 + 1e-12
    assert np.isnan(limited_yaw(0.0, np.nan, hold))
    assert is_spinning(9.0, hold) and not is_spinning(2.0, hold)


@pytest.mark.interpreted
def test_a_longer_period_and_a_smaller_inertia_are_counted_on():
    hold = yaw_hold(YawRange(2.0, 1e9), 0.002, 0.01, 0.2, 0.1)
    assert hold.period == pytest.approx(0.012 / 0.9)
    assert abs(-2.0 + 0.012 / 0.9 * limited_yaw(-2.0, 1e6, hold)) <= 2.0 + 1e-12
    assert yaw_hold(YawRange(50.0, 1e9), 0.01, 0.01, 0.0, 0.0).range.rate == TURN / 0.01


CONDITIONS = [{}, {"delay": 3, "loss": 0.5}, {"jitter": 0.4}, {"inertia_error": 0.2}]


@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize("conditions", CONDITIONS, ids=str)
@pytest.mark.parametrize("action", INTERFACES)
def test_every_interface_keeps_the_yaw_rate(action, conditions, limits):
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0", 8, action=action, conditions=conditions or None, obstacles=[], rotor_limits=limits
    )
    env.reset(seed=0)
    kept = env.unwrapped._world.yaw_hold_at(0.002).range.rate
    for _ in range(150):
        info = env.step(np.tile(np.array([0.0, 0.0, 0.0, 1.0], np.float32), (8, 1)))[4]
        assert not info["spinning"].any()
        assert np.abs(env.unwrapped.state[:, 17]).max() <= 1.01 * kept


MEETS_ALL = {"delay": 2, "loss": 0.3, "jitter": 0.3, "inertia_error": 0.2}


@pytest.mark.parametrize("vehicle", ["crazyflie", "unequal"])
@pytest.mark.parametrize("conditions", [None, MEETS_ALL], ids=["off", "all"])
@pytest.mark.parametrize("action", INTERFACES)
def test_a_single_env_keeps_the_yaw_rate_for_twenty_seconds(action, conditions, vehicle):
    env = gymnasium.make(
        "QuadSafe/Avoid-v0", action=action, conditions=conditions, obstacles=[], params=VEHICLES[vehicle]
    ).unwrapped
    env.reset(seed=0)
    kept, most = env._world.yaw_hold_at(0.002).range.rate, 0.0
    for _ in range(20 * env._world.rates.policy):
        _, _, is_over, _, info = env.step(np.array([0.0, 0.0, 0.0, 1.0]))
        assert not info["spinning"] and not is_over
        most = max(most, abs(env.state[17]))
    # The wrench that a policy asks for is less than what the range allows.
    assert 0.1 * kept < most <= 1.01 * kept


def test_a_single_start_beyond_comes_back_and_says_so():
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=[]).unwrapped
    env.reset(seed=0)
    state = env.state.copy()
    state[17] = -25.0
    env.state = state
    told = [env.step(np.zeros(4))[4]["spinning"] for _ in range(20)]
    assert told[0] and not told[-1]
    assert told == sorted(told, reverse=True)
    assert abs(env.state[17]) <= 10.0


@pytest.mark.parametrize("is_shielded", [False, True])
def test_a_start_beyond_comes_back_and_says_so(is_shielded):
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", 2, obstacles=[])
    env = VectorShieldWrapper(env) if is_shielded else env
    env.reset(seed=0)
    states = env.unwrapped.state
    states[1, 17] = 25.0
    env.unwrapped.state = states
    told = [env.step(np.zeros((2, 4), np.float32))[4]["spinning"].tolist() for _ in range(20)]
    assert told[0] == [False, True] and told[-1] == [False, False]
    assert abs(env.unwrapped.state[1, 17]) <= 10.0
