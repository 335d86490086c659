"""Plans of the predictive filter: pieces of constant snap, and what they do to a chain of four integrators."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.methods.halfspaces import Floats
from shields.settings.chain import chain_over

# Control periods of a block, and of a sample.
BLOCK, SAMPLE = 8, 4
# What the square of a snap behind the first one costs, the first costing 1.
EFFORT = 1e-5


class Horizon(NamedTuple):
    """The plans of one phase: B pieces, S samples; matrices are of one axis with states (r, v, a, j)."""

    starts: NDArray[np.intp]
    """(B,) control periods from now at which pieces begin."""
    lengths: NDArray[np.intp]
    """(B,) of the pieces, control periods."""
    times: Floats
    """(S,) of the samples, s."""
    share: Floats
    """(S,) of the horizon that has passed then."""
    motion: Floats
    """(4 S, 4 + B) from the measured state and the plan to the states at the samples."""
    moved: Floats
    """(S, B − 3) what ``free`` does to the position at the samples."""
    ends: NDArray[np.intp]
    """Samples at which a block ends."""
    rest: Floats
    """(B, 4) the plan of least effort to rest."""
    mended: Floats
    """(B, B) what stays of a plan that is moved by the least change to end where it would without snap."""
    after: Floats
    """(B, 5) the plan of least effort with a given first snap, of the state and of that snap."""
    first: Floats
    """(1, 5) the first snap of least cost if nothing but the end binds, of the state and of the desired one."""
    free: Floats
    """(B, B − 3) the changes of a plan that leave its end, in units in which they cost their square."""
    fixed: Floats
    """What these do to snaps, accelerations at samples and jerks at ends, axis by axis."""


@cache
def horizon_of(phase: int, blocks: int, period: float) -> Horizon:
    """The plans when ``phase`` periods of the present block have been flown, 0 … BLOCK − 1."""
    left = BLOCK - 1 - phase
    lengths = np.array([1, *([left] if left else []), *([BLOCK] * blocks)])
    starts = np.cumsum(lengths) - lengths
    ticks = np.array([k for k in range(1, lengths.sum() + 1) if (k + phase) % SAMPLE == 0])
    carried = np.stack([chain_over(k * period)[0] for k in ticks])
    added = np.stack([_added(k, starts, lengths, period) for k in ticks])
    E, G = carried[-1, 1:], added[-1, 1:]
    inverse = np.linalg.pinv(G)
    first, others = G[:, :1], np.linalg.pinv(G[:, 1:])
    after = np.vstack([np.eye(1, 5, 4), -others @ np.hstack([E, first])])
    ends, free = np.flatnonzero(np.isin(ticks, starts + lengths)), _free(G)
    limited = np.vstack([free, added[:, 2] @ free, added[ends, 3] @ free])
    return Horizon(
        starts,
        lengths,
        ticks * period,
        ticks / ticks[-1],
        np.concatenate([carried, added], axis=2).reshape(4 * len(ticks), -1),
        added[:, 0] @ free,
        ends,
        -inverse @ E,
        np.eye(len(lengths)) - inverse @ G,
        after,
        _first(after),
        free,
        np.kron(np.eye(3), limited).astype(np.float64),
    )


def _added(k: int, starts: NDArray[np.intp], lengths: NDArray[np.intp], period: float) -> Floats:
    """(4, B) what each piece of a plan adds to the state after k periods."""
    held = np.clip(k - starts, 0, lengths)
    rest = np.maximum(k - starts - held, 0)
    pairs = zip(rest.tolist(), held.tolist(), strict=True)
    return np.stack([chain_over(b * period)[0] @ chain_over(a * period)[1] for b, a in pairs], axis=1)


def _first(after: Floats) -> Floats:
    """Where the derivative of (u_0 − u_des)² + ε Σ u_i² by u_0 is zero, the others being ``after``."""
    others, own = after[1:, :4], after[1:, 4]
    return np.array([[*(-EFFORT * own @ others), 1.0]]) / (1.0 + EFFORT * own @ own)


def _free(G: Floats) -> Floats:
    """A basis of what G (3, B) does not see, orthonormal under the costs of a plan."""
    basis = np.linalg.svd(G)[2][3:].T
    costs = weights(len(basis))
    return np.asarray(np.linalg.solve(np.linalg.cholesky(basis.T * costs @ basis), basis.T).T, dtype=np.float64)


def mapped(matrix: Floats, states: Floats) -> Floats:
    """(N, M, 3), what a matrix (M, L) of one axis does to (N, L, 3) along each."""
    lines = states.transpose(0, 2, 1).reshape(-1, states.shape[1]) @ matrix.T
    return lines.reshape(len(states), 3, -1).transpose(0, 2, 1)


def weights(pieces: int) -> Floats:
    """(B,) what the squares of the snaps of a plan cost."""
    return np.array([1.0, *([EFFORT] * (pieces - 1))])
