"""What filters that count on a held backup share: the search for an admitted input, and the batch."""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel

# Equal steps towards the backup until one is admitted, then halvings of that step.
SCAN, BISECTIONS = 8, 30


@inline_kernel
def nearest_admitted(admits, x, wanted, backup, limits, target):
    """An input between ``wanted``, which misses the target, and the backup, near the first that reaches it.

    Args:
        admits: kernel (x, u, limits, target) that says whether G(u) reaches the target.
        x: the state.
        wanted, backup: inputs.
        limits: what ``admits`` needs to know.
        target: of G.
    """
    missed, admitted = wanted, backup
    for i in range(1, SCAN):
        u = wanted + (backup - wanted) * i / SCAN
        if admits(x, u, limits, target):
            admitted = u
            break
        missed = u
    for _ in range(BISECTIONS):
        u = 0.5 * (missed + admitted)
        if admits(x, u, limits, target):
            admitted = u
        else:
            missed = u
    return admitted


def filtered_rows(
    batch, rows: NDArray[np.float64], wanted: NDArray[np.float64], limits: tuple, holding: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Inputs, V, and whether x is in the set, (N,) each, by a batch of held filters; ``holding``: Δ in s, γ."""
    u, value, in_set = np.empty(len(rows)), np.empty(len(rows)), np.empty(len(rows), dtype=np.bool_)
    batch(rows, wanted, limits, holding, u, value, in_set)
    return u, value, in_set
