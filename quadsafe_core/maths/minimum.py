"""The lowest point of x_n along a trajectory, among candidate times.

With ``p[0] t^m + … + p[m-1] t`` the rise of x_n by the time t, every sum keeps its digits where only the total
fits a float.
"""

import math

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.polynomials import LARGEST, ROUNDING, scaled_sum, times_power_of_two


@kernel
def better(p, t, rise, t_star):
    """The lower of a rise so far and that at a later candidate t; within rounding the later time counts."""
    if not t > 0.0:
        return rise, t_star
    candidate, size = rise_at(p, t)
    if candidate <= rise + ROUNDING * size:
        return min(candidate, rise), t
    return rise, t_star


@kernel
def rise_at(p, t):
    """``p[0] t^m + … + p[m-1] t``: how far x_n has risen at t, and the sum of the sizes of the terms."""
    value, size = 0.0, 0.0
    for i in range(len(p)):
        value = (value + p[i]) * t
        size = (size + abs(p[i])) * t
    if size <= LARGEST:
        return value, size
    value, size, e = scaled_sum(p, t, 0.0, 0.0)
    return times_power_of_two(value, e), min(times_power_of_two(size, e), LARGEST)


@kernel
def margin(p, x_n, bound, rise, t_star):
    """``x_n + rise - bound``, also where only the sum of the terms fits a float."""
    value = (x_n - bound) + rise
    if abs(value) <= LARGEST or t_star == 0.0:
        return value
    if bound == -math.inf:
        return math.inf
    value, _, e = scaled_sum(p, t_star, x_n, bound)
    return times_power_of_two(value, e)
