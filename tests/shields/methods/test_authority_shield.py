"""The shield within a vehicle's authority: what it flies, the rotors can do, whatever is asked for."""

import json
import math

import gymnasium
import numpy as np
import pytest
from house import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.authority import Authority, acceleration_along
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from shields import Shield, ShieldWrapper, VectorShieldWrapper
from shields.chains.braking import BrakingSet
from shields.chains.flat_state import Flat, flown
from shields.filters.braking_held import sampled_braking_input
from shields.interface.bodies import Kept
from shields.interface.row_checks import BRAKING_POLE
from shields.methods.authority_limits import limit_demand
from shields.methods.flight_bounds import RESERVED
from shields.methods.halfspace import Sampling, demand_along

LIMITS = Authority(
    snap_max=380.0, jerk_max=44.0, specific_thrust_min=5.0, specific_thrust_max=20.0, gravity=9.81
)
TABLE = LIMITS._asdict()
PERIOD, ROWS = 0.02, 64
UP = np.array([0.0, 0.0, LIMITS.gravity])


def thrust(flat):
    return np.linalg.norm(flat[..., 2, :] + UP, axis=-1)


def after(flat, snap, t):
    return np.array(flown(Flat(*map(tuple, flat)), tuple(snap), t))


def scene(rng, n, k=3):
    """Vehicles at rest at the origin, spheres around them."""
    direction = rng.normal(size=(n, k, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    radius = rng.uniform(0.2, 0.6, (n, k))
    flat = np.zeros((n, 4, 3))
    return flat, direction * (radius + rng.uniform(0.3, 2.0, (n, k)))[..., None], radius


def fly(shield, rng, seconds=4.0):
    """Flat states at ten instants of every period, snaps and clearances, under an attack."""
    flat, center, radius = scene(rng, ROWS)
    states, snaps, clearance, goal = [], [], math.inf, rng.normal(size=(ROWS, 3)) * 4000.0
    for step in range(int(seconds / PERIOD)):
        if step % 10 == 0:
            goal = rng.normal(size=(ROWS, 3)) * rng.choice([50.0, 400.0, 4000.0], (ROWS, 1))
        answer = shield.filter(flat, Obstacles.spheres(center, radius), goal, PERIOD)
        assert answer.certified.all()
        snaps.append(answer.snap)
        for t in np.linspace(PERIOD / 10, PERIOD, 10):
            now = np.array([after(x, s, t) for x, s in zip(flat, answer.snap, strict=True)])
            states.append(now)
            gap = np.linalg.norm(now[:, None, 0] - center, axis=-1) - radius
            clearance = min(clearance, gap.min())
        flat = now
    return np.array(states), np.array(snaps), clearance


def test_under_attack_every_snap_jerk_and_thrust_is_within_the_authority():
    states, snaps, clearance = fly(Shield(authority=LIMITS), np.random.default_rng(0), 2.0)
    assert clearance >= 0.0
    assert np.linalg.norm(snaps, axis=-1).max() <= LIMITS.snap_max * (1 + 1e-12)
    # A stored stop is held by feedback; on the bare chain it has nothing to correct but rounding.
    kept = LIMITS.less(RESERVED)
    assert np.linalg.norm(states[..., 3, :], axis=-1).max() <= kept.jerk_max * (1 + 1e-9)
    assert thrust(states).min() >= kept.specific_thrust_min * (1 - 1e-9)
    assert thrust(states).max() <= kept.specific_thrust_max * (1 + 1e-9)


def test_with_free_numbers_the_same_attack_leaves_it():
    states, snaps, _ = fly(Shield(snap_max=380.0, reserve=1.0), np.random.default_rng(0), 1.0)
    assert np.linalg.norm(snaps, axis=-1).max() > 2 * LIMITS.snap_max
    assert np.linalg.norm(states[..., 3, :], axis=-1).max() > 2 * LIMITS.jerk_max
    assert thrust(states).min() < LIMITS.specific_thrust_min < LIMITS.specific_thrust_max < thrust(states).max()


@pytest.mark.interpreted
def test_what_is_within_the_authority_and_can_be_stopped_passes_bit_for_bit():
    flat, wanted = np.zeros((4, 3)), np.array([30.0, -10.0, 20.0])
    flat[1] = [0.5, 0.0, 0.0]
    answer = Shield(authority=LIMITS).filter(flat, Obstacles.spheres([[50.0, 0.0, 0.0]], [1.0]), wanted, PERIOD)
    assert np.array_equal(answer.snap, wanted) and not answer.intervened and answer.certified
    assert answer.obstacle == -1 and answer.correction == 0.0


@pytest.mark.interpreted
def test_beyond_the_authority_the_snap_is_shortened_and_no_sphere_is_blamed():
    wanted = np.array([4000.0, 0.0, 0.0])
    answer = Shield(authority=LIMITS).filter(
        np.zeros((4, 3)), Obstacles.spheres([[0.0, 50.0, 0.0]], [1.0]), wanted, PERIOD
    )
    assert answer.intervened and answer.obstacle == -1 and answer.certified
    assert answer.snap[0] == pytest.approx(LIMITS.snap_max, rel=1e-12)


@pytest.mark.interpreted
@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_acceleration_along_is_where_the_ray_leaves_the_band(seed):
    rng = np.random.default_rng(seed)
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    reach = acceleration_along(n[2], LIMITS)
    on_ray = np.linalg.norm(np.linspace(0, reach * (1 - 1e-9), 200)[:, None] * n + UP, axis=1)
    assert on_ray.min() >= LIMITS.specific_thrust_min and on_ray.max() <= LIMITS.specific_thrust_max
    beyond = np.linalg.norm(reach * (1 + 1e-6) * n + UP)
    assert not LIMITS.specific_thrust_min <= beyond <= LIMITS.specific_thrust_max


@pytest.mark.interpreted
def test_half_spaces_are_those_of_the_braking_set_along_the_normal():
    rng = np.random.default_rng(3)
    sampling = Sampling(LIMITS.snap_max, -math.expm1(-2 * PERIOD), LIMITS.snap_max, PERIOD, LIMITS)
    active = 0
    for _ in range(200):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        x = Flat(*(tuple(row) for row in rng.normal(size=(4, 3)) * [[3.0], [2.0], [2.0], [10.0]]))
        wanted = rng.normal(size=3) * 300.0
        demand = demand_along(tuple(n), x, tuple(wanted), Kept(1.0, None, None), sampling)
        chain = [np.dot(n, part) for part in (x.j, x.a, x.v, x.r)]
        reach = float(LIMITS.acceleration_along(n))
        limits = BrakingSet(1.0, LIMITS.jerk_max, reach, -LIMITS.snap_max, LIMITS.snap_max)
        u, in_set = sampled_braking_input(limits, chain, np.dot(n, wanted), PERIOD, 2.0)
        assert demand.least == pytest.approx(max(u, np.dot(n, wanted)), rel=1e-9, abs=1e-9)
        assert demand.is_admissible == in_set
        active += bool(in_set and u > np.dot(n, wanted))
    assert active >= 5


@pytest.mark.interpreted
@pytest.mark.parametrize("limit", [0, 1, 2])
def test_a_limit_asks_for_nothing_inside_and_holds_when_flown_against_it(limit):
    sampling = Sampling(LIMITS.snap_max, -math.expm1(-2 * PERIOD), LIMITS.snap_max, PERIOD, LIMITS)
    hover = Flat(*[(0.0, 0.0, 0.0)] * 4)
    calm = limit_demand(limit, hover, (1.0, 0.0, 0.0), sampling, LIMITS)
    assert np.dot(calm.n, (1.0, 0.0, 0.0)) >= calm.least
    wanted = (0.0, 0.0, -300.0) if limit == 2 else (0.0, 0.0, 300.0)
    x, acted = hover, 0
    for _ in range(200):
        u = np.array(wanted)
        for other in (limit, 0):  # the jerk must stay bounded, too
            demand = limit_demand(other, x, tuple(u), sampling, LIMITS)
            missing = demand.least - np.dot(demand.n, u)
            if missing > 0.0:
                u, acted = u + missing * np.array(demand.n), acted + 1
        x = flown(x, tuple(u), PERIOD)
        now = np.array(x)
        assert np.linalg.norm(now[3]) <= LIMITS.jerk_max * (1 + 1e-9)
        if limit == 1:
            assert thrust(now) <= LIMITS.specific_thrust_max * (1 + 1e-9)
        if limit == 2:
            assert thrust(now) >= LIMITS.specific_thrust_min * (1 - 1e-9)
    assert acted > 100


@pytest.mark.interpreted
def test_a_vehicle_beyond_its_authority_is_brought_back():
    flat = np.zeros((4, 3))
    flat[2], flat[3] = [0.0, 0.0, 14.0], [50.0, 0.0, 0.0]
    shield, reached = Shield(authority=LIMITS), False
    assert thrust(flat) > LIMITS.specific_thrust_max and np.linalg.norm(flat[3]) > LIMITS.jerk_max
    for _ in range(200):
        answer = shield.filter(flat, Obstacles.spheres([[0.0, 0.0, 300.0]], [1.0]), [0.0, 0.0, 0.0], PERIOD)
        flat = after(flat, answer.snap, PERIOD)
        is_in = thrust(flat) <= LIMITS.specific_thrust_max and np.linalg.norm(flat[3]) <= LIMITS.jerk_max
        assert is_in or not reached
        reached |= is_in
    assert reached and answer.certified


@pytest.mark.parametrize("radius", [[], [0.0], [1.0]])
def test_where_its_limits_conflict_a_vehicle_brakes(radius):
    # Tumbling, far beyond thrust and jerk: no stop, and half-spaces of the limits that exclude each other.
    rng, center = np.random.default_rng(5), np.full((len(radius), 3), 50.0)
    conflicts = 0
    for _ in range(200):
        flat = rng.normal(size=(4, 3)) * [[0.0], [5.0], [60.0], [3000.0]]
        answer = Shield(authority=LIMITS).filter(
            flat, Obstacles.spheres(center, radius), rng.normal(size=3) * 1e3, PERIOD
        )
        assert np.isfinite(answer.snap).all()
        assert np.linalg.norm(answer.snap) <= LIMITS.snap_max * (1 + 1e-12)
        k_v, k_a, k_j = held_gains(3, BRAKING_POLE, PERIOD)
        brake = -(k_v * flat[1] + k_a * flat[2] + k_j * flat[3])
        along = answer.snap @ brake / (np.linalg.norm(brake) * np.linalg.norm(answer.snap))
        conflicts += bool(not answer.certified and along > 1 - 1e-9)
    assert conflicts > 0


@pytest.mark.interpreted
def test_authority_comes_as_a_mapping_too_and_survives_json():
    shield = Shield(authority=TABLE)
    twin = Shield(**json.loads(json.dumps(shield.settings)))
    assert twin.settings == shield.settings and twin.settings["authority"] == TABLE
    assert shield.settings["snap_max"] is None


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"authority": TABLE, "snap_max": 5.0}, "snap_max must be left out beside an authority"),
        ({"authority": TABLE, "gravity": 9.81}, "gravity must be left out"),
        ({"authority": TABLE, "method": "cbf"}, "authority needs method 'sampled', got 'cbf'"),
        ({"authority": TABLE | {"jerk_max": -1.0}}, "authority.jerk_max must be a finite number > 0"),
        (
            {"authority": TABLE | {"specific_thrust_min": 12.0}},
            "specific_thrust_min < gravity < specific_thrust_max",
        ),
    ],
)
def test_bad_authorities_are_named(changed, message):
    with pytest.raises(ValueError, match=message):
        Shield(**changed)


@pytest.mark.interpreted
@pytest.mark.parametrize("value", ["vehicle", 3.0, {"snap_max": 1.0}])
def test_a_shield_alone_knows_no_vehicle(value):
    with pytest.raises(TypeError, match="authority must be an Authority or a mapping"):
        Shield(authority=value)


@pytest.mark.interpreted
@pytest.mark.parametrize("params", ["crazyflie", "hummingbird"])
def test_the_wrapper_asks_the_vehicle_and_its_spec_keeps_the_word(params):
    env = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", params=params), authority="vehicle")
    assert env.shield.settings["authority"] == env.unwrapped.authority()._asdict()
    again = gymnasium.make(env.spec)
    assert again.shield.settings == env.shield.settings
    assert '"authority": "vehicle"' in env.spec.to_json().replace('\\"', '"')


@pytest.mark.interpreted
def test_another_word_and_a_plant_without_authority_are_errors():
    with pytest.raises(ValueError, match="authority must be 'vehicle'"):
        ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0"), authority="rotors")

    class Plant(gymnasium.Env):
        snap_filter, is_shielded = None, False

    with pytest.raises(TypeError, match=r"env must have authority\(\) .*got Plant"):
        ShieldWrapper(Plant(), authority="vehicle")


def saturated_steps(settings, n=64, seconds=3.0):
    """Steps with a rotor at its limit, violations and flights, of random full-range snaps."""
    env = VectorShieldWrapper(
        gymnasium.make_vec("QuadSafe/Avoid-v0", n, action="snap", policy_hz=50, rotor_limits=True), **settings
    )
    env.reset(seed=0)
    rng, count, hits = np.random.default_rng(1), 0, 0
    for _ in range(int(50 * seconds)):
        *_, info = env.step(np.sign(rng.normal(size=(n, 4))).astype(np.float32))
        count, hits = count + int(info["saturated"].sum()), hits + int(info["violation"].sum())
    return count, hits


def test_within_the_vehicles_authority_no_rotor_is_ever_at_its_limit():
    assert saturated_steps({"authority": "vehicle"}) == (0, 0)


def test_with_a_free_number_rotors_are():
    count, _ = saturated_steps({"snap_max": 2000.0, "inner_loop": "measured"})
    assert count > 10


def test_the_table_of_the_document_is_that_of_its_data(monkeypatch):
    import csv
    import importlib

    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    bench = importlib.import_module("authority")
    with (ROOT / "docs/data/authority.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    text = (ROOT / "docs/authority.md").read_text(encoding="utf-8")
    assert bench.filled(text, rows, bench.TABLES) == text
