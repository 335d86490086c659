"""The facets of a hull of points, those of a flat or needle-like hull too."""

import numpy as np
from numpy.typing import NDArray

# Of the greatest extent: what is thinner is taken for flat.
FLAT = 1e-12


def facets_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half-spaces whose intersection is the hull of points (V, 3), m, to rounding.

    Returns:
        (F, 4) outward unit normal, and the greatest height of the points along it, m.
    """
    normals = _normals(points)
    return np.column_stack([normals, (points @ normals.T).max(axis=0)])


def _normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    _, _, axes = np.linalg.svd(np.linalg.qr(points - points.mean(axis=0), mode="r"))
    along = (points - points[0]) @ axes.T
    extents = np.ptp(along, axis=0)
    size = extents.max()
    is_wide = extents > FLAT * size
    wide, thin = axes[is_wide], axes[~is_wide]
    # At one size along each axis a needle is no harder than a cube.
    scaled = along[:, is_wide] / extents[is_wide]
    outward = _normals_of_solid(scaled) / extents[is_wide] @ wide
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return np.vstack([thin, -thin, outward])


def _normals_of_solid(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outward normals of the facets of points (V, D) with an inside, D of 0 to 3."""
    dimension = points.shape[1]
    if dimension <= 1:
        return np.array([[1.0], [-1.0]])[:, :dimension][: 2 * dimension]
    from scipy.spatial import ConvexHull

    return np.unique(ConvexHull(points).equations[:, :dimension], axis=0)
