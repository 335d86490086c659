"""A steady push ends in rest at the border: the law of the easing, its cone, and flights on the chain."""

import math
from itertools import product

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from quadsafe_env.vehicle.state import hover_state
from shields import Shield, ShieldWrapper
from shields.chains.flat_state import Flat, flown
from shields.filters.easing import (
    POLE,
    Easing,
    easing_at,
    easing_input,
    flat_output,
    is_in_cone,
    next_in_line,
)
from shields.filters.sampled import sampled_value
from shields.interface.bodies import Kept
from shields.methods.halfspace import Sampling, demand_along

U_MAX, MARGIN = 200.0, 0.005
AUTHORITY = {
    "snap_max": 300.0,
    "jerk_max": 60.0,
    "specific_thrust_min": 3.0,
    "specific_thrust_max": 18.0,
    "gravity": 9.81,
}
SHIELDS = {"free": {}, "told": {"uncertainty": {"snap": 50.0}}, "authority": {"authority": AUTHORITY}}


def easing_of(period):
    return easing_at(period, MARGIN)


def after(x, u, t):
    """The chain (y''', y'', y', y) after u was held for t."""
    y = flown(Flat(*((x[i], 0.0, 0.0) for i in (3, 2, 1, 0))), (u, 0.0, 0.0), t)
    return (y.j[0], y.a[0], y.v[0], y.r[0])


def rows_of(x, easing, period):
    """z_0 … z_3."""
    found = []
    for _ in range(4):
        found.append(easing.feedback[0] * flat_output(x, period))
        x = next_in_line(x, period, easing.left)
    return np.array(found)


def state_of(z, easing, period):
    """The chain with these z: the rows are linear and independent."""
    table = np.array([rows_of(tuple(row), easing, period) for row in np.eye(4)]).T
    return tuple(np.linalg.solve(table, z))


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [10, 50, 100, 1000])
def test_e1_each_row_follows_the_next_and_the_law_lets_the_last_decay(rate):
    period, rng = 1 / rate, np.random.default_rng(rate)
    easing, decay = easing_of(period), math.exp(-POLE / rate)
    assert easing.feedback == tuple(held_gains(4, POLE, period))
    for _ in range(50):
        x = tuple(rng.normal(size=4) * [1e2, 10.0, 1.0, 0.1])
        z = rows_of(x, easing, period)
        for extra in (0.0, 30.0):
            then = rows_of(after(x, easing_input(x, easing) + extra, period), easing, period)
            expected = decay * z + (1 - decay) * np.append(z[1:], 0.0)
            np.testing.assert_allclose(then[:3], expected[:3], rtol=1e-6, atol=1e-6 * np.abs(z).max())
            # More than the law is more of the last row, so no less than the law keeps all of them.
            more = then[3] - decay * z[3]
            assert more == pytest.approx(0.0, abs=1e-6 * np.abs(z).max()) if extra == 0.0 else more > 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [10, 50, 200])
def test_in_the_cone_the_law_keeps_the_distance_between_samples_too(rate):
    period, rng, least = 1 / rate, np.random.default_rng(rate), math.inf
    easing = easing_of(period)
    for _ in range(100):
        x = state_of(rng.uniform(0.0, 50.0, 4) * rng.integers(0, 2, 4), easing, period)
        for _ in range(2 * rate):
            u = easing_input(x, easing) + rng.choice([0.0, 0.0, 100.0])
            least = min(least, *(after(x, u, t)[3] for t in np.linspace(0.0, period, 9)))
            x = after(x, u, period)
    # Rounding: the largest z is an input of 1e3 m/s⁴ or so, and y is that over k_0 = 1.6e5 1/s⁴.
    assert least >= -1e-12


@pytest.mark.interpreted
def test_outside_the_cone_the_law_would_not():
    period = 0.02
    easing, x, least = easing_of(period), (0.0, 0.0, -0.5, 0.01), math.inf
    assert not is_in_cone(x, 0.0, math.inf, easing, period)
    for _ in range(100):
        x = after(x, easing_input(x, easing), period)
        least = min(least, x[3])
    assert least < -1e-3


@pytest.mark.interpreted
def test_at_the_border_the_set_is_kept_but_for_a_share_of_the_margin():
    period, rng, seen, distance = 0.02, np.random.default_rng(0), 0, 1.005
    easing = easing_of(period)
    sampling = Sampling(U_MAX, -math.expm1(-2.0 * period), 3 * U_MAX, period, None, easing)
    for _ in range(300):
        y = state_of(rng.uniform(-0.1, 1.0, 4) * U_MAX, easing, period)
        x = Flat(*((y[i] + (distance if i == 3 else 0.0), 0.0, 0.0) for i in (3, 2, 1, 0)))
        demand = demand_along((1.0, 0.0, 0.0), x, (-1e4, 0.0, 0.0), Kept(distance, None, None), sampling)
        if demand.is_admissible:
            seen += 1
            assert -0.2 * U_MAX <= demand.least <= U_MAX
            value, _ = sampled_value([*y[:3], y[3] + distance], demand.least, period, U_MAX, distance)
            assert value >= -0.25 * MARGIN * distance - 2e-9
    assert seen > 200


@pytest.mark.interpreted
def test_in_flight_the_half_space_is_that_of_the_set():
    rng, period = np.random.default_rng(3), 0.02
    plain = Sampling(U_MAX, -math.expm1(-2.0 * period), 3 * U_MAX, period)
    eased = plain._replace(easing=easing_of(period))
    for _ in range(200):
        x = Flat(*(tuple(row) for row in rng.normal(size=(4, 3)) * [[0.1], [1.0], [3.0], [10.0]]))
        x = x._replace(r=(rng.uniform(1.1, 3.0), 0.0, 0.0))
        arguments = ((1.0, 0.0, 0.0), x, tuple(rng.normal(size=3) * 300), Kept(1.005, None, None))
        assert demand_along(*arguments, plain) == demand_along(*arguments, eased)


# Straight at one sphere, and into the gap between two.
SCENES = {
    "below": ([[0.0, 0.0, 2.0]], [0.0, 0.0, 1.0]),
    "side": ([[2.0, 0.0, 0.0]], [1.0, 0.0, 0.0]),
    "two": ([[0.4, 0.0, 2.0], [-0.4, 0.0, 2.0]], [0.0, 0.0, 1.0]),
}


def pushed(settings, rate, scene, speed, seconds=9.0):
    """Positions and snaps of a chain that a velocity feedback with poles at 6 1/s pushes; whether certified."""
    (centers, push), period, flat = SCENES[scene], 1 / rate, np.zeros((4, 3))
    center, radius, shield = np.array(centers), np.full(len(centers), 0.5), Shield(**settings)
    gains, positions, snaps, certified = held_gains(3, 6.0, period), [], [], True
    for _ in range(round(seconds * rate)):
        wanted = gains[0] * speed * np.array(push) - np.einsum("o,oi->i", gains, flat[1:])
        answer = shield.filter(flat, Obstacles.spheres(center, radius), wanted, period)
        certified &= bool(answer.certified)
        positions.append(flat[0]), snaps.append(answer.snap)
        x = flown(Flat(*(tuple(row) for row in flat)), tuple(answer.snap), period)
        flat = np.array(x)
    distance = np.linalg.norm(np.array(positions)[:, None] - center, axis=2).min(axis=1)
    return np.array(positions), np.array(snaps), distance, certified


def assert_rests(positions, snaps, count):
    """In the last periods it moves by 2 mm at most, with 5 m/s⁴ at most."""
    assert np.ptp(positions[-count:], axis=0).max() < 2e-3
    assert np.sqrt((snaps[-count:] ** 2).sum(axis=1).mean()) < 5.0


# Within an authority a push sideways takes thrust from what holds it up: it sinks, and slides off.
@pytest.mark.parametrize(
    ("name", "scene"), [pair for pair in product(SHIELDS, SCENES) if pair != ("authority", "side")]
)
@pytest.mark.parametrize("rate", [20, 50, 100, 200])
def test_a_steady_push_on_the_chain_ends_in_rest_at_the_border(rate, scene, name):
    positions, snaps, distance, certified = pushed(SHIELDS[name], rate, scene, 2.0)
    assert_rests(positions, snaps, rate)
    assert certified and distance.min() >= 0.5
    # At the border: of the tube too, which is widest at 20 Hz.
    assert distance[-1] < 0.5 * (1 + MARGIN) + (0.02 if name == "told" else 1e-4)


@pytest.mark.parametrize("rate", [50, 100])
def test_without_the_easing_the_same_push_bounces_for_ever(rate, monkeypatch):
    monkeypatch.setattr(
        "shields.methods.memory.easing_at", lambda *_: Easing((math.inf, 0.0, 0.0, 0.0), 1.0, 1.0)
    )
    positions, snaps, _, _ = pushed({}, rate, "below", 2.0)
    # Between two rows of bounces it creeps up to the border for a second or two.
    with pytest.raises(AssertionError):
        assert_rests(positions, snaps, 3 * rate)


# The last is straight overhead, as the campaign has it.
PLANT = {
    "down": ([[2.0, 0.0, -1.0, 0.45]], [2.0, 0.0, 3.0], [0, 0, -1, 0]),
    "two": ([[2.4, 0.0, 7.0, 0.45], [1.6, 0.0, 7.0, 0.45]], [2.0, 0.0, 3.0], [0, 0, 1, 0]),
    "overhead": ([[2.0, 0.0, 7.0, 0.95]], [2.0, 0.0, 3.0], [0, 0, 1, 0]),
}


@pytest.mark.parametrize("settings", [{}, SHIELDS["told"]], ids=["free", "told"])
@pytest.mark.parametrize("scene", PLANT)
@pytest.mark.parametrize("rate", [50, 100, 200])
def test_a_steady_push_of_the_quadrotor_ends_in_a_steady_hover(rate, scene, settings):
    obstacles, start, action = PLANT[scene]
    keywords = {"policy_hz": rate, "control_hz": rate, "physics_hz": 1000, "max_episode_steps": 10**6}
    env = ShieldWrapper(
        gymnasium.make("QuadSafe/Flight-v0", obstacles=obstacles, blocked=0, **keywords), **settings
    )
    env.reset(seed=0)
    plant, positions, snaps = env.unwrapped, [], []
    plant.state = hover_state(np.array(start), plant.params)
    for _ in range(8 * rate):
        _, _, terminated, _, info = env.step(np.array(action, dtype=np.float32))
        assert not terminated and info["cost"] == 0.0 and info["shield"]["certified"]
        positions.append(np.array(plant.flat_state()).reshape(4, 3)[0])
        snaps.append(info["shield"]["snap_applied"])
    assert_rests(np.array(positions), np.array(snaps), rate)
    assert info["clearance"] < 0.02
