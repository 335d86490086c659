"""Whether the state that came is the one that was to be expected, within the errors that were declared.

From the state x̂ of the last sample, and the snap that was flown since, the chain predicts the next one. With
errors E of the estimate and D of a period (``shields.settings.uncertainty``) the state that comes is off that
by at most

    E + A E + D        entry by entry, A the chain over a period

and where it is off by more, an assumption of the proof has failed: jitter, a lag, a push, a wrong model.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.vec3 import norm, subtract, triple, vector, write3
from shields.chains.flat_state import Flat, flown
from shields.settings.uncertainty import Uncertainty, chain_over, predicted_error

# Where nothing is declared: what the margin was measured to cover, m/s⁴ (``benchmarks/robustness.py``).
MEASURED_SNAP = 15.0
# Of the numbers that are compared.
ROUNDING = 1e-9
SENTENCE = (
    "the state that came is not the one predicted from the last: row {row} is off by {off} in r, v, a and j, "
    "beyond the declared {declared}; what flies it is not what the shield was told"
)


class Watch(NamedTuple):
    """What is remembered of N rows to compare with what comes.

    | field    | shape       | meaning                                                        |
    |----------|-------------|----------------------------------------------------------------|
    | last     | (N, 4, 3)   | the flat state of the last sample                              |
    | line     | (N, d+1, 3) | the answers that are on their way; the first is flown now      |
    | known    | (N,)        | samples since the row was reset                                |
    | off      | (N, 4)      | how far the last sample was off in r, v, a, j                  |
    | most     | (5,)        | how far it may be, and the period                              |
    """

    last: NDArray[np.float64]
    line: NDArray[np.float64]
    known: NDArray[np.int64]
    off: NDArray[np.float64]
    most: NDArray[np.float64]


def watch_of(rows: int, delay: int) -> Watch:
    """Memory for a number of rows and a delay in periods."""
    return Watch(
        np.zeros((rows, 4, 3)),
        np.zeros((rows, delay + 1, 3)),
        np.zeros(rows, dtype=np.int64),
        np.zeros((rows, 4)),
        np.zeros(5),
    )


def expectation(declared: Uncertainty | None, period: float, snap_max: float) -> NDArray[np.float64]:
    """(5,) how far a sample may be off the prediction in r, v, a and j, and the period.

    Args:
        declared: the errors, None for none.
        period: Δ, s.
        snap_max: longest snap that is flown, m/s⁴; a gain is a share of it.
    """
    told = Uncertainty(snap=MEASURED_SNAP) if declared is None else declared._replace(delay=0)
    error, added = predicted_error(told, period, snap_max)
    most = (error + chain_over(period)[0] @ error + added) * (1.0 + 1e-6)
    return np.append(most, period)


@inline_kernel
def watch_row(i, flat, answer, last, line, known, off, most):
    """Compare row i with its prediction, remember it; whether it was off by more than it may be."""
    x, is_off = Flat(triple(flat, i, 0), triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3)), False
    if known[i] > 0:
        was = Flat(triple(last, i, 0), triple(last, i, 1), triple(last, i, 2), triple(last, i, 3))
        p = flown(was, triple(line, i, 0), most[4])
        for order in range(4):
            off[i, order] = norm(subtract(x[order], p[order]))
            is_off |= not off[i, order] <= most[order] + ROUNDING * (1.0 + norm(p[order]))
    for order in range(4):
        write3(last[i, order], x[order])
    for place in range(line.shape[1] - 1):
        write3(line[i, place], triple(line, i, place + 1))
    write3(line[i, line.shape[1] - 1], vector(answer[i]))
    known[i] += 1
    return is_off
