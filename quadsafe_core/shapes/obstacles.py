"""Many bodies in one packed form, as shields and plants are given them."""

from typing import Any

from numpy.typing import ArrayLike


class Obstacles:
    """Bodies of one world or of N, packed.

    Args:
        center: (N, K, 3) or (K, 3), m.
        radius: (N, K) or (K,), the distance to keep from each core, keep-out included, m.
        velocity: as ``center``, m/s, or None for all at rest.
        cores: None where all are spheres, of which one with radius 0 is absent; else the bytes behind them.
        keep_out: what ``radius`` holds beyond the bodies' own, m.
    """

    __slots__ = ("center", "cores", "keep_out", "radius", "velocity")

    def __init__(
        self, center: Any, radius: Any, velocity: Any = None, cores: Any = None, keep_out: float = 0.0
    ):
        self.center, self.radius, self.velocity = center, radius, velocity
        self.cores, self.keep_out = cores, keep_out

    @classmethod
    def spheres(cls, center: ArrayLike, radius: ArrayLike, velocity: ArrayLike | None = None) -> "Obstacles":
        """Spheres around centres (…, K, 3), m, at keep-out radii (…, K), m, 0 for none; no array is copied."""
        return cls(center, radius, velocity)
