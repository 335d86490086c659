"""The set behind a lag against dense search and a linear program: exact, the largest, and the forms inside."""

import numpy as np
import pytest
from scipy.optimize import linprog

from shields.chains.integrator import flow, lower_value
from shields.chains.lagged import lagged_flow, lagged_lower_value

ORDERS = (1, 2, 3, 4)
each_order = pytest.mark.parametrize("n", ORDERS)


class Case:
    """N states of order n about a second from their least x_n, inputs and time constants over decades."""

    def __init__(self, n, count=300, seed=0):
        rng = self.rng = np.random.default_rng([n, seed])
        self.u_max, self.lag = 10.0 ** rng.uniform(0.0, 2.0, count), 10.0 ** rng.uniform(-2.0, 0.0, count)
        seconds = 10.0 ** rng.uniform(-1.0, 0.5, count)
        self.x = (self.u_max * seconds ** np.arange(1, n + 1)[:, None]).T * rng.normal(size=(count, n))
        self.s = self.u_max * rng.uniform(-3.0, 2.0, count)

    def value(self, bound=0.0):
        return lagged_lower_value(self.x, self.s, self.u_max, bound, self.lag)[0]

    def on_border(self, margin=0.0):
        self.x[:, -1] += margin - self.value()
        return self

    def size(self, t):
        """The largest term of x_n after a time t."""
        powers = t ** np.arange(self.x.shape[1] - 1, -1, -1)[:, None]
        return np.max(abs(self.x.T) * powers, axis=0) + (abs(self.s) + self.u_max) * t ** self.x.shape[1]


def lead(x, s, lag):
    return x + np.asarray(lag)[..., None] * np.column_stack([s, x[:, :-1]])


def shifted(x, s, u_max, lag):
    z = x.copy()
    z[:, 0] -= lag * np.maximum(u_max - s, 0.0)
    return z


@pytest.mark.interpreted
@each_order
def test_the_flow_solves_the_equations_of_the_lagged_chain(n):
    case, h = Case(n, 50), 1e-4
    u = case.rng.normal(size=50) * case.u_max
    ends = [lagged_flow(case.x, case.s, u, 0.3 + k * h, case.lag) for k in (-1, 0, 1)]
    (x0, s0), (x1, s1), (x2, s2) = ends
    rate = np.column_stack([s1, x1[:, :-1]])
    scale = np.abs(rate).max() + np.abs(x1).max() + (case.u_max / case.lag).max()
    assert np.abs((x2 - x0) / (2 * h) - rate).max() <= 1e-4 * scale
    assert np.abs(case.lag * (s2 - s0) / (2 * h) - (u - s1)).max() <= 1e-2 * np.abs(u - case.s).max()


@each_order
def test_the_flow_of_two_times_is_that_of_their_sum(n):
    case = Case(n)
    u, (t1, t2) = case.rng.normal(size=300) * case.u_max, 10.0 ** case.rng.uniform(-3.0, 1.0, (2, 300))
    half_way = lagged_flow(case.x, case.s, u, t1, case.lag)
    end, s_end = lagged_flow(*half_way, u, t2, case.lag)
    x, s = lagged_flow(case.x, case.s, u, t1 + t2, case.lag)
    assert (abs(end[:, -1] - x[:, -1]) <= 1e-13 * (1.0 + np.exp(t1 + t2)) * (1e3 + case.size(t1 + t2))).all()
    assert np.allclose(s_end, s, rtol=1e-12, atol=1e-12 * case.u_max.max())


@each_order
def test_the_value_is_the_least_of_a_dense_search_and_attained(n):
    case = Case(n)
    value, t_star = lagged_lower_value(case.x, case.s, case.u_max, 0.5, case.lag)
    attained = lagged_flow(case.x, case.s, case.u_max, t_star, case.lag)[0][:, -1] - 0.5
    assert (abs(attained - value) <= 1e-14 * (1.0 + case.size(t_star))).all()
    times = np.linspace(0.0, 1.0, 1500) ** 2 * 3.0 * t_star.max()
    dense = (
        np.min([lagged_flow(case.x, case.s, case.u_max, t, case.lag)[0][:, -1] for t in times], axis=0) - 0.5
    )
    excess = (dense - value) / (1.0 + case.size(t_star))
    assert excess.min() >= -1e-14 and np.median(excess) <= 1e-5 and (t_star > 0.0).mean() > 0.3


def test_l2_of_four_stationary_times_the_deeper_dip_counts():
    """``x_3 = a + b t + c t² + t³/6 + d exp(-t)`` with four zeros that are chosen: as many as there can be."""
    rng, deepest = np.random.default_rng(0), np.zeros(4, dtype=int)
    for _ in range(200):
        zeros = np.cumsum(rng.uniform(0.2, 2.0, 4))
        columns = np.column_stack([np.ones(4), zeros, zeros**2, np.exp(-zeros)])
        a, b, c, d = np.linalg.solve(columns, -(zeros**3) / 6.0)
        x, s = np.array([2.0 * c + d, b - d, a + d, 0.0]), 1.0 - d
        at_zeros = lagged_flow(x, s, 1.0, zeros, 1.0)[0][:, -1]
        value, t_star = lagged_lower_value(x, s, 1.0, 0.0, 1.0)
        assert value == pytest.approx(min(0.0, at_zeros.min()), abs=1e-9)
        if t_star > 0.0:
            deepest[np.argmin(at_zeros)] += 1
            assert t_star == pytest.approx(zeros[np.argmin(at_zeros)], abs=1e-5)
        assert s < 0.0
    assert deepest[0] == deepest[2] == 0 < deepest[1] and deepest[3] > 0


@pytest.mark.interpreted
@each_order
def test_without_a_lag_it_is_the_integrator_bit_for_bit(n):
    case = Case(n)
    value, t_star = lagged_lower_value(case.x, case.s, case.u_max, 0.5, 0.0)
    plain, plain_star = lower_value(case.x, case.u_max, 0.5)
    assert (value == plain).all() and (t_star == plain_star).all()
    u, t = case.rng.normal(size=300), case.rng.uniform(0.1, 1.0, 300)
    assert np.allclose(lagged_flow(case.x, case.s, u, t, 0.0)[0], flow(case.x, u, t), rtol=1e-14)
    tiny = lagged_lower_value(case.x, case.s, case.u_max, 0.5, 1e-9)[0]
    assert np.allclose(tiny, plain, rtol=1e-5, atol=1e-5)


@each_order
def test_no_switching_input_does_better_than_u_max(n):
    """A linear program over inputs that switch 40 times: its best is u_max, and what it reaches is g_L."""
    case = Case(n, 6)
    for x, s, u_max, lag in zip(case.x, case.s, case.u_max, case.lag, strict=True):
        value, t_star = lagged_lower_value(x, s, u_max, 0.0, lag)
        times = np.unique(np.r_[np.linspace(0.0, max(2.0 * t_star, 0.1), 40), t_star])
        free = lagged_flow(x, s, 0.0, times, lag)[0][:, -1]
        steps = lagged_flow(np.zeros(n), 0.0, 1.0, np.maximum(times[:, None] - times, 0.0), lag)[0][..., -1]
        forced = steps[:, :-1] - steps[:, 1:]
        rows = np.hstack([-forced, np.ones((len(times), 1))])
        limits = [(-10.0 * u_max, u_max)] * (len(times) - 1) + [(None, None)]
        best = linprog(
            np.r_[np.zeros(len(times) - 1), -1.0], A_ub=rows, b_ub=free, bounds=limits, method="highs"
        )
        assert -best.fun == pytest.approx(value, abs=1e-6 * (1.0 + abs(value)))


@each_order
def test_just_inside_u_max_keeps_the_bound_for_ever_and_just_outside_nothing_does(n):
    for margin in (1e-6, -1e-6):
        case = Case(n).on_border(margin)
        _, t_star = lagged_lower_value(case.x, case.s, case.u_max, 0.0, case.lag)
        times = np.r_[np.linspace(0.0, 2.0, 200)[:, None] * t_star, t_star[None]]
        least = lagged_flow(case.x, case.s, case.u_max, times, case.lag)[0][..., -1].min(axis=0)
        assert (np.sign(least) == np.sign(margin)).all()
        if margin < 0.0:
            switched = [
                lagged_flow(case.x, case.s, u * case.u_max, t_star, case.lag)[0] for u in (0.9, 0.0, -3.0)
            ]
            assert all((x[:, -1] <= 0.0).all() for x in switched)


@each_order
def test_under_u_max_the_value_never_falls_and_under_less_it_may(n):
    case = Case(n).on_border()
    lost = 0
    for t in (0.01, 0.1, 1.0):
        x, s = lagged_flow(case.x, case.s, case.u_max, t, case.lag)
        after = lagged_lower_value(x, s, case.u_max, 0.0, case.lag)[0]
        assert (after >= -1e-12 * (1.0 + case.size(t))).all()
        x, s = lagged_flow(case.x, case.s, 0.5 * case.u_max, t, case.lag)
        lost += (lagged_lower_value(x, s, case.u_max, 0.0, case.lag)[0] < -1e-6).sum()
    assert lost > 50


@each_order
def test_who_ignores_the_lag_violates(n):
    """The counter-case: on the border of the integrator's set u_max comes too late, by what the lag takes."""
    case = Case(n)
    case.s = np.minimum(case.s, 0.9 * case.u_max)
    case.x[:, -1] -= lower_value(case.x, case.u_max, 0.0)[0]
    value, t_star = lagged_lower_value(case.x, case.s, case.u_max, 0.0, case.lag)
    assert (value <= 1e-12 * (1.0 + case.size(t_star))).all() and (value < -1e-3).mean() > 0.2


@each_order
def test_l1_the_lead_state_is_the_integrator_of_the_input_under_every_input(n):
    case = Case(n)
    u, t = case.rng.normal(size=(2, 300)) * case.u_max, case.rng.uniform(0.0, 1.0, (2, 300))
    x, s, z = case.x, case.s, lead(case.x, case.s, case.lag)
    for k in range(2):
        x, s = lagged_flow(x, s, u[k], t[k], case.lag)
        z = flow(z, u[k], t[k])
    scale = 1.0 + np.abs(z) + np.abs(lead(np.abs(x), np.abs(s), case.lag))
    assert (abs(lead(x, s, case.lag) - z) <= 1e-12 * scale * np.exp(t.sum(axis=0))[:, None]).all()


def test_l1_the_position_lies_in_the_hull_of_its_start_and_the_path_of_the_lead():
    """Along any direction: tested along 20 of them, for paths of four held snaps in three dimensions."""
    rng, lag, count = np.random.default_rng(3), 0.0375, 400
    directions = rng.normal(size=(20, 3))
    x, s = rng.normal(size=(count, 3, 4)) * np.array([30.0, 6.0, 2.0, 1.0]), 100.0 * rng.normal(size=(count, 3))
    start, beyond = x[..., 3].copy(), 0
    highest = start @ directions.T
    for _ in range(4):
        u, times = 200.0 * rng.normal(size=(count, 3)), np.linspace(0.0, 0.1, 30)
        for t in times:
            y, d = lagged_flow(x, s, u, t, lag)
            highest = np.maximum(highest, (y[..., 3] + lag * y[..., 2]) @ directions.T)
            assert (y[..., 3] @ directions.T <= highest + 1e-4).all()
            beyond += (y[..., 3] @ directions.T > (y[..., 3] + lag * y[..., 2]) @ directions.T).sum()
        x, s = y, d
    assert beyond > 1000  # where the start is not among the points, it does not hold


@each_order
def test_l3_the_lead_and_the_shifted_form_are_inside_and_the_lead_is_the_larger_one(n):
    case = Case(n, 3000)
    exact, z = case.value(), lead(case.x, case.s, case.lag)
    led = np.minimum(lower_value(z, case.u_max, 0.0)[0], case.x[:, -1])
    moved = lower_value(shifted(case.x, case.s, case.u_max, case.lag), case.u_max, 0.0)[0]
    room = 1e-12 * (1.0 + np.abs(exact) + np.abs(case.x).sum(axis=1))
    assert (led <= exact + room).all() and (moved <= exact + room).all()
    assert np.mean(exact - led) <= np.mean(exact - moved) and (exact - moved > 1e-3).any()


@each_order
def test_l3_without_the_position_the_lead_form_is_not_inside(n):
    """The counter-case: a lead that is clear says nothing of a vehicle that is behind it."""
    case = Case(n, 3000)
    led = lower_value(lead(case.x, case.s, case.lag), case.u_max, 0.0)[0]
    assert (led > case.value() + 1e-3).any()


@each_order
def test_l4_the_leads_of_both_ends_are_inside_for_every_constant_lag_between_and_one_is_not(n):
    case = Case(n, 3000)
    ends = (case.lag, 3.0 * case.lag)
    low, high = (lower_value(lead(case.x, case.s, lag), case.u_max, 0.0)[0] for lag in ends)
    room = 1e-12 * (1.0 + np.abs(case.x).sum(axis=1))
    for share in (0.0, 0.3, 0.7, 1.0):
        lag = (1.0 - share) * ends[0] + share * ends[1]
        exact = lagged_lower_value(case.x, case.s, case.u_max, 0.0, lag)[0]
        assert (np.minimum(np.minimum(low, high), case.x[:, -1]) <= exact + room).all()
        assert share != 0.7 or (np.minimum(low, case.x[:, -1]) > exact + 1e-4).any()


@each_order
def test_l4_no_course_of_the_lag_in_its_interval_does_worse_than_a_corner(n):
    case = Case(n).on_border()
    lags = (case.lag, 3.0 * case.lag)
    worst, _ = lagged_lower_value(case.x, case.s, case.u_max, 0.0, lags)
    corner = np.where(case.s <= case.u_max, lags[1], lags[0])
    assert (worst == lagged_lower_value(case.x, case.s, case.u_max, 0.0, corner)[0]).all()
    x, s, least = case.x, case.s, np.full(300, np.inf)
    for _ in range(200):
        lag = lags[0] * case.rng.choice([1.0, 2.0, 3.0], 300)
        x, s = lagged_flow(x, s, case.u_max, 0.05, lag)
        least = np.minimum(least, x[:, -1])
    assert (least >= worst - 1e-9 * (1.0 + case.size(10.0) * 1e-3)).all()


@each_order
def test_l4_the_wrong_corner_is_not_safe(n):
    case = Case(n)
    for corner in (case.lag, 3.0 * case.lag)[: 1 if n == 1 else 2]:  # x_1 alone does not fall where s > u_max
        x = case.x.copy()
        x[:, -1] -= lagged_lower_value(x, case.s, case.u_max, 0.0, corner)[0]
        assert (lagged_lower_value(x, case.s, case.u_max, 0.0, (case.lag, 3.0 * case.lag))[0] < -1e-4).any()


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"lag": -0.1}, r"lag must be >= 0, got -0\.1"),
        ({"lag": (0.2, 0.1)}, "lag must be an interval, its least first, got"),
        ({"lag": (-0.2, 0.1)}, r"lag must be >= 0, got -0\.2"),
        ({"lag": np.nan}, "lag must"),
        ({"s": np.inf}, "s must"),
        ({"u_max": 0.0}, "u_max must be > 0"),
        ({"x": [1.0] * 5}, "x must have 1 to 4 entries in its last axis, got 5"),
    ],
)
def test_what_is_no_state_or_no_lag_is_named(changed, named):
    given = {"x": [0.0, 1.0], "s": 0.0, "u_max": 1.0, "bound": 0.0, "lag": 0.1}
    with pytest.raises(ValueError, match=named):
        lagged_lower_value(**{**given, **changed})


def test_a_flow_backwards_is_refused():
    with pytest.raises(ValueError, match=r"t must be >= 0, got -1\.0"):
        lagged_flow([0.0, 1.0], 0.0, 1.0, -1.0, 0.1)


def test_leading_shapes_are_broadcast_as_elsewhere():
    value, t_star = lagged_lower_value(np.zeros((3, 1, 4)), np.zeros(5), 1.0, 0.0, (0.1, [[0.2]]))
    assert value.shape == t_star.shape == (3, 5)
    assert lagged_lower_value([0.0, -1.0], 0.0, 1.0, 0.0, 0.1)[0].shape == ()
