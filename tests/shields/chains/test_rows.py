"""Rows of states: what broadcasts, what is checked, and that the answers can be written to."""

import numpy as np
import pytest

from shields.chains.rows import MAX_ORDER, SMALLEST, checked_input, state_rows


@pytest.mark.interpreted
def test_leading_dimensions_broadcast_to_rows():
    x, u = np.arange(12.0).reshape(2, 2, 3), np.array([5.0, 7.0])
    (rows, inputs, one), shape = state_rows(x, u=u, u_max=2.0)
    assert shape == (2, 2) and rows.tolist() == x.reshape(4, 3).tolist()
    assert inputs.tolist() == [5.0, 7.0, 5.0, 7.0] and one.tolist() == [2.0] * 4
    (rows, inputs), shape = state_rows([1.0, 2.0], u=[[3.0], [4.0]])
    assert shape == (2, 1) and rows.tolist() == [[1.0, 2.0]] * 2 and inputs.tolist() == [3.0, 4.0]
    (rows, inputs), shape = state_rows([1.0, 2.0], u=3.0)
    assert shape == () and rows.shape == (1, 2) and inputs.tolist() == [3.0]


@pytest.mark.interpreted
def test_read_only_arguments_become_rows_that_can_be_written_to():
    x, u = np.ones((4, 2)), np.ones(4)
    x.setflags(write=False)
    u.setflags(write=False)
    (rows, inputs), _ = state_rows(x, u=u)
    assert rows.flags.writeable and inputs.flags.writeable
    mine = np.ones((4, 2))
    assert np.shares_memory(state_rows(mine, u=u)[0][0], mine)


@pytest.mark.interpreted
def test_the_order_has_its_limits():
    assert state_rows(np.zeros(MAX_ORDER))[0][0].shape == (1, MAX_ORDER)
    for order in (0, MAX_ORDER + 1):
        with pytest.raises(ValueError, match="x must have 1 to 100 entries"):
            state_rows(np.zeros(order))


@pytest.mark.interpreted
def test_every_input_of_a_batch_is_checked():
    for name, sign in (("u_max", 1.0), ("u_min", -1.0)):
        (_, u), _ = state_rows(np.zeros((2, 1)), **{name: sign * np.array([1.0, SMALLEST])})
        assert u.tolist() == [sign, sign * SMALLEST]
        for wrong in (-1.0, 0.0, 0.5 * SMALLEST):
            with pytest.raises(ValueError, match=f"{name} must be"):
                state_rows(np.zeros((2, 1)), **{name: sign * np.array([1.0, wrong])})
    with pytest.raises(ValueError, match="leading shapes that fit"):
        state_rows(np.zeros((2, 1)), u=np.zeros(3))


@pytest.mark.interpreted
def test_one_input_is_one_number():
    assert checked_input("u_max", 3) == 3.0 and isinstance(checked_input("u_max", 3), float)
    for value in (np.inf, np.nan):
        with pytest.raises(ValueError, match="u must be finite"):
            checked_input("u", value)
    with pytest.raises(TypeError, match="u_max must be a number"):
        checked_input("u_max", [1.0])  # type: ignore[arg-type]
