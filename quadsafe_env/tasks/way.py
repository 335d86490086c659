"""The way of a flight: openings to pass in order, then the goal.

An opening is a rectangle of a vertical plane. It is passed where a flight crosses the plane along ``along``,
within ``reach`` of the centre. What is left of the way from r, with the opening c_i next, is

    ‖r − c_i‖ + ‖c_i − c_{i+1}‖ + … + ‖c_last − goal‖

Kernels are given ``openings``, those of one row (G,) or of all (N, G); ``block`` is one of
``quadsafe_env.simulation.block``.
"""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import norm, subtract, vector, write3

OPENING = np.dtype(
    [
        ("center", "f8", (3,)),  # m
        ("along", "f8", (2,)),  # the level unit vector across its plane, the way it is passed
        ("reach", "f8", (2,)),  # half of its width and of its height, m; 0 for one that is absent
        ("step", "f8"),  # so far before and behind its centre, along, a way that is free turns, m
        ("rest", "f8"),  # the way from its centre to the goal, m
        ("side", "f8"),  # how far the vehicle is behind the plane, m
        ("is_passed", "i8"),  # 1 if it was passed in this episode, or is absent
    ],
    align=True,
)


@inline_kernel
def write_opening(opening, center, along, reach, step):
    """An opening; what is left of the way behind it is written later."""
    opening["step"] = step
    to, size = opening["along"], opening["reach"]
    write3(opening["center"], center)
    to[0], to[1], size[0], size[1] = along[0], along[1], reach[0], reach[1]


@kernel
def write_rests(openings, goal):
    """What is left of the way behind each opening of a row; the absent ones are its first."""
    rest, after = 0.0, goal
    for g in range(openings.shape[0] - 1, -1, -1):
        center = vector(openings[g]["center"])
        rest, after = rest + norm(subtract(after, center)), center
        openings[g]["rest"] = rest


@inline_kernel
def seen_from(opening, p):
    """How far p is behind the plane of an opening, and whether it is within its reach."""
    along, reach = opening["along"], opening["reach"]
    x, y, z = subtract(p, vector(opening["center"]))
    behind, beside = along[0] * x + along[1] * y, along[0] * y - along[1] * x
    return behind, (abs(beside) <= reach[0]) & (abs(z) <= reach[1])


@inline_kernel
def next_opening(openings):
    """The first opening of a row that is not passed; their number where all are."""
    for g in range(openings.shape[0]):
        if openings[g]["is_passed"] == 0:
            return g
    return openings.shape[0]


@inline_kernel
def begin_way(openings, p):
    """None of the openings of a row is passed; the episode begins at p."""
    for g in range(openings.shape[0]):
        opening = openings[g]
        reach = opening["reach"]
        opening["is_passed"] = 0 if reach[0] > 0.0 else 1
        opening["side"] = seen_from(opening, p)[0]


@inline_kernel
def rest_behind(openings, g):
    """The way from opening g of a row to the goal, m; 0 for the goal itself."""
    return openings[g]["rest"] if g < openings.shape[0] else 0.0


@inline_kernel
def target_of(openings, goal):
    """The centre of the next opening of a row, or the goal behind the last."""
    g = next_opening(openings)
    return vector(openings[g]["center"]) if g < openings.shape[0] else goal


@kernel
def go_on(openings, p):
    """The vehicle of a row is at p now; the length of the way between what was next and what is next now, m."""
    g = next_opening(openings)
    if g < openings.shape[0]:
        behind, is_within = seen_from(openings[g], p)
        if openings[g]["side"] < 0.0 and behind >= 0.0 and is_within:
            openings[g]["is_passed"] = 1
    for k in range(openings.shape[0]):
        openings[k]["side"] = seen_from(openings[k], p)[0]
    return rest_behind(openings, g) - rest_behind(openings, next_opening(openings))


def corners_of(start: NDArray[np.float64], openings: NDArray[np.void], goal: NDArray[np.float64]) -> NDArray:
    """The corners of the way from start to goal that is free by construction: (2 + 2 G, 3), m."""
    there = openings[openings["reach"][:, 0] > 0.0]
    steps = np.column_stack([there["along"] * there["step"][:, None], np.zeros(len(there))])
    turns = np.stack([there["center"] - steps, there["center"] + steps], axis=1).reshape(-1, 3)
    return np.vstack([start, turns, goal])
