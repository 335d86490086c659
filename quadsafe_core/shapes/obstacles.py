"""Many bodies in one packed form, as shields and plants are given them."""

from collections.abc import Iterator, Sequence
from numbers import Number
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import keywords_known_to, non_negative_number, shaped_array
from quadsafe_core.shapes.cores import SPHERE, are_within, cores_of
from quadsafe_core.shapes.flat_shapes import Box, HalfSpace, Hull
from quadsafe_core.shapes.reading import entries_of, shapes_from
from quadsafe_core.shapes.records import Body, core_at, core_bytes
from quadsafe_core.shapes.round_shapes import Capsule, Cylinder, Ellipsoid, Sphere
from quadsafe_core.shapes.shape import AT_REST, Shape

# In the order of the kinds of cores, from SPHERE on.
OF_KIND: tuple[Any, ...] = (Sphere, Capsule, Cylinder, Box, Hull, Ellipsoid, HalfSpace)


class Obstacles:
    """Bodies of one world or of N, packed.

    Iterating over one world gives its shapes as they stand, without keep-out; over N, a list for each.

    Args:
        center: (N, K, 3) or (K, 3), m.
        radius: (N, K) or (K,), the distance to keep from each core, keep-out included, m.
        velocity: as ``center``, m/s, or None for all at rest.
        cores: None where all are spheres, of which one with radius 0 is absent; else bytes, (N, K) ``CORE``
            and behind them the numbers of hulls.
        keep_out: what ``radius`` holds beyond the bodies' own, m.
    """

    __slots__ = ("center", "cores", "keep_out", "radius", "velocity")
    __hash__ = None  # type: ignore[assignment]

    def __init__(
        self,
        center: NDArray[np.float64],
        radius: NDArray[np.float64],
        velocity: NDArray[np.float64] | None = None,
        cores: NDArray[np.uint8] | None = None,
        keep_out: float = 0.0,
    ):
        self.center, self.radius, self.velocity = center, radius, velocity
        self.cores, self.keep_out = cores, keep_out

    @classmethod
    @keywords_known_to("Obstacles.spheres")
    def spheres(cls, center: ArrayLike, radius: ArrayLike, velocity: ArrayLike | None = None) -> "Obstacles":
        """Spheres at keep-out radii; what are arrays of float64 in C order are not copied.

        Args:
            center: (N, K, 3) or (K, 3), m.
            radius: (N, K) or (K,), m; 0 for none in a place.
            velocity: as ``center``, m/s, or None for all at rest.

        Raises:
            TypeError, ValueError: for wrong types and shapes; of numbers nothing is checked.
        """
        centers, radii = shaped_array("center", center, ("K", 3)), shaped_array("radius", radius, ("K",))
        velocities = None if velocity is None else shaped_array("velocity", velocity, ("K", 3))
        if centers.ndim > 3:
            raise ValueError(f"center must have shape (K, 3) or (N, K, 3), got {centers.shape}")
        if radii.shape != centers.shape[:-1]:
            raise ValueError(f"radius must have shape {centers.shape[:-1]} as center has, got {radii.shape}")
        if velocities is not None and velocities.shape != centers.shape:
            raise ValueError(f"velocity must have shape {centers.shape} as center has, got {velocities.shape}")
        return cls(centers, radii, velocities)

    @classmethod
    @keywords_known_to("Obstacles.pack")
    def pack(cls, shapes: Sequence[Any], keep_out: float = 0.0) -> "Obstacles":
        """Shapes of one world, or of N worlds, in as many places as the fullest of them has.

        Args:
            shapes: a list of shapes, mappings or rows [x, y, z, radius], as in ``shape_from``, or N such lists.
            keep_out: a distance to keep beyond each, m, >= 0.

        Raises:
            TypeError, ValueError: for what is no shape.
        """
        keep_out = non_negative_number("keep_out", keep_out)
        entries = entries_of(shapes)
        if not entries or not all(map(_is_world, entries)):
            packed = cls._of_worlds([shapes_from(entries)], keep_out)
            return packed._with_leading(packed.radius.shape[1:])
        worlds = [shapes_from(world, f"obstacles[{i}]") for i, world in enumerate(entries)]
        return cls._of_worlds(worlds, keep_out)

    @classmethod
    def _of_worlds(cls, worlds: Sequence[Sequence[Shape]], keep_out: float) -> "Obstacles":
        bodies = [[shape.body() for shape in world] for world in worlds]
        n, k = len(worlds), max(map(len, worlds), default=0)
        center, radius, velocity = np.zeros((n, k, 3)), np.zeros((n, k)), np.zeros((n, k, 3))
        for i, world in enumerate(worlds):
            for j, shape in enumerate(world):
                center[i, j], radius[i, j] = bodies[i][j].center, bodies[i][j].radius + keep_out
                velocity[i, j] = shape.velocity  # type: ignore[attr-defined]
        are_spheres = all(body.kind == SPHERE for world in bodies for body in world)
        cores = None if are_spheres else core_bytes(bodies, k)
        return cls(center, radius, velocity if velocity.any() else None, cores, keep_out)

    def _with_leading(self, places: tuple[int, ...]) -> "Obstacles":
        velocity = None if self.velocity is None else self.velocity.reshape(*places, 3)
        center, radius = self.center.reshape(*places, 3), self.radius.reshape(places)
        return Obstacles(center, radius, velocity, self.cores, self.keep_out)

    def __len__(self) -> int:
        return len(self.radius)

    def __iter__(self) -> Iterator[Any]:
        worlds = self._worlds()
        return iter(worlds if self.radius.ndim > 1 else worlds[0])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Obstacles):
            return NotImplemented
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in self.__slots__)  # type: ignore

    def __repr__(self) -> str:
        if self.radius.ndim > 1:
            return f"<Obstacles: {self.radius.shape[0]} worlds of {self.radius.shape[1]} places>"
        return f"Obstacles.pack({list(self)}, keep_out={self.keep_out})"

    def _worlds(self) -> list[list[Shape]]:
        wide = self if self.radius.ndim > 1 else self._with_leading((1, *self.radius.shape))
        n, k = wide.radius.shape
        if self.cores is not None and not are_within(self.cores, n, k):
            raise ValueError(f"cores must be those of {(n, k)} bodies, got others")
        found = [[wide._shape_at(i, j) for j in range(k)] for i in range(n)]
        return [[shape for shape in world if shape is not None] for world in found]

    def _shape_at(self, i: int, k: int) -> Shape | None:
        center, radius = self.center[i, k], _without(self.keep_out, float(self.radius[i, k]))
        velocity = AT_REST if self.velocity is None else self.velocity[i, k]
        if self.cores is not None:
            body = core_at(cores_of(self.cores, *self.radius.shape), i, k, center, radius)
        else:
            body = Body(SPHERE, center, radius) if self.radius[i, k] > 0.0 else None
        return None if body is None else OF_KIND[body.kind - SPHERE].of_body(body, velocity)


def _is_world(value: Any) -> bool:
    """Whether something is a list of shapes, not one that is written as a row of numbers."""
    if not isinstance(value, list | tuple | np.ndarray):
        return False
    return not any(isinstance(entry, Number) for entry in value)


def _without(keep_out: float, radius: float) -> float:
    """The number of fewest digits to which keep-out was added, if there is one that gives these bits."""
    bare = radius - keep_out
    candidates = (round(bare, digits) for digits in range(17))
    return next((found for found in candidates if found + keep_out == radius), bare)
