"""The shield around method "sampled": what it passes and corrects, and that nothing it flies hits a sphere."""

import copy
import itertools
import math
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from quadsafe_core.shapes import Obstacles
from shields import Shield
from shields.filters.sampled import sampled_value

GRAVITY, U_MAX, ALPHA, MARGIN = 9.81, 200.0, 2.0, 0.005
PERIOD = 0.05


def moved(flat, snap, t):
    """The flat states (N, 4, 3) after the snaps were held for t."""
    r, v, a, j = np.moveaxis(flat, -2, 0)
    return np.stack(
        [
            r + t * (v + t * (a / 2 + t * (j / 6 + t * snap / 24))),
            v + t * (a + t * (j / 2 + t * snap / 6)),
            a + t * (j + t * snap / 2),
            j + t * snap,
        ],
        axis=-2,
    )


def clearance(flat, center, radius):
    """Least distance to a keep-out sphere, per row; absent spheres do not count."""
    distance = np.linalg.norm(flat[:, None, 0] - center, axis=-1) - radius
    return np.where(radius > 0, distance, np.inf).min(axis=1)


def thrust(flat):
    return np.linalg.norm(flat[:, 2] + [0.0, 0.0, GRAVITY], axis=-1)


def resting(*positions):
    flat = np.zeros((len(positions), 4, 3))
    flat[:, 0] = positions
    return flat


def one(*rows):
    flat = np.zeros((4, 3))
    flat[: len(rows)] = rows
    return flat


def scene(rng, n, k, moving=0.0):
    """Vehicles at rest near the origin among K spheres with at least 0.3 m between vehicle and sphere."""
    direction = rng.normal(size=(n, k, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    radius = rng.uniform(0.2, 0.6, (n, k))
    center = direction * (radius + rng.uniform(0.3, 1.5, (n, k)))[..., None]
    return resting(*np.zeros((n, 3))), center, radius, rng.normal(size=(n, k, 3)) * moving


def slow_states(rng, n):
    """States around the unit sphere at the origin, most of them outside and slow enough to be certified."""
    flat = rng.normal(size=(n, 4, 3)) * [[1.0], [0.5], [1.0], [3.0]]
    flat[:, 0] *= rng.uniform(1.3, 3.0, (n, 1)) / np.linalg.norm(flat[:, 0], axis=1, keepdims=True)
    return flat, np.zeros((n, 1, 3)), np.ones((n, 1)), rng.normal(size=(n, 3)) * 300


def attack(rng, flat, center):
    """Half of the vehicles aim at their nearest sphere, the others want anything; up to 4000 m/s⁴ per axis."""
    anything = rng.uniform(-4000, 4000, (len(flat), 3))
    gap = center - flat[:, None, 0]
    nearest = gap[np.arange(len(flat)), np.linalg.norm(gap, axis=-1).argmin(axis=1)]
    aimed = 4000 * nearest / np.linalg.norm(nearest, axis=1, keepdims=True)
    return np.where((np.arange(len(flat)) % 2 == 0)[:, None], aimed, anything)


class Flight:
    """Vehicles under a shield, or none, and the nearest they came to their spheres and to free fall."""

    def __init__(self, shield, flat, center, radius, velocity=None):
        self.shield, self.flat, self.center, self.radius = shield, flat, center, radius
        self.velocity = np.zeros(center.shape) if velocity is None else velocity
        self.clearance = clearance(flat, center, radius)
        self.thrust = thrust(flat)

    def fly(self, wanted, period):
        answer = None
        snap = wanted
        if self.shield is not None:
            answer = self.shield.filter(
                self.flat, Obstacles.spheres(self.center, self.radius, self.velocity), wanted, period
            )
            snap = answer.snap
        for t in np.linspace(0.0, period, 6)[1:]:
            flat, center = moved(self.flat, snap, t), self.center + t * self.velocity
            self.clearance = np.minimum(self.clearance, clearance(flat, center, self.radius))
            self.thrust = np.minimum(self.thrust, thrust(flat))
        self.flat, self.center = flat, center
        return answer


@pytest.mark.interpreted
def test_inside_the_set_everything_passes_bit_for_bit():
    rng = np.random.default_rng(0)
    flat, center, radius, snap = slow_states(rng, 200)
    snap /= 30
    flat[:, 0] *= 2
    answer = Shield().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    np.testing.assert_array_equal(answer.snap, snap)
    assert answer.certified.all() and answer.in_set.all()
    assert not (answer.intervened | answer.refused | answer.stopped | answer.fallback).any()
    assert (answer.correction == 0).all() and (answer.obstacle == -1).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [20, 100, 1000])
def test_eq17_the_correction_is_the_least_along_its_normal(rate):
    rng = np.random.default_rng(1)
    flat, center, radius, snap = slow_states(rng, 2000)
    answer = Shield().filter(flat, Obstacles.spheres(center, radius), snap, 1 / rate)
    cut = np.flatnonzero(answer.intervened & ~answer.refused & (answer.correction > 1e-3))
    assert len(cut) > 10
    n = (answer.snap - snap)[cut] / answer.correction[cut, None]
    chain = np.einsum("nij,nj->ni", flat[cut], n)[:, ::-1]
    u = (answer.snap[cut] * n).sum(axis=1)
    bound = (1 + MARGIN) * radius[cut, 0]
    g, _ = sampled_value(chain, np.full(len(cut), U_MAX), 1 / rate, U_MAX, bound)
    target = math.exp(-ALPHA / rate) * g
    # The direction is a difference of snaps: 1e-13 of 300 m/s⁴ over a correction of 1e-3 m/s⁴ at worst.
    flown, _ = sampled_value(chain, u, 1 / rate, U_MAX, bound)
    assert (flown >= target - 1e-9).all()
    for share in (0.5, 0.99):
        less = (snap[cut] * n).sum(axis=1) + share * answer.correction[cut]
        smaller, _ = sampled_value(chain, less, 1 / rate, U_MAX, bound)
        assert (smaller < target).all()


@pytest.mark.interpreted
def test_filter_is_idempotent():
    rng = np.random.default_rng(2)
    flat, center, radius, snap = slow_states(rng, 400)
    once = Shield().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    twice = Shield().filter(flat, Obstacles.spheres(center, radius), once.snap, PERIOD)
    kept = ~once.refused
    assert (kept & once.intervened).sum() > 10
    # Rounding of the projection.
    np.testing.assert_allclose(twice.snap[kept], once.snap[kept], rtol=1e-9, atol=1e-9)
    assert not twice.refused[kept].any()


@pytest.mark.interpreted
def test_a_copy_remembers_and_forgets_by_itself():
    rng = np.random.default_rng(4)
    flat, center, radius, _ = scene(rng, 4, 2)
    shield = Shield()
    for _ in range(5):
        flat = moved(
            flat,
            shield.filter(flat, Obstacles.spheres(center, radius), attack(rng, flat, center), PERIOD).snap,
            PERIOD,
        )
    wish = attack(rng, flat, center)
    for twin in (copy.deepcopy(shield), pickle.loads(pickle.dumps(shield))):
        twin.reset(np.array([True, False, False, False]))
        answers = [
            s.filter(flat, Obstacles.spheres(center, radius), wish, PERIOD)
            for s in (twin, copy.deepcopy(shield))
        ]
        for ours, theirs in zip(*answers, strict=True):
            np.testing.assert_array_equal(ours[1:], theirs[1:])
        # The first row of the twin is as a new shield has it.
        new = Shield().filter(flat, Obstacles.spheres(center, radius), wish, PERIOD)
        np.testing.assert_array_equal(answers[0].snap[0], new.snap[0])


@pytest.mark.interpreted
def test_a_row_of_a_batch_is_a_single_plant_bit_for_bit():
    rng = np.random.default_rng(3)
    flat, center, radius, velocity = scene(rng, 8, 3, 0.1)
    batch, singles = Shield(), [Shield() for _ in range(8)]
    for _ in range(25):
        wanted = attack(rng, flat, center)
        together = batch.filter(flat, Obstacles.spheres(center, radius, velocity), wanted, PERIOD)
        for i, shield in enumerate(singles):
            alone = shield.filter(
                flat[i], Obstacles.spheres(center[i], radius[i], velocity[i]), wanted[i], PERIOD
            )
            for ours, theirs in zip(alone, together, strict=True):
                np.testing.assert_array_equal(ours, theirs[i])
        flat, center = moved(flat, together.snap, PERIOD), center + PERIOD * velocity


@pytest.mark.interpreted
@pytest.mark.parametrize("mirrored", [False, True])
def test_rotations_about_the_vertical_and_mirrors_commute_with_the_filter(mirrored):
    rng = np.random.default_rng(4)
    turn = Rotation.from_euler("z", 1.234).as_matrix() @ np.diag([1.0, -1.0 if mirrored else 1.0, 1.0])
    flat, center, radius, velocity = scene(rng, 32, 2, 0.1)
    ours, theirs, compared = Shield(), Shield(), 0
    for _ in range(10):
        wanted = rng.normal(size=(32, 3)) * 300
        one_way = ours.filter(flat, Obstacles.spheres(center, radius, velocity), wanted, PERIOD)
        other = theirs.filter(
            flat @ turn.T,
            Obstacles.spheres(center @ turn.T, radius, velocity @ turn.T),
            wanted @ turn.T,
            PERIOD,
        )
        size = np.linalg.norm(one_way.snap, axis=1).max()
        np.testing.assert_allclose(other.snap, one_way.snap @ turn.T, atol=1e-9 * size)
        np.testing.assert_array_equal(other.refused, one_way.refused)
        compared += int(one_way.intervened.sum())
        flat, center = moved(flat, one_way.snap, PERIOD), center + PERIOD * velocity
    assert compared > 20


@pytest.mark.interpreted
def test_a_uniform_motion_of_everything_changes_nothing():
    rng = np.random.default_rng(5)
    flat, center, radius, snap = slow_states(rng, 400)
    wind = np.array([1.5, -0.5, 0.3])
    windy = flat.copy()
    windy[:, 1] += wind
    still = Shield().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    # The stop of the one ends in the world, that of the other in the frame of its sphere.
    moving = Shield().filter(
        windy, Obstacles.spheres(center, radius, np.broadcast_to(wind, (400, 1, 3))), snap, PERIOD
    )
    both = ~(still.refused | moving.refused)
    assert (both & still.intervened).sum() > 10
    np.testing.assert_allclose(moving.snap[both], still.snap[both], atol=1e-8)
    np.testing.assert_allclose(moving.value, still.value, atol=1e-9)


@pytest.mark.parametrize("count", [1, 8])
@pytest.mark.parametrize(("rate", "seconds"), [(20, 6.0), (100, 2.0), (1000, 1.0)])
def test_attacked_vehicles_never_hit_and_keep_their_thrust(rate, seconds, count):
    rng = np.random.default_rng(rate + count)
    flight = Flight(Shield(), *scene(rng, 64, count)[:3])
    intervened = 0
    for _ in range(round(seconds * rate)):
        wanted = attack(rng, flight.flat, flight.center)
        answer = flight.fly(wanted, 1 / rate)
        assert answer.certified.all()
        intervened += int(answer.intervened.sum())
    assert intervened > 64
    # The certificate keeps half of the margin of a radius of 0.2 m or more.
    assert flight.clearance.min() >= 0.5 * MARGIN * 0.2 - 1e-9
    # They started 0.3 m away or more.
    assert flight.clearance.min() < 0.15
    assert flight.thrust.min() >= 1.0 - 1e-9


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [20, 100])
def test_without_a_shield_the_same_attack_hits(rate):
    rng = np.random.default_rng(0)
    flight = Flight(None, *scene(rng, 64, 1)[:3])
    for _ in range(rate):
        flight.fly(attack(rng, flight.flat, flight.center), 1 / rate)
    assert (flight.clearance[::2] < 0.0).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("is_shielded", [True, False])
def test_a_dive_keeps_its_thrust_only_with_the_shield(is_shielded):
    flight = Flight(
        Shield() if is_shielded else None, resting(np.zeros(3)), np.full((1, 1, 3), 99.0), np.ones((1, 1))
    )
    for _ in range(20):
        # Unshielded the thrust is gone after 0.1 s.
        flight.fly(np.array([[0.0, 0.0, -200 * GRAVITY]]), PERIOD)
    assert (flight.thrust[0] >= 1.0 - 1e-9) == is_shielded
    assert is_shielded or flight.thrust[0] < 1e-9


def pressed_against_a_sphere(shield, rate):
    """The clearance of a velocity feedback with poles at 8 1/s that wants 3 m/s into the sphere."""
    flight = Flight(shield, resting([-1.5, 0.1, 0.0]), np.zeros((1, 1, 3)), np.array([[0.5]]))
    for _ in range(5 * rate):
        v, a, j = flight.flat[0, 1:]
        wanted = 8.0**3 * ([3.0, 0.0, 0.0] - v) - 3 * 8.0**2 * a - 3 * 8.0 * j
        flight.fly(wanted[None], 1 / rate)
    return flight.clearance.min()


@pytest.mark.interpreted
def test_the_continuous_filter_held_over_a_period_hits_where_the_sampled_one_does_not():
    assert pressed_against_a_sphere(Shield(method="cbf"), 20) < 0.0
    assert pressed_against_a_sphere(Shield(), 20) > 0.0


@pytest.mark.parametrize("rate", [20, 100])
def test_two_moving_spheres_are_never_hit(rate):
    rng = np.random.default_rng(6)
    flight = Flight(Shield(), *scene(rng, 64, 2, 0.3))
    certified = np.ones(64, dtype=bool)
    for period in range(3 * rate):
        answer = flight.fly(attack(rng, flight.flat, flight.center), 1 / rate)
        # Spheres that come from two sides may leave no stop from the start: that is said at once.
        if period == 0:
            certified = answer.certified
        assert answer.certified[certified].all()
    assert certified.sum() > 50
    assert flight.clearance[certified].min() > 0.0
    assert flight.thrust[certified].min() >= 1.0 - 1e-9


@pytest.mark.interpreted
@pytest.mark.parametrize("missing", [math.nan, math.inf])
def test_a_missing_wish_is_answered_by_the_stored_stop(missing):
    shield, flat = Shield(), one([0, 0, 0], [0.6, 0, 0])
    center, radius = np.array([[3.0, 0, 0]]), np.array([0.5])
    flat = moved(
        flat, shield.filter(flat, Obstacles.spheres(center, radius), [10.0, 0, 0], PERIOD).snap, PERIOD
    )
    for _ in range(120):
        answer = shield.filter(flat, Obstacles.spheres(center, radius), [missing, 0, 0], PERIOD)
        assert answer.stopped and answer.fallback and answer.refused and answer.certified
        flat = moved(flat, answer.snap, PERIOD)
    # A stop ends in exact rest: what is left is rounding.
    np.testing.assert_allclose(flat[1:], 0.0, atol=1e-9)


@pytest.mark.interpreted
def test_from_inside_a_sphere_it_gets_out():
    flight = Flight(Shield(), resting([0.3, 0.05, 0.0]), np.zeros((1, 1, 3)), np.array([[0.5]]))
    first = flight.fly(np.zeros((1, 3)), PERIOD)
    assert np.isfinite(first.snap).all()
    assert not first.certified[0] and not first.in_set[0] and first.fallback[0]
    for _ in range(100):
        last = flight.fly(np.zeros((1, 3)), PERIOD)
    assert clearance(flight.flat, flight.center, flight.radius)[0] > 0.0
    assert last.certified[0]


@pytest.mark.interpreted
def test_at_the_centre_the_answer_is_finite():
    answer = Shield().filter(np.zeros((4, 3)), Obstacles.spheres(np.zeros((1, 3)), [0.5]), np.zeros(3), PERIOD)
    assert np.isfinite(answer.snap).all()
    assert not answer.certified and not answer.in_set


@pytest.mark.interpreted
def test_a_sphere_without_a_radius_is_none():
    answer = Shield().filter(
        np.zeros((4, 3)), Obstacles.spheres(np.zeros((1, 3)), [0.0]), [1.0, 2.0, 3.0], PERIOD
    )
    np.testing.assert_array_equal(answer.snap, [1.0, 2.0, 3.0])
    assert answer.certified and answer.value == math.inf and answer.obstacle == -1


@pytest.mark.parametrize("second", [[0.0, 0, 0], [0.2, 0.1, 0]])
def test_coincident_and_overlapping_spheres_are_no_conflict(second):
    rng = np.random.default_rng(7)
    center = np.broadcast_to([[0.0, 0, 0], second], (16, 2, 3)).copy()
    start = rng.normal(size=(16, 3))
    start *= 1.5 / np.linalg.norm(start, axis=1, keepdims=True)
    flight = Flight(Shield(), resting(*start), center, np.full((16, 2), 0.5))
    for _ in range(60):
        answer = flight.fly(-500 * flight.flat[:, 0] - 100 * flight.flat[:, 1], PERIOD)
        assert answer.certified.all()
    assert flight.clearance.min() > 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize("left", [0.0, 0.5])
def test_from_free_fall_it_comes_to_rest_and_the_thrust_sinks_no_further(left):
    flat = np.zeros((1, 4, 3))
    flat[0, 2, 2] = left - GRAVITY
    flight = Flight(Shield(), flat, np.array([[[0, 0, -5.0]]]), np.array([[0.5]]))
    for _ in range(120):
        answer = flight.fly(np.full((1, 3), math.nan), PERIOD)
    assert answer.certified[0]
    np.testing.assert_allclose(flight.flat[0, 1:], 0.0, atol=1e-9)
    # The certificate allows for rounding.
    assert flight.thrust[0] >= left - 1e-9
    assert flight.clearance[0] > 0.0


@pytest.mark.interpreted
def test_a_sphere_that_jumps_onto_the_path_voids_the_stop():
    shield, flat = Shield(), one([0, 0, 0], [1.0, 0, 0])
    center, radius = np.array([[10.0, 0, 0]]), np.array([0.4])
    flat = moved(flat, shield.filter(flat, Obstacles.spheres(center, radius), np.zeros(3), PERIOD).snap, PERIOD)
    # Too near for any stop.
    center = flat[0] + [[0.45, 0, 0]]
    answer = shield.filter(flat, Obstacles.spheres(center, radius), np.zeros(3), PERIOD)
    assert np.isfinite(answer.snap).all()
    assert not answer.certified and answer.fallback and answer.intervened
    assert answer.snap[0] < 0.0


@pytest.mark.interpreted
def test_a_sphere_that_jumps_further_ahead_is_avoided_by_a_new_stop():
    shield, flat = Shield(), one([0, 0, 0], [1.0, 0, 0])
    radius = np.array([0.4])
    before = shield.filter(
        flat[None], Obstacles.spheres([[[10.0, 0, 0]]], radius[None]), np.zeros((1, 3)), PERIOD
    )
    flat = moved(flat, before.snap[0], PERIOD)
    flight = Flight(shield, flat[None], np.array([[[2.0, 0, 0]]]), radius[None])
    for _ in range(100):
        assert flight.fly(np.array([[100.0, 0, 0]]), PERIOD).certified[0]
    assert flight.clearance[0] > 0.0


def test_the_period_may_change_in_flight():
    rng = np.random.default_rng(8)
    flight = Flight(Shield(), *scene(rng, 32, 3)[:3])
    lost = np.zeros(32, dtype=bool)
    for period in itertools.chain.from_iterable([[0.05, 0.01, 0.1, 0.02, 0.02]] * 12):
        answer = flight.fly(attack(rng, flight.flat, flight.center), period)
        # Where the stop is of another period, a new one has to be found from where the vehicle is.
        lost |= ~answer.certified
    assert lost.sum() < 24
    assert flight.clearance[~lost].min() > 0.0


def test_sixty_four_spheres():
    rng = np.random.default_rng(9)
    flight = Flight(Shield(), *scene(rng, 8, 64)[:3])
    for _ in range(60):
        answer = flight.fly(attack(rng, flight.flat, flight.center), PERIOD)
        assert answer.certified.all()
    assert flight.clearance.min() > 0.0


@pytest.mark.interpreted
def test_reset_forgets_only_the_rows_of_the_mask():
    rng = np.random.default_rng(10)
    shield, (flat, center, radius, _) = Shield(), scene(rng, 6, 2)
    for _ in range(15):
        flat = moved(
            flat,
            shield.filter(flat, Obstacles.spheres(center, radius), attack(rng, flat, center), PERIOD).snap,
            PERIOD,
        )
    twin, fresh = copy.deepcopy(shield), np.arange(6) % 2 == 0
    shield.reset(fresh)
    wanted = np.full((6, 3), math.nan)
    new, old, mixed = (
        each.filter(flat, Obstacles.spheres(center, radius), wanted, PERIOD).snap
        for each in (Shield(), twin, shield)
    )
    np.testing.assert_array_equal(mixed[fresh], new[fresh])
    np.testing.assert_array_equal(mixed[~fresh], old[~fresh])
    assert (new != old).any(axis=1).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [20, 100])
def test_a_vehicle_that_rests_against_a_sphere_flies_away_when_asked_to(rate):
    flight = Flight(Shield(), resting([-1.5, 0.0, 0.0]), np.zeros((1, 1, 3)), np.array([[0.5]]))

    def towards(speed):
        v, a, j = flight.flat[0, 1:]
        return (6.0**3 * ([speed, 0.0, 0.0] - v) - 3 * 6.0**2 * a - 3 * 6.0 * j)[None]

    for _ in range(6 * rate):
        flight.fly(towards(1.0), 1 / rate)
    assert np.linalg.norm(flight.flat[0, 1]) < 0.05
    assert clearance(flight.flat, flight.center, flight.radius)[0] < 0.05
    for _ in range(4 * rate):
        flight.fly(towards(-1.0), 1 / rate)
    assert clearance(flight.flat, flight.center, flight.radius)[0] > 1.0
    assert flight.clearance[0] > 0.0


@pytest.mark.interpreted
def test_a_push_into_a_sphere_is_cut_along_the_line_of_sight():
    answer = Shield().filter(
        one([-0.7, 0, 0]), Obstacles.spheres(np.zeros((1, 3)), [0.5]), [1000.0, 20.0, 0], PERIOD
    )
    assert answer.intervened and answer.certified and answer.obstacle == 0
    assert answer.snap[0] < 1000.0
    assert np.isfinite(answer.snap).all()


@pytest.mark.parametrize("uncertainty", [None, {"position": 0.01}])
def test_bodies_that_begin_to_move_are_met_as_if_velocities_had_been_told_before(uncertainty):
    rng = np.random.default_rng(8)
    flat, center, radius, velocity = scene(rng, 8, 3, 0.1)
    told, still = Shield(uncertainty=uncertainty), Shield(uncertainty=uncertainty)
    for moves in (0.0, 0.0, 1.0, 1.0, 0.0):
        wanted = 40 * rng.normal(size=(8, 3))
        first = told.filter(flat, Obstacles.spheres(center, radius, moves * velocity), wanted, PERIOD)
        others = Obstacles.spheres(center, radius, velocity if moves else None)
        twin = Shield(uncertainty=uncertainty)
        twin.restore(still.snapshot())
        for shield in (still, twin):
            np.testing.assert_array_equal(shield.filter(flat, others, wanted, PERIOD).numbers, first.numbers)
        flat, center = moved(flat, first.snap, PERIOD), center + moves * PERIOD * velocity
    assert still.snapshot()["memory"].size == told.snapshot()["memory"].size
