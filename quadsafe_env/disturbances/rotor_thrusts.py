"""Four rotors in X whose thrusts lag, each behind its own command, rising and falling with times of their own.

    T ḟ_i = c_i − f_i        T = rise where c_i > f_i, else fall

What is asked of a rotor, a_i, is mixed from the torque of the wrench and a collective p that the flight
controller integrates, p̈ = F_z. A loop that is not told has c_i = a_i. One that is told makes the two times one,
T̂ = max(rise, fall):

    c_i = f_i + σ (a_i − f_i)        σ = (1 − k̂)/(1 − k)        k = exp(−δ/T), k̂ = exp(−δ/T̂)

σ is T/T̂ for short steps δ. The held c_i turns f_i into f_i + (1 − k)(c_i − f_i) = f_i + (1 − k̂)(a_i − f_i):
at the end of every step the thrusts are exactly those of T̂ ḟ_i = a_i − f_i, and in its mean to second order
in δ. As σ ≤ 1, c_i lies between f_i and a_i: a rotor is at a stop only where one with the lag T̂ would be.

Commands are kept to [0, thrust_max/4], and p to what brings all four to an end of that. Thrust and thrust rate
of the state are those that the rotors give. A rotor at a stop gives less than a loop that is told counts on;
that loop then takes what is given from the thrusts, and carries on from there. With rise = fall, and within
the range, it is a lag of the wrench.
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
    """Levers (l_x, l_y, c), m; the most that a rotor gives, N; numbers of a thrust that rises, and falls; T̂, s.

    They are k, μ, T in s, and 1 − σ of a step and of an instant, both 0 for a loop that is not told.
    """

    lever: tuple[float, float, float]
    high: float
    rise: tuple[float, float, float, float, float]
    fall: tuple[float, float, float, float, float]
    lag: float


# Places in ``rise`` and ``fall``.
IN_A_STEP, AT_ONCE = 3, 4


@inline_kernel
def thrust_after(before, command, rise, fall):
    """Thrust of a rotor at the end of a step, and in its mean."""
    kept, mean, _, _, _ = rise if command > before else fall
    return command + kept * (before - command), command + mean * (before - command)


@inline_kernel
def thrust_rate(now, command, rise, fall):
    """Rate of a rotor's thrust."""
    return (command - now) / (rise[2] if command > now else fall[2])


@inline_kernel
def command_of(now, asked, rise, fall, place):
    """The command of a rotor of which a thrust is asked, before it is kept to its range."""
    return asked + (rise[place] if asked > now else fall[place]) * (now - asked)


@inline_kernel
def commands_for(asked, f, slow, place):
    """Commands of the four rotors, and whether one is at a stop."""
    _, high, rise, fall, _ = slow
    a, b, c, d = asked
    a, b = command_of(f[0], a, rise, fall, place), command_of(f[1], b, rise, fall, place)
    c, d = command_of(f[2], c, rise, fall, place), command_of(f[3], d, rise, fall, place)
    return within_range((a, b, c, d), 0.0, high)


@inline_kernel
def begin_thrusts(s, slow, m):
    """Let the rotors of a row, if they lag, give the thrust of its state, at its rate, and no torque."""
    if slow is None:
        return
    _, _, rise, fall, _ = slow
    thrust, rate = s[THRUST], s[THRUST_RATE]
    m["thrusts"][:] = 0.25 * thrust
    T, _, back = (rise if rate > 0.0 else fall)[2:5]
    asked = m["collective"]
    asked[0], asked[1] = thrust + T / (1.0 - back) * rate, rate


@inline_kernel
def asked_thrusts(thrust, wrench, slow, dt, m):
    """What is asked of the rotors in the middle of a step and at its end; p moves on."""
    lever, high, rise, fall, _ = slow
    asked = m["collective"]
    p, rate = asked[0], asked[1]
    middle, later = p + 0.5 * dt * (rate + 0.25 * dt * wrench[0]), p + dt * (rate + 0.5 * dt * wrench[0])
    # Where the commands of all four would be at an end.
    least = thrust - thrust / (1.0 - fall[AT_ONCE])
    most = thrust + (4.0 * high - thrust) / (1.0 - rise[AT_ONCE])
    asked[0], rate = within(later, least, most), rate + dt * wrench[0]
    asked[1] = rate if asked[0] == later else 0.0
    return mixed(middle, wrench[1:4], lever), mixed(asked[0], wrench[1:4], lever)


@inline_kernel
def believe(s, slow, m):
    """Let a loop that is told take the wrench that it believes in from the thrusts and a state after a step."""
    lever, _, _, _, lag = slow
    believed, f = m["believed"], m["thrusts"]
    _, torque = collected((f[0], f[1], f[2], f[3]), lever)
    believed[0] = (m["collective"][1] - s[THRUST_RATE]) / lag
    believed[1], believed[2], believed[3] = torque


@inline_kernel
def rotor_step(s, wrench, params, rotors, slow, dt, m):
    """A physics step of a row, and whether a rotor was at a stop: ``limited_step``, or with rotors that lag.

    ``slow`` are the fields of ``SlowRotors``, or None; these have limits whatever ``rotors`` are.
    """
    if slow is None:
        return limited_step(s, wrench, params, rotors, dt)
    lever, _, rise, fall, _ = slow
    f = m["thrusts"]
    middle, last = asked_thrusts(s[THRUST], wrench, slow, dt, m)
    (a, b, c, d), is_clipped = commands_for(middle, f, slow, IN_A_STEP)
    a, b = thrust_after(f[0], a, rise, fall), thrust_after(f[1], b, rise, fall)
    c, d = thrust_after(f[2], c, rise, fall), thrust_after(f[3], d, rise, fall)
    f[0], f[1], f[2], f[3] = a[0], b[0], c[0], d[0]
    thrust, torque = collected((a[1], b[1], c[1], d[1]), lever)
    after = rk4_step((*s[0:THRUST], thrust, 0.0), (0.0, *torque), params, dt)
    # The commands of the end: the state's jerk is that of the end too.
    (a, b, c, d), _ = commands_for(last, f, slow, AT_ONCE)
    rate = thrust_rate(f[0], a, rise, fall) + thrust_rate(f[1], b, rise, fall)
    rate += thrust_rate(f[2], c, rise, fall) + thrust_rate(f[3], d, rise, fall)
    later = (*after[0:THRUST], f[0] + f[1] + f[2] + f[3], rate)
    if is_clipped:
        believe(later, slow, m)
    return later, is_clipped


def slow_rotors(
    params: QuadrotorParams, rise: float, fall: float, dt: float, is_told: bool = False
) -> SlowRotors:
    """Rotors with these time constants, s, steps of ``dt``, and a loop that is told of them, or not."""
    lag = max(rise, fall)
    new = 1.0 - lag_of_step(lag, dt)[0]

    def one_way(T: float) -> tuple[float, float, float, float, float]:
        kept, mean = lag_of_step(T, dt)
        return (
            (kept, mean, T, 1.0 - new / (1.0 - kept), 1.0 - T / lag) if is_told else (kept, mean, T, 0.0, 0.0)
        )

    return SlowRotors(levers(params), params.thrust_max / 4.0, one_way(rise), one_way(fall), lag)
