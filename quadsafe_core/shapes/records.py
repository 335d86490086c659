"""Bodies as Python knows them, and as the records that kernels read."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes.cores import ABSENT, CORE, HULL, Cores
from quadsafe_core.shapes.facets import facets_of

# So that ten to the number of its digits is a float, m.
LEAST_SIZE = 1e-200
NO_VERTICES = np.zeros((0, 3))


class Body(NamedTuple):
    """A body: the kind, axes (3, 3) and half lengths of its core as in ``CORE``, its centre and its ball.

    Vertices (V, 3) are those of a hull, relative to the centre, m.
    """

    kind: int
    center: NDArray[np.float64]
    radius: float
    axes: NDArray[np.float64] = np.eye(3)
    half: Sequence[float] = (0.0, 0.0, 0.0)
    vertices: NDArray[np.float64] = NO_VERTICES


def frame_along(e: Sequence[float]) -> NDArray[np.float64]:
    """Three axes, a row each, of which the first is the unit vector e (Duff et al., JCGT 6(1), 2017)."""
    x, y, z = e
    s = math.copysign(1.0, z)
    a = -1.0 / (s + z)
    return np.array([(x, y, z), (1.0 + s * x * x * a, s * x * y * a, -s * x), (x * y * a, s + y * y * a, -y)])


def as_written(values: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Numbers of few digits where sums with numbers of a size have left rounding at the end of them."""
    rounding = 2 * math.ulp(max(size, LEAST_SIZE))
    short = np.round(values, -math.ceil(math.log10(4 * rounding)))
    return np.where(np.abs(short - values) <= rounding, short, values)


def core_bytes(worlds: Sequence[Sequence[Body]], places: int) -> NDArray[np.uint8]:
    """The cores of worlds in so many places, (N, K) ``CORE``, and behind them the numbers of their hulls."""
    core = np.zeros((len(worlds), places), dtype=CORE)
    hulls = _Numbers()
    for row, bodies in zip(core, worlds, strict=True):
        for record, body in zip(row, bodies, strict=False):
            record["kind"], record["axes"], record["half"] = body.kind, body.axes, body.half
            if body.kind == HULL:
                hulls.write(record, body.vertices)
    # How many there are comes first: behind the records of fewer worlds something else would.
    numbers = np.concatenate([np.array([float(hulls.end)]), *hulls.parts])
    return np.concatenate([core.reshape(-1).view(np.uint8), numbers.view(np.uint8)])


def core_at(cores: Cores, i: int, k: int, center: Iterable[float], radius: float) -> Body | None:
    """The body in a place, or None where it is absent."""
    record = cores.core[i, k]
    kind, first = int(record["kind"]), int(record["vertex"])
    if kind == ABSENT:
        return None
    vertices = cores.numbers[first : first + 3 * int(record["vertices"])].reshape(-1, 3)
    return Body(kind, np.array(center), radius, record["axes"], record["half"].tolist(), vertices)


class _Numbers:
    """The numbers of hulls, one behind the other; hulls of the same vertices share theirs."""

    def __init__(self):
        self.parts: list[NDArray[np.float64]] = []
        self.starts: dict[bytes, int] = {}
        self.end = 1

    def write(self, record: Any, vertices: NDArray[np.float64]) -> None:
        """Add those of a hull, and where they are into its record."""
        key = vertices.tobytes()
        numbers = _hull_numbers(key)
        if key not in self.starts:
            self.parts.append(numbers)
            self.starts[key], self.end = self.end, self.end + numbers.size
        start = self.starts[key]
        record["vertex"], record["vertices"], record["facet"] = start, len(vertices), start + vertices.size
        record["facets"] = (numbers.size - vertices.size) // 4


@lru_cache(maxsize=1024)
def _hull_numbers(vertices: bytes) -> NDArray[np.float64]:
    """Vertices of a hull, and its facets behind them, flat."""
    points = np.frombuffer(vertices).reshape(-1, 3)
    return np.concatenate([points.ravel(), facets_of(points).ravel()])
