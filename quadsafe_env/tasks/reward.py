"""What an agent sees, and what it is paid for: observation, goal and reward on floats."""

import math

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fma
from quadsafe_core.kernels.vec3 import scale, subtract
from quadsafe_env.vehicle.flatness import flat_from_state
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA

GOAL_RADIUS = 0.10  # m
GOAL_HOLD = 0.5  # s
GOAL_BONUS = 2.0
EFFORT_WEIGHT = 0.005

# An entry of 1 in the observation: beyond it the entry saturates.
POSITION_SCALE = 4.0  # m
VELOCITY_SCALE = 4.0  # m/s
ACCELERATION_SCALE = 20.0  # m/s²
JERK_SCALE = 200.0  # m/s³
YAW_RATE_SCALE = 10.0  # rad/s
RADIUS_SCALE = 2.0  # m
SIGHT = 1.0  # m; surfaces that are farther away are not seen
OWN_ENTRIES = 15
SPHERE_ENTRIES = 5
SURFACE_ENTRIES = 7
# Of one obstacle, by the layout of the task.
ENTRIES = {"spheres": SPHERE_ENTRIES, "surfaces": SURFACE_ENTRIES}


@inline_kernel
def saturated(value, scale):
    """``value/scale`` within [−1, 1]."""
    return min(1.0, max(-1.0, value * (1.0 / scale)))


@inline_kernel
def saturated_triple(a, scale):
    """Each entry over the scale, within [−1, 1]."""
    return (saturated(a[0], scale), saturated(a[1], scale), saturated(a[2], scale))


@inline_kernel
def held_time(held, squared_distance, dt):
    """Time within the goal's radius, s: counts up inside, starts over outside."""
    return held + dt if squared_distance <= GOAL_RADIUS * GOAL_RADIUS else 0.0


@inline_kernel
def reward(distance_before, distance_after, effort, arrives):
    """Progress towards the goal, m, minus the effort ``0.005 ‖a‖²``, plus 2 on arrival."""
    bonus = GOAL_BONUS if arrives else 0.0
    return distance_before - distance_after - EFFORT_WEIGHT * effort + bonus


@inline_kernel
def own_entries(s, goal, params):
    """The vehicle's own entries, in triples: goal − r, ṙ, r̈, r⃛, and yaw with yaw rate."""
    r, v, a, j = flat_from_state(s, params)
    forward, left = s[ATTITUDE], s[ATTITUDE + 3]
    level = math.sqrt(fma(forward, forward, left * left))
    # Nose straight up or down: yaw is undefined, and reads as 0.
    has_yaw = level > 0.0
    return (
        saturated_triple(subtract(goal, r), POSITION_SCALE),
        saturated_triple(v, VELOCITY_SCALE),
        saturated_triple(a, ACCELERATION_SCALE),
        saturated_triple(j, JERK_SCALE),
        (
            forward / level if has_yaw else 1.0,
            left / level if has_yaw else 0.0,
            saturated(s[OMEGA + 2], YAW_RATE_SCALE),
        ),
    )


@inline_kernel
def sphere_entries(between, radius, is_there):
    """Entries of one sphere: centre − r, keep-out radius, presence; zeros when there is none."""
    x, y, z = saturated_triple(between, POSITION_SCALE)
    return (
        x if is_there else 0.0,
        y if is_there else 0.0,
        z if is_there else 0.0,
        saturated(radius, RADIUS_SCALE) if is_there else 0.0,
        1.0 if is_there else 0.0,
    )


@inline_kernel
def surface_entries(gap, n):
    """Entries of one body at distance ``gap``, m: way to its keep-out surface, normal there, presence.

    All are faded, times 1 − gap/``SIGHT`` within [0, 1]: what is far away says nothing, and comes into sight
    without a jump. A policy that learned with unit normals of far walls took ten times as long.
    """
    near = min(1.0, max(0.0, 1.0 - gap / SIGHT))
    x, y, z = scale(near, saturated_triple(scale(-gap, n), POSITION_SCALE))
    return (x, y, z, near * n[0], near * n[1], near * n[2], near)
