"""The second half of a control period under conditions, as ``batches.advance_batch`` is without.

A physics step of a row, in this order: the inner loop asks for a wrench, from the true state and the believed
vehicle; the rotors lag behind it; drag and air act over half the step; the true vehicle flies (29) with what
the rotors give; drag and air act over the other half. So with every condition off the step is that of
``block.fly``, bit for bit, and otherwise it is of second order in dt (Strang splitting).
"""

import math
from typing import NamedTuple

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, new_block
from quadsafe_core.kernels.ravel import unraveled
from quadsafe_core.kernels.vec3 import add
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_env.disturbances.disturbance import Disturbance
from quadsafe_env.disturbances.draws import IMPULSE, JITTER, air_of, directed, period_key
from quadsafe_env.disturbances.rotor_lag import asked_wrench, lagged
from quadsafe_env.disturbances.rotor_thrusts import begin_thrusts, rotor_step
from quadsafe_env.simulation.block import (
    CLIPPED,
    CRASH,
    GOAL,
    HELD,
    IS_FLYING,
    LONGEST,
    MARKS,
    PER_SPHERE,
    SNAP,
    SPHERES,
    YAW,
    block_of,
)
from quadsafe_env.simulation.bodies import (
    around_of,
    close_period_among,
    close_step_among,
    columns_among,
    meet_bodies,
    open_around,
)
from quadsafe_env.simulation.episode import (
    close_period,
    close_step,
    load_rows,
    open_period,
    store_told,
)
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rows import rows_in
from quadsafe_env.tasks.obstacles import squared_distance
from quadsafe_env.tasks.reward import held_time
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import LARGEST, THRUST, lane_state, store_lane


class DisturbedPlant(NamedTuple):
    """What the kernels of a world under conditions are told."""

    plant: Plant
    disturbance: Disturbance


@inline_kernel
def true_vehicle(believed, m):
    """The vehicle of a row: mass and inertia other than believed."""
    turn, (Jx, Jy, Jz) = m["inertia"], believed.inertia
    return QuadrotorParams(
        believed.mass * m["mass"],
        (Jx * turn, Jy * turn, Jz * turn),
        believed.arm,
        believed.radius,
        believed.thrust_max,
        believed.thrust_min,
        believed.torque_max,
        believed.gravity,
        believed.yaw_rate_max,
    )


@inline_kernel
def steps_of(substeps, d, m):
    """Physics steps of the present period of a row, by its clock."""
    key, n = period_key(m)
    return max(1, math.floor(substeps * uniform(key, n + JITTER, 1.0 - d.jitter, 1.0 + d.jitter) + 0.5))


@inline_kernel
def struck(v, d, m):
    """Velocity after the impulse that a row meets in the present period, or meets none."""
    key, n = period_key(m)
    has_rested = m["steps"] - m["pushed"] >= d.impulse_rest
    if not has_rested or uniform(key, n + IMPULSE, 0.0, 1.0) >= d.impulse_chance:
        return v
    m["pushed"] = m["steps"]
    return add(v, directed(key, n + IMPULSE + 1, d.impulse))


@inline_kernel
def pushed(s, air, d):
    """The state after drag and air have acted on its velocity for half a physics step."""
    return (
        *s[0:3],
        d.half_drag * s[3] + d.half_push * air[0],
        d.half_drag * s[4] + d.half_push * air[1],
        d.half_drag * s[5] + d.half_push * air[2],
        *s[6:20],
    )


@inline_kernel
def is_state_sound(s, thrust_min):
    """Not grown beyond a flight, and the thrust above the floor of the flat map."""
    total = s[0] + s[1] + s[2] + s[3] + s[4] + s[5] + s[6] + s[7] + s[8] + s[9]
    total += s[10] + s[11] + s[12] + s[13] + s[14] + s[15] + s[16] + s[17] + s[18] + s[19]
    return abs(total) < LARGEST and s[THRUST] > thrust_min


@inline_kernel
def record_step(block, i, row, among, s, dt):
    """Time at the goal and least distances after a step of lane i, a row: to spheres squared, or to bodies."""
    spheres, around = among
    held = held_time(
        block[LANES * HELD + i], squared_distance(s[0], s[1], s[2], lane_triple(block, U(LANES * GOAL + i))), dt
    )
    block[LANES * HELD + i] = held
    block[LANES * LONGEST + i] = max(block[LANES * LONGEST + i], held)
    for k in range(spheres):
        at = LANES * (SPHERES + PER_SPHERE * k) + i
        squared = squared_distance(s[0], s[1], s[2], lane_triple(block, U(at)))
        block[at + 4 * LANES] = min(block[at + 4 * LANES], squared)
    meet_bodies(around, row, i, s[0:3], dt)


@inline_kernel
def load_flown(block, first, count, memory):
    """What is flown in the period, of the rows' records."""
    for lane in range(count):
        flown = memory[first + lane]["flown"]
        for k in range(4):
            block[LANES * (SNAP + k) + lane] = flown[k]


@kernel
def fly_row(block, lane, row, among, told, m):
    """Fly a row, in a lane, for a control period; it stays in its last sound state when it crashes.

    ``among`` are the number of spheres and the ``Around`` of bodies, or None; ``told`` a ``Plant``, ``drive``
    and a ``Disturbance``; ``m`` the row's record of the dtype ``WEATHER``.
    """
    plant, (rotors, lead, slow), d = told
    dt, steps = plant.dt, steps_of(plant.substeps, d, m)
    vehicle, air = true_vehicle(plant.params, m), air_of(dt * m["steps"], d, m)
    snap, yaw_acceleration = lane_triple(block, U(LANES * SNAP + lane)), block[LANES * YAW + lane]
    before = lane_state(block, U(lane))
    s = before[0:3] + struck(before[3:6], d, m) + before[6:20]
    if m["steps"] == 0:
        begin_thrusts(s, slow, m)
    for _ in range(steps):
        given = lagged(asked_wrench(s, snap, yaw_acceleration, plant, lead, m), m)
        after, is_clipped = rotor_step(pushed(s, air, d), given, vehicle, rotors, slow, dt, m)
        after = pushed(after, air, d)
        if is_clipped:
            block[LANES * CLIPPED + lane] = 1.0
        if not is_state_sound(after, plant.params.thrust_min):
            block[LANES * (MARKS + IS_FLYING) + lane], block[LANES * (MARKS + CRASH) + lane] = 0.0, 1.0
            break
        s = after
        record_step(block, lane, row, among, s, dt)
    store_lane(block, U(lane), s)
    m["periods"] += 1
    m["steps"] += steps
    m["lasted"] = steps


@kernel
def advance_disturbed_batch(numbers, drive, closes, memory, scene_memory, body_memory, weather):
    """Hold what is flown for a control period, as ``advance_batch`` does; observations are not written.

    ``numbers`` are a ``DisturbedPlant``, raveled; ``drive`` are the fields of ``Rotors``, the numbers of
    ``rotor_lag.lag_lead`` and the fields of ``SlowRotors``, each None without; ``body_memory`` is that of
    ``SceneBodies``, or None among spheres at rest; ``weather`` is (N,) of the dtype ``WEATHER``.
    """
    (plant, d), rows = unraveled(numbers, DisturbedPlant), rows_in(borrowed(memory))
    scenes, around = columns_among(scene_memory, body_memory), around_of(scene_memory, body_memory)
    spheres = scenes.sphere_count
    block, gaps = block_of(spheres), new_block(I(1))
    for first in range(0, weather.shape[0], LANES):
        count = min(LANES, weather.shape[0] - first)
        load_rows(block, first, count, rows.state, scenes)
        load_flown(block, first, count, weather)
        open_period(block, first, count, rows, plant.yaw)
        open_around(around, count)
        for lane in range(count):
            row = first + lane
            if block[LANES * (MARKS + IS_FLYING) + lane] > 0.0:
                fly_row(block, lane, row, (spheres, around), (plant, drive, d), weather[row])
        if body_memory is None:
            close_period(block, gaps, first, count, spheres, plant, rows)
            if closes:
                close_step(block, gaps, count, spheres, plant)
        else:
            close_period_among(block, gaps, first, count, around, plant, rows)
            if closes:
                close_step_among(block, gaps, first, count, around, plant)
        store_told(block, first, count, closes, rows)
