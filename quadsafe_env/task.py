"""What an agent sees, and what it is paid for: observation, goal and reward on floats and rows."""

import math

from quadsafe_core.jit import inline_kernel
from quadsafe_env.flatness import flat_from_state
from quadsafe_env.obstacles import NO_OBSTACLE, distance_to, nearest_after
from quadsafe_env.state import ATTITUDE, OMEGA, load

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
OWN_ENTRIES = 15
SPHERE_ENTRIES = 5


@inline_kernel
def saturated(value, scale):
    """``value/scale`` within [−1, 1]."""
    return min(1.0, max(-1.0, value / scale))


@inline_kernel
def held_time(held, distance, dt):
    """Time within the goal's radius, s: counts up inside, starts over outside."""
    return held + dt if distance <= GOAL_RADIUS else 0.0


@inline_kernel
def reward(distance_before, distance_after, effort, arrives):
    """Progress towards the goal, m, minus the effort ``0.005 ‖a‖²``, plus 2 on arrival."""
    bonus = GOAL_BONUS if arrives else 0.0
    return distance_before - distance_after - EFFORT_WEIGHT * effort + bonus


@inline_kernel
def write_own(out, s, goal, params):
    """The vehicle's own entries: goal − r, ṙ, r̈, r⃛, yaw and yaw rate."""
    r, v, a, j = flat_from_state(s, params)
    for axis in range(3):
        out[axis] = saturated(goal[axis] - r[axis], POSITION_SCALE)
        out[3 + axis] = saturated(v[axis], VELOCITY_SCALE)
        out[6 + axis] = saturated(a[axis], ACCELERATION_SCALE)
        out[9 + axis] = saturated(j[axis], JERK_SCALE)
    forward, left = s[ATTITUDE], s[ATTITUDE + 3]
    level = math.sqrt(forward * forward + left * left)
    # Nose straight up or down: yaw is undefined, and reads as 0.
    out[12] = forward / level if level > 0.0 else 1.0
    out[13] = left / level if level > 0.0 else 0.0
    out[14] = saturated(s[OMEGA + 2], YAW_RATE_SCALE)


@inline_kernel
def write_spheres(out, s, center, radius):
    """The nearest spheres, nearest first: centre − r, keep-out radius, presence; zeros when fewer."""
    gap, index = -NO_OBSTACLE, -1
    for slot in range(out.shape[0] // SPHERE_ENTRIES):
        first = slot * SPHERE_ENTRIES
        index, gap = nearest_after(s[0], s[1], s[2], center, radius, gap, index)
        if index < 0:
            out[first:] = 0.0
            return
        for axis in range(3):
            out[first + axis] = saturated(center[index, axis] - s[axis], POSITION_SCALE)
        out[first + 3] = saturated(radius[index], RADIUS_SCALE)
        out[first + 4] = 1.0


@inline_kernel
def distance_to_goal(s, goal):
    """Distance from the vehicle to its goal, m."""
    return distance_to(s[0], s[1], s[2], goal)


@inline_kernel
def write_observation(out, state, goal, center, radius, params):
    """One observation: the vehicle's own entries, then the spheres'."""
    s = load(state)
    write_own(out, s, goal, params)
    write_spheres(out[OWN_ENTRIES:], s, center, radius)
