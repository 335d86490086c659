"""What was meant by a word that is not known."""

import pytest

from quadsafe_core.nearest_word import did_you_mean

pytestmark = pytest.mark.interpreted


@pytest.mark.parametrize(
    ("word", "end"),
    [
        ("hummingbrid", "; did you mean 'hummingbird'?"),
        ("Racer", "; did you mean 'racer'?"),
        ("SNAP_MAX", "; did you mean 'snap_max'?"),
        ("falcon", ""),
        ("", ""),
        (3, ""),
        (None, ""),
        (["racer"], ""),
    ],
)
def test_the_nearest_option_is_suggested_where_one_is_near(word, end):
    assert did_you_mean(word, ("crazyflie", "hummingbird", "racer", "snap_max")) == end


def test_nothing_is_suggested_where_there_is_nothing():
    assert did_you_mean("racer", ()) == ""
