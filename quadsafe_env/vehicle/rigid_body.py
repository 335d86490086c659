"""The kernels of the rigid body of equation (29), and of its Runge–Kutta step.

m r̈ = −m g e3 + f_z Q e3        Q̇ = Q ω̂
J ω̇ = −ω̂ J ω + τ                f̈_z = F_z
"""

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fma, fused_dot
from quadsafe_env.vehicle.state import THRUST, THRUST_RATE, body_z, omega_of


@inline_kernel
def angular_acceleration(omega, torque, params):
    """(29): ``ω̇ = J⁻¹(τ − ω × Jω)``."""
    Jx, Jy, Jz = params.inertia
    x, y, z = omega
    return (
        fma((Jy - Jz) / Jx, y * z, torque[0] * (1.0 / Jx)),
        fma((Jz - Jx) / Jy, z * x, torque[1] * (1.0 / Jy)),
        fma((Jx - Jy) / Jz, x * y, torque[2] * (1.0 / Jz)),
    )


@inline_kernel
def acceleration(s, params):
    """(29): ``r̈ = f_z Q e3 / m − g e3``."""
    return lifted(s[THRUST], body_z(s), params)


@inline_kernel
def lifted(thrust, z, params):
    """``acceleration`` of a body with its z axis along ``z``."""
    lift = thrust * (1.0 / params.mass)
    return (lift * z[0], lift * z[1], fma(lift, z[2], -params.gravity))


@inline_kernel
def row_rate(a, b, c, omega):
    """A row (a, b, c) of ``Q ω̂``."""
    x, y, z = omega
    return (fma(b, z, -(c * y)), fma(c, x, -(a * z)), fma(a, y, -(b * x)))


@inline_kernel
def derivative_kernel(s, wrench, params):
    """(29): time derivative of the state tuple under the wrench (F_z, τ_x, τ_y, τ_z)."""
    omega = omega_of(s)
    return (
        *s[3:6],
        *acceleration(s, params),
        *row_rate(s[6], s[7], s[8], omega),
        *row_rate(s[9], s[10], s[11], omega),
        *row_rate(s[12], s[13], s[14], omega),
        *angular_acceleration(omega, wrench[1:4], params),
        s[THRUST_RATE],
        wrench[0],
    )


@inline_kernel
def times_symmetric(a, b, c, diagonal, off):
    """Row (a, b, c) times the symmetric matrix with this diagonal and off-diagonal (xy, yz, zx)."""
    row = (a, b, c)
    return (
        fused_dot(row, (diagonal[0], off[0], off[2])),
        fused_dot(row, (off[0], diagonal[1], off[1])),
        fused_dot(row, (off[2], off[1], diagonal[2])),
    )


@inline_kernel
def orthonormal(s):
    """One Newton–Schulz correction ``Q ← Q(3I − QᵀQ)/2``: an error ε of QᵀQ becomes about 3ε²/4."""
    x, y, z = (s[6], s[9], s[12]), (s[7], s[10], s[13]), (s[8], s[11], s[14])
    diagonal = (
        fma(-0.5, fused_dot(x, x), 1.5),
        fma(-0.5, fused_dot(y, y), 1.5),
        fma(-0.5, fused_dot(z, z), 1.5),
    )
    off = (-0.5 * fused_dot(x, y), -0.5 * fused_dot(y, z), -0.5 * fused_dot(z, x))
    return (
        *s[0:6],
        *times_symmetric(s[6], s[7], s[8], diagonal, off),
        *times_symmetric(s[9], s[10], s[11], diagonal, off),
        *times_symmetric(s[12], s[13], s[14], diagonal, off),
        *s[15:20],
    )


@inline_kernel
def stages(x, k, dt):
    """A number at the four stages of a Runge–Kutta step, from its rates at the first three."""
    return (x, fma(0.5 * dt, k[0], x), fma(0.5 * dt, k[1], x), fma(dt, k[2], x))


@inline_kernel
def advanced(x, k, dt):
    """A number after a Runge–Kutta step, from its rates at the four stages."""
    return fma(dt / 6.0, fma(2.0, k[1], fma(2.0, k[2], k[3] + k[0])), x)


@inline_kernel
def shifted(x, h, k):
    """``x + h k`` of triples."""
    return (fma(h, k[0], x[0]), fma(h, k[1], x[1]), fma(h, k[2], x[2]))


@inline_kernel
def advanced_triple(x, k1, k2, k3, k4, dt):
    """``advanced`` of triples."""
    return (
        advanced(x[0], (k1[0], k2[0], k3[0], k4[0]), dt),
        advanced(x[1], (k1[1], k2[1], k3[1], k4[1]), dt),
        advanced(x[2], (k1[2], k2[2], k3[2], k4[2]), dt),
    )


@inline_kernel
def spun(omega, torque, params, dt):
    """The angular velocity at the four stages, and after them."""
    k1 = angular_acceleration(omega, torque, params)
    second = shifted(omega, 0.5 * dt, k1)
    k2 = angular_acceleration(second, torque, params)
    third = shifted(omega, 0.5 * dt, k2)
    k3 = angular_acceleration(third, torque, params)
    fourth = shifted(omega, dt, k3)
    k4 = angular_acceleration(fourth, torque, params)
    return (omega, second, third, fourth), advanced_triple(omega, k1, k2, k3, k4, dt)


@inline_kernel
def turned(row, spins, dt):
    """Entry z of a row of Q at the four stages, and the row after them."""
    k1 = row_rate(row[0], row[1], row[2], spins[0])
    second = shifted(row, 0.5 * dt, k1)
    k2 = row_rate(second[0], second[1], second[2], spins[1])
    third = shifted(row, 0.5 * dt, k2)
    k3 = row_rate(third[0], third[1], third[2], spins[2])
    fourth = shifted(row, dt, k3)
    k4 = row_rate(fourth[0], fourth[1], fourth[2], spins[3])
    return (row[2], second[2], third[2], fourth[2]), advanced_triple(row, k1, k2, k3, k4, dt)


@inline_kernel
def rk4_step(s, wrench, params, dt):
    """One classical Runge–Kutta step of (29) with the wrench held, the attitude put back on SO(3).

    Part by part, each from the stages of those that it depends on: there are registers for a few of them only.
    """
    spins, omega = spun(omega_of(s), wrench[1:4], params, dt)
    F = (wrench[0], wrench[0], wrench[0], wrench[0])
    pulls = stages(s[THRUST_RATE], F, dt)
    f = stages(s[THRUST], pulls, dt)
    x, row_x = turned(s[6:9], spins, dt)
    y, row_y = turned(s[9:12], spins, dt)
    z, row_z = turned(s[12:15], spins, dt)
    a1, a2 = lifted(f[0], (x[0], y[0], z[0]), params), lifted(f[1], (x[1], y[1], z[1]), params)
    a3, a4 = lifted(f[2], (x[2], y[2], z[2]), params), lifted(f[3], (x[3], y[3], z[3]), params)
    v = s[3:6]
    v2, v3, v4 = shifted(v, 0.5 * dt, a1), shifted(v, 0.5 * dt, a2), shifted(v, dt, a3)
    return orthonormal(
        (
            *advanced_triple(s[0:3], v, v2, v3, v4, dt),
            *advanced_triple(v, a1, a2, a3, a4, dt),
            *row_x,
            *row_y,
            *row_z,
            *omega,
            advanced(s[THRUST], pulls, dt),
            advanced(s[THRUST_RATE], F, dt),
        )
    )
