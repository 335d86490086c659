"""From inside a sphere the vehicle leaves by the nearest exit that is tried, no faster than declared."""

import math

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from quadsafe_env.vehicle.state import hover_state
from shields import Shield, ShieldWrapper
from shields.backup.recovery import RECOVERY_POLE, RECOVERY_SPEED, leaving_snap, length_of_way, nearest_exit
from shields.backup.stored_stop import NOTHING
from shields.chains.flat_state import Flat, flown
from shields.interface.records import MovingBodies

AUTHORITY = {
    "snap_max": 300.0,
    "jerk_max": 60.0,
    "specific_thrust_min": 3.0,
    "specific_thrust_max": 18.0,
    "gravity": 9.81,
}
SHIELDS = {"free": {}, "told": {"uncertainty": {"snap": 50.0}}, "authority": {"authority": AUTHORITY}}
# Where the vehicle is at rest, centres, radii, and how long the way out is at most.
PLACES = {
    "centre": ([0.0, 0.0, 0.0], [[0.0, 0.0, 0.0]], [0.5], 0.5),
    "centre of a large one": ([0.0, 0.0, 0.0], [[0.0, 0.0, 0.0]], [1.0], 1.0),
    "off the centre": ([0.1, 0.05, 0.0], [[0.0, 0.0, 0.0]], [0.5], 0.39),
    "under the surface": ([0.0, 0.0, -0.49], [[0.0, 0.0, 0.0]], [0.5], 0.01),
    "two in one": ([0.0, 0.0, 0.0], [[0.0, 0.0, 0.0]] * 2, [0.5, 0.4], 0.5),
    "two": ([0.0, 0.0, 0.0], [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]], [0.5, 0.5], 0.46),
    "three": ([0.0, 0.02, 0.0], [[0.3, 0, 0], [-0.3, 0, 0], [0.0, 0.3, 0.1]], [0.5, 0.5, 0.4], 0.45),
}


def spheres(center, radius):
    """Spheres at rest, as kernels see them."""
    centers = np.array(center, dtype=float)
    return MovingBodies(centers, np.zeros_like(centers), np.array(radius, dtype=float))


def recovered(shield, rate, place, seconds=4.0, start=NOTHING):
    """Greatest speed, all positions, whether certified in every period; the pilot wants to hover."""
    position, center, radius, _ = PLACES[place]
    center, radius, flat = np.array(center), np.array(radius), np.zeros((4, 3))
    flat[0], flat[1] = position, start
    gains, fastest, positions, certified = held_gains(3, 6.0, 1 / rate), 0.0, [flat[0]], []
    for _ in range(round(seconds * rate)):
        wanted = -np.einsum("o,oi->i", gains, flat[1:])
        answer = shield.filter(flat, Obstacles.spheres(center, radius), wanted, 1 / rate)
        certified.append(bool(answer.certified))
        assert answer.certified or answer.fallback
        x = Flat(*(tuple(row) for row in flat))
        for share in (0.25, 0.5, 0.75, 1.0):
            fastest = max(fastest, math.hypot(*flown(x, tuple(answer.snap), share / rate).v))
        flat = np.array(flown(x, tuple(answer.snap), 1 / rate))
        positions.append(flat[0])
    gap = np.linalg.norm(np.array(positions)[:, None] - center, axis=2) - radius
    return fastest, np.array(positions), gap.min(axis=1), np.array(certified)


@pytest.mark.parametrize("name", SHIELDS)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("rate", [20, 50, 100, 500])
def test_from_rest_inside_it_leaves_no_faster_than_declared_and_is_certified_outside(rate, place, name):
    fastest, positions, gap, certified = recovered(Shield(**SHIELDS[name]), rate, place)
    # A hundredth for the pilot's own loop after it.
    assert fastest <= 1.01 * RECOVERY_SPEED
    first = int(np.argmax(certified))
    assert certified[first] and certified[first:].all() and not certified[:first].any()
    assert gap[0] < 0.0 and (gap[first:] >= 0.0).all()
    # By the nearest exit, and it comes to rest within the distance that 1 m/s takes.
    way = np.linalg.norm(positions - positions[0], axis=1)
    assert way[first] <= PLACES[place][3] + 0.02 + 1.1 * RECOVERY_SPEED / rate
    assert way.max() <= PLACES[place][3] + 0.7


@pytest.mark.interpreted
def test_the_law_from_rest_rises_to_its_speed_and_not_above():
    for rate in (10, 100):
        gains, x = tuple(held_gains(3, RECOVERY_POLE, 1 / rate)), Flat(*[NOTHING] * 4)
        speeds = []
        for _ in range(3 * rate):
            x = flown(x, leaving_snap(x, (0.0, 1.0, 0.0), NOTHING, gains), 1 / rate)
            speeds.append(x.v[1])
        assert np.all(np.diff(speeds) >= -1e-12) and speeds[-1] == pytest.approx(RECOVERY_SPEED, abs=1e-4)


@pytest.mark.interpreted
def test_the_way_out_goes_through_every_sphere_in_its_path():
    bodies = spheres([[0.0, 0, 0], [1.5, 0, 0], [3.5, 0, 0], [0.5, 0, 0]], [1.0, 1, 0.5, 0])
    for point, way, expected in (
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.5),
        ((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.0), (0.0, 0.6, 0.8), 1.0),
        ((2.75, 0.0, 0.0), (1.0, 0.0, 0.0), 0.0),
    ):
        assert length_of_way(point, way, bodies, 0.0) == pytest.approx(expected, abs=1e-12)
    assert length_of_way((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), bodies, 0.1) == pytest.approx(1.1)


@pytest.mark.interpreted
def test_the_exit_of_one_sphere_is_the_nearest_and_from_its_centre_it_is_up():
    rng = np.random.default_rng(0)
    for _ in range(50):
        point = rng.normal(size=3) * 0.3
        way, k = nearest_exit(tuple(point), spheres(np.zeros((1, 3)), [2.0]), 0.0)
        np.testing.assert_allclose(way, point / np.linalg.norm(point), rtol=1e-12)
        assert k == 0
    assert nearest_exit(NOTHING, spheres(np.zeros((1, 3)), [2.0]), 0.0) == ((0.0, 0.0, 1.0), 0)
    assert nearest_exit((3.0, 0.0, 0.0), spheres(np.zeros((2, 3)), [2.0, 0.0]), 0.0)[1] == -1


@pytest.mark.interpreted
def test_the_exit_of_several_is_no_farther_than_straight_away_from_any_of_them():
    rng = np.random.default_rng(1)
    for _ in range(50):
        center, radius = rng.normal(size=(5, 3)) * 0.4, rng.uniform(0.3, 1.0, 5)
        bodies = spheres(center, radius)
        way, k = nearest_exit(NOTHING, bodies, 0.0)
        inside = np.linalg.norm(center, axis=1) < radius
        if not inside.any():
            assert k == -1
            continue
        assert k == np.argmax(radius - np.linalg.norm(center, axis=1))
        length = length_of_way(NOTHING, way, bodies, 0.0)
        end = length * np.array(way)
        assert (np.linalg.norm(end - center, axis=1) >= radius - 1e-9).all()
        for c in center[inside]:
            # The direction is rounded here as the machine's BLAS has it.
            straight = length_of_way(NOTHING, tuple(-c / np.linalg.norm(c)), bodies, 0.0)
            assert length <= straight * (1.0 + 1e-12)


@pytest.mark.interpreted
def test_it_leaves_relative_to_a_sphere_that_moves():
    shield, flat = Shield(), np.zeros((4, 3))
    center, drift = np.array([[-0.1, 0.0, 0.0]]), np.array([[0.0, 0.5, 0.0]])
    flat[1] = drift[0]
    for _ in range(200):
        answer = shield.filter(flat, Obstacles.spheres(center, [0.5], drift), np.zeros(3), 0.02)
        if answer.certified:
            break
        flat = np.array(flown(Flat(*(tuple(row) for row in flat)), tuple(answer.snap), 0.02))
        center = center + 0.02 * drift
        assert np.linalg.norm(flat[1] - drift[0]) <= RECOVERY_SPEED
    assert answer.certified and flat[1, 1] == pytest.approx(0.5)


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [20, 100])
def test_outside_and_too_fast_it_brakes_as_hard_as_ever(rate):
    flat = np.zeros((4, 3))
    flat[:2] = [[-0.6, 0.0, 0.0], [3.0, 0.0, 0.0]]
    answer = Shield().filter(flat, Obstacles.spheres(np.zeros((1, 3)), [0.5]), np.zeros(3), 1 / rate)
    # More than ū, which the law of the recovery would not ask for.
    assert not answer.certified and answer.snap[0] <= -300.0


@pytest.mark.parametrize("settings", [{}, SHIELDS["told"]], ids=["free", "told"])
@pytest.mark.parametrize("rate", [20, 50, 100, 500])
@pytest.mark.parametrize("offset", [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.1, -0.3]])
def test_the_quadrotor_leaves_and_stays_within_the_bounds_of_the_task(offset, rate, settings):
    rates = {"policy_hz": rate, "control_hz": rate, "physics_hz": 1000}
    env = ShieldWrapper(
        gymnasium.make("QuadSafe/Avoid-v0", obstacles=[[0, 0, 0, 0.9]], terminate_on_violation=False, **rates),
        **settings,
    )
    env.reset(seed=0)
    plant, fastest = env.unwrapped, 0.0
    plant.state = hover_state(np.array(offset), plant.params)
    for _ in range(3 * rate):
        _, _, terminated, _, info = env.step(np.zeros(4, dtype=np.float32))
        fastest = max(fastest, np.linalg.norm(np.array(plant.flat_state()).reshape(4, 3)[1]))
        assert not terminated and not info["out_of_bounds"] and not info["crash"]
    assert info["clearance"] > 0.0 and info["shield"]["certified"]
    # The inner loop flies the snap with an error, by some per cent at 20 Hz.
    assert fastest <= 1.1 * RECOVERY_SPEED


@pytest.mark.interpreted
def test_cbf_at_rest_inside_leaves_the_snap_as_it_is_and_the_value_says_so():
    # At rest t* = 0, where (33) gives no bound of order 4.
    answer = Shield(method="cbf").filter(
        np.zeros((4, 3)), Obstacles.spheres([[0.1, 0, 0]], [0.5]), [1.0, 0, 0], 0.02
    )
    assert not answer.intervened and not answer.in_set and not answer.certified
    assert answer.value == pytest.approx(0.1 - 0.5 * 1.005)
