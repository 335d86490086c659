"""The shield around method "cbf": what it passes, what it corrects, what it refuses, what it remembers."""

import copy
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quadsafe_core.shapes import Box, Obstacles, Sphere
from shields import Filtered, Shield
from shields.chains.radial import radial_snap, radial_state
from shields.methods.cbf_shield import ClosingBounds, Limits, filtered_input
from shields.methods.memory import PLANS, sampled_memory

PERIOD = 0.01
SNAP_MAX = 30.0
CENTER, RADIUS = np.array([[0.5, -0.25, 1.0]]), np.array([0.8])
BOXES = Obstacles.pack([Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))])


def cbf(**settings):
    return Shield(**({"method": "cbf", "snap_max": 100.0} | settings))


def coordinates(reach):
    return st.tuples(*[st.floats(-reach, reach)] * 3)


FLAT = st.tuples(coordinates(4.0), coordinates(3.0), coordinates(6.0), coordinates(30.0)).map(np.array)
FLAT = FLAT.filter(lambda flat: np.linalg.norm(flat[0] - CENTER[0]) > 0.1)
SNAP = coordinates(300.0).map(np.array)


def shielded(flat, snap, **changed):
    return cbf(**({"snap_max": SNAP_MAX} | changed)).filter(
        flat, Obstacles.spheres(CENTER, RADIUS), snap, PERIOD
    )


def rows(n, seed=0):
    """Flat states, spheres and snaps of n plants, most of them flying at their sphere."""
    rng = np.random.default_rng(seed)
    flat = rng.normal(size=(n, 4, 3)) * [[3.0], [1.0], [2.0], [5.0]]
    flat[:, 1] -= flat[:, 0]
    radius = np.where(rng.random((n, 1)) < 0.9, 0.5, 0.0)
    return flat, Obstacles.spheres(np.zeros((n, 1, 3)), radius), rng.normal(size=(n, 3)) * 100.0


def row(spheres, i):
    """The spheres of plant i."""
    return Obstacles.spheres(spheres.center[i], spheres.radius[i])


@settings(deadline=None)
@given(FLAT, SNAP)
def test_what_is_safe_passes_bit_for_bit(flat, snap):
    answer = shielded(flat, snap)
    U_des = radial_snap(flat, snap, CENTER[0])
    U, _ = filtered_input(
        radial_state(flat, CENTER[0]),
        U_des,
        1.005 * RADIUS[0],
        ClosingBounds(),
        Limits(SNAP_MAX, 2.0, 3.0 * SNAP_MAX),
    )
    # The two paths to U_des differ by rounding.
    assume(abs(U - U_des) > 1e-9 or U_des == U)
    assert answer.intervened == (U_des != U)
    if not answer.intervened:
        assert answer.snap.tobytes() == snap.tobytes()
        assert answer.correction == 0.0


@pytest.mark.interpreted
def test_correction_is_the_least_one_along_the_line_of_sight():
    flat, spheres, snap = rows(300, seed=1)
    answer = cbf().filter(flat, spheres, snap, PERIOD)
    n = flat[:, 0] / np.linalg.norm(flat[:, 0], axis=1, keepdims=True)
    # The correction is a difference of snaps whose drift can be large.
    slack = 1e-9 * (1.0 + answer.correction[:, np.newaxis])
    assert (np.abs(answer.snap - snap - answer.correction[:, np.newaxis] * n) <= slack).all()
    short = snap + (answer.correction[:, np.newaxis] - 2.0 * slack) * n
    almost = cbf().filter(flat, spheres, short, PERIOD)
    acted = answer.intervened
    assert np.count_nonzero(acted) > 50
    assert almost.intervened[acted].all()
    assert (np.abs(almost.snap - answer.snap)[acted] <= 4.0 * slack[acted]).all()


@settings(deadline=None)
@given(FLAT, SNAP)
def test_filter_is_idempotent(flat, snap):
    first = shielded(flat, snap)
    again = shielded(flat, first.snap)
    assert again.correction <= 1e-9 * (1.0 + first.correction)
    assert (again.value, again.in_set) == (first.value, first.in_set)


@settings(deadline=None)
@given(FLAT, SNAP, st.integers(0, 2**32 - 1))
def test_filter_is_rotation_invariant(flat, snap, seed):
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    answer = shielded(flat, snap)
    turned = cbf(snap_max=SNAP_MAX).filter(
        flat @ turn.T, Obstacles.spheres(CENTER @ turn.T, RADIUS), turn @ snap, PERIOD
    )
    # t* can jump between two minima of nearly one value: compare where the answer is continuous.
    nudged = shielded(flat * (1.0 + 1e-9), snap)
    slack = 1e-9 * (1.0 + answer.correction) + 10.0 * np.linalg.norm(nudged.snap - answer.snap)
    np.testing.assert_allclose(turned.snap, turn @ answer.snap, atol=slack)
    assert turned.value == pytest.approx(answer.value, rel=1e-9, abs=1e-9)


@settings(deadline=None)
@given(FLAT, SNAP, st.floats(0.0, 100.0))
def test_filter_is_monotone_along_the_line_of_sight(flat, snap, more):
    n = (flat[0] - CENTER[0]) / np.linalg.norm(flat[0] - CENTER[0])
    low, high = shielded(flat, snap), shielded(flat, snap + more * n)
    assert n @ (high.snap - low.snap) >= -1e-9 * (1.0 + low.correction)


@pytest.mark.interpreted
def test_batch_equals_single_bit_for_bit():
    flat, spheres, snap = rows(200)
    batch = cbf().filter(flat, spheres, snap, PERIOD)
    assert 20 < np.count_nonzero(batch.intervened) < 180
    for i in range(200):
        single = cbf().filter(flat[i], row(spheres, i), snap[i], PERIOD)
        assert all(np.array_equal(a[i], b) for a, b in zip(batch, single, strict=True))


@pytest.mark.interpreted
def test_answers_have_the_shape_of_the_question():
    flat, spheres, snap = rows(7)
    batch = cbf().filter(flat, spheres, snap, PERIOD)
    assert [x.shape for x in batch] == [(7, 3), *[(7,)] * 10]
    assert not np.shares_memory(batch.snap, snap)
    single = cbf().filter(flat[0], row(spheres, 0), snap[0], PERIOD)
    assert [np.shape(x) for x in single] == [(3,), *[()] * 10]
    flat, center, radius, snap = (x[0].tolist() for x in (flat, spheres.center, spheres.radius, snap))
    as_lists = cbf().filter(flat, Obstacles.spheres(center, radius), snap, 1)
    assert np.array_equal(as_lists.snap, single.snap)


@pytest.mark.interpreted
@pytest.mark.parametrize("obstacles", [0, 1, 3])
def test_without_an_obstacle_everything_passes(obstacles):
    snap = np.array([1e3, -2e3, 3e3])
    spheres = Obstacles.spheres(np.zeros((obstacles, 3)), np.zeros(obstacles))
    answer = cbf(max_closing_speed=0.1).filter(np.ones((4, 3)), spheres, snap, PERIOD)
    assert answer.snap.tobytes() == snap.tobytes()
    assert (answer.value, answer.in_set, answer.intervened) == (math.inf, True, False)


@pytest.mark.interpreted
def test_the_obstacle_is_found_among_absent_ones():
    flat, center, radius = (
        np.array([[[2.0, 0, 0], [-2.0, 1, 0], [0] * 3, [0] * 3]]),
        np.zeros((1, 1, 3)),
        np.ones((1, 1)),
    )
    snap = np.array([[-9.0, 8.0, 7.0]])
    alone = cbf().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    more = Obstacles.spheres(
        np.concatenate([np.ones((1, 2, 3)), center, np.ones((1, 1, 3))], axis=1),
        np.concatenate([np.zeros((1, 2)), radius, np.zeros((1, 1))], axis=1),
    )
    among = cbf().filter(flat, more, snap, PERIOD)
    assert alone.intervened
    assert np.array_equal(alone.snap, among.snap)


@pytest.mark.interpreted
def test_margin_widens_the_radius():
    flat, snap = np.array([[3.0, 0, 0], [-1.0, 0, 0], [0, 0, 0], [0, 0, 0]]), np.array([-50.0, 0, 0])
    wide = cbf(margin=0.1).filter(flat, Obstacles.spheres(np.zeros((1, 3)), [1.0]), snap, PERIOD)
    exact = cbf(margin=0.0).filter(flat, Obstacles.spheres(np.zeros((1, 3)), [1.1]), snap, PERIOD)
    assert np.array_equal(wide.snap, exact.snap)
    assert wide.value == exact.value


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("bound", "flat"),
    [
        ("max_closing_speed", [[9.0, 0, 0], [-2.0, 0, 0], [-1.0, 0, 0], [0, 0, 0]]),
        ("max_closing_acceleration", [[9.0, 0, 0], [0, 0, 0], [-2.0, 0, 0], [-1.0, 0, 0]]),
        ("max_closing_jerk", [[9.0, 0, 0], [0, 0, 0], [0, 0, 0], [-2.0, 0, 0]]),
    ],
)
def test_optional_bounds_act_on_their_derivative(bound, flat):
    sphere = Obstacles.spheres(np.zeros((1, 3)), [1.0])
    question = (np.array(flat), sphere, np.array([-20.0, 0, 0]), PERIOD)
    assert not cbf().filter(*question).intervened
    tight = cbf(**{bound: 2.01}).filter(*question)
    assert tight.intervened
    assert tight.value < 0.02
    assert not cbf(**{bound: 50.0}).filter(*question).intervened
    assert not cbf(**{bound: 1.0}).filter(*question).in_set


@pytest.mark.interpreted
def test_recovery_from_outside_is_capped():
    flat = np.array([[1.0, 0, 0], [-4.0, 0, 0], [0, 0, 0], [0, 0, 0]])
    answer = cbf(snap_max=50.0, reserve=2.0).filter(
        flat, Obstacles.spheres(np.zeros((1, 3)), [1.0]), np.zeros(3), PERIOD
    )
    assert not answer.in_set
    assert radial_snap(flat, answer.snap, np.zeros(3)) == pytest.approx(100.0, rel=1e-12)


@pytest.mark.interpreted
def test_at_the_centre_the_answer_is_finite_and_leads_out():
    flat = np.array([[0.0, 0, 0], [-2.0, 0, -1.0], [0, 1.0, 0], [0, 0, -3.0]])
    answer = cbf().filter(flat, Obstacles.spheres(np.zeros((1, 3)), [1.0]), np.zeros(3), PERIOD)
    assert np.array_equal(answer.snap, [0.0, 0.0, 300.0])


@pytest.mark.interpreted
def test_a_missing_wish_is_answered_by_braking():
    flat = np.array([[50.0, 0, 0], [1.0, -2.0, 0.5], [3.0, 0, 1.0], [0, 10.0, -5.0]])
    for bad in ([np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf]):
        answer = shielded(flat, np.array(bad))
        assert answer.fallback
        assert not answer.intervened
        assert np.isfinite(answer.snap).all()
    # As the period goes to zero the gains become those of (s + 3)³.
    tiny = cbf().filter(flat, Obstacles.spheres(CENTER, RADIUS), [np.nan] * 3, 1e-6)
    np.testing.assert_allclose(tiny.snap, -27.0 * flat[1] - 27.0 * flat[2] - 9.0 * flat[3], rtol=1e-4)


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.001, 0.05, 1.0])
def test_braking_comes_to_rest_and_stays_shielded(period):
    flat, shield = np.array([[4.0, 0, 0], [-2.0, 1.0, 0], [0, 0, 1.0], [0, 0, 0]]), cbf()
    none, wish = Obstacles.spheres(np.zeros((1, 3)), np.zeros(1)), np.full(3, np.nan)
    for _ in range(int(max(8.0, 10 * period) / period)):
        flat = held(flat, shield.filter(flat, none, wish, period).snap, period)
    assert np.abs(flat[1:]).max() < 1e-3


def held(flat, snap, period):
    """Flat state after a period of constant snap."""
    powers = [period**k / math.factorial(k) for k in range(5)]
    extended = [*flat, snap]
    return np.array([sum(extended[i + k] * powers[k] for k in range(5 - i)) for i in range(4)])


def fly_at_the_sphere(shield, seconds, period):
    """Least distance under an attack that always pulls at the centre, from a curved start."""
    flat = np.array([[3.0, 0.2, 0.1], [0.0, 0.4, -0.2], [0, 0, 0], [0, 0, 0]])
    least = np.inf
    for _ in range(round(seconds / period)):
        snap = -60.0 * flat[0] / np.linalg.norm(flat[0])
        if shield is not None:
            snap = shield.filter(flat, Obstacles.spheres(np.zeros((1, 3)), np.ones(1)), snap, period).snap
        flat = held(flat, snap, period)
        least = min(least, np.linalg.norm(flat[0]))
    return least


def test_in_continuous_time_the_sphere_is_never_entered():
    # 0.1 ms holds, against braking times of about 0.5 s; no margin.
    least = fly_at_the_sphere(cbf(snap_max=20.0, margin=0.0), 3.0, 1e-4)
    assert 1.0 <= least < 1.1


@pytest.mark.interpreted
def test_without_the_shield_the_same_attack_hits():
    assert fly_at_the_sphere(None, 3.0, 1e-3) < 0.9


SETTINGS = {"snap_max": 40.0, "reserve": 2.0, "alpha": 1.5, "margin": 0.01, "max_closing_speed": 3.0}


@pytest.mark.interpreted
def test_settings_survive_json_pickle_and_copies():
    shield = cbf(**SETTINGS)
    question = (*rows(4), PERIOD)
    expected = shield.filter(*question)
    twins = [
        Shield(**json.loads(json.dumps(shield.settings))),
        pickle.loads(pickle.dumps(shield)),
        copy.deepcopy(shield),
    ]
    for twin in twins:
        assert twin.settings == shield.settings
        assert np.array_equal(twin.filter(*question).snap, expected.snap)
    assert repr(shield).startswith("Shield(method='cbf', snap_max=40.0, reserve=2.0, held_snap_max=None,")
    assert cbf(snap_max=np.float32(2.0)).settings["snap_max"] == 2.0


@pytest.mark.interpreted
def test_number_of_plants_is_fixed_until_reset():
    shield = cbf()
    shield.reset(np.array([True, False]))
    assert isinstance(shield.filter(*rows(3), PERIOD), Filtered)
    with pytest.raises(ValueError, match=r"keep their N and K until reset\(\), got \(2, 1\) after \(3, 1\)"):
        shield.filter(*rows(2), PERIOD)
    shield.reset(np.array([True, False, True]))
    shield.filter(*rows(3), PERIOD)
    shield.reset()
    shield.filter(*rows(2), PERIOD)


@pytest.mark.interpreted
@pytest.mark.parametrize("mask", [np.ones(2, dtype=bool), np.ones(3), np.ones((3, 1), dtype=bool)])
def test_wrong_reset_masks_are_named(mask):
    shield = cbf()
    shield.filter(*rows(3), PERIOD)
    with pytest.raises(ValueError, match="mask must"):
        shield.reset(mask)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"method": "magic"}, "method must be one of 'sampled', 'cbf'"),
        ({"snap_max": 0.0}, "snap_max must be a finite number > 0, got 0.0"),
        ({"reserve": 0.5}, "reserve must be >= 1, got 0.5"),
        ({"reserve": math.inf}, "reserve must be a finite number > 0"),
        ({"alpha": -1.0}, "alpha must be"),
        ({"margin": -0.1}, "margin must be a finite number >= 0"),
        ({"max_closing_speed": 0.0}, "max_closing_speed must be"),
        ({"max_closing_acceleration": -1.0}, "max_closing_acceleration must be"),
        ({"max_closing_jerk": math.nan}, "max_closing_jerk must be"),
    ],
)
def test_bad_settings_are_named(changed, message):
    with pytest.raises(ValueError, match=message):
        Shield(**changed)


@pytest.mark.interpreted
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # compiled, nothing warns
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"flat": np.zeros((2, 3, 3))}, r"flat must have shape \(…, 4, 3\), got \(2, 3, 3\)"),
        ({"flat": np.zeros((3, 4, 3))}, "must agree in N and K"),
        ({"flat": np.full((2, 4, 3), np.nan)}, r"flat must be finite, got nan at index \(0, 0, 0\)"),
        ({"flat": np.full((2, 4, 3), 1e200)}, "flat must be small enough for float64 arithmetic"),
        ({"center": np.full((2, 1, 3), np.inf)}, "center must be finite"),
        ({"center": np.zeros((2, 3))}, "must agree in N and K"),
        ({"radius": np.full((2, 1), -1.0)}, "radius must be >= 0, got -1.0"),
        ({"radius": np.full((2, 1), np.nan)}, "radius must be finite"),
        ({"radius": np.ones((2, 3))}, "must agree in N and K"),
        ({"snap": np.zeros((2, 2))}, "snap must have shape"),
        ({"period": 0.0}, "period must be a finite number > 0"),
        ({"period": np.nan}, "period must be a finite number > 0"),
        ({"center": np.zeros((2, 2, 3)), "radius": np.ones((2, 2))}, "several need method 'sampled'"),
    ],
)
def test_bad_measurements_are_named(changed, message):
    good = {
        "flat": np.ones((2, 4, 3)),
        "center": np.zeros((2, 1, 3)),
        "radius": np.ones((2, 1)),
        "snap": np.zeros((2, 3)),
        "period": PERIOD,
    }
    flat, center, radius, snap, period = (good | changed).values()
    with pytest.raises(ValueError, match=message):
        cbf().filter(flat, Obstacles(center, radius), snap, period)


@pytest.mark.interpreted
def test_what_is_not_a_number_is_a_type_error():
    with pytest.raises(TypeError, match="flat must be an array of real numbers"):
        cbf().filter("here", Obstacles.spheres(np.zeros((1, 3)), [1.0]), np.zeros(3), PERIOD)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("here", "obstacles must be a list of shapes, mappings or rows"),
        ([[0.0, 0.0, 1.0]], r"obstacles\[0\] must be a shape, a mapping or a row"),
        ([{"shape": "cone"}], r"obstacles\[0\].shape must be one of 'sphere'"),
        (
            Obstacles(BOXES.center, BOXES.radius, None, BOXES.cores[:10]),
            r"obstacles.cores must have \d+ bytes or more for \(1, 1\)",
        ),
        (
            Obstacles(BOXES.center, BOXES.radius, None, BOXES.cores.astype(float)),
            "obstacles.cores must be None or an array of bytes",
        ),
    ],
)
def test_what_are_no_obstacles_is_refused(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        Shield().filter(np.ones((4, 3)), given, np.zeros(3), PERIOD)


@pytest.mark.interpreted
def test_rows_mappings_and_shapes_are_the_packed_form_of_one_plant():
    flat, snap = np.zeros((4, 3)), [1e5, 20.0, 0.0]
    flat[0, 0] = -0.7
    packed = Shield().filter(flat, Obstacles.spheres(np.zeros((1, 3)), [0.5]), snap, PERIOD)
    assert packed.intervened and packed.certified
    sphere = Sphere((0.0, 0.0, 0.0), 0.5)
    for same in ([[0, 0, 0, 0.5]], [sphere], [sphere.as_dict()], Obstacles.pack([sphere])):
        assert np.array_equal(Shield().filter(flat, same, snap, PERIOD).numbers, packed.numbers)
    with pytest.raises(ValueError, match="must agree in N and K"):
        Shield().filter(flat[None], [sphere], [snap], PERIOD)


@pytest.mark.interpreted
def test_the_paper_filters_spheres_alone():
    with pytest.raises(ValueError, match="obstacles must be spheres with method 'cbf', got other shapes"):
        cbf().filter(np.ones((4, 3)), BOXES, np.zeros(3), PERIOD)


@pytest.mark.interpreted
def test_one_filtered_row():
    flat = np.array([[2.0, 0, 0], [-1.0, 0.5, 0], [0, 0, 0], [0, 0, 0]])
    answer = cbf(snap_max=10.0).filter(
        flat, Obstacles.spheres(np.zeros((1, 3)), [1.0]), np.array([-30.0, 1.0, 2.0]), PERIOD
    )
    assert answer.intervened
    assert np.array_equal(answer.snap[1:], [1.0, 2.0])
    assert answer.correction == pytest.approx(answer.snap[0] + 30.0, rel=1e-14)
    braked = cbf().filter(flat, Obstacles.spheres(np.zeros((1, 3)), [0.0]), np.full(3, np.nan), PERIOD)
    assert braked.fallback
    assert braked.snap[0] > 0.0 > braked.snap[1]


@pytest.mark.interpreted
def test_unchecked_arguments_start_no_compilation():
    from shields.methods.sampled_shield import sampled_one

    flat, spheres, snap = rows(1)
    measured = flat, center, radius, snap = [x[0] for x in (flat, spheres.center, spheres.radius, snap)]
    shield, spheres = Shield(), Obstacles.spheres(center, radius)
    expected = shield.filter(flat, spheres, snap, PERIOD)
    compiled = len(getattr(sampled_one, "signatures", ()))
    kinds = (
        [x.astype(np.float32) for x in measured],
        [x.tolist() for x in measured],
        [np.asfortranarray(x) for x in measured],
    )
    for own, centers, radii, wanted in kinds:
        shield.reset()
        question = own, Obstacles.spheres(centers, radii), wanted, PERIOD
        shield.filter(*question)
        answer = shield.filter(*question)
        np.testing.assert_allclose(answer.snap, expected.snap, rtol=1e-4)
    read_only = flat.copy()
    read_only.flags.writeable = False
    shield.reset()
    assert np.array_equal(shield.filter(read_only, spheres, snap, PERIOD).snap, expected.snap)
    assert np.array_equal(shield.filter(read_only, spheres, snap, PERIOD).snap, expected.snap)
    assert len(getattr(sampled_one, "signatures", ())) == compiled
    with pytest.raises(ValueError, match=r"must have shape \(…, 4, 3\)"):
        shield.filter(flat[:3], spheres, snap, PERIOD)


@pytest.mark.interpreted
@pytest.mark.parametrize("method", ["sampled", "cbf"])
def test_a_shield_goes_on_where_it_was_when_it_gave_the_snapshot(method):
    flat, spheres, snap = rows(3)
    first, second = Shield(method=method), Shield(method=method)
    assert first.snapshot() == {}
    for k in range(3):
        first.filter(flat, spheres, snap * k, PERIOD)
    kept = first.snapshot()
    later = [np.array(first.filter(flat, spheres, snap * k, PERIOD).numbers) for k in (5, -1)]
    # what was given away does not change
    second.restore(kept)
    assert all(np.array_equal(kept[name], entry) for name, entry in second.snapshot().items())
    again = [np.array(second.filter(flat, spheres, snap * k, PERIOD).numbers) for k in (5, -1)]
    np.testing.assert_array_equal(again, later)
    with pytest.raises(ValueError, match="keep their N and K"):
        second.filter(*rows(2), PERIOD)
    second.restore({})
    second.filter(*rows(2), PERIOD)


@pytest.mark.interpreted
def test_a_snapshot_of_one_plant_is_restored_as_one_plant():
    shield, again = cbf(), cbf()
    arguments = ([*np.eye(4, 3) * 3.0], Obstacles.spheres(CENTER, RADIUS), np.zeros(3))
    answer = shield.filter(*arguments, PERIOD)
    again.restore(shield.snapshot())
    assert again.filter(*arguments, PERIOD).snap.shape == answer.snap.shape == (3,)


@pytest.mark.interpreted
def test_a_snapshot_of_another_method_is_refused():
    shield = Shield()
    shield.filter(*rows(2), PERIOD)
    with pytest.raises(ValueError, match="snapshot must have memory of"):
        cbf().restore(shield.snapshot())


@pytest.mark.interpreted
def test_velocities_have_the_shape_of_the_centres():
    flat, spheres, snap = rows(2)
    center, radius = np.repeat(spheres.center, 3, axis=1), np.repeat(spheres.radius, 3, axis=1)
    for wrong in (np.zeros((3, 2, 3)), np.zeros((2, 3)), np.zeros((4, 3, 3)), "fast"):
        with pytest.raises(ValueError, match="velocity must have the shape of center"):
            Shield().filter(flat, Obstacles(center, radius, wrong), snap, PERIOD)
        with pytest.raises((TypeError, ValueError), match="velocity must "):
            Obstacles.spheres(center, radius, wrong)
    calm = Shield().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    still = Shield().filter(flat, Obstacles.spheres(center, radius, np.zeros((2, 3, 3))), snap, PERIOD)
    assert np.array_equal(calm.numbers, still.numbers)
    moving = Obstacles.spheres(spheres.center, np.ones((2, 1)), np.ones((2, 1, 3)))
    with pytest.raises(ValueError, match="velocity must be 0 with method 'cbf'"):
        cbf().filter(flat, moving, snap, PERIOD)


@pytest.mark.interpreted
def test_a_call_at_another_period_is_that_of_a_new_shield():
    shield = cbf()
    for period in (PERIOD, 0.5, PERIOD):
        for wanted in (np.full((2, 3), np.nan), np.zeros((2, 3))):
            flat, spheres, _ = rows(2)
            answer = shield.filter(flat, spheres, wanted, period)
            assert np.array_equal(answer.numbers, cbf().filter(flat, spheres, wanted, period).numbers)


@pytest.mark.interpreted
def test_the_reserve_is_told_only_of_a_sphere_that_asks_and_in_units_of_the_greatest_snap():
    calm = shielded(np.array([[9.0, 0.0, 0.0], *np.zeros((3, 3))]), np.zeros(3))
    assert (calm.reserve, calm.obstacle, calm.intervened, calm.fallback) == (0.0, -1, False, False)
    flat = np.array([CENTER[0] + [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], *np.zeros((2, 3))])
    answer = shielded(flat, np.array([-200.0, 0.0, 0.0]))
    assert answer.obstacle == 0 and answer.intervened
    asked = radial_snap(flat, answer.snap, CENTER[0])
    assert answer.reserve == pytest.approx(max(0.0, asked / SNAP_MAX)) and answer.correction > 0.0
    # the least input is below 0 here: nothing of the reserve
    slow = np.array([CENTER[0] + [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], *np.zeros((2, 3))])
    answer = shielded(slow, np.array([-1e6, 0.0, 0.0]))
    assert answer.intervened and radial_snap(slow, answer.snap, CENTER[0]) < 0.0 and answer.reserve == 0.0


@pytest.mark.interpreted
def test_motion_of_the_spheres_is_heard_in_the_second_call_too():
    flat, spheres, snap = rows(2)
    moving = Obstacles.spheres(spheres.center, spheres.radius, np.ones((2, 1, 3)))
    shield = Shield()
    shield.filter(flat, spheres, snap, PERIOD)
    still = np.array(shield.filter(flat, spheres, snap, PERIOD).value)
    assert not np.array_equal(shield.filter(flat, moving, snap, PERIOD).value, still)


@pytest.mark.interpreted
@pytest.mark.parametrize("given", [{}, {"uncertainty": {"position": 0.01, "delay": 2}}, {"method": "cbf"}])
def test_a_changed_snapshot_changes_no_size_and_no_setting(given):
    flat, spheres, snap = rows(2)
    shield, twin = Shield(**given), Shield(**given)
    shield.filter(flat, spheres, snap, PERIOD)
    whole, changed = shield.snapshot(), shield.snapshot()
    # Sizes and settings stand first.
    changed["memory"][:80] = 255
    twin.restore(changed)
    assert twin.snapshot()["memory"].tobytes() == whole["memory"].tobytes()
    expected = shield.filter(flat, spheres, snap, PERIOD)
    assert twin.filter(flat, spheres, snap, PERIOD).numbers.tobytes() == expected.numbers.tobytes()


@pytest.mark.interpreted
@pytest.mark.parametrize("given", [{}, {"uncertainty": {"position": 0.01, "delay": 2}}])
@pytest.mark.parametrize(("name", "value"), [("choice", 13), ("choice", -1), ("segments_left", 4)])
def test_a_snapshot_with_a_stop_that_cannot_be_is_refused(given, name, value):
    shield = Shield(**given)
    shield.filter(*rows(2), PERIOD)
    snapshot = shield.snapshot()
    sampled_memory(snapshot["memory"], *snapshot["size"].tolist(), PLANS)[0].rows.plans[name][1] = value
    with pytest.raises(ValueError, match="snapshot must hold stops"):
        shield.restore(snapshot)


@pytest.mark.interpreted
@pytest.mark.parametrize("given", [{}, {"uncertainty": {"position": 0.01, "delay": 2}}])
def test_velocities_are_those_of_the_call_and_of_no_later_one(given):
    flat, spheres, snap = arguments = rows(2)
    velocity = np.broadcast_to([0.0, 2.0, 0.0], spheres.center.shape).copy()
    moved = Obstacles.spheres(spheres.center, spheres.radius, velocity)
    shield, still = Shield(**given), Shield(**given)
    moving = shield.filter(flat, moved, snap, PERIOD).numbers.tobytes()
    expected = still.filter(*arguments, PERIOD).numbers.tobytes()
    assert moving != expected
    shield.reset(np.ones(2, dtype=bool))
    assert shield.filter(*arguments, PERIOD).numbers.tobytes() == expected
    # Nor of one that was refused.
    with pytest.raises(ValueError, match="velocity must be finite"):
        lost = Obstacles.spheres(spheres.center, spheres.radius, velocity * np.nan)
        shield.filter(flat, lost, snap, PERIOD)
    assert (
        shield.filter(*arguments, PERIOD).numbers.tobytes()
        == still.filter(*arguments, PERIOD).numbers.tobytes()
    )


def velocities_of(n, kind):
    """Velocities (N, 1, 3), m/s, as callers hold them."""
    array = np.random.default_rng(3).normal(size=(n, 1, 3))
    kinds = {
        "array": array,
        "read-only": np.broadcast_to(array[:1], array.shape),
        "strided": np.repeat(array, 2, axis=2)[..., ::2],
        "Fortran order": np.asfortranarray(array),
        "float32": array.astype(np.float32),
        "integers": np.full((n, 1, 3), 2),
        "list": array.tolist(),
    }
    return kinds[kind]


@pytest.mark.interpreted
@pytest.mark.parametrize("given", [{}, {"uncertainty": {"position": 0.01, "delay": 2}}])
@pytest.mark.parametrize(
    "kind", ["array", "read-only", "strided", "Fortran order", "float32", "integers", "list"]
)
def test_velocities_are_read_in_every_call_as_in_the_first(given, kind):
    flat, spheres, snap = rows(5)
    velocity, shield = velocities_of(5, kind), Shield(**given)
    shield.filter(flat, Obstacles(spheres.center, spheres.radius, np.ones((5, 1, 3))), snap, PERIOD)
    for _ in range(3):
        moving, first = Obstacles(spheres.center, spheres.radius, velocity), Shield(**given)
        first.restore(shield.snapshot())
        expected = first.filter(flat, moving, snap, PERIOD).numbers.tobytes()
        assert shield.filter(flat, moving, snap, PERIOD).numbers.tobytes() == expected
        assert shield.snapshot()["memory"].tobytes() == first.snapshot()["memory"].tobytes()
        snap = snap + 1.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("velocity", "error"),
    [
        (np.zeros((2, 1, 3), dtype=bool), TypeError),
        (np.zeros((1, 1, 3)), ValueError),
        (np.zeros((2, 2, 3)), ValueError),
        (np.zeros(3), ValueError),
        (np.full((2, 1, 3), np.inf), ValueError),
        ("fast", ValueError),
    ],
)
def test_wrong_velocities_are_named_in_later_calls_too(velocity, error):
    flat, spheres, snap = rows(2)
    moving, shield = Obstacles(spheres.center, spheres.radius, np.ones((2, 1, 3))), Shield()
    for _ in range(2):
        shield.filter(flat, moving, snap, PERIOD)
        with pytest.raises(error, match="velocity must "):
            shield.filter(flat, Obstacles(spheres.center, spheres.radius, velocity), snap, PERIOD)
