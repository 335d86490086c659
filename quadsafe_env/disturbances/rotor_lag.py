"""Rotors that lag behind the wrench that is asked of them, T ẇ = u − w, and an inner loop that is told of it.

A wrench u that is asked for over a physics step δ turns w into u + k (w − u) and gives u + μ (w − u) in the
mean, with k = exp(−δ/T) and μ = (1 − k) T/δ: the solution of the lag.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_env.vehicle.inner_loop import held_wrench, leading_wrench


@kernel
def lag_of_step(lag, dt):
    """k and μ of a physics step ``dt`` for a time constant, s; 0 and 0 without a lag."""
    new = -math.expm1(-dt / lag) if lag > 0.0 else 1.0
    return 1.0 - new, new * lag / dt


@inline_kernel
def after_lag(asked, before, share):
    """What is asked but for the share of what was given before."""
    return (
        asked[0] + share * (before[0] - asked[0]),
        asked[1] + share * (before[1] - asked[1]),
        asked[2] + share * (before[2] - asked[2]),
        asked[3] + share * (before[3] - asked[3]),
    )


@inline_kernel
def lagged(asked, m):
    """The wrench that the rotors of a row give in the mean of a physics step, and their lag at its end."""
    memory, lag = m["wrench"], m["lag"]
    before = (memory[0], memory[1], memory[2], memory[3])
    memory[0], memory[1], memory[2], memory[3] = after_lag(asked, before, lag[0])
    return after_lag(asked, before, lag[1])


@inline_kernel
def asked_wrench(s, snap, yaw_acceleration, plant, lead, m):
    """The wrench that the inner loop of a row asks for; with the numbers of ``lag_lead`` it counts the lag."""
    if lead is None:
        return held_wrench(s, snap, yaw_acceleration, plant.params, plant.dt)
    memory = m["believed"]
    before = (memory[0], memory[1], memory[2], memory[3])
    asked = leading_wrench(s, snap, yaw_acceleration, before, (lead[1], lead[2], 0.5 * plant.dt), plant.params)
    memory[0], memory[1], memory[2], memory[3] = after_lag(asked, before, lead[0])
    return asked


def lag_lead(lag: float, dt: float) -> tuple[float, float, float]:
    """k, μ and the lead θ = δ/(2 (1 − μ)), s, of an inner loop with steps of ``dt`` that is told a lag, s."""
    kept, mean = lag_of_step(lag, dt)
    return kept, mean, 0.5 * dt / (1.0 - mean)
