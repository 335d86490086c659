"""The way of a flight: openings to pass in order, then the goal, and how far a flight has come.

An opening is a level rectangle's worth of a vertical plane: it is passed where a flight crosses that plane along
``along``, within ``reach`` of the centre. What is left of the way from r, with the opening c_i next, is

    ‖r − c_i‖ + ‖c_i − c_{i+1}‖ + … + ‖c_last − goal‖
"""

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import norm, subtract, vector, write3

OPENING = np.dtype(
    [
        ("center", "f8", (3,)),  # m
        ("along", "f8", (2,)),  # the level unit vector across its plane, the way it is passed
        ("reach", "f8", (2,)),  # half of its width and of its height, m; 0 for one that is absent
        ("rest", "f8"),  # the way from its centre to the goal, m
    ],
    align=True,
)


@inline_kernel
def write_opening(opening, center, along, reach):
    """An opening; what is left of the way behind it is written later."""
    to, size = opening["along"], opening["reach"]
    write3(opening["center"], center)
    to[0], to[1], size[0], size[1] = along[0], along[1], reach[0], reach[1]


@kernel
def write_rests(openings, goal):
    """What is left of the way behind each opening of a row, the absent ones at its beginning."""
    rest, after = 0.0, goal
    for g in range(openings.shape[0] - 1, -1, -1):
        center = vector(openings[g]["center"])
        rest, after = rest + norm(subtract(after, center)), center
        openings[g]["rest"] = rest
