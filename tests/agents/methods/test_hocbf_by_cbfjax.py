"""The rows of the HOCBF-QP against those that cbfjax makes by automatic differentiation of h.

It needs JAX, which is not of the development environment: ``pip install cbfjax==0.2.0`` into one of its own.
cbfpy knows barriers of relative degree 1 and 2 alone.
"""

import numpy as np
import pytest

from agents.methods.halfspaces import bodies_of
from agents.methods.hocbf_qp import barrier
from quadsafe_core.shapes import HalfSpace, Obstacles, Sphere

jax = pytest.importorskip("jax", reason="needs JAX and cbfjax")
Barrier = pytest.importorskip("cbfjax.barriers.barrier", reason="needs cbfjax").Barrier
jax.config.update("jax_enable_x64", True)

KEEP_OUT, MARGIN = 0.1, 0.01


class Chain:
    """r⁗ = u, as f and g of x = (r, v, a, j)."""

    def f(self, x):
        return jax.numpy.concatenate([x[3:], jax.numpy.zeros(3)])

    def g(self, x):
        return jax.numpy.zeros((12, 3)).at[9:].set(jax.numpy.eye(3))


def their_row(h, flat, p):
    """A u ≥ b of (d/dt + p)⁴ h ≥ 0, with A a unit vector."""
    found = Barrier(barrier_func=h, dynamics=Chain(), rel_deg=4, alphas=(p,) * 3)
    value, drift, A = map(np.asarray, found.get_hocbf_and_lie_derivs(jax.numpy.array(flat.ravel())))
    length = np.linalg.norm(A)
    return A / length, -(drift + p * value) / length


def sphere(rng):
    """A moving sphere, and h of the state relative to it."""
    center, velocity, radius = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.1, 1.0)
    D = radius + KEEP_OUT + MARGIN
    away = np.concatenate([center, velocity, np.zeros(6)]).reshape(4, 3)
    return Sphere(center, radius, velocity=tuple(velocity)), away, lambda x: x[:3] @ x[:3] - D**2


def wall(rng):
    """A half-space and its h."""
    normal, offset = rng.normal(size=3), rng.normal()
    n, c = normal / np.linalg.norm(normal), offset / np.linalg.norm(normal)
    return HalfSpace(normal, offset), np.zeros((4, 3)), lambda x: n @ x[:3] - c - KEEP_OUT - MARGIN


@pytest.mark.parametrize("body", [sphere, wall])
def test_rows_are_those_of_cbfjax(body):
    rng = np.random.default_rng(0)
    for _ in range(50):
        shape, away, h = body(rng)
        flat, p = rng.normal(size=(4, 3)) * [[3.0], [2.0], [5.0], [20.0]], rng.uniform(2.0, 12.0)
        A, b = barrier(bodies_of(Obstacles.pack([[shape]], keep_out=KEEP_OUT)), 0, 0, flat, (p, MARGIN))
        theirs, bound = their_row(h, flat - away, p)
        assert np.allclose(A, theirs, rtol=0.0, atol=1e-12)
        assert b == pytest.approx(bound, rel=1e-12, abs=1e-9)
