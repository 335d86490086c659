"""The definition (8) in exact rational arithmetic: the oracle of the integrator's tests."""

import itertools
import math
from fractions import Fraction


def terms(x, u, t, bound):
    """The terms of ``[flow(x, u, t)]_n - bound``, exact."""
    n, t = len(x), Fraction(t)
    powers = [Fraction(value) * t ** (n - i) / math.factorial(n - i) for i, value in enumerate([u, *x])]
    return [*powers, -Fraction(bound)]


def dips_below(x, u_max, level):
    """Whether ``[flow(x, u_max, t)]_n < level`` for some t >= 0: Sturm's theorem, no root is computed."""
    n = len(x)
    rise = [Fraction(value) / math.factorial(n - i) for i, value in enumerate([u_max, *x])]
    rise[-1] -= Fraction(level)
    if rise[-1] < 0:
        return True
    chain = _sturm_chain(rise)
    at_zero = _sign_changes([p[-1] for p in chain])
    at_infinity = _sign_changes([p[0] for p in chain])
    return at_zero - at_infinity > 0


def _sturm_chain(p):
    m = len(p) - 1
    chain = [_primitive(p), _primitive([c * (m - i) for i, c in enumerate(p[:-1])])]
    while len(chain[-1]) > 1:
        remainder = _remainder(chain[-2], chain[-1])
        if not remainder:
            break
        chain.append(_primitive([-c for c in remainder]))
    return chain


def _remainder(a, b):
    a = list(a)
    while len(a) >= len(b):
        factor = a[0] / b[0]
        a = [c - factor * (b[i] if i < len(b) else 0) for i, c in enumerate(a)][1:]
    while a and a[0] == 0:
        a.pop(0)
    return a


def _primitive(p):
    """The same up to a positive factor, with small coefficients."""
    denominator = math.lcm(*(c.denominator for c in p))
    numbers = [int(c * denominator) for c in p]
    divisor = math.gcd(*numbers) or 1
    return [Fraction(c // divisor) for c in numbers]


def _sign_changes(values):
    signs = [value > 0 for value in values if value != 0]
    return sum(a != b for a, b in itertools.pairwise(signs))
