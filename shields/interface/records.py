"""What kernels pass to each other: what was measured, what is answered, what a certified flight keeps to.

Arrays in tuples are for kernels alone: from Python they would take microseconds to cross. What kernels of
``shields.backup`` and ``shields.methods`` are given has the same name, shape and unit everywhere:

| parameter       | what it is                                                                               |
|-----------------|------------------------------------------------------------------------------------------|
| i, k            | a row, a vehicle; a sphere of it; in batches n and k are N and K                         |
| x               | ``Flat``, world frame, SI; relative to a sphere where that is said                       |
| snap, wanted, u | 3 numbers, m/s⁴: any; the desired one; what would be flown                               |
| n               | a direction, 3 numbers, of length 1 in half-spaces                                       |
| spheres         | ``Obstacles`` beside a row i, else the ``MovingSpheres`` of one world                    |
| distance, keep  | to keep from a centre, m; ``share``: the same in radii                                   |
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


class ThrustBand(NamedTuple):
    """Least and greatest specific thrust ‖r̈ + g e3‖ and gravity, m/s²."""

    least: float
    most: float
    gravity: float


class MovingSpheres(NamedTuple):
    """Spheres of one world: centres (K, 3), m, velocities, m/s, distances to keep (K,), m, 0 for none."""

    center: np.ndarray
    velocity: np.ndarray
    keep_out: np.ndarray


class Obstacles(NamedTuple):
    """The spheres of N worlds: centres (N, K, 3), m, velocities (N, K, 3), m/s, radii (N, K), m, 0 for none.

    Whole arrays, as every view of a row is counted by its owner, which takes longer than a quick test.
    """

    center: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray


class Measured(NamedTuple):
    """What a shield is given: flat states (N, 4, 3), SI, the spheres, the desired snaps (N, 3), m/s⁴."""

    flat: np.ndarray
    spheres: Obstacles
    snap: np.ndarray


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
