"""The bound of what stands out of a union: never below dense samples, never far above them."""

import numpy as np
import pytest

from quadsafe_core.shapes import Box, Hull, Sphere
from quadsafe_env.maps.cover import ABSOLUTE, RELATIVE, farthest_outside

SQUARE = np.array([[[0, 0, 0], [2, 0, 0], [2, 1, 0]], [[0, 0, 0], [2, 1, 0], [0, 1, 0]]], dtype=float)


def sampled(triangles, bodies):
    """The greatest distance from the union among many points of each triangle."""
    grid = np.array([(i, j, 80 - i - j) for i in range(81) for j in range(81 - i)]) / 80
    points = grid @ triangles
    return max(0.0, np.min([body.distance(points) for body in bodies], axis=0).max())


@pytest.mark.parametrize("seed", range(20))
def test_random_triangles_stand_out_as_far_as_samples_say(seed):
    rng = np.random.default_rng(seed)
    bodies = [
        *(Hull(rng.normal(size=(8, 3)) + rng.normal(size=3)) for _ in range(rng.integers(1, 4))),
        Sphere(rng.normal(size=3), 0.8),
    ]
    triangles = rng.normal(size=(rng.integers(1, 6), 3, 3)) * rng.choice([0.1, 1.0])
    least, bound = sampled(triangles, bodies), farthest_outside(triangles, bodies)
    # Samples are at most 1 / 80 of an edge away from the farthest point.
    spacing = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max() / 80
    assert (
        least
        <= bound
        <= (1 + RELATIVE) * (least + spacing) + ABSOLUTE * np.ptp(triangles.reshape(-1, 3), axis=0).max()
    )


def test_two_boxes_cover_across_the_seam_between_them():
    left, right = Box((0.5, 0.5, 0), (1, 1, 0.2)), Box((1.5, 0.5, 0), (1, 1, 0.2))
    assert farthest_outside(SQUARE, [left, right]) <= 2 * ABSOLUTE
    assert farthest_outside(SQUARE, [left]) == pytest.approx(1.0, rel=0.11)


def test_a_gap_between_covered_corners_is_seen():
    left, right = Box((0.45, 0.5, 0), (1, 1, 0.2)), Box((1.55, 0.5, 0), (1, 1, 0.2))
    assert (np.minimum(left.distance(SQUARE), right.distance(SQUARE)) <= 0.0).all()
    assert 0.05 <= farthest_outside(SQUARE, [left, right]) <= 0.0555 + 2 * ABSOLUTE


def test_what_is_inside_does_not_stand_out():
    assert farthest_outside(SQUARE, [Box((1, 0.5, 0), (4, 4, 4)), Sphere((9, 9, 9), 1)]) == 0.0
