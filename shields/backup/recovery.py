"""The way out of a body: at a bounded speed, by the nearest exit.

Inside a body nothing is certified, and no set tells how to leave. The vehicle is brought to
``RECOVERY_SPEED`` along the shortest of a few ways out of the union of all bodies, by held feedback with real
poles: from rest it never gets faster than that. What it moves with at the start dies out at ``RECOVERY_POLE``.
"""

import math

from quadsafe_core.kernels.choice import entry_at
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, subtract, vector
from shields.backup.stored_stop import NOTHING, within_ball
from shields.chains.radial import line_of_sight
from shields.interface.bodies import distance_from, is_there, look_at, outward, widened
from shields.interface.row_checks import braking

# Relative to the body that is left, m/s; triple pole of the feedback on (v, a, j), 1/s.
RECOVERY_SPEED, RECOVERY_POLE = 1.0, 6.0
# Ways out that are tried beside those away from the centres: of equals the first, up.
AXES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
# Where there is no formula a way out is stepped along, m, so often at most.
STRIDE, STRIDES = 1e-3, 256


@kernel
def length_out_of(core, gap, way, keep):
    """How far a ray goes from ``gap`` until it is out of a body, m; inf if it does not get there."""
    if core is None:
        along, inside = dot(gap, way), keep * keep - dot(gap, gap)
        return math.sqrt(along * along + inside) - along if inside > 0.0 else 0.0
    far = 0.0
    for _ in range(STRIDES):
        depth = keep - distance_from(core, combined(gap, far, way))
        if depth <= 0.0:
            return far
        # No way out is shorter than the depth.
        far += max(depth, STRIDE)
    return math.inf


@kernel
def length_of_way(point, way, bodies, margin):
    """How far a ray goes until it is out of every body with its margin, m."""
    far = 0.0
    # A ray leaves each body once, so each turn is the last one or leaves one more for good.
    for _ in range(bodies.keep_out.shape[0]):
        begin = far
        for k in range(bodies.keep_out.shape[0]):
            core = entry_at(bodies.cores, k)
            if is_there(core, bodies.keep_out[k]):
                gap = subtract(combined(point, far, way), vector(bodies.center[k]))
                far += length_out_of(core, gap, way, widened(core, bodies.keep_out[k], margin))
        if far in (begin, math.inf):
            break
    return far


@kernel
def nearest_exit(point, bodies, margin):
    """Direction of the shortest way out that is tried; the body that the point is deepest in, −1 for none.

    Tried are the ways straight away from each body around the point, from the middle of these, and along the
    axes. Where none of them is a way out, as between walls that are too close, the direction is 0.
    """
    best, shortest, deepest, depth, away = NOTHING, math.inf, -1, 0.0, NOTHING
    for k in range(bodies.keep_out.shape[0]):
        core, gap = entry_at(bodies.cores, k), subtract(point, vector(bodies.center[k]))
        keep, (distance, way) = widened(core, bodies.keep_out[k], margin), look_at(core, gap)
        if is_there(core, bodies.keep_out[k]) and distance < keep:
            away = add(away, outward(core, gap))
            if keep - distance > depth:
                deepest, depth = k, keep - distance
            length = length_of_way(point, way, bodies, margin)
            if length < shortest:
                best, shortest = way, length
    if deepest >= 0:
        for way in (line_of_sight(away)[1], *AXES):
            length = length_of_way(point, way, bodies, margin)
            if length < shortest:
                best, shortest = way, length
    return best, deepest


@inline_kernel
def leaving_snap(x, way, drift, gains):
    """Snap towards the recovery speed along a way, 0 for rest, relative to a body that moves at ``drift``."""
    wanted = combined(drift, RECOVERY_SPEED, way)
    return braking(subtract(x.v, wanted), x.a, x.j, gains)


@kernel
def recovery_snap(x, bodies, settings, tube, fact):
    """The snap that leaves the bodies, and whether the vehicle has to.

    It has to inside one of them, and in the shell that a stop keeps around it unless it is coming nearer: then
    it can still be kept out, and ``shields.methods.sampled_row.backup_snap`` tries.
    """
    way, k = nearest_exit(x.r, bodies, settings.margin)
    if k < 0:
        return NOTHING, False
    core, bare = entry_at(bodies.cores, k), bodies.keep_out[k]
    gap, drift = subtract(x.r, vector(bodies.center[k])), vector(bodies.velocity[k])
    if tube is not None:
        bare -= tube.vehicle
    if not (distance_from(core, gap) < bare or dot(outward(core, gap), subtract(x.v, drift)) >= 0.0):
        return NOTHING, False
    fact["obstacle"] = k
    return within_ball(leaving_snap(x, way, drift, settings.recovery), settings.flight.limits.snap_max), True


@inline_kernel
def is_within(x, bodies):
    """Whether the vehicle is inside a body."""
    for k in range(bodies.keep_out.shape[0]):
        core = entry_at(bodies.cores, k)
        gap = subtract(x.r, vector(bodies.center[k]))
        if is_there(core, bodies.keep_out[k]) and distance_from(core, gap) < bodies.keep_out[k]:
            return True
    return False
