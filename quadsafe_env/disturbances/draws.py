"""What conditions draw and remember: errors of the estimate, lost answers, the delay line, the air.

Every draw is a hash of the scene's integer, and of the number of control periods flown where it is not one of
the whole episode. So nothing random is remembered, and a scene flown again is the same flight.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, norm, scale
from quadsafe_core.maths.counter_rng import Key, derived_key, uniform
from quadsafe_env.disturbances.disturbance import GUST_LENGTH, GUST_PERIOD, unpacked_disturbance
from quadsafe_env.tasks.conditions import TURBULENCE_LIMIT
from quadsafe_env.vehicle.actions import velocity_feedback

# Far beyond the counters of the scene and of the later episodes.
STREAM = 1 << 30
# Counters of the episode's draws; a bias takes two, a triple of normal numbers four, a gust three.
BIAS, WIND, GAIN, MASS, INERTIA, CALM, GUSTS = 0, 8, 10, 11, 12, 13, 32
# Counters of a control period's draws, of which there are at most this many; an error takes three.
PER_PERIOD = 32
ERROR, LOSS, JITTER, IMPULSE, WHITE = 0, 12, 13, 14, 17
# Entries of what is drawn for an episode: four biases, the wind, and three factors.
WIND_AT, GAIN_AT, MASS_AT, INERTIA_AT, DRAWN = 12, 15, 16, 17, 18


class Memory(NamedTuple):
    """What N rows remember of their conditions.

    | field      | shape     | meaning                                                                 |
    |------------|-----------|-------------------------------------------------------------------------|
    | keys       | (N, 4)    | keys of the draws of the episode and of its periods                     |
    | drawn      | (N, 18)   | biases, wind, gain, and factors of mass and inertia                     |
    | age        | (N, 2)    | control periods and physics steps flown in the episode                  |
    | turbulence | (N, 3)    | the Gauss–Markov noise, before its limit, m/s²                          |
    | wrench     | (N, 4)    | the lagged wrench                                                       |
    | through    | (N, 4)    | snap and yaw acceleration that got through last                         |
    | line       | (N, k, 4) | the delay line of snaps and yaw accelerations                           |
    """

    keys: NDArray[np.int64]
    drawn: NDArray[np.float64]
    age: NDArray[np.int64]
    turbulence: NDArray[np.float64]
    wrench: NDArray[np.float64]
    through: NDArray[np.float64]
    line: NDArray[np.float64]


def memory_of(n: int, delay: int) -> Memory:
    """Memory of ``n`` rows."""
    return Memory(
        keys=np.zeros((n, 4), dtype=np.int64),
        drawn=np.zeros((n, DRAWN)),
        age=np.zeros((n, 2), dtype=np.int64),
        turbulence=np.zeros((n, 3)),
        wrench=np.zeros((n, 4)),
        through=np.zeros((n, 4)),
        line=np.zeros((n, delay, 4)),
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
def episode_key(m, i):
    """Key of the draws of row i that hold for the episode."""
    return Key(m.keys[i, 0], m.keys[i, 1])


@inline_kernel
def period_key(m, i):
    """Key of the draws of row i in its control periods; where those of the present one begin."""
    return Key(m.keys[i, 2], m.keys[i, 3]), PER_PERIOD * m.age[i, 0]


@kernel
def draw_rows(rows, words, numbers, m):
    """Draw what holds for the episode of rows that begin one, and forget the last one."""
    d = unpacked_disturbance(numbers)
    for i in rows:
        base = derived_key(Key(words[i, 0], words[i, 1]), STREAM)
        key, later = derived_key(base, 0), derived_key(base, 1)
        m.keys[i, 0], m.keys[i, 1], m.keys[i, 2], m.keys[i, 3] = key.low, key.high, later.low, later.high
        m.age[i], m.wrench[i], m.through[i], m.line[i] = 0, 0.0, 0.0, 0.0
        wind, calm = directed(key, WIND, d.wind), normal_triple(key, CALM, d.turbulence)
        for order in range(4):
            bias = directed(key, BIAS + 2 * order, d.bias[order])
            for axis in range(3):
                m.drawn[i, 3 * order + axis] = bias[axis]
        for axis in range(3):
            m.drawn[i, WIND_AT + axis], m.turbulence[i, axis] = wind[axis], calm[axis]
        m.drawn[i, GAIN_AT] = uniform(key, GAIN, 1.0 - d.gain, 1.0 + d.gain)
        m.drawn[i, MASS_AT] = uniform(key, MASS, 1.0 - d.mass_error, 1.0 + d.mass_error)
        m.drawn[i, INERTIA_AT] = uniform(key, INERTIA, 1.0 - d.inertia_error, 1.0 + d.inertia_error)


@inline_kernel
def error_of(i, order, d, m):
    """The present error of the estimate of a derivative of the position of row i: noise plus bias."""
    key, n = period_key(m, i)
    noise, at = in_ball(key, n + ERROR + 3 * order, d.noise[order]), 3 * order
    return add(noise, (m.drawn[i, at], m.drawn[i, at + 1], m.drawn[i, at + 2]))


@kernel
def estimate_batch(numbers, m, gains, flat, snap):
    """Flat states with their errors, and snaps of the feedback ``gains`` from these; a nan stays nan."""
    d = unpacked_disturbance(numbers)
    for i in range(flat.shape[0]):
        r, v = error_of(i, 0, d, m), error_of(i, 1, d, m)
        a, j = error_of(i, 2, d, m), error_of(i, 3, d, m)
        for axis in range(3):
            flat[i, 0, axis] += r[axis]
            flat[i, 1, axis] += v[axis]
            flat[i, 2, axis] += a[axis]
            flat[i, 3, axis] += j[axis]
            snap[i, axis] += velocity_feedback(v[axis], a[axis], j[axis], gains)


@kernel
def estimated_states(rows, numbers, m, states):
    """Estimated position and velocity in place of the true ones, in the given rows."""
    d = unpacked_disturbance(numbers)
    for i in rows:
        r, v = error_of(i, 0, d, m), error_of(i, 1, d, m)
        for axis in range(3):
            states[i, axis] += r[axis]
            states[i, 3 + axis] += v[axis]


@kernel
def lost_batch(numbers, m, lost):
    """Whether the answer of the present period is lost."""
    d = unpacked_disturbance(numbers)
    for i in range(lost.shape[0]):
        key, n = period_key(m, i)
        lost[i] = uniform(key, n + LOSS, 0.0, 1.0) < d.loss


@kernel
def deliver_batch(m, snap, yaw_acceleration, lost, backup, flown, flown_yaw):
    """What is flown of the answers: past losses, the delay line and the gain.

    In place of a lost answer stand its snap in ``backup``, or without any the last one that got through, and
    the last yaw acceleration that did.
    """
    delay = m.line.shape[1]
    for i in range(snap.shape[0]):
        if not lost[i]:
            m.through[i, 0], m.through[i, 1], m.through[i, 2] = snap[i, 0], snap[i, 1], snap[i, 2]
            m.through[i, 3] = yaw_acceleration[i]
        x, y, z, turn = m.through[i, 0], m.through[i, 1], m.through[i, 2], m.through[i, 3]
        if lost[i] and backup.shape[0] > 0:
            x, y, z = backup[i, 0], backup[i, 1], backup[i, 2]
        if delay > 0:
            place = m.line[i, m.age[i, 0] % delay]
            (x, place[0]), (y, place[1]) = (place[0], x), (place[1], y)
            (z, place[2]), (turn, place[3]) = (place[2], z), (place[3], turn)
        gain = m.drawn[i, GAIN_AT]
        flown[i, 0], flown[i, 1], flown[i, 2], flown_yaw[i] = gain * x, gain * y, gain * z, turn


@inline_kernel
def gust_of(i, time, d, m):
    """Acceleration of the gust of row i at a time of the episode: (1 − cos)/2 over its length."""
    window = math.floor(time / GUST_PERIOD)
    key, n = episode_key(m, i), GUSTS + 3 * window
    begin = window * GUST_PERIOD + uniform(key, n, 0.0, GUST_PERIOD - GUST_LENGTH)
    phase = (time - begin) / GUST_LENGTH
    if d.gust == 0.0 or phase <= 0.0 or phase >= 1.0:
        return (0.0, 0.0, 0.0)
    return directed(key, n + 1, 0.5 * d.gust * (1.0 - math.cos(2.0 * math.pi * phase)))


@inline_kernel
def air_of(i, time, d, m):
    """Acceleration by the air in the present period of row i, and a step of its turbulence."""
    wind = (m.drawn[i, WIND_AT], m.drawn[i, WIND_AT + 1], m.drawn[i, WIND_AT + 2])
    if d.turbulence == 0.0:
        return add(wind, gust_of(i, time, d, m))
    rough = (m.turbulence[i, 0], m.turbulence[i, 1], m.turbulence[i, 2])
    most, (key, n) = TURBULENCE_LIMIT * d.turbulence, period_key(m, i)
    white = normal_triple(key, n + WHITE, d.turbulence * math.sqrt(1.0 - d.turbulence_kept**2))
    for axis in range(3):
        m.turbulence[i, axis] = d.turbulence_kept * rough[axis] + white[axis]
    size = norm(rough)
    felt = scale(most / size, rough) if size > most else rough
    return add(add(wind, gust_of(i, time, d, m)), felt)
