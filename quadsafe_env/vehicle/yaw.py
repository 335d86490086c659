"""The yaw motion of a vehicle: a range for ω_z and ω̇_z, and the yaw acceleration that keeps to it.

    ω̇_z ∈ [(−w − ω_z)/Δ, (w − ω_z)/Δ] ∩ [−β, β]

is the exact sampled set of order 1 under both bounds: 0 is in it wherever |ω_z| <= w, so it is feasible for
ever, and |ω_z| <= w at every instant of the period Δ. A rate beyond w comes back with β. It is asked where the
yaw acceleration is flown, from the rate that the gyroscope on board sees: a delay or a lost answer changes
nothing.
"""

from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel

# Largest turn about the thrust in a physics step, rad: the error of the inner loop grows with it
# (``quadsafe_env.vehicle.inner_loop_error``), and ``dynamics.step`` wants less than 0.3.
TURN = 0.02
# Largest yaw acceleration over the largest rate that a step allows, 1/s. At 500 Hz it is what the velocity
# interface asks for at most: 10 1/s on a change from −2 to 2 rad/s.
QUICKNESS = 4.0


class YawRange(NamedTuple):
    """Bounds of the yaw motion: |ω_z|, rad/s, and |ω̇_z|, rad/s²."""

    rate: float
    acceleration: float


class YawHold(NamedTuple):
    """A yaw range, and the longest time for which a yaw acceleration is held, s, as far as it is felt.

    A period that lasts longer, or an inertia that is smaller than believed, turns the body by more.
    """

    range: YawRange
    period: float


@inline_kernel
def within(value, low, high):
    """``value`` clipped to [low, high]; nan stays nan."""
    if value < low:
        return low
    return high if value > high else value


@inline_kernel
def limited_yaw(rate, asked, hold):
    """The yaw acceleration nearest to the asked one that keeps to the range."""
    most, per_period = hold.range.acceleration, 1.0 / hold.period
    kept = within(asked, (-hold.range.rate - rate) * per_period, (hold.range.rate - rate) * per_period)
    return within(kept, -most, most)


@inline_kernel
def is_spinning(rate, hold):
    """Whether a yaw rate is beyond its range by more than J_x ≠ J_y adds in a period."""
    return abs(rate) > 1.01 * hold.range.rate


def yaw_hold(kept: YawRange, dt: float, period: float, jitter: float, inertia_error: float) -> YawHold:
    """The range of a world, no wider than a physics step allows.

    Args:
        kept: range of the vehicle.
        dt: of a physics step, s.
        period: of control, s.
        jitter: a period lasts 1 ± jitter of that, in whole physics steps.
        inertia_error: the true inertia is 1 ± inertia_error of the believed one.
    """
    # As ``disturbed_flight.steps_of`` rounds.
    longest = dt * max(1, int(period / dt * (1.0 + jitter) + 0.5 + 1e-9))
    most = TURN / dt
    kept = YawRange(min(kept.rate, most), min(kept.acceleration, QUICKNESS * most))
    return YawHold(kept, longest / (1.0 - inertia_error))
