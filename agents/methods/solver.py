"""The solver of quadratic programmes, daqp, asked in one way, and only once it is needed."""

from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# What daqp takes for no bound.
NONE = 1e30


def check_solver() -> None:
    """Raise a ValueError where daqp is missing."""
    if find_spec("daqp") is None:
        raise ValueError('filter must have daqp, got none: pip install "quadsafe[methods]"')


def solved(H: Floats, f: Floats, A: Floats, low: Floats, high: Floats) -> Floats | None:
    """The x of least ½ xᵀH x + f·x with low ≤ (x, A x) ≤ high, or None where daqp says that there is none.

    What it answers is not believed to keep the constraints: who asks checks.

    Args:
        H: (Z, Z), positive definite.
        f: (Z,).
        A: (M, Z).
        low: (M,), or (B + M,) with bounds of the first B of x before them; −inf for none.
        high: as ``low``, +inf for none.
    """
    import daqp  # pyright: ignore[reportMissingImports] - an extra

    low, high = np.maximum(low, -NONE), np.minimum(high, NONE)
    x, _, flag, _ = daqp.solve(H, f, np.ascontiguousarray(A), high, low)
    return np.array(x) if flag > 0 and np.isfinite(x).all() else None
