"""The third-order integrator above a lower bound on x_3 while x_1 stays below an upper one (Section IV-A).

    u = u_max until x_1 = x1_max, at T = (x1_max - x_1) / u_max, then u = 0

makes x_3 as large as it can be at every instant, so

    g_3^b(x) = min over t >= 0 of x_3(t) - bound                                                      (26)

Behind T the system is the second-order one of (27), with x1_max for its input. Where x_2(T) >= 0 the least x_3
comes before T and is that of g_3. Otherwise x_2 < 0 up to T and beyond, but for a first part that rises: the
least x_3 is at the start or at ``T - x_2(T) / x1_max``, and the interior of [0, T] need not be searched.
"""

import math

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.polynomials import LARGEST
from shields.chains.lower_bound import lower3, sensitivity


@kernel
def capped3(x1, x2, x3, u_max, x1_max, bound):
    """(26): g_3^b, t_star, and its derivative with respect to x_1 along t_star; needs u_max > 0."""
    T = max(x1_max - x1, 0.0) / u_max
    x2_end = x2 + 0.5 * T * (min(x1, x1_max) + x1_max)
    if x2_end >= 0.0 or T > LARGEST:
        value, t_star = lower3(x1, x2, x3, u_max, bound)
        return value, t_star, sensitivity(3, t_star)
    if x1_max <= 0.0:
        return -math.inf, math.inf, math.inf
    fall = T * (x2 + T * (2.0 * min(x1, x1_max) + x1_max) / 6.0) - 0.5 * x2_end * x2_end / x1_max
    if fall > 0.0:
        return x3 - bound, 0.0, 0.0
    t_star = T - x2_end / x1_max
    return x3 - bound + fall, t_star, T * (t_star - 0.5 * T)


@kernel
def least_corner_x2(x1_min, x1_max, x2_min, u_max):
    """Least x_2 that the lower functions of (28) allow at ``x_1 = x1_min <= 0`` on the lower bound of x_3."""
    T = (x1_max - x1_min) / u_max
    if -x1_min <= 2.0 * x1_max:
        needed = 0.375 * x1_min * x1_min / u_max
    else:
        needed = 0.5 * u_max * T * T - math.sqrt(x1_max * u_max * T * T * T / 3.0)
    return max(needed, x2_min + 0.5 * x1_min * x1_min / u_max)
