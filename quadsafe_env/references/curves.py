"""References as functions of time: a figure-eight, and a random spline of minimum snap, both from rest.

The figure-eight, in a level frame of a random heading, with θ = 2π s/period and a size A and tilt h:

    x = A (cos θ − 1),   y = (A/2) sin 2θ,   z = h sin θ

s is the time, but for the first ``RAMP`` seconds, in which its rate rises from 0 to 1 along
35 u⁴ − 84 u⁵ + 70 u⁶ − 20 u⁷, so that it is C⁴ and begins at rest. The spline has ``SEGMENTS`` polynomials of
degree 7, each a quarter of a period long, through waypoints: of all such from rest to rest that with the least
∫ ‖snap‖² dt, which is C⁶ at the inner waypoints. After the last it stays there. It is linear in the waypoints,
so that one matrix gives its coefficients.

A curve is a row of numbers, relative to its start: ``write_curve`` draws it, ``curve_at`` reads it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_env.tasks.scene_columns import columns_in, point
from quadsafe_env.tasks.scenes import key_of

REFERENCES = ("figure-eight", "minimum-snap")
EIGHT, SPLINE = range(2)
RAMP = 2.0  # s
LARGEST_TILT = 0.25  # h over A
SEGMENTS, COEFFICIENTS = 8, 8
SEGMENTS_OF_A_PERIOD = 4
# The first is the duration of a segment.
NUMBERS = 1 + SEGMENTS * COEFFICIENTS * 3
CURVE_STREAM = 1 << 24
STILL = (0.0, 0.0, 0.0)


class Course(NamedTuple):
    """What is followed: the kind, ``EIGHT`` or ``SPLINE``, its size, m, and its period, s.

    The size is half of the length of the figure-eight, and of the box that waypoints are drawn from; that is
    half as high.
    """

    kind: int = EIGHT
    size: float = 1.5
    period: float = 10.0


def _spline_matrix() -> NDArray[np.float64]:
    """Coefficients (segments, 8) of unit segments, flat, from waypoints: (64, 9)."""
    knots, order = SEGMENTS + 1, np.arange(COEFFICIENTS)
    # From coefficients to position, velocity, acceleration and jerk at both ends.
    ends = np.zeros((8, 8))
    for n in range(4):
        factor = np.array([math.perm(int(k), n) for k in order], dtype=np.float64)
        ends[n], ends[4 + n] = np.where(order == n, factor, 0.0), factor
    hermite = np.linalg.inv(ends)
    factor = np.array([math.perm(int(k), 4) for k in order], dtype=np.float64)
    cost = np.outer(factor, factor) / np.maximum(order[:, None] + order - 7, 1)
    own = hermite.T @ cost @ hermite
    whole = np.zeros((4 * knots, 4 * knots))
    for k in range(SEGMENTS):
        whole[4 * k : 4 * k + 8, 4 * k : 4 * k + 8] += own
    free = [4 * k + n for k in range(1, SEGMENTS) for n in (1, 2, 3)]
    given = [4 * k for k in range(knots)]
    at_knots = np.zeros((4 * knots, knots))
    at_knots[given] = np.eye(knots)
    at_knots[free] = -np.linalg.solve(whole[np.ix_(free, free)], whole[np.ix_(free, given)])
    return np.concatenate([hermite @ at_knots[4 * k : 4 * k + 8] for k in range(SEGMENTS)])


MATRIX = _spline_matrix()


@inline_kernel
def write_eight(key, course, curve):
    """A figure-eight of random heading and tilt."""
    heading = uniform(key, CURVE_STREAM, -math.pi, math.pi)
    curve[0], curve[1] = course.size, 2.0 * math.pi / course.period
    curve[2], curve[3] = math.cos(heading), math.sin(heading)
    curve[4] = course.size * uniform(key, CURVE_STREAM + 1, -LARGEST_TILT, LARGEST_TILT)


@inline_kernel
def write_spline(key, course, curve):
    """A spline through random waypoints; the first is the start."""
    curve[0] = course.period / SEGMENTS_OF_A_PERIOD
    for axis in range(3):
        half = course.size if axis < 2 else 0.5 * course.size
        for row in range(SEGMENTS * COEFFICIENTS):
            total = 0.0
            for k in range(1, SEGMENTS + 1):
                total += MATRIX[row, k] * uniform(key, CURVE_STREAM + 3 * k + axis, -half, half)
            curve[1 + 3 * row + axis] = total


@kernel
def write_curve(key, course, curve):
    """The numbers of a curve, from the key of its scene."""
    if course.kind == EIGHT:
        write_eight(key, course, curve)
    else:
        write_spline(key, course, curve)


@inline_kernel
def ramped(t):
    """s and its first four derivatives."""
    if t >= RAMP:
        return t - 0.5 * RAMP, 1.0, 0.0, 0.0, 0.0
    u = t / RAMP
    return (
        RAMP * u**5 * (7.0 - 14.0 * u + 10.0 * u**2 - 2.5 * u**3),
        u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3),
        u**3 * (140.0 - 420.0 * u + 420.0 * u**2 - 140.0 * u**3) / RAMP,
        u**2 * (420.0 - 1680.0 * u + 2100.0 * u**2 - 840.0 * u**3) / RAMP**2,
        u * (840.0 - 5040.0 * u + 8400.0 * u**2 - 4200.0 * u**3) / RAMP**3,
    )


@inline_kernel
def wave(amplitude, k, phase, d):
    """``amplitude · sin(k θ + phase)`` and its first four derivatives in time, from θ and its four."""
    th, d1, d2, d3, d4 = d
    up, over = amplitude * math.sin(k * th + phase), amplitude * math.cos(k * th + phase)
    g1, g2, g3, g4 = k * over, -(k**2) * up, -(k**3) * over, k**4 * up
    return (
        up,
        g1 * d1,
        g2 * d1**2 + g1 * d2,
        g3 * d1**3 + 3.0 * g2 * d1 * d2 + g1 * d3,
        g4 * d1**4 + 6.0 * g3 * d1**2 * d2 + g2 * (3.0 * d2**2 + 4.0 * d1 * d3) + g1 * d4,
    )


@kernel
def eight_at(curve, t):
    """Position, velocity, acceleration, jerk and snap of a figure-eight at time t, relative to its start."""
    s, s1, s2, s3, s4 = ramped(t)
    w, cos, sin = curve[1], curve[2], curve[3]
    d = (w * s, w * s1, w * s2, w * s3, w * s4)
    x0, x1, x2, x3, x4 = wave(curve[0], 1.0, 0.5 * math.pi, d)
    y0, y1, y2, y3, y4 = wave(0.5 * curve[0], 2.0, 0.0, d)
    z0, z1, z2, z3, z4 = wave(curve[4], 1.0, 0.0, d)
    x0 -= curve[0]
    return (
        (cos * x0 - sin * y0, sin * x0 + cos * y0, z0),
        (cos * x1 - sin * y1, sin * x1 + cos * y1, z1),
        (cos * x2 - sin * y2, sin * x2 + cos * y2, z2),
        (cos * x3 - sin * y3, sin * x3 + cos * y3, z3),
        (cos * x4 - sin * y4, sin * x4 + cos * y4, z4),
    )


@inline_kernel
def polynomial_at(curve, at, n, u):
    """The n-th derivative of three polynomials of degree 7 at u."""
    x = y = z = 0.0
    for k in range(COEFFICIENTS - 1, n - 1, -1):
        factor = 1.0
        for i in range(n):
            factor *= k - i
        x = x * u + factor * curve[at + 3 * k]
        y = y * u + factor * curve[at + 3 * k + 1]
        z = z * u + factor * curve[at + 3 * k + 2]
    return (x, y, z)


@kernel
def spline_at(curve, t):
    """Position, velocity, acceleration, jerk and snap of a spline at time t, relative to its start."""
    duration = curve[0]
    segment = min(int(t / duration), SEGMENTS - 1)
    u, at = min(t / duration - segment, 1.0), 1 + 3 * COEFFICIENTS * segment
    p = polynomial_at(curve, at, 0, u)
    if t >= SEGMENTS * duration:
        return p, STILL, STILL, STILL, STILL
    rate = 1.0 / duration
    vx, vy, vz = polynomial_at(curve, at, 1, u)
    ax, ay, az = polynomial_at(curve, at, 2, u)
    jx, jy, jz = polynomial_at(curve, at, 3, u)
    sx, sy, sz = polynomial_at(curve, at, 4, u)
    r2, r3, r4 = rate**2, rate**3, rate**4
    return (
        p,
        (rate * vx, rate * vy, rate * vz),
        (r2 * ax, r2 * ay, r2 * az),
        (r3 * jx, r3 * jy, r3 * jz),
        (r4 * sx, r4 * sy, r4 * sz),
    )


@kernel
def curve_at(kind, curve, t):
    """Position, velocity, acceleration, jerk and snap of a curve at time t, relative to its start."""
    return eight_at(curve, t) if kind == EIGHT else spline_at(curve, t)


@kernel
def curves_batch(words, rows, course, curves):
    """The curves (N, NUMBERS) of the given rows, from the integers of their scenes."""
    for i in rows:
        write_curve(key_of(words, i), course, curves[i])


@kernel
def references_batch(course, curves, times, scene_memory, out):
    """The references of all rows at times (N,), s, in the world frame: (N, 5, 3)."""
    starts = columns_in(scene_memory).start
    for i in range(times.size):
        found, start = curve_at(course.kind, curves[i], times[i]), point(starts, i)
        for n in range(5):
            for axis in range(3):
                out[i, n, axis] = found[n][axis] + (start[axis] if n == 0 else 0.0)
