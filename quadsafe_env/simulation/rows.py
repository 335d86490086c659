"""What a world remembers of its rows: columns of one array, which kernels are given as it is.

An array costs a call from Python 80 ns, so that one is cheaper than ten. The numbers of a field lie together,
not those of a row: a filter is given its arguments as contiguous arrays.
"""

from collections.abc import Mapping
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import LANES, aligned_rows
from quadsafe_env.simulation.block import LINES
from quadsafe_env.vehicle.state import STATE_SIZE

OUTCOMES, FLAGS = 3, 8
# What a world has as views of its memory: a copy makes them anew.
COLUMNS = frozenset(
    [
        "states",
        "scenes",
        "obstacles",
        "openings",
        "outcomes",
        "flags",
        "_flat",
        "_snap",
        "_yaw_acceleration",
        "_table",
    ]
)


class Rows(NamedTuple):
    """The columns of M rows, flat; M is N, up to whole blocks of sixteen.

    | field            | of a row | laid out     | meaning                                                  |
    |------------------|----------|--------------|----------------------------------------------------------|
    | state            | 20       | row by row   | as in ``quadsafe_env.vehicle.state``                     |
    | flat             | 4 × 3    | row by row   | r, ṙ, r̈, r⃛ for the filter, m, m/s, m/s², m/s³           |
    | snap             | 3        | row by row   | desired, for the filter, m/s⁴                            |
    | yaw_acceleration | 1        | row by row   | desired, rad/s²                                          |
    | table            | 14       | in lanes     | the lines of ``quadsafe_env.simulation.block``           |
    | outcome          | 3        | line by line | reward, cost and clearance, m, of the last policy step   |
    | flags            | 8 bool   | line by line | of the last policy step, as in ``episode``               |
    """

    state: NDArray[np.float64]
    flat: NDArray[np.float64]
    snap: NDArray[np.float64]
    yaw_acceleration: NDArray[np.float64]
    table: NDArray[np.float64]
    outcome: NDArray[np.float64]
    flags: NDArray[np.bool_]


# float64 of a row in each column, and before it.
NUMBERS: Any = Rows(STATE_SIZE, 12, 3, 1, LINES, OUTCOMES, FLAGS // 8)  # type: ignore[arg-type]
AT: Any = Rows(*accumulate(NUMBERS[:-1], initial=0))  # type: ignore[arg-type]
SIZE = sum(NUMBERS)


def rows_of(memory):
    """The columns within the memory (SIZE, M) of a world."""
    numbers, m = memory.reshape(-1), memory.shape[1]
    return Rows(
        state=numbers[AT.state * m : AT.flat * m],
        flat=numbers[AT.flat * m : AT.snap * m],
        snap=numbers[AT.snap * m : AT.yaw_acceleration * m],
        yaw_acceleration=numbers[AT.yaw_acceleration * m : AT.table * m],
        table=numbers[AT.table * m : AT.outcome * m],
        outcome=numbers[AT.outcome * m : AT.flags * m],
        flags=numbers[AT.flags * m : SIZE * m].view(np.bool_),
    )


rows_in = inline_kernel(rows_of)


def memory_of(n: int) -> NDArray[np.float64]:
    """Memory of ``n`` rows, zeros."""
    memory = aligned_rows(SIZE, -(-n // LANES) * LANES)
    memory[:] = 0.0
    return memory


def restore_arrays(own: Mapping[str, NDArray], snapshot: Mapping[str, NDArray], n: int) -> None:
    """Write the arrays of a snapshot into those that a world of ``n`` rows remembers.

    Raises:
        ValueError: for other arrays.
    """
    found = {name: (array.shape, array.dtype) for name, array in snapshot.items()}
    if found != {name: (array.shape, array.dtype) for name, array in own.items()}:
        raise ValueError(f"snapshot must be one of {n} rows in equal scenes, got arrays {found}")
    for name, array in own.items():
        array[...] = snapshot[name]
