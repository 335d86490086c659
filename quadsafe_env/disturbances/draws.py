"""What conditions draw and remember: errors of the estimate, lost answers, the delay line, the air.

Every draw is a hash of the scene's integer, and of the number of control periods flown where it is not one of
the whole episode. So nothing random is remembered, and a scene flown again is the same flight.

In kernels ``d`` is a ``Disturbance`` and ``m`` the record of a row, of the dtype ``WEATHER``.
"""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_core.kernels.vec3 import add, norm, scale, vector, write3
from quadsafe_core.maths.counter_rng import Key, derived_key, uniform
from quadsafe_env.disturbances.disturbance import GUST_LENGTH, GUST_PERIOD, Disturbance
from quadsafe_env.disturbances.rotor_lag import lag_of_step
from quadsafe_env.tasks.conditions import TURBULENCE_LIMIT
from quadsafe_env.vehicle.actions import velocity_feedback

# Far beyond the counters of the scene and of the later episodes.
STREAM = 1 << 30
# Counters of the episode's draws; a bias takes two, a triple of normal numbers four, a gust three.
BIAS, WIND, GAIN, MASS, INERTIA, CALM, LAG, GUSTS = 0, 8, 10, 11, 12, 13, 17, 32
# Counters of a control period's draws, of which there are at most this many; an error takes three.
PER_PERIOD = 32
ERROR, LOSS, JITTER, IMPULSE, WHITE = 0, 12, 13, 14, 17

# Physics steps; longer than any flight.
LONG_AGO = 2**62
# What each of N rows remembers of its conditions: an array of records, (N,).
#
# | field      | of a row | meaning                                                                 |
# |------------|----------|-------------------------------------------------------------------------|
# | keys       | 4        | keys of the draws of the episode and of its periods, two words each     |
# | bias       | 4 × 3    | constant errors of the flat state, m, m/s, m/s², m/s³                   |
# | wind       | 3        | constant acceleration, m/s²                                             |
# | gain       |          | snap flown over snap answered                                           |
# | mass       |          | true over believed mass                                                 |
# | inertia    |          | true over believed moments of inertia                                   |
# | lag        | 2        | of what a physics step begins with, the shares at its end and in its    |
# |            |          | mean that rotors still give                                             |
# | periods    |          | control periods flown in the episode                                    |
# | steps      |          | physics steps flown in the episode                                      |
# | lasted     |          | physics steps of the last control period                                |
# | pushed     |          | physics steps flown in the episode when the last impulse came           |
# | turbulence | 3        | the Gauss–Markov noise, before its limit, m/s²                          |
# | wrench     | 4        | the lagged wrench, N/s² and N m                                         |
# | believed   | 4        | the lagged wrench as an inner loop that is told of the lag counts it    |
# | thrusts    | 4        | of the rotors that lag one by one, N                                    |
# | collective | 2        | thrust, N, and its rate, N/s, that these are asked for together         |
# | through    | 4        | snap, m/s⁴, and yaw acceleration, rad/s², that got through last         |
# | flown      | 4        | snap and yaw acceleration that are flown in this period                 |
WEATHER = np.dtype(
    [
        ("keys", np.int64, 4),
        ("bias", np.float64, (4, 3)),
        ("wind", np.float64, 3),
        ("gain", np.float64),
        ("mass", np.float64),
        ("inertia", np.float64),
        ("lag", np.float64, 2),
        ("periods", np.int64),
        ("steps", np.int64),
        ("lasted", np.int64),
        ("pushed", np.int64),
        ("turbulence", np.float64, 3),
        ("wrench", np.float64, 4),
        ("believed", np.float64, 4),
        ("thrusts", np.float64, 4),
        ("collective", np.float64, 2),
        ("through", np.float64, 4),
        ("flown", np.float64, 4),
    ]
)


@inline_kernel
def directed(key, counter, length):
    """A vector of this length, its direction uniform; two draws."""
    if length == 0.0:
        return (0.0, 0.0, 0.0)
    z, turn = uniform(key, counter, -1.0, 1.0), uniform(key, counter + 1, -math.pi, math.pi)
    level = length * math.sqrt(1.0 - z * z)
    return (level * math.cos(turn), level * math.sin(turn), length * z)


@inline_kernel
def in_ball(key, counter, radius):
    """A vector uniform in the ball of this radius; three draws."""
    if radius == 0.0:
        return (0.0, 0.0, 0.0)
    return directed(key, counter, radius * uniform(key, counter + 2, 0.0, 1.0) ** (1.0 / 3.0))


@inline_kernel
def normal_triple(key, counter, deviation):
    """Three independent normal numbers, after Box and Muller; four draws."""
    if deviation == 0.0:
        return (0.0, 0.0, 0.0)
    a = deviation * math.sqrt(-2.0 * math.log(1.0 - uniform(key, counter, 0.0, 1.0)))
    b = deviation * math.sqrt(-2.0 * math.log(1.0 - uniform(key, counter + 1, 0.0, 1.0)))
    turn, other = uniform(key, counter + 2, -math.pi, math.pi), uniform(key, counter + 3, -math.pi, math.pi)
    return (a * math.cos(turn), a * math.sin(turn), b * math.cos(other))


@inline_kernel
def episode_key(m):
    """Key of the draws of a row that hold for the episode."""
    return Key(m["keys"][0], m["keys"][1])


@inline_kernel
def period_key(m):
    """Key of the draws of a row in its control periods; where those of the present one begin."""
    return Key(m["keys"][2], m["keys"][3]), PER_PERIOD * m["periods"]


@inline_kernel
def error_of(order, d, m):
    """The present error of the estimate of a derivative of the position of a row: noise plus bias."""
    key, n = period_key(m)
    return add(in_ball(key, n + ERROR + 3 * order, d.noise[order]), vector(m["bias"][order]))


@inline_kernel
def gust_of(time, d, m):
    """Acceleration of the gust of a row at a time of the episode, s: (1 − cos)/2 over its length."""
    window = math.floor(time / GUST_PERIOD)
    key, n = episode_key(m), GUSTS + 3 * window
    begin = window * GUST_PERIOD + uniform(key, n, 0.0, GUST_PERIOD - GUST_LENGTH)
    phase = (time - begin) / GUST_LENGTH
    if d.gust == 0.0 or phase <= 0.0 or phase >= 1.0:
        return (0.0, 0.0, 0.0)
    return directed(key, n + 1, 0.5 * d.gust * (1.0 - math.cos(2.0 * math.pi * phase)))


@inline_kernel
def air_of(time, d, m):
    """Acceleration by the air in the present period of a row, m/s², and a step of its turbulence."""
    wind = vector(m["wind"])
    if d.turbulence == 0.0:
        return add(wind, gust_of(time, d, m))
    rough = vector(m["turbulence"])
    most, (key, n) = TURBULENCE_LIMIT * d.turbulence, period_key(m)
    white = normal_triple(key, n + WHITE, d.turbulence * math.sqrt(1.0 - d.turbulence_kept**2))
    for axis in range(3):
        m["turbulence"][axis] = d.turbulence_kept * rough[axis] + white[axis]
    size = norm(rough)
    felt = scale(most / size, rough) if size > most else rough
    return add(add(wind, gust_of(time, d, m)), felt)


@kernel
def draw_rows(rows, words, numbers, weather, line):
    """Draw what holds for the episode of rows that begin one, and forget the last one.

    Here and below ``numbers`` are a ``Disturbance``, raveled; ``weather`` (N,) is of the dtype ``WEATHER``, and
    ``line`` (N, k, 4) the delay line of snaps and yaw accelerations. ``words`` are (N, 2).
    """
    d = unraveled(numbers, Disturbance)
    for i in rows:
        m, base = weather[i], derived_key(Key(words[i, 0], words[i, 1]), STREAM)
        key, later = derived_key(base, 0), derived_key(base, 1)
        keys = m["keys"]
        keys[0], keys[1], keys[2], keys[3] = key.low, key.high, later.low, later.high
        m["periods"], m["steps"], m["lasted"], m["pushed"] = 0, 0, d.substeps, -LONG_AGO
        m["wrench"][:], m["believed"][:], m["through"][:], line[i] = 0.0, 0.0, 0.0, 0.0
        for order in range(4):
            write3(m["bias"][order], directed(key, BIAS + 2 * order, d.bias[order]))
        write3(m["wind"], directed(key, WIND, d.wind))
        write3(m["turbulence"], normal_triple(key, CALM, d.turbulence))
        m["gain"] = uniform(key, GAIN, 1.0 - d.gain, 1.0 + d.gain)
        m["mass"] = uniform(key, MASS, 1.0 - d.mass_error, 1.0 + d.mass_error)
        m["inertia"] = uniform(key, INERTIA, 1.0 - d.inertia_error, 1.0 + d.inertia_error)
        lag = m["lag"]
        lag[0], lag[1] = lag_of_step(uniform(key, LAG, d.lag[0], d.lag[1]), d.dt)


@kernel
def estimate_batch(numbers, weather, gains, flat, snap):
    """Flat states (N, 4, 3) with their errors, and snaps (N, 3) of the feedback from these; a nan stays nan."""
    d = unraveled(numbers, Disturbance)
    for i in range(flat.shape[0]):
        m = weather[i]
        r, v, a, j = error_of(0, d, m), error_of(1, d, m), error_of(2, d, m), error_of(3, d, m)
        for axis in range(3):
            flat[i, 0, axis] += r[axis]
            flat[i, 1, axis] += v[axis]
            flat[i, 2, axis] += a[axis]
            flat[i, 3, axis] += j[axis]
            snap[i, axis] += velocity_feedback(v[axis], a[axis], j[axis], gains)


@kernel
def estimated_states(rows, numbers, weather, states):
    """Estimated position and velocity in place of the true ones, in the given rows of states (N, 20)."""
    d = unraveled(numbers, Disturbance)
    for i in rows:
        r, v = error_of(0, d, weather[i]), error_of(1, d, weather[i])
        for axis in range(3):
            states[i, axis] += r[axis]
            states[i, 3 + axis] += v[axis]


@kernel
def lost_batch(numbers, weather, lost):
    """Whether the answer of the present period is lost, (N,)."""
    d = unraveled(numbers, Disturbance)
    for i in range(lost.shape[0]):
        key, n = period_key(weather[i])
        lost[i] = uniform(key, n + LOSS, 0.0, 1.0) < d.loss


@kernel
def deliver_batch(weather, line, lost, snap, yaw_acceleration, backup):
    """What is flown of the answers, snaps (N, 3) and yaw accelerations (N,): past losses, delay and gain.

    In place of a lost answer stand its snap in ``backup`` (N, 3), or without any, (0, 3), the last one that got
    through, and the last yaw acceleration that did.
    """
    delay = line.shape[1]
    for i in range(snap.shape[0]):
        m = weather[i]
        through, flown, gain = m["through"], m["flown"], m["gain"]
        if not lost[i]:
            through[0], through[1], through[2] = snap[i, 0], snap[i, 1], snap[i, 2]
            through[3] = yaw_acceleration[i]
        x, y, z, turn = through[0], through[1], through[2], through[3]
        if lost[i] and backup.shape[0] > 0:
            x, y, z = backup[i, 0], backup[i, 1], backup[i, 2]
        if delay > 0:
            place = line[i, m["periods"] % delay]
            (x, place[0]), (y, place[1]) = (place[0], x), (place[1], y)
            (z, place[2]), (turn, place[3]) = (place[2], z), (place[3], turn)
        flown[0], flown[1], flown[2], flown[3] = gain * x, gain * y, gain * z, turn
