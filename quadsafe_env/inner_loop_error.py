"""How far the body's snap is off the one that is held: a bound by formula, from what the flight keeps to.

Let at every instant ‖r⁗ asked‖ <= U, ‖r⃛‖ <= j̄, the specific thrust t >= t̲, |ω_z| <= w, |ω̇_z| <= β. Write
ϖ = j̄/t̲ (so |ζ|, |ṫ|/t <= ϖ), S for a bound of ‖s‖, A = S + j̄ϖ (so |tα|, |ẗ| <= A), and ν for the larger of
(J_x + J_z − J_y)/J_x and (J_y + J_z − J_x)/J_y. Then along a step δ with the wrench held

    ‖κ‖  <= K = 3√2 ϖ S + √5 ϖ² j̄ + (1 + ν) w A + ν (w² + β) j̄
    κ changes with the snap that the wrench is made for by at most L = 3√2 ϖ + (1 + ν) w times
    ‖κ̇‖  <= M = 6 A ‖z̈‖ + 4 j̄ ‖z⃛‖ + ‖t z⁗‖

and the error d = s − u of the wrench of ``held_wrench`` is κ̂ (t' − δ/2) + e(t') at the time t' of the step,
with |∫e| <= m t', m = (L K/4 + M/6) δ². The first term has no mean, and leaves no more than K δ²/12 of jerk on
average. So over a control period Δ the jerk, acceleration, velocity and position are off no more than a snap of

    d̄ = m + K δ² / (3Δ)

held would put them: a ``snap`` for ``shields.Uncertainty``. ``docs/theory/inner_loop.md`` has the proof.
"""

import math
from typing import NamedTuple

from quadsafe_env.params import QuadrotorParams
from quadsafe_env.yaw import YawRange

# From S on, the error that S allows is counted in until both fit.
ROUNDS = 60
# The bounds hold a little beyond the flight's limits: an instant that leaves them has left by something.
BEYOND = 1.01


class Flight(NamedTuple):
    """Bounds that a flight keeps to: ‖snap asked‖, m/s⁴, ‖jerk‖, m/s³, least specific thrust, m/s², and yaw."""

    snap: float
    jerk: float
    thrust: float
    yaw: YawRange


class Shape(NamedTuple):
    """What moments of inertia do: ν, the largest coefficient of Euler's equations for ω_x, ω_y, and for ω_z."""

    coupling: float
    turning: float
    yawing: float


def shape_of(params: QuadrotorParams) -> Shape:
    """The coefficients of Euler's equations."""
    x, y, z = params.inertia
    return Shape(max((x + z - y) / x, (y + z - x) / y), max(abs(y - z) / x, abs(z - x) / y), abs(x - y) / z)


class Slopes(NamedTuple):
    """K, L and M of the module's text, and bounds of |ω_⊥| and |ω̇_⊥|."""

    crackle: float
    gain: float
    bend: float
    turn: float
    turn_rate: float


def slopes(snap: float, flight: Flight, shape: Shape, dt: float) -> Slopes:
    """K, L and M for ‖s‖ <= ``snap``."""
    nu, turning, yawing = shape
    w, beta = flight.yaw
    j, t = flight.jerk, flight.thrust
    turn = j / t
    A = snap + j * turn
    alpha = A / t
    turn_rate = alpha + w * turn
    # J_x ≠ J_y turns the body about its thrust while the wrench is held.
    w_rate2 = yawing * turn * turn_rate
    beta += dt * w_rate2
    w += dt * beta
    K = 3.0 * math.sqrt(2.0) * turn * snap + math.sqrt(5.0) * turn * turn * j
    K += (1.0 + nu) * w * A + nu * (w * w + beta) * j
    spin = beta * turn + w * turn_rate
    bent = nu * spin + w * alpha
    z2, z3 = alpha + turn**2, bent + 3.0 * turn * alpha + turn**3
    later = nu * (w_rate2 * turn + 2.0 * beta * turn_rate + w * turning * spin)
    later += beta * alpha + w * nu * spin + w * bent
    z4 = later + 4.0 * turn * bent + 3.0 * alpha**2 + 6.0 * turn**2 * alpha + turn**4
    # Where t is larger than t̲, ζ and α are smaller by as much: t z⁗ is largest at t̲.
    M = 6.0 * A * z2 + 4.0 * j * z3 + t * z4
    return Slopes(K, 3.0 * math.sqrt(2.0) * turn + (1.0 + nu) * w, M, turn, turn_rate)


def lead(flight: Flight, params: QuadrotorParams, dt: float) -> float:
    """K δ/2, m/s⁴: how far the snap that the wrench of a step is made for is from the one that is held."""
    return 0.5 * dt * slopes(flight.snap, flight, shape_of(params), dt).crackle


def snap_error(
    flight: Flight, params: QuadrotorParams, dt: float, period: float, inertia: float = 0.0
) -> float:
    """d̄, m/s⁴; infinite where the wrench of a step is no bound for the snap.

    With an inertia that is off by the share ι = ``inertia``, torques turn the body by up to ι/(1 − ι) more: of
    ‖u‖ that is a ``gain``; of the rest, ι/(1 − ι) (j̄ϖ + ν w j̄), it is counted in here.

    Args:
        flight: what is kept to.
        params: the vehicle.
        dt: δ, a physics step, s.
        period: Δ, of control, s.
        inertia: ι.
    """
    flight = Flight(flight.snap, BEYOND * flight.jerk, flight.thrust / BEYOND, flight.yaw)
    shape, wrong = shape_of(params), inertia / (1.0 - inertia)
    turn = flight.jerk / flight.thrust
    S = flight.snap
    for _ in range(ROUNDS):
        found = slopes(S, flight, shape, dt)
        K, L, M = found[:3]
        more = wrong * (S + flight.jerk * turn + shape.coupling * flight.yaw.rate * flight.jerk)
        needed = flight.snap + more + 0.5 * K * dt * (1.0 + L * dt) + 0.5 * M * dt * dt
        if needed <= S:
            steady = more - wrong * flight.snap
            return steady + (0.25 * L * K + M / 6.0) * dt * dt + K * dt * dt / (3.0 * period)
        S = needed * (1.0 + 1e-6)
        if 10.0 * flight.snap + 1e3 < S:
            break
    return math.inf
