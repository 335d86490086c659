"""The way out of a sphere: at a bounded speed, by the nearest exit.

Inside a keep-out sphere nothing is certified, and no set tells how to leave. The vehicle is brought to
``RECOVERY_SPEED`` along the shortest of a few ways out of the union of all spheres, by held feedback with real
poles: from rest it never gets faster than that. What it moves with at the start dies out at ``RECOVERY_POLE``.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, subtract, vector
from shields.backup.stored_stop import NOTHING, within_ball
from shields.chains.radial import line_of_sight
from shields.interface.row_checks import braking

# Relative to the sphere that is left, m/s; triple pole of the feedback on (v, a, j), 1/s.
RECOVERY_SPEED, RECOVERY_POLE = 1.0, 6.0
# Ways out that are tried beside those away from the centres: up first, where nothing else decides.
AXES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))


@kernel
def length_of_way(point, way, center, radius, share):
    """How far a ray goes until it is out of every sphere, of ``share`` times the radius, m."""
    far = 0.0
    # A ray leaves each sphere once, so each turn is the last one or leaves one more for good.
    for _ in range(radius.shape[0]):
        begin = far
        for k in range(radius.shape[0]):
            keep = share * radius[k]
            gap = subtract(combined(point, far, way), vector(center[k]))
            along, inside = dot(gap, way), keep * keep - dot(gap, gap)
            if inside > 0.0:
                far += math.sqrt(along * along + inside) - along
        if far == begin:
            break
    return far


@kernel
def nearest_exit(point, center, radius, share):
    """Direction of the shortest way out that is tried; the sphere that the point is deepest in, −1 for none.

    Tried are the ways straight away from the centre of each sphere around the point, from the middle of these
    centres, and along the axes.
    """
    best, shortest, deepest, depth, away = AXES[0], math.inf, -1, 0.0, NOTHING
    for k in range(radius.shape[0]):
        gap = subtract(point, vector(center[k]))
        distance, way, _ = line_of_sight(gap)
        if distance < share * radius[k]:
            away = add(away, gap)
            if share * radius[k] - distance > depth:
                deepest, depth = k, share * radius[k] - distance
            length = length_of_way(point, way, center, radius, share)
            if length < shortest:
                best, shortest = way, length
    if deepest >= 0:
        for way in (line_of_sight(away)[1], *AXES):
            length = length_of_way(point, way, center, radius, share)
            if length < shortest:
                best, shortest = way, length
    return best, deepest


@inline_kernel
def leaving_snap(x, way, drift, gains):
    """Snap towards the recovery speed along a way, relative to a sphere that moves at ``drift``."""
    wanted = combined(drift, RECOVERY_SPEED, way)
    return braking(subtract(x.v, wanted), x.a, x.j, gains)


@kernel
def recovery_snap(x, spheres, settings, tube, fact):
    """The snap that leaves the spheres, and whether the vehicle has to.

    It has to inside one of them, and in the shell that a stop keeps around it unless it is coming nearer: then
    it can still be kept out, and ``shields.methods.sampled_row.backup_snap`` tries.
    """
    center, velocity, radius = spheres
    way, k = nearest_exit(x.r, center, radius, 1.0 + settings.margin)
    if k < 0:
        return NOTHING, False
    gap, drift = subtract(x.r, vector(center[k])), vector(velocity[k])
    bare = radius[k]
    if tube is not None:
        bare -= tube.vehicle
    if not (norm(gap) < bare or dot(gap, subtract(x.v, drift)) >= 0.0):
        return NOTHING, False
    fact["obstacle"] = k
    return within_ball(leaving_snap(x, way, drift, settings.recovery), settings.flight.limits.snap_max), True


@inline_kernel
def is_within(x, spheres):
    """Whether the vehicle is inside a sphere."""
    center, _, radius = spheres
    for k in range(radius.shape[0]):
        if norm(subtract(x.r, vector(center[k]))) < radius[k]:
            return True
    return False
