"""Starts and goals: those that a user gives, and how often the straight way between them is blocked.

A start, or a goal, is drawn from one of K boxes; a point is the smallest box. The straight way of a scene is
blocked if who flies along it from the beginning on, at ``CRUISE``, enters what is to be kept clear of an
obstacle, at rest or moving.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, dot, norm, subtract, vector
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_env.tasks.scene_bodies import Bodies, bodies_in, gap_of
from quadsafe_env.tasks.scene_columns import columns_in, point, write_point
from quadsafe_env.tasks.scenes import FREE_SPACE, LEAST_WAY, STRIDE, Task, key_of

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]
NO_BOXES = np.zeros((0, 2, 3))
# Random numbers: whether a scene is to be blocked, then eight for each attempt.
ENDS_STREAM = 1 << 23
# Where one draw in 300 is clear, or blocked, all but 3 of 100 scenes find one that is.
DRAWS = 1024
CRUISE = 1.0  # m/s
# Least step along a way, m: a body that is entered for less may be missed.
LEAST_STEP = 0.01
LEAST_SQUARED = 1e-12  # m²


@kernel
def given_ends_batch(words, rows, attempt, starts, goals, memory):
    """A start and a goal out of boxes (K, 2, 3); where there are none, what is there stays."""
    scenes = columns_in(memory)
    for i in rows:
        key, n = key_of(words, i), ENDS_STREAM + STRIDE * (1 + attempt)
        which = uniform(key, n, 0.0, 1.0)
        # Lists of one length are pairs.
        other = which if starts.shape[0] == goals.shape[0] else uniform(key, n + 1, 0.0, 1.0)
        if starts.shape[0] > 0:
            _write_from(starts, which, key, n + 2, scenes.start, i)
        if goals.shape[0] > 0:
            _write_from(goals, other, key, n + 5, scenes.goal, i)


@inline_kernel
def _write_from(boxes, which, key, n, points, i):
    """A point out of one of the boxes, chosen by a number in [0, 1)."""
    box = boxes[int(which * boxes.shape[0])]
    low, high = vector(box[0]), vector(box[1])
    write_point(
        points,
        i,
        uniform(key, n, low[0], high[0]),
        uniform(key, n + 1, low[1], high[1]),
        uniform(key, n + 2, low[2], high[2]),
    )


@kernel
def flag_wanted(words, rows, share, out):
    """Flag the rows whose straight way is to be blocked: this share of all scenes."""
    for i in rows:
        out[i] = uniform(key_of(words, i), ENDS_STREAM, 0.0, 1.0) < share


@kernel
def blocked_rows(rows, memory, out):
    """Flag the rows whose straight way is blocked by a sphere at rest."""
    scenes = columns_in(memory)
    n, k = memory.shape[1], scenes.sphere_count
    centers, radii = scenes.center.reshape((n, k, 3)), scenes.radius.reshape((n, k))
    for i in rows:
        start = point(scenes.start, i)
        way = subtract(point(scenes.goal, i), start)
        out[i] = False
        for j in range(k):
            x = subtract(vector(centers[i, j]), start)
            along = min(max(dot(x, way) / max(dot(way, way), LEAST_SQUARED), 0.0), 1.0)
            out[i] |= norm(combined(x, -along, way)) < radii[i, j]


@kernel
def blocked_among(rows, scene_memory, memory, out):
    """Flag the rows whose straight way is blocked by a body of any kind, from where it is at the beginning."""
    scenes, b = columns_in(scene_memory), bodies_in(scene_memory, memory)
    bodies = Bodies(b.home, b.radius, b.velocity, b.home, b.bound, b.seen, b.core, b.numbers, b.openings)
    for i in rows:
        start, goal = point(scenes.start, i), point(scenes.goal, i)
        out[i] = False
        for k in range(b.radius.shape[1]):
            out[i] |= _is_in_the_way(bodies, i, k, start, goal)


@kernel
def _is_in_the_way(bodies, row, k, start, goal):
    """Whether a body blocks the straight way: a march with steps that cannot reach it."""
    way, last, s = subtract(goal, start), math.inf, 0.0
    length = norm(way)
    closing = 1.0 + norm(vector(bodies.velocity[row, k])) / CRUISE
    while s < length:
        gap = gap_of(bodies, row, k, combined(start, s / length, way), s / CRUISE)
        if gap < 0.0:
            return True
        # The distance from a convex body is convex along the way: it rises from here on.
        if gap > last:
            return False
        last = gap
        s += max(gap / closing, LEAST_STEP)
    return gap_of(bodies, row, k, goal, length / CRUISE) < 0.0


@dataclass(frozen=True, eq=False)
class GivenEnds(Task):
    """A task whose starts, goals or both are drawn from boxes (K, 2, 3), m; those of ``own`` where K is 0."""

    own: Task | None = None
    starts: NDArray[np.float64] = field(default_factory=lambda: NO_BOXES)
    goals: NDArray[np.float64] = field(default_factory=lambda: NO_BOXES)

    def endpoints(self, words, rows, attempt, memory):
        """See ``given_ends_batch``."""
        if self.own is not None and not (len(self.starts) and len(self.goals)):
            self.own.endpoints(words, rows, attempt, memory)
        given_ends_batch(words, rows, attempt, self.starts, self.goals, memory)


def with_given_ends(task: Task, starts: NDArray[np.float64], goals: NDArray[np.float64]) -> GivenEnds:
    """The task with starts and goals from boxes (K, 2, 3), m; its own where K is 0."""
    same = {one.name: getattr(task, one.name) for one in fields(Task)}
    return GivenEnds(**same, own=task, starts=starts, goals=goals)


def draw_ends(
    task: Task,
    words: NDArray[np.int64],
    rows: Rows,
    memory: NDArray[np.float64],
    flag_crowded: Callable[[Rows, Flags], None],
    flag_blocked: Callable[[Rows, Flags], None],
) -> None:
    """Draw start and goal until they are clear, and blocked in the share ``task.blocked`` of scenes.

    A scene that is to be blocked and cannot be in ``DRAWS`` draws is the first clear one.

    Args:
        task: that draws.
        words: (N, 2) integers of the scenes.
        rows: (M,) indices.
        memory: of the scenes.
        flag_crowded: writes into (N,) whether start and goal are not clear, for given rows.
        flag_blocked: writes into (N,) whether their straight way is blocked.

    Raises:
        ValueError: if they are not clear after so many draws.
    """
    _draw_clear(task, words, rows, memory, flag_crowded)
    if task.blocked == 0.0:
        return
    wanted, crowded, blocked = np.zeros((3, memory.shape[1]), dtype=np.bool_)
    flag_wanted(words, rows, task.blocked, wanted)
    flag_blocked(rows, blocked)
    rows = rows[wanted[rows] & ~blocked[rows]]
    for attempt in range(DRAWS):
        if not rows.size:
            return
        task.endpoints(words, rows, attempt, memory)
        flag_crowded(rows, crowded)
        flag_blocked(rows, blocked)
        rows = rows[crowded[rows] | ~blocked[rows]]
    _draw_clear(task, words, rows, memory, flag_crowded)


def _draw_clear(task: Task, words, rows: Rows, memory, flag_crowded: Callable[[Rows, Flags], None]) -> None:
    crowded = np.zeros(memory.shape[1], dtype=np.bool_)
    for attempt in range(DRAWS):
        task.endpoints(words, rows, attempt, memory)
        flag_crowded(rows, crowded)
        rows = rows[crowded[rows]]
        if not rows.size:
            return
    raise ValueError(
        f"obstacles and bounds must leave start and goal {FREE_SPACE} m clear, and these be {LEAST_WAY} m "
        f"apart, got no such scene in {DRAWS} draws"
    )
