"""Pushes, and a lag known to an interval: the tube holds what they do, and is no wider than it must be."""

import gymnasium
import numpy as np
import pytest

from quadsafe_core.maths.lag import lag_shares
from quadsafe_core.shapes import Obstacles
from shields import Shield, ShieldWrapper, Uncertainty
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.chain import chain_over
from shields.settings.seldom import SEGMENT
from shields.settings.tube import tube_of
from shields.settings.uncertainty import lag_told, largest_part

LIMITS = FlightLimits(600.0, 600.0, np.inf, ThrustBand(1.0, np.inf, 9.81))
PERIOD = 0.01


def after(e, gains, pushes):
    """Deviations (steps + 1, M, 4) of M chains with feedback, pushed in v (steps, M) when a period begins."""
    (step, b), path = chain_over(PERIOD), [e]
    for m, push in enumerate(pushes):
        # The period of an accepted snap has no feedback.
        u = -e @ gains if m else np.zeros(len(e))
        e = (e + push[:, None] * np.eye(4)[1]) @ step.T + u[:, None] * b
        path.append(e)
    return np.array(path)


@pytest.mark.interpreted
@pytest.mark.parametrize("gap", [0.05, 0.3, 1.0])
def test_no_pushes_leave_the_tube_and_the_worst_reach_its_side(gap):
    told = Uncertainty(impulse=0.1, impulse_gap=gap)
    tube, steps, apart = tube_of(told, PERIOD, LIMITS), 300, round(gap / PERIOD)
    # What a push of every period does alone at the end, in r and a.
    alone = after(np.zeros((steps, 4)), tube.gains, 0.1 * np.eye(steps))[-1]
    for order in (0, 2):
        best = np.zeros(steps + apart)
        for m in range(steps):
            best[m + apart] = max(best[m + apart - 1], best[m] + abs(alone[m, order]))
        assert 0.6 * tube.deviation[order] <= best[-1] <= tube.deviation[order] * (1 + 1e-9)


@pytest.mark.interpreted
def test_pushes_that_come_more_often_than_told_leave_the_tube():
    tube, steps = tube_of(Uncertainty(impulse=0.1, impulse_gap=1.0), PERIOD, LIMITS), 200
    alone = after(np.zeros((steps, 4)), tube.gains, 0.1 * np.eye(steps))[-1]
    signs = np.sign(alone[:, 0])[:, None]
    assert abs(after(np.zeros((1, 4)), tube.gains, 0.1 * signs)[-1, 0, 0]) > 2.0 * tube.deviation[0]


class Lagged:
    """M chains behind lags that are switched every period, and the snap ŝ that is carried with the one told."""

    def __init__(self, rng, lags, told, m):
        self.rng, self.lags, self.told = rng, lags, told
        self.x, self.s, self.carried = np.zeros((m, 4)), np.zeros(m), np.zeros(m)

    def lead(self):
        """Of the measured state and ŝ."""
        return self.x + self.told * np.column_stack([self.x[:, 1:], self.carried])

    def fly(self, u, signs):
        """A period at the end of the interval that takes s to one side of ŝ, or in one chain of four at any."""
        rng, (quick, slow), m = self.rng, self.lags, len(self.s)
        lag = np.where((u - self.s) * signs > 0.0, quick, slow)
        lag = np.where(np.arange(m) % 4 == 0, rng.choice(self.lags, m), lag)
        new = self.x @ chain_over(PERIOD)[0].T
        for k, factorial in ((1, 1), (2, 2), (3, 6), (4, 24)):
            old, fresh = np.array([lag_shares(k, PERIOD, one) for one in lag]).T
            new[:, 4 - k] += (old * self.s + fresh * u) * PERIOD**k / factorial
        self.x, self.s = new, u + (self.s - u) * np.exp(-PERIOD / lag)
        self.carried = u + (self.carried - u) * np.exp(-PERIOD / self.told)


def lagged_stops(lags, told, longest=600.0, m=40, steps=100):
    """Deviations (steps, M, 4) of leads from stops that jump as far as they may; the largest |s − ŝ|."""
    rng, lag = np.random.default_rng(0), lag_told(told).told
    tube, (step, b) = tube_of(told, PERIOD, LIMITS), chain_over(PERIOD)
    signs, flown = np.where(rng.random(m) < 0.5, 1.0, -1.0), Lagged(rng, lags, lag, m)
    for _ in range(30):
        # Whatever was flown before.
        flown.fly(longest * np.where(rng.random(m) < 0.3, -signs, signs), signs)
    known, path, most = flown.lead(), [], np.abs(flown.s - flown.carried)
    for k in range(steps):
        turn = 0 if k == 0 else 1 + (k - 1) // round(SEGMENT / PERIOD)
        held = (longest - tube.feedback) * signs * (-1.0) ** turn if turn < 4 else np.zeros(m)
        feedback = (known - flown.lead()) @ tube.gains if k else np.zeros(m)
        flown.fly(held + feedback, signs)
        known = known @ step.T + held[:, None] * b
        path.append(flown.lead() - known)
        most = np.maximum(most, np.abs(flown.s - flown.carried))
    return np.abs(path).max(axis=(0, 1)), most.max(), tube


@pytest.mark.interpreted
@pytest.mark.parametrize("lags", [(0.036, 0.039), (0.01, 0.0115)])
def test_no_lag_of_the_interval_takes_a_stop_out_of_the_tube(lags):
    told = Uncertainty(rotor_lag=lags)
    reached, off, tube = lagged_stops(lags, told)
    assert (reached <= tube.deviation * (1 + 1e-9)).all() and off <= 2.0 * lag_told(told).spread * 600.0
    # The attack is one, and lags further out than were told leave the tube.
    assert reached[0] > 0.1 * tube.deviation[0]
    wide = (lags[0] / 2.0, 2.0 * lags[1])
    assert lagged_stops(wide, told)[0][0] > tube.deviation[0]


@pytest.mark.interpreted
def test_the_lag_that_is_counted_with_is_as_far_from_both_ends():
    told, spread, slowest = lag_told(Uncertainty(rotor_lag=[0.03, 0.045]))
    assert told / 0.03 - 1.0 == pytest.approx(spread) and 1.0 - told / 0.045 == pytest.approx(spread)
    assert slowest == 0.045 and lag_told(Uncertainty(rotor_lag=(0.02, 0.02))) == (0.02, 0.0, 0.02)


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ({"rotor_lag": (0.03, 0.045)}, "rotor_lag = (0.033, 0.0396) would do"),
        ({"impulse": 5.0, "impulse_gap": 1.0}, "impulse = "),
        ({"gain": 0.5, "wind": 5.0}, " of gain and wind would do"),
        ({"position": 1e3}, "position = "),
    ],
)
def test_a_refusal_tells_the_most_that_would_do(given, shown):
    def fits(part):
        try:
            return tube_of(part, PERIOD, LIMITS) is not None
        except ValueError:
            return False

    told = Uncertainty(**given)
    with pytest.raises(ValueError, match="uncertainty must leave half") as raised:
        tube_of(told, PERIOD, LIMITS)
    assert shown in str(raised.value)
    sentence = largest_part(told, fits)
    if len(given) == 1 or "impulse" in given:
        name, value = sentence.removesuffix(" would do").split(" = ")
        assert fits(told._replace(**{name: eval(value)}))
        assert not fits(
            told._replace(
                **{name: np.array(eval(value)) * [0.97, 1.03] if "(" in value else 1.03 * float(value)}
            )
        )


@pytest.mark.interpreted
def test_a_push_may_not_come_twice_in_a_period():
    shield, spheres = (
        Shield(uncertainty={"impulse": 5e-3, "impulse_gap": 0.01}),
        Obstacles.spheres([[2.0, 0, 0]], [0.5]),
    )
    shield.filter(np.zeros((4, 3)), spheres, np.zeros(3), 0.01)
    with pytest.raises(ValueError, match=r"uncertainty.impulse_gap must be at least a control period, 0.02 s"):
        shield.filter(np.zeros((4, 3)), spheres, np.zeros(3), 0.02)


@pytest.mark.parametrize(
    ("told", "is_surprised"), [({"impulse": 0.1, "impulse_gap": 0.1}, False), (None, True)]
)
def test_a_push_that_was_told_is_no_surprise(told, is_surprised):
    pushes = {"impulse": 0.1, "impulse_rate": 1.0}
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=pushes), uncertainty=told)
    env.reset(seed=0)
    seen = [env.step(np.zeros(4, dtype=np.float32))[4]["shield"]["surprised"] for _ in range(100)]
    assert any(seen) == is_surprised


def test_a_wrapper_refuses_at_once_what_leaves_no_tube():
    for inner_loop in ("measured", "proved"):
        env = gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0")
        with pytest.raises(ValueError, match=r"jerk = \d+.* would do"):
            ShieldWrapper(env, uncertainty={"jerk": 500.0, "snap": 100.0}, inner_loop=inner_loop)
