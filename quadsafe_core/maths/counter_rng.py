"""A counter-based random number generator for kernels: a number is a hash of (key, counter).

Scenes are pure functions of a 64-bit integer, so no generator state is kept anywhere. The key travels as
two 32-bit words in int64 arithmetic, where a product masked to 32 bits is the same in compiled code and in
plain Python. The mixing constants are those of the public-domain "lowbias32" integer hash, the second one
less 2^32, which keeps every product within int64.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.kernels.jit import inline_kernel

MASK = 0xFFFFFFFF
KEY_LIMIT = 2**64
# Zero hashes to zero; the offset keeps the stream of key 0 away from it.
OFFSET = 0x9E3779B9


class Key(NamedTuple):
    """A 64-bit integer as two 32-bit words."""

    low: int
    high: int


@inline_kernel
def mixed(word):
    """Bijective hash of a 32-bit word."""
    word = ((word ^ (word >> 16)) * 0x7FEB352D) & MASK
    word = ((word ^ (word >> 15)) * -0x7B935975) & MASK
    return word ^ (word >> 16)


@inline_kernel
def word_at(key, counter):
    """The ``counter``-th 32-bit word of the stream of ``key``."""
    return mixed(key.high ^ mixed(key.low ^ mixed((counter + OFFSET) & MASK)))


@inline_kernel
def uniform(key, counter, low, high):
    """The ``counter``-th uniform number of the stream of ``key``, in [low, high)."""
    return low + (high - low) * (word_at(key, counter) / 4294967296.0)


@inline_kernel
def derived_key(key, episode):
    """The key of a later episode, a hash of (key, episode)."""
    return Key(word_at(key, 2 * episode), word_at(key, 2 * episode + 1))


def key_words(integers: ArrayLike) -> NDArray[np.int64]:
    """Rows (low, high) of 64-bit integers, shape (N, 2)."""
    # As objects: a list that mixes small integers with ones of 2^63 and more would become floats.
    flat = np.atleast_1d(np.asarray(integers, dtype=object))
    return np.array([[int(k) & MASK, int(k) >> 32] for k in flat], dtype=np.int64).reshape(-1, 2)


def key_integer(words: NDArray[np.int64]) -> int:
    """The 64-bit integer of one row (low, high)."""
    return int(words[0]) | int(words[1]) << 32
