"""The inner loop: the wrench that is held over a physics step so that the body flies a held snap.

Along the flight under a held wrench the snap s moves at the rate κ = ṡ, the crackle. With the specific thrust
t, ζ = ż_B and α = z̈_B across the thrust, in body axes, and ω̇ from (35) for the snap u,

    κ_⊥ = 3 ẗ ζ + 3 ṫ α + t (γ − |ζ|² ζ)       κ_z = −3 ṫ |ζ|² − 3 t ζ·α       ẗ = u_z + t |ζ|²
    γ_x = (J_y + J_z − J_x)/J_y (ω̇_z ω_x + ω_z ω̇_x) − ω_z α_y
    γ_y = (J_x + J_z − J_y)/J_x (ω̇_z ω_y + ω_z ω̇_y) + ω_z α_x

The wrench is that of the snap u − κ δ/2 at the start of the step δ: half a step earlier on the same slope, so
the mean over the step is u but for terms of second order in δ. ``inner_loop_error`` bounds what is left.

Rotors that lag, T ẇ = u_w − w, let the snap lag with a disturbance: m s = B(x) w + c(x), so for the wrench u_w
of a snap u

    T ṡ = u − s + T η        η = (Ḃ w + ċ)/m, which is the crackle κ under a held w

A loop that knows T asks for the snap u − θκ. In the mean of a step the rotors give the share μ of what they
gave before it and 1 − μ of what is asked, so θ = δ/(2 (1 − μ)) leaves the mean snap μ s + (1 − μ) u of the
chain alone, to second order in δ. θ is T for δ ≪ T, and δ/2, the lead above, for T ≪ δ.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fma
from quadsafe_env.vehicle.flatness import body_snap_from_wrench, wrench_from_body_snap
from quadsafe_env.vehicle.rigid_body import angular_acceleration
from quadsafe_env.vehicle.state import THRUST, THRUST_RATE, omega_of, to_body


@inline_kernel
def crackle(s, snap, yaw_acceleration, params):
    """κ in body axes under the held wrench that gives a snap, in body axes, and ω̇_z; also ω̇_x and ω̇_y."""
    x, y, z = omega_of(s)
    Jx, Jy, Jz = params.inertia
    per_mass = 1.0 / params.mass
    t, rate = s[THRUST] * per_mass, s[THRUST_RATE] * per_mass
    # Written out so that interpreted and compiled code agree at the singularity.
    per_thrust = 1.0 / t if t != 0.0 else math.nan
    ax, ay = fma(-2.0 * rate, y, snap[0]) * per_thrust, fma(2.0 * rate, x, snap[1]) * per_thrust
    wx, wy = fma(y, z, -ay), fma(-x, z, ax)
    turn = fma(x, x, y * y)
    bend = fma(t, turn, snap[2])
    gx = fma((Jy + Jz - Jx) / Jy, fma(yaw_acceleration, x, z * wx), -(z * ay))
    gy = fma((Jx + Jz - Jy) / Jx, fma(yaw_acceleration, y, z * wy), z * ax)
    across = fma(y, ax, -(x * ay))
    return (
        fma(3.0, fma(bend, y, rate * ax), t * fma(-turn, y, gx)),
        fma(3.0, fma(-bend, x, rate * ay), t * fma(turn, x, gy)),
        -3.0 * fma(rate, turn, t * across),
    ), (wx, wy)


@inline_kernel
def held_wrench(s, snap, yaw_acceleration, params, dt):
    """The wrench that, held over a step, gives snap and ω̇_z in the mean to second order in dt."""
    u, half = to_body(s, snap), -0.5 * dt
    k, (wx, wy) = crackle(s, u, yaw_acceleration, params)
    earlier = (fma(half, k[0], u[0]), fma(half, k[1], u[1]), fma(half, k[2], u[2]))
    # ω_x ω_y as it is at the middle of the step turns the body about the thrust if J_x ≠ J_y.
    x, y, _ = omega_of(s)
    x, y = fma(-half, wx, x), fma(-half, wy, y)
    return wrench_from_body_snap(s, earlier, yaw_acceleration, x * y, params)


@inline_kernel
def coasted(s, wrench, params, t):
    """The state with its thrust and body rates as they are a time t later, to first order."""
    x, y, z = omega_of(s)
    wx, wy, wz = angular_acceleration((x, y, z), wrench[1:4], params)
    thrust, rate = fma(t, s[THRUST_RATE], s[THRUST]), fma(t, wrench[0], s[THRUST_RATE])
    return (*s[0:15], fma(t, wx, x), fma(t, wy, y), fma(t, wz, z), thrust, rate)


@inline_kernel
def leading_wrench(s, snap, yaw_acceleration, given, lag, params):
    """The wrench to ask of rotors that lag, so that snap and ω̇_z lag behind what is wanted and do no more.

    ``given`` is the wrench that the rotors give now, ``lag`` the share μ, the lead θ, s, and half a step, s.
    """
    mean, lead, half = lag
    u = to_body(s, snap)
    now, turn = body_snap_from_wrench(s, given, params)
    met = (fma(mean, now[0] - u[0], u[0]), fma(mean, now[1] - u[1], u[1]), fma(mean, now[2] - u[2], u[2]))
    # The rotors lag for so long that what κ changes by in half a step counts.
    middle = coasted(s, given, params, half)
    k, (wx, wy) = crackle(middle, met, fma(mean, turn - yaw_acceleration, yaw_acceleration), params)
    earlier = (fma(-lead, k[0], u[0]), fma(-lead, k[1], u[1]), fma(-lead, k[2], u[2]))
    x, y, _ = omega_of(s)
    product = fma(x, y, lead * fma(wx, y, x * wy))
    return wrench_from_body_snap(s, earlier, yaw_acceleration, product, params)
