"""What kernels pass to each other: what was measured, what is answered, what a certified flight keeps to.

Arrays in tuples are for kernels alone: from Python they would take microseconds to cross. What kernels of
``shields.backup`` and ``shields.methods`` are given has the same name, shape and unit everywhere:

| parameter       | what it is                                                                               |
|-----------------|------------------------------------------------------------------------------------------|
| i, k            | a row, a vehicle; a body of it; in batches n and k are N and K                           |
| x               | ``Flat``, world frame, SI; relative to the centre of a body where that is said           |
| snap, wanted, u | 3 numbers, m/s⁴: any; the desired one; what would be flown                               |
| n               | a direction, 3 numbers, of length 1 in half-spaces                                       |
| bodies          | ``Bodies`` beside a row i, else the ``MovingBodies`` of one world                        |
| core            | of one body, ``Core``, or None among spheres alone, ``shields.interface.bodies``         |
| gap             | from the centre of a body, 3 numbers, m                                                  |
| distance, keep  | to keep from a core, m; ``share``: of the margin, that is kept too                       |
| kept            | ``Kept``, of one body                                                                    |
| plan            | a stored stop, ``shields.backup.stored_stop.PLAN``                                       |
| frame           | w, with which a stop ends, m/s                                                           |
| start, h        | when something begins, from now on, s; length of a segment of a stop, s                  |
| period          | Δ of control, s                                                                          |
| band, limits    | ``ThrustBand``, ``FlightLimits``                                                         |
| flight          | ``FlightRules``                                                                          |
| gains           | of a feedback on (r, v, a, j) or (v, a, j)                                               |
| settings, tube  | ``ShieldSettings`` and ``Width``, or None, of ``shields.methods.memory``                 |
| fact            | one row of ``FACTS``                                                                     |
"""

from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.vec3 import triple
from quadsafe_core.shapes.cores import Cores


class ThrustBand(NamedTuple):
    """Least and greatest specific thrust ‖r̈ + g e3‖ and gravity, m/s²."""

    least: float
    most: float
    gravity: float


class MovingBodies(NamedTuple):
    """Bodies of one world: centres (K, 3), m, velocities, m/s, distances to keep (K,), m, and their cores (K).

    Without cores all are spheres, of which one with distance 0 is absent.
    """

    center: np.ndarray
    velocity: np.ndarray
    keep_out: np.ndarray
    cores: Cores | None = None


class Bodies(NamedTuple):
    """The bodies of N worlds: centres (N, K, 3), m, velocities, m/s, radii (N, K), m, and their cores (N, K).

    Where no body moves, velocities are (1, K, 3) zeros: ``velocity_of``.
    Without cores all are spheres, of which one with radius 0 is absent.

    Whole arrays, as every view of a row is counted by its owner, which takes longer than a quick test.
    """

    center: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    cores: Cores | None = None


class BehindRows(NamedTuple):
    """Vehicles behind their leads: position, acceleration and jerk (N, 3, 3), SI; the lag, s."""

    places: np.ndarray
    lag: float


class Measured(NamedTuple):
    """What a shield is given: flat states (N, 4, 3), SI, the bodies, the desired snaps (N, 3), m/s⁴.

    With a lag they are leads, and what is behind them is there too.
    """

    flat: np.ndarray
    bodies: Bodies
    snap: np.ndarray
    behind: BehindRows | None = None


class Answers(NamedTuple):
    """What it answers with: safe snaps (N, 3), m/s⁴, and for each row the facts (N,) of ``Filtered``."""

    safe: np.ndarray
    facts: np.ndarray


class Demand(NamedTuple):
    """A half-space ``n·u ≥ least``, m/s⁴, the set value along n, and whether the state is in that set."""

    n: tuple
    least: float
    value: float
    is_admissible: bool


class FlightLimits(NamedTuple):
    """What a certified flight keeps.

    The largest snap that is flown, and that a stop counts on, m/s⁴; the largest jerk, m/s³; the thrust band.
    """

    snap_max: float
    stop_snap_max: float
    jerk_max: float
    band: ThrustBand


class FlightRules(NamedTuple):
    """How a vehicle is flown: the control period, s, the limits, the gains (4,) that hold it on a stop."""

    period: float
    limits: FlightLimits
    gains: tuple


@inline_kernel
def velocity_row(i, velocity):
    """Where the velocities of row i are: where no body moves, one row stands for all."""
    return min(i, velocity.shape[0] - 1)


@inline_kernel
def velocity_of(i, k, bodies):
    """The velocity of body k of row i, m/s."""
    return triple(bodies.velocity, velocity_row(i, bodies.velocity), k)
