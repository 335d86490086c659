"""Gates: a slalom through window frames, each of four capsules or four boxes.

The way from the start over two points before and behind each gate, on its axis, to the goal keeps ``CORRIDOR``
clear of every frame beyond the vehicle's radius; between the two points of a gate that, or half of what the gate
is wider than the vehicle, if less.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import write3
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_core.shapes.cores import BOX, CAPSULE
from quadsafe_env.tasks.drawn_bodies import UP, write_absent, write_core
from quadsafe_env.tasks.rooms import CORRIDOR
from quadsafe_env.tasks.scene_columns import columns_in, point, write_point
from quadsafe_env.tasks.scenes import STRIDE, Task, key_of
from quadsafe_env.tasks.way import write_opening, write_rests

FEWEST, MOST = 3, 6
BEAMS = 4
# Random numbers: those of the course, then eight for each gate.
COURSE_STREAM = 1 << 22
GATE_STREAM = COURSE_STREAM + 8
NUMBERS_EACH = 8
# The thickest beam's half, m, so much deep is a gate before and behind its plane.
DEPTH = 0.06
# Of the heading of a gate, rad: the way between two neighbours then stays in front of one and behind the other.
LARGEST_TURN = 0.25
# Between two gates, beside what they keep free before and behind them, m.
LEAST_GAP, LARGEST_GAP = 0.7, 1.1


class GateSizes(NamedTuple):
    """Of a course: inner width of its gates, m, how many, 0 for 3 to 6, and radius of the vehicle, m."""

    opening: float
    gates: int
    vehicle: float


class Gate(NamedTuple):
    """A gate: its centre, m, the level unit vector through it, half of its inner width and of its beams', m."""

    center: tuple[float, float, float]
    along: tuple[float, float]
    reach: float
    beam: float


@inline_kernel
def gate_count(key, sizes):
    """How many gates a scene has."""
    drawn = FEWEST + int(uniform(key, COURSE_STREAM, 0.0, MOST - FEWEST + 1.0))
    return sizes.gates if sizes.gates > 0 else drawn


@inline_kernel
def gap_before(key, g, sizes):
    """How far along x gate g stands behind the one before it, or behind the start, m."""
    free = 2.0 * (sizes.vehicle + CORRIDOR + DEPTH)
    return free + uniform(key, GATE_STREAM + NUMBERS_EACH * g, LEAST_GAP, LARGEST_GAP)


@inline_kernel
def course_length(key, count, sizes):
    """How far along x the goal is from the start, m."""
    length = 0.0
    for g in range(count + 1):
        length += gap_before(key, g, sizes)
    return length


@inline_kernel
def gate_of(key, g, x, sizes):
    """Gate g at x: left and right in turn by 0.2–0.8 m, within 0.5 m up and down, turned by up to 0.25 rad."""
    n = GATE_STREAM + NUMBERS_EACH * g
    is_left = (uniform(key, COURSE_STREAM + 1, 0.0, 1.0) < 0.5) == (g % 2 == 0)
    y = uniform(key, n + 1, 0.2, 0.8) * (1.0 if is_left else -1.0)
    turn = uniform(key, n + 3, -LARGEST_TURN, LARGEST_TURN)
    return Gate(
        (x, y, uniform(key, n + 2, -0.5, 0.5)),
        (math.cos(turn), math.sin(turn)),
        0.5 * sizes.opening,
        uniform(key, n + 4, 0.5 * DEPTH, DEPTH),
    )


@inline_kernel
def is_of_capsules_in(key, g):
    """Whether gate g is made of capsules, as every second one is."""
    return uniform(key, GATE_STREAM + NUMBERS_EACH * g + 5, 0.0, 1.0) < 0.5


@inline_kernel
def write_beam(core, center, gate, is_of_capsules, sideways, up):
    """A beam at −1 or 1 beside the opening, or below or above it."""
    (x, y, z), (ax, ay), across = gate.center, gate.along, gate.reach + gate.beam
    write3(center, (x - sideways * across * ay, y + sideways * across * ax, z + up * across))
    level, through = (-ay, ax, 0.0), (ax, ay, 0.0)
    along = level if sideways == 0.0 else UP
    if is_of_capsules:
        write_core(core, CAPSULE, along, through, (across, 0.0, 0.0))
    else:
        # The upright ones have the corners.
        length = gate.reach if sideways == 0.0 else across + gate.beam
        write_core(core, BOX, along, through, (length, gate.beam, gate.beam))


@kernel
def write_gate(cores, centers, gate, is_of_capsules):
    """The four beams of a gate: left, right, below, above."""
    for k in range(BEAMS):
        side = 2.0 * (k % 2) - 1.0
        sideways, up = (side, 0.0) if k < 2 else (0.0, side)
        write_beam(cores[k], centers[k], gate, is_of_capsules, sideways, up)


@kernel
def write_no_gate(cores, centers):
    """An empty place for a gate."""
    for k in range(BEAMS):
        write_absent(cores[k])
        write3(centers[k], (0.0, 0.0, 0.0))


@kernel
def gates_endpoints_batch(words, rows, attempt, sizes, memory):
    """A start before the first gate and a goal behind the last, both within half a metre of the x axis."""
    scenes = columns_in(memory)
    for i in rows:
        key, n = key_of(words, i), STRIDE * attempt
        half = 0.5 * course_length(key, gate_count(key, sizes), sizes)
        write_point(scenes.start, i, -half, uniform(key, n, -0.5, 0.5), uniform(key, n + 1, -0.5, 0.5))
        write_point(scenes.goal, i, half, uniform(key, n + 2, -0.5, 0.5), uniform(key, n + 3, -0.5, 0.5))


@kernel
def gates_bodies_batch(words, rows, sizes, memory, cores):
    """Four beams a gate, every second gate of capsules; places behind the last gate are empty."""
    scenes = columns_in(memory)
    n, k = cores.shape
    centers, radii = scenes.center.reshape((n, k, 3)), scenes.radius.reshape((n, k))
    for i in rows:
        key = key_of(words, i)
        count, x = gate_count(key, sizes), scenes.start[3 * i]
        for g in range(k // BEAMS):
            here = slice(BEAMS * g, BEAMS * g + BEAMS)
            if g < count:
                x += gap_before(key, g, sizes)
                gate = gate_of(key, g, x, sizes)
                write_gate(cores[i, here], centers[i, here], gate, is_of_capsules_in(key, g))
                radii[i, here] = sizes.vehicle + (gate.beam if is_of_capsules_in(key, g) else 0.0)
            else:
                write_no_gate(cores[i, here], centers[i, here])
                radii[i, here] = 0.0


@kernel
def gates_openings_batch(words, rows, sizes, memory, openings):
    """The gates of each scene in the last places, so that behind the last one is the goal."""
    scenes, step = columns_in(memory), sizes.vehicle + CORRIDOR + DEPTH
    for i in rows:
        key, x = key_of(words, i), scenes.start[3 * i]
        count = gate_count(key, sizes)
        first = openings.shape[1] - count
        for g in range(first):
            write_opening(openings[i, g], point(scenes.start, i), (1.0, 0.0), (0.0, 0.0), 0.0)
        for g in range(count):
            x += gap_before(key, g, sizes)
            gate = gate_of(key, g, x, sizes)
            write_opening(openings[i, first + g], gate.center, gate.along, (gate.reach, gate.reach), step)
        write_rests(openings[i], point(scenes.goal, i))


@dataclass(frozen=True)
class GatesTask(Task):
    """A slalom through window frames.

    ``opening`` is their inner width and height, m, ``gates`` how many there are, 0 for 3 to 6, and ``vehicle``
    the vehicle's radius, m.
    """

    opening: float = 0.8
    gates: int = 0
    vehicle: float = 0.0

    @property
    def _sizes(self) -> GateSizes:
        return GateSizes(self.opening, self.gates, self.vehicle)

    def endpoints(self, words, rows, attempt, memory):
        """See ``gates_endpoints_batch``."""
        gates_endpoints_batch(words, rows, attempt, self._sizes, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``gates_bodies_batch``."""
        gates_bodies_batch(words, rows, self._sizes, memory, cores)

    def openings(self, words, rows, memory, openings):
        """See ``gates_openings_batch``."""
        gates_openings_batch(words, rows, self._sizes, memory, openings)
