"""What a shield answers with."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

# What a shield decided for one plant, beside the snap; the fields of ``Filtered`` say what they mean.
FACTS = np.dtype(
    [
        (name, "f8")
        for name in (
            "correction",
            "value",
            "reserve",
            "obstacle",
            "in_set",
            "intervened",
            "fallback",
            "refused",
            "stopped",
            "certified",
        )
    ]
)
# Of one plant: a snap and the facts.
NUMBERS = 3 + len(FACTS.fields or ())


class Filtered:
    """Answer of a shield; each field has a leading N for a batch of N plants.

    Args:
        numbers: N safe snaps, then N times ten facts, flat.
        leading: (N,), or () for one plant.
    """

    __slots__ = ("_leading", "numbers")

    def __init__(self, numbers: NDArray[np.float64], leading: tuple[int, ...]):
        self.numbers, self._leading = numbers, leading

    def __iter__(self) -> Iterator[Any]:
        """The snap and the other fields in the order in which they stand here."""
        return (getattr(self, name) for name in FIELDS)

    def __repr__(self) -> str:
        fields = zip(FIELDS, self, strict=True)
        return f"Filtered({', '.join(f'{name}={field!r}' for name, field in fields)})"

    @property
    def snap(self) -> NDArray[np.float64]:
        """(…, 3) safe snap, m/s⁴."""
        if not self._leading:
            return self.numbers[:3]
        n = self._leading[0]
        return self.numbers[: 3 * n].reshape(n, 3)

    @property
    def facts(self) -> NDArray[np.void]:
        """(…) the fields below, in one array of records of floats."""
        n = self._leading[0] if self._leading else 1
        return self.numbers[3 * n :].view(FACTS).reshape(self._leading)

    @property
    def correction(self) -> Any:
        """(…) ‖safe − desired‖, m/s⁴."""
        return self.facts["correction"][()]

    @property
    def value(self) -> Any:
        """(…) least set value, m (each optional bound in its own unit); +inf without an obstacle."""
        return self.facts["value"][()]

    @property
    def reserve(self) -> Any:
        """(…) largest input a sphere asked for, in units of ū; above 1 the reserve was used."""
        return self.facts["reserve"][()]

    @property
    def obstacle(self) -> Any:
        """(…) index of the sphere that asked for the largest correction; −1 for none, or for the authority."""
        return self.facts["obstacle"].astype(np.int64)[()]

    @property
    def in_set(self) -> Any:
        """(…) whether ``value`` is at least 0."""
        return self._is("in_set")

    @property
    def intervened(self) -> Any:
        """(…) whether the safe snap differs from the desired one."""
        return self._is("intervened")

    @property
    def fallback(self) -> Any:
        """(…) whether the shield answered with its backup in place of the desired snap."""
        return self._is("fallback")

    @property
    def refused(self) -> Any:
        """(…) whether the snap nearest to the desired one could not be certified."""
        return self._is("refused")

    @property
    def stopped(self) -> Any:
        """(…) whether the stored stop was flown."""
        return self._is("stopped")

    @property
    def certified(self) -> Any:
        """(…) whether a stop that clears every sphere is stored; never so with method "cbf"."""
        return self._is("certified")

    def _is(self, fact: str) -> Any:
        return (self.facts[fact] != 0.0)[()]


FIELDS = ("snap", *(FACTS.names or ()))
