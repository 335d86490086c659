"""Bodies as kernels know them: a core that moves at constant velocity, grown by a ball.

| kind       | core, relative to its centre                                | axes                     | half              |
|------------|-------------------------------------------------------------|--------------------------|-------------------|
| SPHERE     | the centre                                                  |                          |                   |
| CAPSULE    | the segment from −l e to l e                                | e first                  | l                 |
| CYLINDER   | flat ends at ±l e, radius a                                 | e first                  | l, a              |
| BOX        | |e_i · p| ≤ l_i                                             | e_1, e_2, e_3            | l_1, l_2, l_3     |
| HULL       | the hull of its vertices                                    |                          |                   |
| ELLIPSOID  | Σ (e_i · p / l_i)² ≤ 1                                      | e_1, e_2, e_3            | l_1, l_2, l_3     |
| HALF_SPACE | m · p ≤ 0; its centre lies on the plane                     | m first, into free space |                   |
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ABSENT, SPHERE, CAPSULE, CYLINDER, BOX, HULL, ELLIPSOID, HALF_SPACE = range(8)

CORE = np.dtype(
    [
        ("kind", "i8"),
        ("axes", "f8", (3, 3)),  # unit vectors, one a row
        ("half", "f8", (3,)),  # m
        ("vertex", "i8"),  # where in the numbers the vertices of a hull begin: x, y, z, m
        ("vertices", "i8"),  # how many
        ("facet", "i8"),  # where its facets begin: outward unit normal, offset, m
        ("facets", "i8"),  # how many; 0 where the hull is flat
    ],
    align=True,
)


class Cores(NamedTuple):
    """The cores of N worlds among K bodies: (N, K) ``CORE``, and the numbers of their hulls, flat, m."""

    core: NDArray[np.void]
    numbers: NDArray[np.float64]
