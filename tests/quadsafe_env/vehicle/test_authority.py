"""The vehicle's authority: the proposition attacked inside its box, and shown to be tight at its edge."""

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_env.simulation.world import Passed
from quadsafe_env.vehicle.authority import (
    authority,
    steering_thrust,
    yaw_range,
)
from quadsafe_env.vehicle.flatness import flat_state, wrench_from_snap
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.rotors import levers, rotor_thrusts
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, THRUST_RATE, hover_state
from quadsafe_env.vehicle.yaw import YawRange

CRAZYFLIE = PRESETS["crazyflie"]
VEHICLES = {
    **PRESETS,
    "lopsided": CRAZYFLIE._replace(inertia=(1.0e-5, 1.6e-5, 2.2e-5)),
    "plank": PRESETS["racer"]._replace(inertia=(1e-3, 5e-3, 5.5e-3), torque_max=(0.5, 1.5, 0.05)),
    "weak": CRAZYFLIE._replace(thrust_max=1.3 * CRAZYFLIE.mass * CRAZYFLIE.gravity),
}
every_vehicle = pytest.mark.parametrize("name", VEHICLES)


def on_sphere(rng, count):
    rows = rng.normal(size=(count, 3))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def pushed_to_the_edge(rng, count, edge_share=0.5):
    """Numbers in [0, 1], many of them 1."""
    return np.where(rng.uniform(size=count) < edge_share, 1.0, rng.uniform(size=count))


def flights(thrust, jerk, snap, yaw_rate, rng, params):
    """States and world snaps, at random attitudes, with these body-axis quantities."""
    states = hover_state(np.zeros((len(thrust), 3)), params)
    attitude = Rotation.random(len(thrust), rng).as_matrix()
    states[:, ATTITUDE:OMEGA] = attitude.reshape(-1, 9)
    states[:, OMEGA : OMEGA + 2] = np.column_stack([-jerk[:, 1], jerk[:, 0]]) / thrust[:, np.newaxis]
    states[:, OMEGA + 2] = yaw_rate
    states[:, THRUST], states[:, THRUST_RATE] = params.mass * thrust, params.mass * jerk[:, 2]
    return states, np.einsum("nij,nj->ni", attitude, snap)


def rotors_asked(states, snaps, yaw_acceleration, params):
    wrench = wrench_from_snap(states, snaps, params, yaw_acceleration)
    return rotor_thrusts(states[:, THRUST], wrench[:, 1:], params)


def attack(params, limits, yaw, rng, count):
    """Random flights inside the box, with most quantities at their bounds."""
    thrust = limits.specific_thrust_min + (
        limits.specific_thrust_max - limits.specific_thrust_min
    ) * rng.integers(0, 2, count)
    inside = rng.uniform(size=count) < 0.3
    thrust[inside] = rng.uniform(limits.specific_thrust_min, limits.specific_thrust_max, inside.sum())
    jerk = limits.jerk_max * pushed_to_the_edge(rng, count)[:, np.newaxis] * on_sphere(rng, count)
    snap = limits.snap_max * pushed_to_the_edge(rng, count)[:, np.newaxis] * on_sphere(rng, count)
    level = rng.uniform(size=count) < 0.5
    snap[level, 2] = 0.0
    snap[level] *= limits.snap_max / np.linalg.norm(snap[level], axis=1, keepdims=True)
    yaw_rate = yaw.rate * rng.choice([-1.0, 1.0], count) * pushed_to_the_edge(rng, count)
    spin = yaw.acceleration * rng.choice([-1.0, 1.0], count) * pushed_to_the_edge(rng, count)
    return *flights(thrust, jerk, snap, yaw_rate, rng, params), spin


def worst_flight(params, limits, yaw, thrust):
    """The flight in which every step of the proof is an equality, for J_x = J_y: jerk and snap in body axes."""
    kappa, turn = params.inertia[2] / params.inertia[0], limits.jerk_max / thrust
    q = (4 * turn**2 + (kappa * yaw.rate) ** 2) / 8
    assert q <= turn**2
    p = 2 * np.sqrt(turn**2 - q)
    # Both brackets of the proof are equal where ω_xy, turned by the angle of (p, κΩ), lies on the diagonal.
    angle = np.pi / 4 - np.arctan2(kappa * yaw.rate, p)
    omega = np.sqrt(q) * np.array([np.cos(angle), np.sin(angle)])
    jerk = thrust * np.array([omega[1], -omega[0], p / 2])
    return jerk, limits.snap_max * np.array([-1.0, 1.0, 0.0]) / np.sqrt(2)


def worst_rotors(params, thrust, snap_factor, yaw_sign):
    """Rotor thrusts of that flight, its snap times a factor; one sign of yaw empties a rotor, one fills one."""
    limits, yaw = authority(params), yaw_range(params)
    jerk, snap = worst_flight(params, limits, yaw, thrust)
    rng = np.random.default_rng(0)
    rows = np.array([thrust]), jerk[np.newaxis], snap_factor * snap[np.newaxis]
    states, snaps = flights(*rows, np.array([yaw.rate]), rng, params)
    return rotors_asked(states, snaps, yaw_sign * yaw.acceleration, params)[0]


@every_vehicle
@pytest.mark.parametrize("share", [0.5, 0.7])
def test_no_rotor_leaves_its_range_inside_the_box(name, share):
    """10⁵ flights of each vehicle, most of them with several quantities at their bounds."""
    params, rng = VEHICLES[name], np.random.default_rng(0)
    limits, yaw = authority(params, share), yaw_range(params)
    states, snaps, spin = attack(params, limits, yaw, rng, 100_000)
    flat = flat_state(states, params)
    thrust = np.linalg.norm(flat[:, 2] + [0.0, 0.0, params.gravity], axis=1)
    # The attack keeps to the box, to rounding.
    assert thrust.min() >= limits.specific_thrust_min * (1 - 1e-12)
    assert thrust.max() <= limits.specific_thrust_max * (1 + 1e-12)
    assert np.linalg.norm(flat[:, 3], axis=1).max() <= limits.jerk_max * (1 + 1e-12)
    assert np.linalg.norm(snaps, axis=1).max() == pytest.approx(limits.snap_max, rel=1e-12)
    rotors = rotors_asked(states, snaps, spin, params) / (params.thrust_max / 4)
    assert rotors.min() >= 0.0 and rotors.max() <= 1.0
    # The attack comes near both edges, but for weak vehicles, whose steering thrust is short at the top.
    if params.thrust_max > 2.0 * params.mass * params.gravity:
        assert rotors.min() < 0.02
    assert rotors.max() > 0.98


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["crazyflie", "hummingbird", "racer", "x500_light"])  # strong, with J_x = J_y
def test_worst_flight_empties_a_rotor_and_no_more(name):
    params, low = PRESETS[name], authority(name).specific_thrust_min
    full = params.thrust_max / 4
    # 1e-9 of the steering thrust is left against rounding.
    assert 0.0 <= worst_rotors(params, low, 1.0, 1.0).min() / full < 1e-8
    assert worst_rotors(params, low, 1.001, 1.0).min() < 0.0
    assert worst_rotors(params, low, 1.0, 1.0).max() < full


@pytest.mark.interpreted
def test_worst_flight_at_the_top_of_the_band_fills_a_rotor_and_no_more():
    top, full = authority(CRAZYFLIE).specific_thrust_max, CRAZYFLIE.thrust_max / 4
    assert 1.0 - 1e-8 < worst_rotors(CRAZYFLIE, top, 1.0, -1.0).max() / full <= 1.0
    assert worst_rotors(CRAZYFLIE, top, 1.001, -1.0).max() > full


@every_vehicle
def test_steering_thrust_bounds_the_torques(name):
    """D = Σ |τ_i|/l_i <= D̄(t), for any thrust, jerk, snap and yaw."""
    params, rng = VEHICLES[name], np.random.default_rng(1)
    thrust = 10.0 ** rng.uniform(-1, 2, 500)
    jerk, snap = (10.0 ** rng.uniform(0, 4, (500, 1)) * on_sphere(rng, 500) for _ in range(2))
    yaw_rate, spin = rng.normal(size=(2, 500)) * [[10.0], [50.0]]
    states, snaps = flights(thrust, jerk, snap, yaw_rate, rng, params)
    torque = wrench_from_snap(states, snaps, params, spin)[:, 1:]
    needed = (np.abs(torque) / levers(params)).sum(axis=1)
    bounds = [
        steering_thrust(t, np.linalg.norm(u), np.linalg.norm(j), YawRange(abs(w), abs(b)), params)
        for t, u, j, w, b in zip(thrust, snap, jerk, yaw_rate, spin, strict=True)
    ]
    assert (needed <= np.array(bounds) * (1 + 1e-12)).all()


@pytest.mark.interpreted
@every_vehicle
def test_band_holds_hover_and_ends_where_the_steering_thrust_is_spent(name):
    params = VEHICLES[name]
    limits, yaw = authority(params), yaw_range(params)
    assert params.thrust_min / params.mass < limits.specific_thrust_min < params.gravity == limits.gravity
    assert params.gravity < limits.specific_thrust_max < params.thrust_max / params.mass
    # At least the unshared half of the way from hover to full thrust.
    assert limits.specific_thrust_max >= 0.5 * (params.gravity + params.thrust_max / params.mass)
    spent = steering_thrust(limits.specific_thrust_max, limits.snap_max, limits.jerk_max, yaw, params)
    room = params.thrust_max - params.mass * limits.specific_thrust_max
    assert spent == pytest.approx(room, rel=1e-6)
    for thrust in np.linspace(limits.specific_thrust_min, limits.specific_thrust_max, 50):
        lift = params.mass * thrust
        spent = steering_thrust(thrust, limits.snap_max, limits.jerk_max, yaw, params)
        assert spent <= min(lift, params.thrust_max - lift)


@pytest.mark.interpreted
def test_crazyflie_has_these_numbers():
    limits = authority("crazyflie")
    assert all(type(number) is float for number in limits)
    np.testing.assert_allclose(limits, (380.6, 44.28, 5.150, 20.16, 9.81), rtol=5e-4)
    assert limits.jerk_max / limits.specific_thrust_min == pytest.approx(8.60, abs=0.01)
    # The velocity interface never asks for more yaw: 10 rad/s, held for 10 ms, on a change from −2 to 2 rad/s.
    assert yaw_range("crazyflie").acceleration > 4.0 * (1 - np.exp(-0.1)) / 0.01


@pytest.mark.interpreted
def test_more_share_gives_more_snap_and_less_acceleration():
    rows = np.array([authority("crazyflie", share) for share in (0.3, 0.4, 0.5, 0.6, 0.7)])
    assert (np.diff(rows[:, :3], axis=0) > 0).all() and (np.diff(rows[:, 3]) < 0).all()


@pytest.mark.interpreted
def test_slower_body_rates_leave_more_snap():
    free, slow = authority("crazyflie"), authority("crazyflie", body_rate_max=5.0)
    assert slow.jerk_max == pytest.approx(5.0 * slow.specific_thrust_min, rel=1e-15)
    assert slow.snap_max > free.snap_max
    assert authority("crazyflie", body_rate_max=9.0) == free


@pytest.mark.interpreted
def test_vehicle_of_another_size_has_scaled_authority():
    """Mass and thrust times k, inertia times k: the same motion."""
    k = 3.0
    p = CRAZYFLIE
    big = p._replace(
        mass=k * p.mass,
        inertia=tuple(k * J for J in p.inertia),
        thrust_max=k * p.thrust_max,
        thrust_min=k * p.thrust_min,
        torque_max=tuple(k * torque for torque in p.torque_max),
    )
    np.testing.assert_allclose(authority(big), authority(p), rtol=1e-12)
    np.testing.assert_allclose(yaw_range(big), yaw_range(p), rtol=1e-12)


def farthest(limits, n):
    """Farthest λ by walking: acceleration λ n within the band all the way."""
    walk = np.arange(0.0, 60.0, 1e-3)
    thrust = np.linalg.norm(walk[:, np.newaxis] * n + [0.0, 0.0, limits.gravity], axis=1)
    inside = (thrust >= limits.specific_thrust_min) & (thrust <= limits.specific_thrust_max)
    return walk[np.argmin(inside)]


def test_acceleration_along_a_direction_is_where_the_band_is_left():
    rng, limits = np.random.default_rng(2), authority("crazyflie")
    directions = on_sphere(rng, 300)
    along = limits.acceleration_along(directions)
    # The edge of the downward cone, where the walk only grazes the lower end, is left out.
    edge = -np.sqrt(1.0 - (limits.specific_thrust_min / limits.gravity) ** 2)
    grazes = np.abs(directions[:, 2] - edge) < 1e-3
    for n, value in zip(directions[~grazes], along[~grazes], strict=True):
        assert farthest(limits, n) == pytest.approx(value, abs=1.1e-3)
    np.testing.assert_allclose(limits.acceleration_along(7.0 * directions), along, rtol=1e-12)


@pytest.mark.interpreted
def test_acceleration_up_down_and_level():
    limits = authority("racer")
    up, down, level = limits.acceleration_along([[0, 0, 2], [0, 0, -1], [0, 3, 0]])
    assert up == pytest.approx(limits.specific_thrust_max - limits.gravity, rel=1e-12)
    assert down == pytest.approx(limits.gravity - limits.specific_thrust_min, rel=1e-12)
    assert level == pytest.approx(np.sqrt(limits.specific_thrust_max**2 - limits.gravity**2), rel=1e-12)
    assert limits.acceleration_along([0.0, 0.0, 1.0]).shape == ()


@pytest.mark.interpreted
def test_bad_numbers():
    for share in (1.0, 1.5):
        with pytest.raises(ValueError, match=rf"^share must be in \(0, 1\), got {share}$"):
            authority("crazyflie", share)
    with pytest.raises(ValueError, match=r"^share must be a finite number > 0, got 0$"):
        authority("crazyflie", 0)
    with pytest.raises(ValueError, match=r"^share must leave thrust to steer with .*, got 0.1, .* N short$"):
        authority("hummingbird", 0.1)
    with pytest.raises(ValueError, match=r"^body_rate_max must be a finite number > 0, got -1$"):
        authority("crazyflie", body_rate_max=-1)
    with pytest.raises(ValueError, match=r"^thrust must be a finite number > 0, got 0$"):
        steering_thrust(0, 1.0, 1.0, YawRange(1.0, 1.0), "crazyflie")
    with pytest.raises(ValueError, match=r"^direction must be longer than 0, got a vector of zeros$"):
        authority("crazyflie").acceleration_along([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


def plant(n=None, **keywords):
    keywords = {"obstacles": [], "action": "snap", **keywords}
    if n is None:
        env = gymnasium.make("QuadSafe/Avoid-v0", **keywords).unwrapped
    else:
        env = gymnasium.make_vec("QuadSafe/Avoid-v0", n, **keywords).unwrapped
    env.reset(seed=0)
    return env


@pytest.mark.parametrize("preset", PRESETS)
def test_both_envs_tell_their_vehicles_authority(preset):
    whole, told = authority(preset), plant(params=preset).authority()
    assert told == plant(3, params=preset).authority() == plant(params=preset, rotor_limits=True).authority()
    # The inner loop asks for a little on top of a held snap.
    assert 0.9 * whole.snap_max < told.snap_max < whole.snap_max and told[1:] == whole[1:]


class Wish:
    """A filter that flies given snaps, whatever was desired."""

    def __init__(self, snaps):
        self._snaps = snaps

    def filter(self, flat, obstacles, snap, period):
        return Passed(self._snaps)

    def reset(self, mask):
        pass


@pytest.mark.parametrize("preset", PRESETS)
def test_plant_does_not_clip_inside_the_box_and_does_beyond(preset):
    """One physics step from states inside the box; full yaw actions, which the plant limits to its range."""
    params, n = PRESETS[preset], 2000
    limits, yaw, rng = authority(params), yaw_range(params), np.random.default_rng(4)
    states, snaps, spin = attack(params, limits, yaw, rng, n)
    env = plant(n, params=params, rotor_limits=True, policy_hz=500, control_hz=500)
    actions = np.zeros((n, 4))
    actions[:, 3] = np.sign(spin)
    flagged = []
    for factor in (1.0, 3.0):
        env.reset(seed=0)
        env.state = states
        env.snap_filter = Wish(factor * snaps)
        flagged.append(env.step(actions)[4]["saturated"])
    assert not flagged[0].any()
    assert flagged[1].mean() > 0.05


def test_plant_limits_the_yaw_that_a_policy_asks_for():
    free, limited = plant(), plant(rotor_limits=True)
    for _ in range(40):
        for env in (free, limited):
            env.step(np.array([0.0, 0.0, 0.0, 1.0]))
    # 10 rad/s² for 1.6 s would be 16 rad/s.
    assert free.state[OMEGA + 2] == pytest.approx(10.0, rel=1e-12)
    assert limited.state[OMEGA + 2] == pytest.approx(2.0, rel=1e-12)
