"""What comes out of a file: shapes, and by how much some of them are larger than what the file says."""

from collections.abc import Iterable

from quadsafe_core.shapes import Shape


class Map(list[Shape]):
    """The obstacles of a file: a list, as ``obstacles=`` of ``gym.make`` takes it.

    Args:
        shapes: what is in the way.
        grown: the greatest radius by which convex parts were grown so that they cover what they stand for, m.
    """

    def __init__(self, shapes: Iterable[Shape] = (), grown: float = 0.0):
        super().__init__(shapes)
        self.grown = grown
