"""Which of the thirteen segment lengths a stop can have at all: the limits, without any body, side by side.

Most stops that are refused break a limit of snap, jerk or thrust, whatever the bodies are. A lane for each
length asks that in the time of two; the answer is one integer, bit k for length k.
"""

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, U, wide_vectors
from quadsafe_core.kernels.vec3 import add, combined, dot, norm
from shields.backup.stored_stop import LENGTHS, dead_beat_snap
from shields.chains.flat_state import flown

# What is a rounding too much or too little is left to the arcs.
LESS = 1.0 - 1e-12
# The lanes behind the last length repeat it.
IN_LANES = np.array([*LENGTHS, *[LENGTHS[-1]] * (LANES - len(LENGTHS))])


@inline_kernel
def has_length(lengths, choice):
    """Whether a length is among those of an answer."""
    return (lengths >> U(choice)) & U(1) == U(1)


@inline_kernel
def without_length(lengths, choice):
    """The answer without a length that is in it."""
    return lengths ^ (U(1) << U(choice))


@inline_kernel
def whole_periods(length, period):
    """``periods_of`` times the period, without a branch."""
    return max(1.0, np.rint(length / period)) * period


@inline_kernel
def keeps_band(x, snap, t, band):
    """Whether the specific thrust is within the band a time t later, but for rounding."""
    thrust = add(combined(combined(x.a, t, x.j), 0.5 * t * t, snap), (0.0, 0.0, band.gravity))
    square = dot(thrust, thrust)
    return (square >= LESS * abs(band.least) * band.least) & (LESS * square <= band.most * band.most)


@inline_kernel
def segment_keeps_limits(x, frame, h, limits):
    """Whether points of the first segment of a stop keep the limits, and the flat state where it ends."""
    snap, band = dead_beat_snap(x, frame, h), limits.band
    end = flown(x, snap, h)
    keeps = keeps_band(x, snap, 0.125 * h, band) & keeps_band(x, snap, 0.25 * h, band)
    keeps = keeps & keeps_band(x, snap, 0.375 * h, band) & keeps_band(x, snap, 0.5 * h, band)
    keeps = keeps & keeps_band(x, snap, 0.625 * h, band) & keeps_band(x, snap, 0.75 * h, band)
    keeps = keeps & keeps_band(x, snap, 0.875 * h, band) & keeps_band(end, snap, 0.0, band)
    return keeps & (norm(snap) <= limits.stop_snap_max) & (norm(end.j) <= limits.jerk_max), end


@inline_kernel
def stop_keeps_limits(x, frame, h, limits):
    """The same for the whole stop; no branch is taken, and no loop that LLVM would have to unroll."""
    first, x = segment_keeps_limits(x, frame, h, limits)
    second, x = segment_keeps_limits(x, frame, h, limits)
    third, x = segment_keeps_limits(x, frame, h, limits)
    return first & second & third, x


@kernel
def lengths_ahead(x, frame, period, limits):
    """Lengths whose stop keeps the limits at points of it: necessary for ``stop_is_clear``."""
    wide_vectors()
    lengths = U(0)
    for i in range(U(LANES)):
        h = whole_periods(IN_LANES[i], period)
        keeps, _ = stop_keeps_limits(x, frame, h, limits)
        lengths |= U(keeps) << i
    return lengths
