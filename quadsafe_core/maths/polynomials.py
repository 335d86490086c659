"""Real roots of polynomials with coefficients of any magnitude.

A root is as good as its residual: each root returned makes the polynomial zero to within rounding of its
largest term at that root, also where one coefficient is tiny against the others and formulas in the
depressed variable would drown the small roots. Quadratic and cubic are closed forms; from degree 4 on, the
roots of the derivative cut the line into pieces with at most one root each.
"""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel

LARGEST = 1.7976931348623157e308
ROUNDING = 8.9e-16  # four times the distance from 1 to the next float
ABSENT = math.nan


@kernel
def times_power_of_two(x, exponent):
    """``x 2^exponent``; ±inf where that does not fit."""
    while exponent > 1000:
        x *= 1.0715086071862673e301
        exponent = min(exponent - 1000, 2200)
    while exponent < -1000:
        x *= 9.332636185032189e-302
        exponent = max(exponent + 1000, -2200)
    return x * 2.0**exponent


@kernel
def _mantissa_and_exponent(x):
    """``x = m 2^e``; a zero gets an exponent below all others."""
    return (0.0, -100_000) if x == 0.0 else math.frexp(x)


@inline_kernel
def _clamped(t):
    """A root beyond the range of floats becomes the largest float, so that it is never lost."""
    return min(max(t, -LARGEST), LARGEST)


@kernel
def quadratic_roots(a, b, c):
    """Real roots of ``a t² + b t + c``, ascending, nan for absent ones; a may be 0."""
    half = -0.5 * b
    size = half * half + abs(a * c)
    if not 1e-290 < size < 1e300:
        return _scaled_quadratic_roots(a, half, c)
    discriminant = half * half - a * c
    if discriminant < -ROUNDING * size:
        return ABSENT, ABSENT
    z = half + math.copysign(math.sqrt(max(discriminant, 0.0)), half)
    near = c / z
    if a == 0.0:
        return near, ABSENT
    far = _clamped(z / a)
    return min(near, far), max(near, far)


@kernel
def _scaled_quadratic_roots(a, half, c):
    """Real roots of ``a t² - 2 half t + c`` where squares of the coefficients leave the range of floats."""
    if half == 0.0 and (a == 0.0 or c == 0.0):
        return (ABSENT, ABSENT) if a == 0.0 else (0.0, 0.0)
    ma, ea = _mantissa_and_exponent(a)
    mh, eh = _mantissa_and_exponent(half)
    mc, ec = _mantissa_and_exponent(c)
    scale = max(eh, (ea + ec) // 2)
    h = times_power_of_two(mh, eh - scale)
    product = times_power_of_two(ma * mc, ea + ec - 2 * scale)
    if h * h - product < -ROUNDING * (h * h + abs(product)):
        return ABSENT, ABSENT
    z = h + math.copysign(math.sqrt(max(h * h - product, 0.0)), h)
    near = _clamped(times_power_of_two(mc / z, ec - scale))
    if a == 0.0:
        return near, ABSENT
    far = _clamped(times_power_of_two(z / ma, scale - ea))
    return min(near, far), max(near, far)


@kernel
def cubic_roots(a, b, c, d):
    """Real roots of ``a t³ + b t² + c t + d``, ascending, nan for absent ones; a may be 0."""
    if a == 0.0:
        low, high = quadratic_roots(b, c, d)
        return low, high, ABSENT
    B, C, D, k = _monic(a, b, c, d)
    P = C - B * B
    s = _isolated_root(P, B * B * B - 1.5 * B * C + D)
    if s * B > 0.0 and abs(B) > 0.5 * abs(s):
        # s - B cancels, the other two roots do not: the third follows from the product of all
        product = B * B + s * B + (s * s + 3.0 * P)
        low, high = quadratic_roots(1.0, 2.0 * B + s, product)
        root = -2.0 * D / product
        if k != 0:
            low, high = _clamped(times_power_of_two(low, k)), _clamped(times_power_of_two(high, k))
            root = _small_root(a, d, product, k)
    else:
        root = s - B if k == 0 else _clamped(times_power_of_two(s - B, k))
        if P > 0.0:
            return root, ABSENT, ABSENT
        if root == 0.0:
            return 0.0, 0.0, 0.0
        # what remains is divided from the low end: this keeps roots that are small against this one
        low, high = quadratic_roots(-a * root, c + d / root, d)
    return _inserted(root, low, high)


@kernel
def _monic(a, b, c, d):
    """(B, C, D, k) with ``t = 2^k s`` and ``s³ + 3 B s² + 3 C s + 2 D``; k is 0 at ordinary scales."""
    B, C, D = b / (3.0 * a), c / (3.0 * a), d / (2.0 * a)
    B2 = B * B
    size = B2 * B2 * B2 + abs(C * C * C) + D * D
    if 1e-270 < size < 1e290:
        return B, C, D, 0
    ma, ea = _mantissa_and_exponent(a)
    mb, eb = _mantissa_and_exponent(b)
    mc, ec = _mantissa_and_exponent(c)
    md, ed = _mantissa_and_exponent(d)
    k = max(eb - ea, (ec - ea) // 2, (ed - ea) // 3)
    B = times_power_of_two(mb / (3.0 * ma), eb - ea - k)
    C = times_power_of_two(mc / (3.0 * ma), ec - ea - 2 * k)
    D = times_power_of_two(md / (2.0 * ma), ed - ea - 3 * k)
    return B, C, D, k


@kernel
def _isolated_root(P, Q):
    """The real root of ``s³ + 3 P s + 2 Q`` that is never one of a close pair, by Cardano and Viète."""
    discriminant = Q * Q + P * P * P
    if discriminant < 0.0:
        w = math.sqrt(-P)
        s = 2.0 * w * math.cos(math.acos(min(abs(Q) / (w * w * w), 1.0)) / 3.0)
        return math.copysign(s, -Q)
    w = float(np.cbrt(abs(Q) + math.sqrt(discriminant)))
    if w == 0.0:
        return 0.0
    v = P / w
    s = w - v if P < 0.0 else 2.0 * abs(Q) / (w * w + P + v * v)
    return math.copysign(s, -Q)


@kernel
def _small_root(a, d, product, k):
    """``-d / (a product 4^k)`` without overflow on the way."""
    ma, ea = _mantissa_and_exponent(a)
    md, ed = _mantissa_and_exponent(d)
    return _clamped(times_power_of_two(-md / (ma * product), ed - ea - 2 * k))


@inline_kernel
def _inserted(root, low, high):
    """Three roots ascending, from one and an ascending pair that may be absent."""
    if not low <= high:
        return root, ABSENT, ABSENT
    return min(root, low), max(low, min(root, high)), max(root, high)


@kernel
def quartic_roots(a, b, c, d, e):
    """Real roots of ``a t⁴ + b t³ + c t² + d t + e``, ascending, each once, nan in place of absent ones."""
    if a == 0.0:
        t1, t2, t3 = cubic_roots(b, c, d, e)
        return t1, t2, t3, ABSENT
    p = (a, b, c, d, e)
    t1, t2, t3 = cubic_roots(4.0 * a, 3.0 * b, 2.0 * c, d)
    bound = root_bound(p)
    outside = math.copysign(1.0, a)
    s1 = sign_at(p, t1)
    first = root_between(p, -bound, t1, outside, s1)
    if math.isnan(t2):
        return first, ABSENT, ABSENT, root_between(p, t1, bound, s1, outside)
    s2, s3 = sign_at(p, t2), sign_at(p, t3)
    second = root_between(p, t1, t2, s1, s2)
    third = root_between(p, t2, t3, s2, s3)
    return first, second, third, root_between(p, t3, bound, s3, outside)


@kernel
def evaluate(p, t):
    """Value, slope and sum of the sizes of the terms of ``p[0] t^m + … + p[m]`` (Horner)."""
    value, slope, size = p[0], 0.0, abs(p[0])
    for i in range(1, len(p)):
        slope = slope * t + value
        value = value * t + p[i]
        size = size * abs(t) + abs(p[i])
    return value, slope, size


@kernel
def sign_at(p, t):
    """Sign of the polynomial at t; 0 where its value is within rounding of 0."""
    value, _, size = evaluate(p, t)
    if abs(value) <= ROUNDING * size <= LARGEST:
        return 0.0
    return math.copysign(1.0, value)


@kernel
def root_bound(p):
    """A bound on the size of all roots (Fujiwara), a power of two; the leading coefficient is not 0."""
    _, leading = math.frexp(p[0])
    exponent = -2200
    for i in range(1, len(p)):
        exponent = max(exponent, -((leading - 1 - _mantissa_and_exponent(p[i])[1]) // i))
    return min(times_power_of_two(2.0, exponent), LARGEST)


@kernel
def root_between(p, low, high, sign_low, sign_high):
    """The root between neighbouring stationary points, nan if there is none.

    A root within rounding of a stationary point is that point, and belongs to the piece on its left.
    """
    if sign_high == 0.0:
        return high
    if sign_low * sign_high >= 0.0:
        return ABSENT
    sign_zero = sign_low if low >= 0.0 else (sign_high if high <= 0.0 else sign_at(p, 0.0))
    if sign_zero == 0.0:
        return 0.0
    if sign_zero == sign_low:
        return _crossing(p, 1.0, max(low, 0.0), high, sign_high)
    return -_crossing(p, -1.0, max(-high, 0.0), -low, sign_low)


@kernel
def _crossing(p, side, low, high, sign_high):
    """The t in (low, high) at which ``p(side t)`` takes the sign it has at high: Newton in a bracket."""
    t, step = middle(low, high), high - low
    for _ in range(200):
        value, slope, size = evaluate(p, side * t)
        if abs(value) <= 0.5 * ROUNDING * size <= LARGEST:
            break
        if value * sign_high > 0.0:
            high = t
        else:
            low = t
        newton = t - side * value / slope if slope != 0.0 else math.inf
        if not (low < newton < high and abs(newton - t) < 0.5 * step):
            newton = middle(low, high)
        step = abs(newton - t)
        if step <= 1e-16 * t:
            break
        t = newton
    return t


@inline_kernel
def middle(low, high):
    """Middle of a positive bracket: of the exponents while they differ, then of the values."""
    if low < 0.25 * high:
        return math.sqrt(max(low, 1e-300 * high, 1e-307)) * math.sqrt(high)
    return low + 0.5 * (high - low)


@kernel
def roots_from_stationary(p, stationary, count, roots):
    """The positive roots of p into ``roots``, from those ``count`` of its derivative; returns their number."""
    low, sign_low, found = 0.0, sign_at(p, 0.0), 0
    for k in range(count + 1):
        high = stationary[k] if k < count else root_bound(p)
        sign_high = sign_at(p, high) if k < count else math.copysign(1.0, p[0])
        t = root_between(p, low, high, sign_low, sign_high)
        if t > 0.0:
            roots[found] = t
            found += 1
        low, sign_low = high, sign_high
    return found


@kernel
def scaled_sum(p, t, last, bound):
    """``p[0] t^m + … + p[m-1] t + last - bound`` as (value, sum of sizes, e), both to be multiplied by 2^e."""
    m = len(p)
    mantissa, k = math.frexp(t)
    e = max(_mantissa_and_exponent(last)[1], _mantissa_and_exponent(bound)[1])
    for i in range(m):
        e = max(e, _mantissa_and_exponent(p[i])[1] + (m - i) * k)
    value, size = 0.0, 0.0
    for i in range(m):
        term = times_power_of_two(p[i], (m - i) * k - e)
        value, size = (value + term) * mantissa, (size + abs(term)) * mantissa
    last, bound = times_power_of_two(last, -e), times_power_of_two(bound, -e)
    return value + last - bound, size + abs(last) + abs(bound), e
