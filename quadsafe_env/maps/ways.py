"""Whether there is a way around the obstacles of a map at all, on a grid."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import HalfSpace, Obstacles

# Cells along the longest side: first few, and where these find no way, more.
COARSE, FINE = 32, 96
# Beyond starts and goals the grid goes on for this, m, and around every body that it holds.
AROUND = 1.0


def ways_around(
    starts: NDArray[np.float64], goals: NDArray[np.float64], given: Obstacles
) -> tuple[float, float]:
    """The share of pairs that a way of free cells joins, and the length of a cell, m.

    A cell is free if a vehicle at its centre keeps its distance from every obstacle, as these stand at first;
    cells that share a face are neighbours. A narrower way may be missed, and what is thinner
    than one, keep-out included, be passed through.

    Args:
        starts, goals: (M, 3), m, M >= 1.
        given: packed obstacles of one world.
    """
    share, cell = _ways_on_grid(starts, goals, given, COARSE)
    return (share, cell) if share == 1.0 else _ways_on_grid(starts, goals, given, FINE)


def _ways_on_grid(starts, goals, given: Obstacles, cells: int) -> tuple[float, float]:
    from scipy.ndimage import label

    low, high = _box(np.concatenate([starts, goals]), given)
    cell = float((high - low).max()) / cells
    counts = np.maximum(1, np.ceil((high - low) / cell).astype(int))
    axes = [at + cell * (np.arange(count) + 0.5) for at, count in zip(low, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    is_free = np.ones(points.shape[:3], dtype=np.bool_)
    for shape in given:
        is_free &= shape.distance(points) >= given.keep_out
    labelled: Any = label(is_free)
    regions = labelled[0]
    pairs = zip(starts, goals, strict=True)
    joined = [_regions_near(a, regions, low, cell) & _regions_near(b, regions, low, cell) for a, b in pairs]
    return float(np.mean([bool(regions) for regions in joined])), cell


def _box(ends: NDArray[np.float64], given: Obstacles) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Starts and goals, and the bodies among and beside them with a way around."""
    low, high = ends.min(axis=0) - AROUND, ends.max(axis=0) + AROUND
    for shape in given:
        if not isinstance(shape, HalfSpace):
            least, most = np.diag(shape.support(-np.eye(3))), np.diag(shape.support(np.eye(3)))
            if (least < high).all() and (most > low).all():
                low, high = np.minimum(low, least - AROUND), np.maximum(high, most + AROUND)
    return low, high


def _regions_near(point, regions, low, cell: float) -> set[int]:
    """The free regions within a cell of a point."""
    at = np.clip(((point - low) / cell).astype(int), 0, np.array(regions.shape) - 1)
    around = tuple(slice(max(0, i - 1), i + 2) for i in at)
    return set(np.unique(regions[around]).tolist()) - {0}
