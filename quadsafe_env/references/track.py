"""Track: a reference to follow, with spheres on it.

Every sphere is entered by the reference, by half of its keep-out radius or more. Spheres keep ``APART``
from each other's keep-outs and ``FREE_SPACE`` from the start; so what is free is
connected: there is a way around each.
"""

import math
from dataclasses import dataclass

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_env.references.curves import (
    EIGHT,
    NUMBERS,
    RAMP,
    SEGMENTS,
    SEGMENTS_OF_A_PERIOD,
    Course,
    curve_at,
    write_curve,
)
from quadsafe_env.tasks.obstacles import distance_to
from quadsafe_env.tasks.scene_columns import columns_in, point, write_point
from quadsafe_env.tasks.scenes import FREE_SPACE, STRIDE, TRIES, Task, key_of

FIGURE_EIGHT = Course()
APART = 0.1  # m
# Of a keep-out radius: so far from the reference a centre is at most.
OFFSET = 0.5
TRACK_STREAM = (1 << 24) + 64
# Of a slot of time that a sphere stands in.
FIRST, LAST = 0.1, 0.9
# Where a scene of given obstacles is asked to be free, beside the start: m above it.
ABOVE = 0.6


@kernel
def track_endpoints_batch(words, rows, attempt, memory):
    """A start within half a metre of the origin; the goal is moved along the reference later."""
    scenes = columns_in(memory)
    for i in rows:
        key, n = key_of(words, i), STRIDE * attempt
        x, y, z = (
            uniform(key, n, -0.5, 0.5),
            uniform(key, n + 1, -0.5, 0.5),
            uniform(key, n + 2, -0.5, 0.5),
        )
        write_point(scenes.start, i, x, y, z)
        write_point(scenes.goal, i, x, y, z + ABOVE)


@inline_kernel
def once_through(course):
    """When a curve has been flown once, s."""
    if course.kind == EIGHT:
        return 0.5 * RAMP + course.period
    return SEGMENTS / SEGMENTS_OF_A_PERIOD * course.period


@inline_kernel
def is_free(scenes, first, k, center, keep_out):
    """Whether a sphere keeps apart from those of its scene before it, the first k from ``first`` on."""
    for other in range(first, first + k):
        gap = distance_to(center[0], center[1], center[2], point(scenes.center, other))
        if scenes.radius[other] > 0.0 and gap < scenes.radius[other] + keep_out + APART:
            return False
    return True


@inline_kernel
def place_on(key, n, time, kind, curve, start, reach):
    """A point at most ``reach`` from where the reference is at a time, m."""
    p, _, _, _, _ = curve_at(kind, curve, time)
    offset, turn = reach * uniform(key, n + 2, 0.0, 1.0), uniform(key, n + 3, -math.pi, math.pi)
    up = uniform(key, n + 4, -1.0, 1.0)
    level = offset * math.sqrt(1.0 - up * up)
    return (
        start[0] + p[0] + level * math.cos(turn),
        start[1] + p[1] + level * math.sin(turn),
        start[2] + p[2] + offset * up,
    )


@kernel
def track_spheres_batch(words, rows, sizes, course, memory):
    """Spheres on the reference, one in each part of its time, redrawn until apart and clear of the start."""
    scenes, curve = columns_in(memory), np.zeros(NUMBERS)
    count, whole = scenes.sphere_count, once_through(course)
    for i in rows:
        key, start = key_of(words, i), point(scenes.start, i)
        write_curve(key, course, curve)
        for k in range(count):
            at = count * i + k
            for attempt in range(TRIES):
                n = TRACK_STREAM + STRIDE * (TRIES * k + attempt)
                keep_out = uniform(key, n, sizes.least, sizes.greatest) + sizes.vehicle
                time = whole * (k + uniform(key, n + 1, FIRST, LAST)) / count
                center = place_on(key, n, time, course.kind, curve, start, OFFSET * keep_out)
                gap = distance_to(center[0], center[1], center[2], start) - keep_out
                is_placed = gap >= FREE_SPACE and is_free(scenes, count * i, k, center, keep_out)
                write_point(scenes.center, at, center[0], center[1], center[2])
                scenes.radius[at] = keep_out if is_placed else 0.0
                if is_placed:
                    break


@dataclass(frozen=True)
class TrackTask(Task):
    """A reference with spheres on it; the flight goes on to its time limit."""

    course: Course = FIGURE_EIGHT

    def endpoints(self, words, rows, attempt, memory):
        """See ``track_endpoints_batch``."""
        track_endpoints_batch(words, rows, attempt, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``track_spheres_batch``."""
        track_spheres_batch(words, rows, sizes, self.course, memory)
