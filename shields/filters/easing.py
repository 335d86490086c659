"""How a vehicle comes to rest at the border of its set: a linear law, exact for held snaps.

On the border of g_4 the least input is ū until the vehicle touches, and an acceleration is left when it does:
under a steady push it leaves, and comes again, for ever. So where it is slow and near, the law

    U = −k·x        x = (y, y', y'', y'''),  all poles of the sampled chain at λ = e^(−pΔ)               (E1)

is the least input. With the flat output c of the held chain (c b = c A b = c A² b = 0) and the rows

    z_i = k_0 c ((A − λ)/(1 − λ))^i x,  i = 0 … 3,        z_i⁺ = λ z_i + (1 − λ) z_{i+1}                 (E2)

any input from (E1) up keeps z_3 ≥ 0, so z_2, z_1 and z_0; and z_0 at the samples are the control values of the
quartic spline that y is, so y ≥ 0 between samples too (``docs/theory/half_space.md``, Lemma E1). At rest
z_i = k_0 y, an input.
"""

import math
from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.maths.feedback import held_gains

# p, 1/s. A slower law would ask for more than g_4 does of a vehicle in flight, a faster one needs higher rates.
POLE = 20.0
# In units of ū: how far below 0 a z_i may be by errors; up to where the law is asked, and where it alone is.
SLACK, REACH, BORDER = 0.1, 20.0, 1.0
# In units of ū, the least input that a vehicle at the border is allowed: it is let go gently.
LET_GO = -0.2
# Of the margin around a radius, the share that may be used up at the border; and rounding, m.
SHARE, ROUNDING = 0.25, 1e-9


class Easing(NamedTuple):
    """k, (4,); 1 − λ; by what the distance to keep is multiplied at the border."""

    feedback: tuple
    left: float
    within: float


@inline_kernel
def above(state, distance):
    """The chain relative to the distance to keep."""
    return (state[0], state[1], state[2], state[3] - distance)


@inline_kernel
def easing_input(x, easing):
    """(E1); x highest derivative first."""
    k = easing.feedback
    return -(k[0] * x[3] + k[1] * x[2] + k[2] * x[1] + k[3] * x[0])


@inline_kernel
def flat_output(x, t):
    """c·x of the chain held for t."""
    return x[3] - t * (1.5 * x[2] - t * (11 / 12 * x[1] - t / 4 * x[0]))


@inline_kernel
def next_in_line(x, t, left):
    """((A − λ)/(1 − λ)) x = x + (A − I) x/(1 − λ)."""
    share = t / left
    return (
        x[0],
        x[1] + share * x[0],
        x[2] + share * (x[1] + t / 2 * x[0]),
        x[3] + share * (x[2] + t / 2 * (x[1] + t / 3 * x[0])),
    )


@inline_kernel
def is_in_cone(x, least, most, easing, t):
    """Whether z_0, …, z_3 are within these bounds."""
    for _ in range(4):
        if not least <= easing.feedback[0] * flat_output(x, t) <= most:
            return False
        x = next_in_line(x, t, easing.left)
    return True


def easing_at(period: float, margin: float) -> Easing:
    """The ``Easing`` at a control period, s, of a shield with that margin."""
    within = (1.0 + (1.0 - SHARE) * margin) / (1.0 + margin)
    return Easing(tuple(held_gains(4, POLE, period).tolist()), -math.expm1(-POLE * period), within)
