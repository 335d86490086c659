"""The slot: what a filter need not have is answered for it, and what it has is asked."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.simulation.slot import NOTHING_DONE, Passed, PassThrough, completed

pytestmark = pytest.mark.interpreted


class Minimal:
    """All that a filter needs."""

    def __init__(self):
        self.masks = []

    def filter(self, flat, obstacles, snap, period):
        return Passed(0.5 * snap)

    def reset(self, mask):
        self.masks.append(mask.copy())


class Seen(Minimal):
    """A filter that can also be seen in pictures."""

    done = (True, 3)


class Backed(Minimal):
    """A filter that has a watchdog, if only at times."""

    is_on = False

    @property
    def backup(self):
        return (lambda mask: np.full((len(mask), 3), 7.0)) if self.is_on else None


def test_the_empty_slot_can_be_asked_all():
    slot = PassThrough()
    assert completed(slot) is slot
    assert (slot.done, slot.backup) == (NOTHING_DONE, None)


def test_a_filter_needs_no_more_than_filter_and_reset():
    given = Minimal()
    slot = completed(given)
    assert (slot.done, slot.backup) == (NOTHING_DONE, None)
    assert slot.filter(None, None, np.ones((1, 3)), 0.01).snap.tolist() == [[0.5, 0.5, 0.5]]
    slot.reset(np.array([True]))
    assert [mask.tolist() for mask in given.masks] == [[True]]


def test_what_a_filter_has_is_asked_when_it_is_needed():
    assert completed(Seen()).done == (True, 3)
    backed = Backed()
    slot = completed(backed)
    assert slot.backup is None
    backed.is_on = True
    assert slot.backup(np.array([True])).tolist() == [[7.0, 7.0, 7.0]]


@pytest.mark.parametrize("kind", [Minimal, Seen, Backed])
def test_the_env_gives_back_the_very_filter_that_was_put_in(kind):
    env = gymnasium.make("QuadSafe/Avoid-v0").unwrapped
    env.snap_filter = given = kind()
    assert env.snap_filter is given and env.is_shielded
    env.snap_filter = PassThrough()
    assert not env.is_shielded
