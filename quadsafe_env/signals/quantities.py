"""The quantities that a user's observation or reward is a function of."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import norm, scale
from quadsafe_env.tasks.obstacles import NO_OBSTACLE
from quadsafe_env.tasks.scene_bodies import bodies_in, sight_of
from quadsafe_env.tasks.scene_columns import columns_in

Floats = NDArray[np.float64]


class Quantities(NamedTuple):
    """What is known after a policy step, or at a reset; SI, in the world frame.

    Leading axes are () in the single env, and (M,), some of the rows, in the vector env.

    | field             | shape       | meaning                                                             |
    |-------------------|-------------|---------------------------------------------------------------------|
    | position          | (…, 3)      | r                                                                   |
    | velocity          | (…, 3)      | ṙ                                                                   |
    | acceleration      | (…, 3)      | r̈                                                                  |
    | jerk              | (…, 3)      | r⃛                                                                  |
    | attitude          | (…, 3, 3)   | Q, from the body frame to the world frame                           |
    | body_rates        | (…, 3)      | ω, in the body frame                                                |
    | thrust            | (…)         | F_z                                                                 |
    | goal              | (…, 3)      | the goal; in Track where the reference is now                       |
    | distance          | (…)         | what is left of the way to the goal, in Rooms and Gates by openings |
    | previous_distance | (…)         | the same before the step, to where the goal is after it             |
    | arrives           | (…) bool    | whether this step is the arrival                                    |
    | clearance         | (…)         | least signed distance to an obstacle in the step; inf without any   |
    | violation         | (…) bool    | whether that was negative                                           |
    | terminated        | (…) bool    | whether the step ended the episode                                  |
    | action            | (…, 4)      | of the step, as flown: clipped to [−1, 1], 0 if it was not finite   |
    | previous_action   | (…, 4)      | of the step before; both are 0 at a reset                           |
    | reward            | (…)         | what the task pays for the step                                     |
    | gaps              | (…, k)      | signed distances of the k nearest keep-out surfaces now, inf for none|
    | points            | (…, k, 3)   | their nearest points; 0 for none                                    |
    | normals           | (…, k, 3)   | unit normals there, away from the obstacle; 0 for none              |
    | reference         | (…, 5, 3)   | in Track, position to snap of the reference now; else None          |
    | error             | (…)         | in Track, its distance from r; else None                            |

    Under conditions, what an observation is made of has the estimate of position and velocity, and what
    follows from these; ``error``, distances and what happened in the step are true. A reward gets the truth.
    """

    position: Floats
    velocity: Floats
    acceleration: Floats
    jerk: Floats
    attitude: Floats
    body_rates: Floats
    thrust: Floats
    goal: Floats
    distance: Floats
    previous_distance: Floats
    arrives: NDArray[np.bool_]
    clearance: Floats
    violation: NDArray[np.bool_]
    terminated: NDArray[np.bool_]
    action: Floats
    previous_action: Floats
    reward: Floats
    gaps: Floats
    points: Floats
    normals: Floats
    reference: Floats | None = None
    error: Floats | None = None


@kernel
def sphere_sights(states, scene_memory, gaps, normals):
    """Signed distances (N, K) of rows from keep-out spheres, m, and unit normals; inf and 0 for none."""
    scenes = columns_in(scene_memory)
    for i in range(gaps.shape[0]):
        for k in range(gaps.shape[1]):
            at = gaps.shape[1] * i + k
            way = (
                states[i, 0] - scenes.center[3 * at],
                states[i, 1] - scenes.center[3 * at + 1],
                states[i, 2] - scenes.center[3 * at + 2],
            )
            radius, length = scenes.radius[at], norm(way)
            gaps[i, k] = length - radius if radius > 0.0 else NO_OBSTACLE
            unit = scale(1.0 / length if radius > 0.0 and length > 0.0 else 0.0, way)
            normals[i, k, 0], normals[i, k, 1], normals[i, k, 2] = unit


@kernel
def body_sights(states, scene_memory, memory, gaps, normals):
    """As ``sphere_sights``, among bodies of any kind."""
    bodies = bodies_in(borrowed(scene_memory), borrowed(memory))
    for i in range(gaps.shape[0]):
        r = (states[i, 0], states[i, 1], states[i, 2])
        for k in range(gaps.shape[1]):
            gap, n = sight_of(bodies, i, k, r, 0.0)
            gaps[i, k] = gap
            normals[i, k, 0], normals[i, k, 1], normals[i, k, 2] = n


def nearest_of(gaps: Floats, normals: Floats, position: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Gaps, points and normals of the nearest obstacles (N, count), of equals the first; inf and 0 for none."""
    missing = max(0, count - gaps.shape[1])
    gaps = np.pad(gaps, [(0, 0), (0, missing)], constant_values=np.inf)
    normals = np.pad(normals, [(0, 0), (0, missing), (0, 0)])
    order = np.argsort(gaps, axis=1, kind="stable")[:, :count]
    gaps, normals = np.take_along_axis(gaps, order, 1), np.take_along_axis(normals, order[..., None], 1)
    is_there = np.isfinite(gaps)[..., None]
    away = np.where(is_there, gaps[..., None], 0.0) * normals
    return gaps, np.where(is_there, position[:, None] - away, 0.0), np.where(is_there, normals, 0.0)


def sample(leading: tuple[int, ...], count: int, follows: bool) -> Quantities:
    """Quantities that a function can be tried with: a metre from the goal, and from each obstacle."""
    one, along = np.ones(leading), np.broadcast_to([1.0, 0.0, 0.0], (*leading, 3)).copy()
    shapes = {name: np.zeros((*leading, 3)) for name in ("position", "velocity", "acceleration", "jerk")}
    sides = np.broadcast_to(along[..., None, :], (*leading, count, 3)).copy()
    return Quantities(
        **shapes,
        attitude=np.broadcast_to(np.eye(3), (*leading, 3, 3)).copy(),
        body_rates=np.zeros((*leading, 3)),
        thrust=one,
        goal=along,
        distance=one,
        previous_distance=one,
        arrives=np.zeros(leading, dtype=np.bool_),
        clearance=one,
        violation=np.zeros(leading, dtype=np.bool_),
        terminated=np.zeros(leading, dtype=np.bool_),
        action=np.zeros((*leading, 4)),
        previous_action=np.zeros((*leading, 4)),
        reward=np.zeros(leading),
        gaps=np.ones((*leading, count)),
        points=sides,
        normals=-sides,
        reference=np.zeros((*leading, 5, 3)) if follows else None,
        error=one if follows else None,
    )
