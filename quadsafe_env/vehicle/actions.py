"""Action interfaces: what a policy commands, and the desired snap and yaw acceleration it becomes.

Every interface maps an action in [−1, 1]⁴ linearly to a command in SI units, and turns the command into a
desired snap (world frame) and yaw acceleration (body z axis) once per control period:

| name       | command                                                  | desired                            |
|------------|----------------------------------------------------------|------------------------------------|
| "velocity" | velocity (3), world frame, m/s; yaw rate, rad/s          | sampled state feedback on (v, a, j)|
| "snap"     | snap (3), world frame, m/s⁴; yaw acceleration, rad/s²    | the command itself                 |
| "wrench"   | F_z, N/s²; torque (3), body frame, N·m, both from hover  | equation (31) at the measured state|
| "rates"    | specific thrust beyond g, m/s²; ω (3), body frame, rad/s | feedback on thrust and ω           |
| "attitude" | specific thrust beyond g, m/s²; roll, pitch, rad; ω_z    | feedback on thrust and tilt        |

The last two command motion of the body, with specific thrust t = f_z/m and, seen from the body, up n = Qᵀe3:

    ẗ    = −k_t (t − g − t_cmd) − k_ṫ ṫ                        "rates" and "attitude"
    ω̇_xy = k_ω (ω_cmd − ω)_xy                                  "rates"
    ω̇_xy = k_n (n_cmd × n)_xy − k_ṅ (ω − ω_z n_cmd/n_cmd,z)_xy   "attitude"
    n_cmd = (−sin θ, sin φ cos θ, cos φ cos θ)                 roll φ, pitch θ

n is the third row of Q, so roll and pitch need no yaw angle: ṅ = n × ω, hence with ω = k (n_cmd × n) the
product n·n_cmd grows, to 1 from any attitude but the opposite one, and n rests at n_cmd if ω is along it: the
last term. Equation (31) makes of (ẗ, ω̇) the snap s. As ω turns the body under a snap that is held in the
world, the desired one is that of the middle of the period Δ: s + κΔ/2, with the crackle κ of
``quadsafe_env.vehicle.inner_loop``.
"""

import math
from typing import NamedTuple

from quadsafe_core.checks import one_of
from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fma
from quadsafe_core.maths.feedback import held_gains
from quadsafe_env.vehicle.flatness import flat_from_state, snap_from_wrench_kernel, yaw_acceleration_kernel
from quadsafe_env.vehicle.inner_loop import crackle
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import OMEGA, THRUST, THRUST_RATE, omega_of, to_world, up_of

SPEED = 2.0  # m/s per axis at full action
YAW_RATE = 2.0  # rad/s at full action
SNAP = 200.0  # m/s⁴ per axis at full action
YAW_ACCELERATION = 10.0  # rad/s² at full action
# Triple pole of the velocity loop. With commands within ±2 m/s the acceleration stays below 6.5 m/s²,
# the L1 norm of the loop's response, so the thrust never falls to its floor.
VELOCITY_POLE = 6.0  # rad/s
YAW_RATE_POLE = 10.0  # rad/s
BODY_RATE = 6.0  # rad/s about x and y at full action
TILT = math.pi / 6.0  # roll and pitch at full action
# Part of the shorter way from hover to the thrust floor and to full thrust at full action: the rest is left to
# steer with.
THRUST_SHARE = 0.5
# Simple pole of the body rates, double poles of tilt and thrust: as fast as small vehicles' inner loops.
BODY_RATE_POLE, TILT_POLE, THRUST_POLE = 20.0, 10.0, 20.0  # rad/s


class VelocityGains(NamedTuple):
    """Feedback gains of the velocity interface, for one control period: k_v, k_a, k_j and k_ψ."""

    velocity: float
    acceleration: float
    jerk: float
    yaw_rate: float


class BodyGains(NamedTuple):
    """Feedback gains of body rates, tilt (k_n, k_ṅ) and thrust (k_t, k_ṫ), and half of the period, s."""

    rate: float
    tilt: float
    tilt_rate: float
    thrust: float
    thrust_rate: float
    half_period: float


class Gains(NamedTuple):
    """Feedback gains of the interfaces, for one control period."""

    velocity: VelocityGains
    body: BodyGains


@inline_kernel
def velocity_law(s, command, params, gains):
    """Snap ``−k_v (v − v_cmd) − k_a a − k_j j`` and yaw acceleration ``k_ψ (rate_cmd − ω_z)``."""
    k = gains.velocity
    _, v, a, j = flat_from_state(s, params)
    return (
        velocity_feedback(v[0] - command[0], a[0], j[0], k),
        velocity_feedback(v[1] - command[1], a[1], j[1], k),
        velocity_feedback(v[2] - command[2], a[2], j[2], k),
        k.yaw_rate * (command[3] - s[OMEGA + 2]),
    )


@inline_kernel
def velocity_feedback(error, acceleration, jerk, k):
    """``−k_v (v − v_cmd) − k_a a − k_j j`` along one axis."""
    return -fma(k.velocity, error, fma(k.acceleration, acceleration, k.jerk * jerk))


@inline_kernel
def snap_law(s, command, params, gains):
    """The command is the desired snap and yaw acceleration."""
    return command


@inline_kernel
def wrench_law(s, command, params, gains):
    """Equation (31): snap and yaw acceleration that the commanded wrench gives at the measured state."""
    snap = snap_from_wrench_kernel(s, command, params)
    return (*snap, yaw_acceleration_kernel(s, command, params))


@inline_kernel
def rates_law(s, command, params, gains):
    """Motion with ``ω̇_xy = k_ω (ω_cmd − ω)_xy``."""
    x, y, z = omega_of(s)
    k = gains.body.rate
    spin = (k * (command[1] - x), k * (command[2] - y), gains.velocity.yaw_rate * (command[3] - z))
    return motion_wish(s, command[0], spin, params, gains.body)


@inline_kernel
def attitude_law(s, command, params, gains):
    """Motion with ``ω̇_xy = k_n (n_cmd × n)_xy − k_ṅ (ω − ω_z n_cmd/n_cmd,z)_xy``."""
    x, y, z = omega_of(s)
    k, n = gains.body, up_of(s)
    level = math.cos(command[2])
    to_x, to_y, to_z = -math.sin(command[2]), math.sin(command[1]) * level, math.cos(command[1]) * level
    turn, per_z = (fma(to_y, n[2], -(to_z * n[1])), fma(to_z, n[0], -(to_x * n[2]))), z / to_z
    spin_x = fma(k.tilt, turn[0], -(k.tilt_rate * fma(-per_z, to_x, x)))
    spin_y = fma(k.tilt, turn[1], -(k.tilt_rate * fma(-per_z, to_y, y)))
    spin = (spin_x, spin_y, gains.velocity.yaw_rate * (command[3] - z))
    return motion_wish(s, command[0], spin, params, k)


@inline_kernel
def motion_wish(s, extra, spin, params, k):
    """(31): snap and yaw acceleration of ω̇ and of thrust that goes to g + extra, amid the period."""
    x, y, z = omega_of(s)
    t, rate = s[THRUST] / params.mass, s[THRUST_RATE] / params.mass
    lift = -fma(k.thrust, t - params.gravity - extra, k.thrust_rate * rate)
    u = (
        fma(2.0 * rate, y, t * fma(x, z, spin[1])),
        fma(-2.0 * rate, x, t * fma(y, z, -spin[0])),
        fma(-t, fma(x, x, y * y), lift),
    )
    moved, _ = crackle(s, u, spin[2], params)
    half = k.half_period
    held = (fma(half, moved[0], u[0]), fma(half, moved[1], u[1]), fma(half, moved[2], u[2]))
    return (*to_world(s, held), spin[2])


INTERFACES = ("velocity", "snap", "wrench", "rates", "attitude")


def action_scale(name: str, params: QuadrotorParams) -> tuple[float, float, float, float]:
    """SI value of an action of 1; the full wrench gives the snap interface's full snap at hover.

    Raises:
        ValueError: for an unknown name of an interface.
    """
    tilt = SNAP / params.gravity
    ways = (params.gravity - params.specific_thrust_min, params.specific_thrust_max - params.gravity)
    thrust = THRUST_SHARE * min(ways)
    Jx, Jy, Jz = params.inertia
    return {
        "velocity": (SPEED, SPEED, SPEED, YAW_RATE),
        "snap": (SNAP, SNAP, SNAP, YAW_ACCELERATION),
        "wrench": (params.mass * SNAP, Jx * tilt, Jy * tilt, Jz * YAW_ACCELERATION),
        "rates": (thrust, BODY_RATE, BODY_RATE, YAW_RATE),
        "attitude": (thrust, TILT, TILT, YAW_RATE),
    }[one_of("action", name, INTERFACES)]


def velocity_gains(period: float) -> VelocityGains:
    """Gains of the velocity interface for a control period, s."""
    k = held_gains(3, VELOCITY_POLE, period).tolist()
    return VelocityGains(*k, *held_gains(1, YAW_RATE_POLE, period).tolist())


def gains_at(period: float) -> Gains:
    """Gains of every interface for a control period, s."""
    (rate,) = held_gains(1, BODY_RATE_POLE, period).tolist()
    tilt, tilt_rate = held_gains(2, TILT_POLE, period).tolist()
    thrust, thrust_rate = held_gains(2, THRUST_POLE, period).tolist()
    body = BodyGains(rate, tilt, tilt_rate, thrust, thrust_rate, 0.5 * period)
    return Gains(velocity_gains(period), body)
