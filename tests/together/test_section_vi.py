"""The test flight of Section VI, flown by the example, and what its Figures 1, 5 and 6 show."""

import importlib

import numpy as np
import pytest
from house import ROOT

from quadsafe_env.vehicle.state import THRUST

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def example():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLES)
        yield importlib.import_module("section_vi_flight")


@pytest.fixture(scope="module")
def nominal(example):
    return example.fly(None)


@pytest.fixture(scope="module")
def safe(example):
    return example.fly(example.SHIELD)


def distance_to_goal(flight):
    return np.linalg.norm(flight.position[-1] - flight.goal)


def test_fig6_without_the_shield_the_path_enters_the_keep_out_sphere(nominal):
    # The straight path passes the centre at √5/3 m.
    assert nominal.clearance == pytest.approx(np.sqrt(5.0) / 3.0 - nominal.radius, abs=1e-3)
    assert distance_to_goal(nominal) < 0.10


def test_fig6_with_the_shield_it_does_not_and_still_arrives(safe):
    assert safe.clearance >= 0.005 * safe.radius  # the margin
    assert distance_to_goal(safe) < 0.10
    assert len(safe.time) == 1200  # the whole flight, neither crashed nor out of bounds


def test_fig1_the_vehicle_passes_above_the_sphere(safe):
    level = np.linalg.norm((safe.position - safe.center)[:, :2], axis=1)
    over = safe.position[np.argmin(level)]
    assert over[2] > safe.center[2] + safe.radius


def test_fig1_the_vehicle_turns_away_from_the_sphere(nominal, safe):
    tilt = [np.degrees(np.arccos(flight.state[:, 14])).max() for flight in (nominal, safe)]
    assert tilt[0] < 2.0 and tilt[1] > 10.0


def test_fig5_the_desired_second_torque_grows_beyond_the_applied_one(safe):
    desired, applied = np.abs(safe.desired[:, 1:]).max(axis=0), np.abs(safe.applied[:, 1:]).max(axis=0)
    assert desired[1] == desired.max()
    assert desired[1] > 1.1 * applied[1]
    acts = safe.correction > 0.0
    np.testing.assert_array_equal(safe.desired[~acts], safe.applied[~acts])


def test_fig5_the_thrust_dips_at_4_s_and_then_peaks(nominal, safe):
    change = safe.state[:, THRUST] - nominal.state[:, THRUST]
    dip, peak = np.argmin(change[:450]), np.argmax(change)
    assert 3.9 < safe.time[dip] < 4.3
    assert safe.time[dip] < safe.time[peak] < safe.time[dip] + 1.0
    assert change[dip] < -1e-3 and change[peak] > 5e-3  # N; rounding is about 1e-15


def test_until_the_shield_acts_both_flights_are_the_same(nominal, safe):
    first = np.flatnonzero(safe.correction)[0]
    assert first > 100
    np.testing.assert_array_equal(nominal.state[: first + 1], safe.state[: first + 1])


def test_both_flights_stay_in_the_vertical_plane_of_start_goal_and_centre(nominal, safe):
    normal = np.array([-1.0, 2.0, 0.0]) / np.sqrt(5.0)
    for flight in (nominal, safe):
        # Rounding of float32 actions, along an unstable direction.
        assert np.abs((flight.position - flight.position[0]) @ normal).max() < 1e-6


@pytest.mark.parametrize("hz", [20, 50, 250])
def test_the_clearance_hardly_depends_on_the_control_rate(example, safe, hz):
    flight = example.fly(example.SHIELD, policy_hz=hz, control_hz=hz, max_episode_steps=12 * hz)
    assert flight.clearance == pytest.approx(safe.clearance, abs=0.002)
    assert distance_to_goal(flight) < 0.10


def test_the_example_draws_and_prints(example, nominal, safe, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    importlib.import_module("section_vi_figures").draw_figures(nominal, safe, tmp_path)
    pictures = sorted(tmp_path.glob("*.png"))
    assert [p.stem for p in pictures] == ["flight", "section_vi_fig1", "section_vi_fig5", "section_vi_fig6"]
    assert all(10_000 < p.stat().st_size < 200_000 for p in pictures)
    table = example.table(nominal, safe).splitlines()
    assert table[1].split()[-2:] == ["-0.255", "0.012"]
