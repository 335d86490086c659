"""Argument checks: what passes, and the one sentence that a bad argument gets."""

import math
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest

from quadsafe_core.checks import (
    checked_when_made,
    finite_array,
    finite_number,
    instance_of,
    keywords_known_to,
    non_negative_number,
    one_of,
    positive_integer,
    positive_number,
    shaped_array,
)

pytestmark = pytest.mark.interpreted


def test_arrays_become_c_ordered_float64_of_their_own_shape():
    for value in (3, [1, 2], np.arange(12, dtype=np.int32).reshape(3, 4).T, np.zeros((0, 4))):
        array = finite_array("x", value)
        assert array.dtype == np.float64 and array.flags.c_contiguous
        assert array.shape == np.shape(value)
        np.testing.assert_array_equal(array, value)


def test_last_axes_are_compared_and_strings_stand_for_any_length():
    assert finite_array("x", np.zeros((7, 4, 3)), (4, 3)).shape == (7, 4, 3)
    assert finite_array("x", np.zeros((7, 9, 3)), ("K", 3)).shape == (7, 9, 3)
    with pytest.raises(ValueError, match=r"^x must have shape \(…, K, 3\), got \(3,\)$"):
        finite_array("x", np.zeros(3), ("K", 3))


def test_shaped_array_lets_non_finite_entries_pass():
    assert np.isnan(shaped_array("x", [math.nan, 1.0], (2,))[0])


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ([1.0, math.nan], "x must be finite, got nan at index (1,)"),
        ([[1.0], [-math.inf]], "x must be finite, got -inf at index (1, 0)"),
        (math.inf, "x must be finite, got inf"),
    ],
)
def test_first_non_finite_entry_is_named(value, sentence):
    with pytest.raises(ValueError) as error:
        finite_array("x", value)
    assert str(error.value) == sentence


@pytest.mark.parametrize(
    "value",
    [
        *(
            "abc",
            "1",
            ["1", "2"],
            b"1",
            True,
            [True, False],
            np.True_,
            None,
            [None, 1.0],
            [True, Fraction(1, 2)],
        ),
        *(1j, [1j, 2.0], np.zeros(2, dtype=complex), np.zeros(2, dtype="M8[s]"), np.zeros(2, dtype="m8[s]")),
        *([[1.0], [1.0, 2.0]], {"a": 1}, Exception, [10**400]),
    ],
    ids=repr,
)
def test_what_holds_no_real_numbers_is_a_type_error(value):
    with pytest.raises(TypeError, match=r"^x must be an array of real numbers, got "):
        finite_array("x", value)


@pytest.mark.parametrize(
    ("check", "accepted", "refused"),
    [
        (finite_number, (-1, 0, 2.5), (math.nan, math.inf, -math.inf)),
        (positive_number, (1, 1e-30), (0, -1.0, math.nan, math.inf)),
        (non_negative_number, (0, 0.0, 3), (-1e-300, math.nan, math.inf)),
    ],
)
def test_numbers(check, accepted, refused):
    for value in (*accepted, *map(np.float32, accepted), *map(np.array, accepted)):
        number = check("x", value)
        assert type(number) is float
        assert number == value
    for value in refused:
        with pytest.raises(ValueError, match=r"^x must be a finite number( > 0| >= 0)?, got "):
            check("x", value)
    for value in ("1", b"1", True, None, [1.0], np.ones(1), 1j):
        with pytest.raises(TypeError, match=r"^x must be a finite number"):
            check("x", value)


def test_positive_integer():
    assert positive_integer("n", 3) == 3
    assert type(positive_integer("n", np.int64(3))) is int
    for value in (0, -1, 2.0, True, "3", None):
        with pytest.raises(ValueError, match=r"^n must be an integer >= 1, got "):
            positive_integer("n", value)


def test_one_of():
    assert one_of("mode", "a", ("a", "b")) == "a"
    with pytest.raises(ValueError, match=r"^mode must be one of 'a', 'b', got 'c'$"):
        one_of("mode", "c", ("a", "b"))
    with pytest.raises(ValueError, match=r"one of 'wide', 'high', got 'Hihg'; did you mean 'high'\?$"):
        one_of("mode", "Hihg", ("wide", "high"))


def test_an_unknown_keyword_names_what_was_called_and_the_nearest_there_is():
    @keywords_known_to("Vehicle")
    def made(mass, *, thrust_max=1.0):
        return mass, thrust_max

    assert made(2.0, thrust_max=3.0) == (2.0, 3.0) and made(2.0) == (2.0, 1.0)
    sentence = r"^Vehicle must get keywords among 'mass', 'thrust_max', got an unexpected keyword argument "
    with pytest.raises(TypeError, match=sentence + r"'max_thrust'; did you mean 'thrust_max'\?$"):
        made(2.0, max_thrust=3.0)
    with pytest.raises(TypeError, match=sentence + "'colour'$"):
        made(2.0, colour="red")


def test_numbers_of_other_kinds_are_numbers():
    for value in ([Fraction(1, 2), 1], [Decimal("0.5"), 1.0], np.array([0.5, 1.0], dtype=np.float16)):
        np.testing.assert_array_equal(finite_array("x", value), [0.5, 1.0])
    for value in (Fraction(1, 2), Decimal("0.5"), np.float32(0.5), np.array(0.5)):
        assert positive_number("x", value) == 0.5 and type(positive_number("x", value)) is float


def test_instances():
    assert instance_of("x", 1, int) == 1
    with pytest.raises(TypeError, match=r"^x must be a int, got '1'$"):
        instance_of("x", "1", int)


class Pair(NamedTuple):
    low: float
    high: float = 1.0


def test_a_checked_tuple_is_checked_by_every_call_and_not_by_make():
    def check(pair):
        return Pair._make([finite_number("low", pair.low), finite_number("high", pair.high)])

    checked = checked_when_made(check)(Pair)
    assert checked is Pair and Pair(1) == Pair(low=1.0) == (1.0, 1.0) and type(Pair(1).low) is float
    for make in (lambda: Pair("1"), lambda: Pair(0.0, high="1"), lambda: Pair(0.0)._replace(low="1")):
        with pytest.raises(TypeError, match="must be a finite number, got '1'"):
            make()
    assert Pair._make(["1", 2]) == ("1", 2)
