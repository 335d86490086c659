"""Four rotors in X whose thrusts lag, each behind its own command, rising and falling with times of their own.

    T ḟ_i = c_i − f_i        T = rise where c_i > f_i, else fall

The commands are mixed from the torque of the wrench and a collective p that the flight controller integrates,
p̈ = F_z, and each is kept to [0, thrust_max/4]; p stops at the ends of four of these. Thrust and thrust rate of
the state are those that the rotors give. With rise = fall, and within the range, it is a lag of the wrench.
"""

from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_env.disturbances.rotor_lag import lag_of_step
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.rotors import collected, levers, limited_step, mixed, within_range
from quadsafe_env.vehicle.state import THRUST, THRUST_RATE
from quadsafe_env.vehicle.yaw import within


class SlowRotors(NamedTuple):
    """Levers (l_x, l_y, c), m; the most that a rotor gives, N; k, μ and T, s, of a step, rising and falling."""

    lever: tuple[float, float, float]
    high: float
    rise: tuple[float, float, float]
    fall: tuple[float, float, float]


@inline_kernel
def thrust_after(before, command, rise, fall):
    """Thrust of a rotor at the end of a step, and in its mean."""
    kept, mean, _ = rise if command > before else fall
    return command + kept * (before - command), command + mean * (before - command)


@inline_kernel
def thrust_rate(now, command, rise, fall):
    """Rate of a rotor's thrust."""
    return (command - now) / (rise[2] if command > now else fall[2])


@inline_kernel
def begin_thrusts(s, slow, m):
    """Let the rotors of a row, if they lag, give the thrust of its state, at its rate, and no torque."""
    if slow is None:
        return
    _, _, rise, fall = slow
    thrust, rate = s[THRUST], s[THRUST_RATE]
    m["thrusts"][:] = 0.25 * thrust
    asked = m["collective"]
    asked[0], asked[1] = thrust + (rise[2] if rate > 0.0 else fall[2]) * rate, rate


@inline_kernel
def commands_of(wrench, slow, dt, m):
    """Commands of the rotors in the middle of a step and at its end, whether one is at a stop; p moves on."""
    lever, high, _, _ = slow
    asked = m["collective"]
    p, rate = asked[0], asked[1]
    middle, later = p + 0.5 * dt * (rate + 0.25 * dt * wrench[0]), p + dt * (rate + 0.5 * dt * wrench[0])
    asked[0], rate = within(later, 0.0, 4.0 * high), rate + dt * wrench[0]
    asked[1] = rate if asked[0] == later else 0.0
    commands, is_clipped = within_range(mixed(middle, wrench[1:4], lever), 0.0, high)
    return commands, within_range(mixed(asked[0], wrench[1:4], lever), 0.0, high)[0], is_clipped


@inline_kernel
def rotor_step(s, wrench, params, rotors, slow, dt, m):
    """A physics step of a row, and whether a rotor was at a stop: ``limited_step``, or with rotors that lag.

    ``slow`` are the fields of ``SlowRotors``, or None; these have limits whatever ``rotors`` are.
    """
    if slow is None:
        return limited_step(s, wrench, params, rotors, dt)
    lever, _, rise, fall = slow
    (a, b, c, d), last, is_clipped = commands_of(wrench, slow, dt, m)
    f = m["thrusts"]
    a, b = thrust_after(f[0], a, rise, fall), thrust_after(f[1], b, rise, fall)
    c, d = thrust_after(f[2], c, rise, fall), thrust_after(f[3], d, rise, fall)
    f[0], f[1], f[2], f[3] = a[0], b[0], c[0], d[0]
    thrust, torque = collected((a[1], b[1], c[1], d[1]), lever)
    after = rk4_step((*s[0:THRUST], thrust, 0.0), (0.0, *torque), params, dt)
    # The commands of the end: the state's jerk is that of the end too.
    rate = thrust_rate(f[0], last[0], rise, fall) + thrust_rate(f[1], last[1], rise, fall)
    rate += thrust_rate(f[2], last[2], rise, fall) + thrust_rate(f[3], last[3], rise, fall)
    return (*after[0:THRUST], f[0] + f[1] + f[2] + f[3], rate), is_clipped


def slow_rotors(params: QuadrotorParams, rise: float, fall: float, dt: float) -> SlowRotors:
    """Rotors with these time constants, s, and steps of ``dt``."""
    (kept_up, mean_up), (kept_down, mean_down) = lag_of_step(rise, dt), lag_of_step(fall, dt)
    high = params.thrust_max / 4.0
    return SlowRotors(levers(params), high, (kept_up, mean_up, rise), (kept_down, mean_down, fall))
