"""What the rotors can give for a flight that asks for acceleration, jerk and snap: sufficient conditions.

Specific thrust t = ‖r̈ + g e3‖ = f_z/m, jerk j = r⃛, snap u = r⁗, in components along the body axes. With
w = (ω_y, −ω_x) the flat map (31) and its inverse (35) read

    w = j_xy / t        ẇ = (u_xy − 2 j_z w)/t − ω_z (ω_x, ω_y)        τ = Jω̇ + ω × Jω

A rotor gives (m t ± τ_x/l_x ± τ_y/l_y ± τ_z/c)/4 (``quadsafe_env.vehicle.rotors``), so all four lie in [0,
F/4], F = thrust_max, if the *steering thrust* D = |τ_x|/l_x + |τ_y|/l_y + |τ_z|/c is at most min(m t, F − m t).

**Proposition.** Let ‖j‖ <= j̄, ‖u‖ <= ū, |ω_z| <= Ω, |ω̇_z| <= β. Let H² = (J_x/l_x)² + (J_y/l_y)², κ and δ
half the sum and half the distance of (J_x + J_z − J_y)/J_x and (J_y + J_z − J_x)/J_y. Then

    D <= H [ū/t + (j̄/t)² + (κΩ/2)² + δΩ j̄/t] + [J_z β + |J_y − J_x| (j̄/t)²/2] / c =: D̄(t)

and, if D̄(t) <= min(m t, F − m t) at both ends of a band of t, no rotor leaves its range anywhere in it.

*Proof.* Put κ_x, κ_y for the two ratios. Inserting ω̇ gives

    τ_x = −J_x (u_y/t + 2 j_z ω_x/t − κ_x ω_y ω_z)      τ_y = J_y (u_x/t − 2 j_z ω_y/t − κ_y ω_x ω_z)

so by Cauchy's inequality |τ_x|/l_x + |τ_y|/l_y <= H × the length of the vector of the two brackets, which is at
most the sum of three lengths: ū/t; that of (p ω_x − κ ω_z ω_y, p ω_y + κ ω_z ω_x) with p = 2 j_z/t; and
δΩ‖w‖ for what κ leaves of κ_x, κ_y. The second is ‖w‖ √(p² + (κω_z)²), its two parts being perpendicular.
With q = ‖w‖² and (j_z/t)² <= (j̄/t)² − q its square is at most q (4 (j̄/t)² − 4q + (κΩ)²), and that at most
((j̄/t)² + (κΩ/2)²)², its value at the vertex. Last, |τ_z| <= J_z β + |J_y − J_x| |ω_x ω_y|, and
|ω_x ω_y| <= q/2 <= (j̄/t)²/2. D̄ is convex in t and min(m t, F − m t) concave, so what holds at both ends of
a band holds between them. ∎

For J_x = J_y (δ = 0) and κΩ <= 2 j̄/t every step is attained: a larger ū fails (see the tests). The
statement is about instants: the state must meet it at the start of a physics step, where (35) is evaluated.

**The shares.** ``authority`` chooses. The band of t goes from the thrust floor a ``share`` of the way up to
hover; differential thrust comes out of the collective, so near zero thrust there is nothing to steer with, and
(35) is singular. Upwards, a ``share`` of the way from hover to F is kept for steering; the band then ends
higher, where D̄ is met exactly. Of the steering thrust, yaw gets ``yaw_range``. The rest is halved between
the terms of the jerk and the snap: near the split that turns the acceleration round soonest, since that takes
a time of about 2|r̈|/j̄ + j̄/ū.
"""

import math

from quadsafe_core.authority import Authority
from quadsafe_core.checks import non_negative_number, positive_number
from quadsafe_env.vehicle.actions import YAW_RATE, YAW_RATE_POLE
from quadsafe_env.vehicle.params import QuadrotorParams, params_from
from quadsafe_env.vehicle.rotors import levers
from quadsafe_env.vehicle.yaw import YawRange

# Kept of both ways from hover, to the floor and to full thrust: half, a choice.
SHARE = 0.5
# Of the differential thrust at hover: the Crazyflie then follows every yaw command of the velocity interface.
YAW_SHARE = 1 / 8
TURN_SHARE = 1 / 2
# What small vehicles' gyroscopes and attitude loops follow well, a choice; the presets' torque ends earlier.
BODY_RATE = 20.0  # rad/s
# Rounding must not carry a rotor over the edge that the proposition lets it touch.
SLACK = 1e-9


def yaw_range(params: "QuadrotorParams | str") -> YawRange:
    """The part of the rotors that is kept for yaw.

    The rate is that of the velocity interface. The acceleration is what this interface asks for at most, or
    less: ``YAW_SHARE × min(m g, thrust_max − m g) c / J_z``, a part of the differential thrust at hover.

    Args:
        params: parameters or the name of a preset.
    """
    p = params_from(params)
    hover, full = p.mass * p.gravity, p.thrust_max
    available = YAW_SHARE * min(hover, full - hover) * levers(p)[2] / p.inertia[2]
    return YawRange(min(YAW_RATE, p.yaw_rate_max), min(2.0 * YAW_RATE * YAW_RATE_POLE, available))


def steering_thrust(
    thrust: float, snap: float, jerk: float, yaw: YawRange, params: "QuadrotorParams | str"
) -> float:
    """D̄(t) of the proposition: what torques may ask of the rotors together, N.

    Args:
        thrust: specific thrust t, m/s², > 0.
        snap: ū, bound of ‖r⁗‖, m/s⁴.
        jerk: j̄, bound of ‖r⃛‖, m/s³.
        yaw: bounds of the yaw motion.
        params: parameters or the name of a preset.

    Raises:
        ValueError: for a thrust not above zero, or a negative bound.
    """
    p = params_from(params)
    for name, value in yaw._asdict().items():
        non_negative_number(f"yaw.{name}", value)
    h, kappa, delta = _inertia_terms(p)
    turn = non_negative_number("jerk", jerk) / positive_number("thrust", thrust)
    bending = (
        non_negative_number("snap", snap) / thrust
        + turn**2
        + (kappa * yaw.rate / 2) ** 2
        + delta * yaw.rate * turn
    )
    Jx, Jy, Jz = p.inertia
    return h * bending + (Jz * yaw.acceleration + abs(Jy - Jx) * turn**2 / 2) / levers(p)[2]


def authority(
    params: "QuadrotorParams | str", share: float = SHARE, body_rate_max: float = BODY_RATE
) -> Authority:
    """Bounds of snap, jerk and specific thrust within which no rotor leaves its range.

    Sufficient together with the bounds ``yaw_range(params)`` on the yaw motion, at every instant and attitude;
    the module's text has the proposition and its proof. ``snap_max`` is the largest that the proposition allows
    with the other numbers.

    Args:
        params: parameters or the name of a preset.
        share: part that is kept for steering of the ways from hover to the thrust floor and to full thrust, in
            (0, 1). More of it: more snap and jerk, and less acceleration up and down.
        body_rate_max: bound of √(ω_x² + ω_y²), rad/s.

    Raises:
        ValueError: for a share not in (0, 1), or one that leaves nothing to steer with beside yaw.

    Reference: equations (31), (35).
    """
    p, yaw = params_from(params), yaw_range(params)
    # In N; the ends of the band that are returned are specific thrusts.
    floor, full = p.thrust_min, p.thrust_max
    if not 0.0 < positive_number("share", share) < 1.0:
        raise ValueError(f"share must be in (0, 1), got {share!r}")
    low = share * p.gravity + (1.0 - share) * floor / p.mass
    kept = (1.0 - SLACK) * min(p.mass * low, share * (full - p.mass * p.gravity))
    free = kept - steering_thrust(low, 0.0, 0.0, yaw, p)
    if free <= 0.0:
        raise ValueError(f"share must leave thrust to steer with beside yaw, got {share!r}, {free:g} N short")
    jerk = low * min(positive_number("body_rate_max", body_rate_max), _turn_rate(TURN_SHARE * free, yaw, p))
    snap = low * (kept - steering_thrust(low, 0.0, jerk, yaw, p)) / _inertia_terms(p)[0]
    return Authority(snap, jerk, low, _highest_thrust(snap, jerk, yaw, p), p.gravity)


def _inertia_terms(p: QuadrotorParams) -> tuple[float, float, float]:
    """H, κ and δ of the proposition."""
    lx, ly, _ = levers(p)
    Jx, Jy, Jz = p.inertia
    x, y = (Jx + Jz - Jy) / Jx, (Jy + Jz - Jx) / Jy
    return math.hypot(Jx / lx, Jy / ly), (x + y) / 2, abs(x - y) / 2


def _turn_rate(steering: float, yaw: YawRange, p: QuadrotorParams) -> float:
    """The j̄/t whose terms in D̄ are ``steering``."""
    h, _, delta = _inertia_terms(p)
    square = h + abs(p.inertia[1] - p.inertia[0]) / (2 * levers(p)[2])
    linear = h * delta * yaw.rate / 2
    return (math.sqrt(linear**2 + square * steering) - linear) / square


def _highest_thrust(snap: float, jerk: float, yaw: YawRange, p: QuadrotorParams) -> float:
    """The largest t with D̄(t) <= F − m t, m/s²; hover keeps to it, and no t beyond that one does."""
    low, high, full = p.gravity, p.specific_thrust_max, p.thrust_max
    for _ in range(60):
        middle = 0.5 * (low + high)
        room = full * (1.0 - SLACK) - p.mass * middle
        low, high = (middle, high) if steering_thrust(middle, snap, jerk, yaw, p) <= room else (low, middle)
    return low
