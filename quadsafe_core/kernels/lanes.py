"""Sixteen rows side by side: the layout in which LLVM turns a loop of scalar kernels into vector code.

A *block* is a flat float64 array, (LANES entries,): it holds entry k of lane i at ``LANES k + i``. A loop over
lanes becomes vector code if its index is unsigned, its offsets are literal and its kernels take no branch.
Rounding is that of scalar code: nothing is reordered, a product and a sum are fused only where a kernel says
``fma``. So a row gets the same bits in whatever lane, full block or remainder it is computed.
"""

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

from quadsafe_core.kernels.jit import inline_kernel, kernel

LANES = 16
U = np.uint64
# An argument ``I(3)`` instead of ``3``: numba compiles a function anew for every literal.
I = np.int64
# What is transposed in registers: four entries of eight rows.
TILE = 4
# Numbers in a cache line.
LINE = 8
HALF = ir.VectorType(ir.DoubleType(), TILE)
WHOLE = ir.VectorType(ir.DoubleType(), 2 * TILE)


def _wide_vectors(typing_context):
    """Let the calling kernel use 512-bit vectors where there are any; LLVM's habit is 256 bits."""

    def emit(context, builder, signature, arguments):
        # llvmlite's own ``add`` knows only the attributes without a value.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), emit


def _fma(typing_context, a, b, c):
    """``a b + c``, rounded once."""

    def emit(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), emit


def _tile_to_lanes(typing_context, rows, start, stride, block, at):
    """``block[at + LANES j + i] = rows[start + stride i + j]`` for i < 8, j < 4."""

    def emit(context, builder, signature, arguments):
        at_row, at_entry = _places(context, builder, signature.args, arguments)
        halves = [builder.load(at_row(i), align=8, typ=HALF) for i in range(2 * TILE)]
        pairs = [builder.shuffle_vector(*halves[i::TILE], _picks(range(2 * TILE))) for i in range(TILE)]
        for j, entry in enumerate(_transposed(builder, pairs)):
            builder.store(entry, at_entry(j), align=8)
        return context.get_dummy_value()

    return types.none(rows, types.intp, types.intp, block, types.intp), emit


def _tile_from_lanes(typing_context, rows, start, stride, block, at):
    """``rows[start + stride i + j] = block[at + LANES j + i]`` for i < 8, j < 4."""

    def emit(context, builder, signature, arguments):
        at_row, at_entry = _places(context, builder, signature.args, arguments)
        entries = [builder.load(at_entry(j), align=8, typ=WHOLE) for j in range(TILE)]
        for i, pair in enumerate(_transposed(builder, entries)):
            for first in (0, TILE):
                half = builder.shuffle_vector(pair, pair, _picks(range(first, first + TILE)))
                builder.store(half, at_row(i + first), align=8)
        return context.get_dummy_value()

    return types.none(rows, types.intp, types.intp, block, types.intp), emit


def _places(context, builder, kinds, arguments):
    """Pointers to four entries of row i, and to entry j of eight lanes."""
    rows, start, stride, block, at = arguments

    def place(kind, array, index, vector):
        data = context.make_array(kind)(context, builder, array).data
        return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

    def plus(first, step, i):
        return builder.add(first, builder.mul(step, ir.Constant(first.type, i)))

    pitch = ir.Constant(at.type, LANES)
    return (
        lambda i: place(kinds[0], rows, plus(start, stride, i), HALF),
        lambda j: place(kinds[3], block, plus(at, pitch, j), WHOLE),
    )


def _picks(indices):
    indices = list(indices)
    return ir.Constant(ir.VectorType(ir.IntType(32), len(indices)), indices)


def _transposed(builder, vectors):
    """Two 4 × 4 matrices side by side in four vectors, each transposed: exchanges 1 and 2 apart."""
    for step in (1, 2):
        lanes = range(2 * TILE)
        upper = _picks(j if not j & step else 2 * TILE + j - step for j in lanes)
        lower = _picks(j + step if not j & step else 2 * TILE + j for j in lanes)
        for i in (0, 3 - step):
            pair = vectors[i], vectors[i + step]
            vectors[i], vectors[i + step] = (builder.shuffle_vector(*pair, pick) for pick in (upper, lower))
    return vectors


def _plain_tile_to_lanes(rows, start, stride, block, at):
    for i in range(2 * TILE):
        for j in range(TILE):
            block[at + LANES * j + i] = rows[start + stride * i + j]


def _plain_tile_from_lanes(rows, start, stride, block, at):
    for i in range(2 * TILE):
        for j in range(TILE):
            rows[start + stride * i + j] = block[at + LANES * j + i]


def _either(compiled: Callable, plain: Callable) -> Callable:
    """What kernels call: LLVM's instructions, or with the JIT off plain Python."""
    return plain if getattr(config, "DISABLE_JIT") else intrinsic(compiled)  # noqa: B009 - set by numba


wide_vectors = _either(_wide_vectors, lambda: None)
fma = _either(_fma, lambda a, b, c: a * b + c)
tile_to_lanes = _either(_tile_to_lanes, _plain_tile_to_lanes)
tile_from_lanes = _either(_tile_from_lanes, _plain_tile_from_lanes)


@inline_kernel
def fused_dot(a, b):
    """``a · b`` of two (3,)."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@inline_kernel
def aligned(count):
    """(count,) numbers from the start of a cache line on: a vector across two lines costs twice."""
    memory = np.empty(count + LINE)
    first = LINE - memory.ctypes.data // 8 % LINE
    return memory[first : first + count]


@inline_kernel
def new_block(entries):
    """Memory of a block, (LANES entries,)."""
    return aligned(LANES * entries)


@kernel
def aligned_rows(count, width):
    """``np.empty((count, width))`` from the start of a cache line on."""
    return aligned(count * width).reshape((count, width))


@inline_kernel
def to_lanes(rows, width, first, count, block, at):
    """Rows first … first + count of a flat (N width,) array into entries at … at + width of a block."""
    if count == LANES and width % TILE == 0:
        for half in range(0, LANES, 2 * TILE):
            for k in range(0, width, TILE):
                tile_to_lanes(rows, (first + half) * width + k, width, block, LANES * (at + k) + half)
    else:
        for k in range(U(width)):
            for i in range(U(count)):
                block[U(LANES) * (U(at) + k) + i] = rows[U(width) * (U(first) + i) + k]


@inline_kernel
def from_lanes(block, at, rows, width, first, count):
    """Entries at … at + width of a block into rows first … first + count of a flat (N width,) array.

    Not one piece with ``to_lanes``: through a common loop a row of RK4 took 4 to 10 % longer.
    """
    if count == LANES and width % TILE == 0:
        for half in range(0, LANES, 2 * TILE):
            for k in range(0, width, TILE):
                tile_from_lanes(rows, (first + half) * width + k, width, block, LANES * (at + k) + half)
    else:
        for i in range(U(count)):
            for k in range(U(width)):
                rows[U(width) * (U(first) + i) + k] = block[U(LANES) * (U(at) + k) + i]


@inline_kernel
def lane_triple(block, at):
    """Three entries of a lane, from the place ``at`` on."""
    return (block[at], block[at + U(LANES)], block[at + U(2 * LANES)])


@inline_kernel
def store_triple(block, at, triple):
    """Write three entries of a lane, from the place ``at`` on."""
    block[at], block[at + U(LANES)], block[at + U(2 * LANES)] = triple
