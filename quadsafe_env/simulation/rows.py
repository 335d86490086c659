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
from quadsafe_env.simulation.block import FLAGS, NUMBERS
from quadsafe_env.vehicle.state import STATE_SIZE

# What a world has as views of its memory: a copy makes them anew.
COLUMNS = frozenset(
    [
        "states",
        "scenes",
        "obstacles",
        "openings",
        "flags",
        "_kept",
        "_yaw_acceleration",
        "table",
    ]
)


class Rows(NamedTuple):
    """The columns of M rows, flat; M is N, up to whole blocks of sixteen.

    | field            | of a row | laid out     | meaning                                                  |
    |------------------|----------|--------------|----------------------------------------------------------|
    | state            | 20       | row by row   | as in ``quadsafe_env.vehicle.state``                     |
    | yaw_acceleration | 1        | row by row   | desired, rad/s²                                          |
    | table            | 5        | line by line | the numbers of ``quadsafe_env.simulation.block``         |
    | flags            | 12 bytes | line by line | the flags of ``quadsafe_env.simulation.block``           |
    """

    state: NDArray[np.float64]
    yaw_acceleration: NDArray[np.float64]
    table: NDArray[np.float64]
    flags: NDArray[np.uint8]


# Numbers of a flat state.
FLAT = 12
# float64 of a row in each column, and before it.
WIDTHS: Any = Rows(STATE_SIZE, 1, NUMBERS, -(-FLAGS // 8))  # type: ignore[arg-type]
AT: Any = Rows(*accumulate(WIDTHS[:-1], initial=0))  # type: ignore[arg-type]
SIZE = sum(WIDTHS)


def rows_of(memory):
    """The columns within the memory (SIZE, M) of a world."""
    numbers, m = memory.reshape(-1), memory.shape[1]
    return Rows(
        state=numbers[AT.state * m : AT.yaw_acceleration * m],
        yaw_acceleration=numbers[AT.yaw_acceleration * m : AT.table * m],
        table=numbers[AT.table * m : AT.flags * m],
        flags=numbers[AT.flags * m : SIZE * m].view(np.uint8),
    )


rows_in = inline_kernel(rows_of)


@inline_kernel
def size_of(rows):
    """How many rows there is memory for, M."""
    return rows.yaw_acceleration.size


class Wishes(NamedTuple):
    """What a filter is given of N rows, in one array, which kernels are given; a world has it for a step only.

    | field   | shape        | meaning                                                  |
    |---------|--------------|----------------------------------------------------------|
    | numbers | (15, M)      | flat states, then snaps, row by row                      |
    | flat    | (N, 4, 3)    | r, ṙ, r̈, r⃛, m, m/s, m/s², m/s³                          |
    | snap    | (N, 3)       | desired, m/s⁴                                            |
    """

    numbers: NDArray[np.float64]
    flat: NDArray[np.float64]
    snap: NDArray[np.float64]


def wishes_of(n: int) -> Wishes:
    """Room for the wishes of ``n`` rows."""
    numbers = aligned_rows(FLAT + 3, -(-n // LANES) * LANES)
    flat, snap = numbers[:FLAT].reshape(-1, 4, 3), numbers[FLAT:].reshape(-1, 3)
    return Wishes(numbers, flat[:n], snap[:n])


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
