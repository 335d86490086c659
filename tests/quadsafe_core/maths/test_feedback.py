"""Held state feedback of integrator chains."""

import math

import numpy as np
import pytest

from quadsafe_core.maths.feedback import held_gains


def sampled_chain(order, period):
    A = np.array(
        [
            [period ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(order)]
            for i in range(order)
        ]
    )
    B = np.array([period ** (order - i) / math.factorial(order - i) for i in range(order)])
    return A, B


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("period", [0.001, 0.005, 0.02, 0.05])
def test_poles_are_where_they_were_asked_for(order, period):
    pole = 6.0
    A, B = sampled_chain(order, period)
    closed = A - np.outer(B, held_gains(order, pole, period))
    defect = np.linalg.matrix_power(closed - math.exp(-pole * period) * np.eye(order), order)
    # Cayley–Hamilton with an n-fold pole; the entries of the solve lose up to Δ⁻ⁿ of the last digit.
    assert np.abs(defect).max() < 1e-6 * period


def test_short_periods_give_the_continuous_gains():
    p = 5.0
    assert held_gains(3, p, 1e-5) == pytest.approx([p**3, 3 * p**2, 3 * p], rel=1e-3)


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="period must be a finite number > 0, got 0"):
        held_gains(3, 1.0, 0)
    with pytest.raises(ValueError, match="order must be an integer >= 1, got 0"):
        held_gains(0, 1.0, 0.1)
