"""The half-space of one sphere: what it keeps, which direction it takes, and why the last one is kept."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadsafe_core.authority import Authority
from shields.chains.flat_state import Flat, flown
from shields.chains.integrator import lower_value
from shields.filters.sampled import sampled_input
from shields.interface.bodies import Kept, look_at
from shields.methods.authority_limits import limit_demand
from shields.methods.halfspace import (
    Demand,
    Sampling,
    closest_approach,
    closing_along,
    demand_along,
    distance_demand,
    excess,
    preferred,
)

U_MAX, ALPHA, DISTANCE = 200.0, 2.0, 0.5
KEPT = Kept(DISTANCE, None, None)
PERIODS = [0.05, 0.01, 0.001]
SEEDS = st.integers(0, 2**32 - 1)
NO_NORMAL = (0.0, 0.0, 0.0)


def three(x):
    return tuple(float(entry) for entry in x)


def sampling_at(period):
    return Sampling(U_MAX, -math.expm1(-ALPHA * period), 3 * U_MAX, period)


def approach(rng):
    """A flat state relative to a sphere, most of the time outside of it and flying towards it."""
    r = rng.normal(size=3)
    r *= rng.uniform(0.9, 4.0) * DISTANCE / np.linalg.norm(r)
    v = -r * rng.uniform(0.0, 4.0) + rng.normal(size=3)
    return Flat(three(r), three(v), three(rng.normal(size=3) * 3), three(rng.normal(size=3) * 20))


def unit(rng):
    n = rng.normal(size=3)
    return three(n / np.linalg.norm(n))


def sight_of(x):
    """The direction away from a sphere."""
    return look_at(None, x.r)[1]


@settings(max_examples=300, deadline=None)
@given(SEEDS, st.sampled_from(PERIODS))
def test_the_chosen_direction_costs_no_more_than_the_line_of_sight(seed, period):
    rng = np.random.default_rng(seed)
    x, wanted, sampling = approach(rng), three(rng.normal(size=3) * 500), sampling_at(period)
    chosen = distance_demand(x, sight_of(x), unit(rng), wanted, KEPT, sampling)
    sight = demand_along(sight_of(x), x, wanted, KEPT, sampling)
    if sight.is_admissible:
        assert chosen.is_admissible
        assert excess(chosen, wanted) <= excess(sight, wanted)
    elif not chosen.is_admissible:
        assert chosen.value >= sight.value
    assert np.linalg.norm(chosen.n) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.interpreted
@pytest.mark.parametrize("period", PERIODS)
def test_the_last_normal_stays_admissible_when_its_demand_was_flown(period):
    rng = np.random.default_rng(0)
    sampling, kept = sampling_at(period), 0
    for _ in range(60):
        x, last = approach(rng), NO_NORMAL
        for _ in range(30):
            wanted = three(rng.normal(size=3) * 2000)
            demand = distance_demand(x, sight_of(x), last, wanted, KEPT, sampling)
            if not demand.is_admissible:
                break
            # Flown as asked: the nearest snap in the half-space.
            snap = np.add(wanted, excess(demand, wanted) * np.array(demand.n))
            x, last = flown(x, three(snap), period), demand.n
            again = demand_along(last, x, wanted, KEPT, sampling)
            assert again.is_admissible
            kept += 1
    assert kept > 500


@pytest.mark.interpreted
@pytest.mark.parametrize("period", PERIODS)
def test_the_distance_along_the_normal_is_kept_between_samples_too(period):
    rng = np.random.default_rng(1)
    sampling, flights = sampling_at(period), 0
    for _ in range(600):
        x, wanted = approach(rng), three(rng.normal(size=3) * 2000)
        demand = distance_demand(x, sight_of(x), NO_NORMAL, wanted, KEPT, sampling)
        if demand.is_admissible:
            flights += 1
            snap = three(np.add(wanted, excess(demand, wanted) * np.array(demand.n)))
            for t in np.linspace(0.0, period, 11):
                y = np.dot(demand.n, flown(x, snap, float(t)).r)
                # States within rounding of the set count as inside.
                assert y >= DISTANCE - 1e-9
                assert np.linalg.norm(flown(x, snap, float(t)).r) >= y - 1e-12
    assert flights > 200


@pytest.mark.interpreted
def test_what_is_inside_the_half_space_is_the_demand_itself():
    x = Flat((2.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    demand = distance_demand(x, sight_of(x), NO_NORMAL, (-1.0, 5.0, 0.0), KEPT, sampling_at(0.01))
    assert demand.n == (1.0, 0.0, 0.0)
    assert demand.least == -1.0
    assert demand.is_admissible
    assert demand.value == pytest.approx(1.5, abs=1e-12)
    assert excess(demand, (-1.0, 5.0, 0.0)) == 0.0


@pytest.mark.interpreted
def test_a_passing_flight_takes_the_direction_of_closest_approach():
    # 0.6 m beside the sphere, fast: along the line of sight it comes closer than it ever will.
    x = Flat((-1.0, 0.6, 0.0), (6.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(closest_approach(x.r, x.v), (0.0, 0.6, 0.0), atol=1e-15)
    demand = distance_demand(x, sight_of(x), NO_NORMAL, (0.0, 0.0, 0.0), KEPT, sampling_at(0.01))
    np.testing.assert_allclose(demand.n, (0.0, 1.0, 0.0), atol=1e-15)
    assert demand.is_admissible
    assert excess(demand, (0.0, 0.0, 0.0)) == 0.0


@pytest.mark.interpreted
def test_a_slow_flight_has_its_closest_approach_ahead_too():
    x = Flat((0.3, 0.4, 0.0), (-0.2, 0.0, 0.0), NO_NORMAL, NO_NORMAL)
    assert closest_approach(x.r, x.v) == pytest.approx((0.0, 0.4, 0.0))
    far = Flat((3.0, 0.4, 0.0), (-0.2, 0.0, 0.0), NO_NORMAL, NO_NORMAL)
    assert closest_approach(far.r, far.v) == pytest.approx((2.6, 0.4, 0.0))  # after 2 s


@pytest.mark.interpreted
def test_at_rest_and_behind_the_closest_approach_is_now():
    rest = Flat((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert closest_approach(rest.r, rest.v) == rest.r
    away = Flat((1.0, 2.0, 3.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert closest_approach(away.r, away.v) == away.r


@pytest.mark.interpreted
def test_the_first_of_equal_demands_is_preferred():
    x = Flat((2.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    wanted, sampling = (0.0, 0.0, 0.0), sampling_at(0.01)
    first = demand_along((1.0, 0.0, 0.0), x, wanted, KEPT, sampling)
    second = demand_along((0.8, 0.6, 0.0), x, wanted, KEPT, sampling)
    inside = demand_along((0.0, 1.0, 0.0), x, wanted, KEPT, sampling)
    assert preferred(first, second, wanted) == first
    assert preferred(second, first, wanted) == second
    # Across the line of sight the distance is 0: not in the set.
    assert not inside.is_admissible
    assert preferred(inside, first, wanted) == preferred(first, inside, wanted) == first


@pytest.mark.interpreted
def test_no_closing_bounds_ask_for_nothing():
    x = Flat((1.0, 0.0, 0.0), (-9.0, 0.0, 0.0), (-9.0, 0.0, 0.0), (-9.0, 0.0, 0.0))
    wanted = (-5000.0, 0.0, 0.0)
    free = (-math.inf, -math.inf, -math.inf)
    demand = closing_along((1.0, 0.0, 0.0), x, wanted, free, sampling_at(0.01))
    assert demand.value == math.inf
    assert excess(demand, wanted) == 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_closing_bound_holds_between_samples_too(order):
    rng = np.random.default_rng(4)
    bounds = [-math.inf] * 3
    bounds[order] = -4.0
    for period in PERIODS:
        sampling = sampling_at(period)
        for _ in range(100):
            x = Flat(*(three(row) for row in rng.normal(size=(4, 3))))
            n, wanted = unit(rng), three(rng.normal(size=3) * 2000)
            demand = closing_along(n, x, wanted, tuple(bounds), sampling)
            if demand.is_admissible:
                snap = three(np.add(wanted, excess(demand, wanted) * np.array(n)))
                for t in np.linspace(0.0, period, 6):
                    row = flown(x, snap, float(t))[order + 1]
                    assert np.dot(n, row) >= -4.0 - 1e-9


@pytest.mark.interpreted
def test_each_closing_bound_is_the_sampled_filter_of_its_order():
    rng, period = np.random.default_rng(5), 0.05
    sampling = sampling_at(period)
    for _ in range(40):
        x, n = Flat(*(three(row) for row in rng.normal(size=(4, 3)))), unit(rng)
        wanted = three(rng.normal(size=3) * 1000)
        chain = np.array([np.dot(n, x.j), np.dot(n, x.a), np.dot(n, x.v)])
        asked, values, inside = [], [], []
        for i, bound in enumerate((-2.0, -3.0, -4.0)):
            bounds = [-math.inf] * 3
            bounds[i] = bound
            demand = closing_along(n, x, wanted, tuple(bounds), sampling)
            state, u = chain[: 3 - i], np.dot(n, wanted)
            least, in_set = sampled_input(state, u, period, U_MAX, bound, ALPHA, 3.0)
            assert demand.least == pytest.approx(least, rel=1e-9) and demand.is_admissible == in_set
            assert demand.value == pytest.approx(lower_value(state, U_MAX, bound)[0], rel=1e-9)
            asked.append(demand.least)
            values.append(demand.value)
            inside.append(demand.is_admissible)
        whole = closing_along(n, x, wanted, (-2.0, -3.0, -4.0), sampling)
        assert whole == (n, max(asked), min(values), all(inside))


@pytest.mark.interpreted
def test_in_free_fall_the_thrust_has_no_direction_and_asks_for_nothing():
    authority = Authority(380.0, 44.0, 5.0, 20.0, 9.81)
    x = Flat(NO_NORMAL, NO_NORMAL, (0.0, 0.0, -9.81), (1.0, 2.0, 3.0))
    for limit in (1, 2):
        demand = limit_demand(limit, x, (0.0, 0.0, -300.0), sampling_at(0.02), authority)
        assert excess(demand, (0.0, 0.0, -300.0)) == 0.0 and demand.is_admissible


@pytest.mark.interpreted
def test_the_jerk_plane_touches_the_ball_where_the_jerk_leaves_it():
    authority, sampling = Authority(380.0, 44.0, 5.0, 20.0, 9.81), sampling_at(0.1)
    x = Flat(NO_NORMAL, NO_NORMAL, NO_NORMAL, (30.0, 0.0, 0.0))
    # (30 + 0.1·300, 80)/100: the plane leaves n·(j + Δu) = −44
    demand = limit_demand(0, x, (300.0, 800.0, 0.0), sampling, authority)
    assert demand.n == pytest.approx((-0.6, -0.8, 0.0)) and demand.value == pytest.approx(44.0 - 100.0)
    assert demand.least == pytest.approx((-44.0 + 18.0) / 0.1) and demand.is_admissible
    inside = limit_demand(0, x, (140.0, 0.0, 0.0), sampling, authority)
    assert excess(inside, (140.0, 0.0, 0.0)) == 0.0 and inside.is_admissible
    # a jerk so far out that the greatest snap does not bring it back in a period
    far = limit_demand(0, x._replace(j=(90.0, 0.0, 0.0)), NO_NORMAL, sampling, authority)
    assert far.least == 380.0 and not far.is_admissible


@pytest.mark.interpreted
def test_membership_comes_first_then_the_correction_or_outside_the_value():
    n, wanted = (1.0, 0.0, 0.0), (5.0, 0.0, 0.0)
    little, much = Demand(n, 6.0, 0.5, True), Demand(n, 9.0, 3.0, True)
    near, far = Demand(n, 2.0, -0.1, False), Demand(n, 1.0, -0.5, False)
    for best, other in ((little, much), (much, near), (little, far), (near, far)):
        assert preferred(best, other, wanted) == preferred(other, best, wanted) == best
    # none asks for a correction: the first stays
    free = Demand(n, 4.0, 9.0, True), Demand(n, 3.0, 1.0, True)
    assert preferred(*free, wanted) == free[0] and preferred(*free[::-1], wanted) == free[1]
    assert excess(little, wanted) == 1.0 and excess(free[0], wanted) == 0.0
