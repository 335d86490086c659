"""What kernels pass to each other: spheres of one world, and what a certified flight keeps to."""

from typing import NamedTuple

import numpy as np


class ThrustBand(NamedTuple):
    """Least and greatest specific thrust ‖r̈ + g e3‖ and gravity, m/s²."""

    least: float
    most: float
    gravity: float


class MovingSpheres(NamedTuple):
    """Spheres of one world: centers (K, 3), velocities (K, 3), distances to keep (K,), 0 for an absent one."""

    center: np.ndarray
    velocity: np.ndarray
    keep_out: np.ndarray


class FlightLimits(NamedTuple):
    """What a certified flight keeps.

    The largest snap that is flown, and that a stop counts on, m/s⁴; the largest jerk, m/s³; the thrust band.
    """

    snap_max: float
    stop_snap_max: float
    jerk_max: float
    band: ThrustBand
