"""Parts of the sampled shield: distances of stops, limits of now, the backup, half-spaces as they enter."""

import math

import numpy as np
import pytest

from quadsafe_core.authority import Authority
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from shields import Shield
from shields.backup.certificate import ACCEPTED, ASTRAY, BLENDED, STOPPED, UNCERTIFIED, standing
from shields.backup.recovery import RECOVERY_POLE, RECOVERY_SPEED
from shields.backup.stored_stop import (
    LED_PLAN,
    NOTHING,
    PLAN,
    advance_stop,
    dead_beat_snap,
    reference,
    segment_periods,
    write_stop,
)
from shields.chains.flat_state import Flat, flown
from shields.filters.easing import POLE
from shields.filters.sampled import sampled_input
from shields.interface.bodies import as_one_row
from shields.interface.filtered import FACTS
from shields.interface.records import Demand, FlightLimits, MovingBodies, ThrustBand
from shields.interface.row_checks import BRAKING_POLE, braking, opened
from shields.methods.authority_limits import limit_demand
from shields.methods.flight_bounds import RESERVED, bounds_of
from shields.methods.halfspace import excess
from shields.methods.memory import (
    HALF_SPACE,
    PLANS,
    SETTINGS,
    Width,
    empty_memory,
    kind_of,
    sampled_memory,
    sampled_size,
    stops_of,
    tube_memory,
    tube_size,
    write_settings,
)
from shields.methods.memory import settings_of as settings_in
from shields.methods.nearest_snap import (
    LIMITS,
    Chosen,
    Row,
    choose_directions,
    cut_as_chosen,
    enter,
    nearest_snap,
    no_half_spaces,
    note_demand,
    shortened,
)
from shields.methods.sampled_row import backup_snap, distances_to_keep, limits_at, note_kind
from shields.methods.sampled_shield import TRACKING_POLE

PERIOD, GRAVITY = 0.02, 9.81
HOVER = Flat(*[(0.0, 0.0, 0.0)] * 4)
VEHICLE = Authority(
    snap_max=380.0, jerk_max=44.0, specific_thrust_min=5.0, specific_thrust_max=20.0, gravity=GRAVITY
)


def settings_of(**given):
    """The settings of a shield as its kernels see them."""
    shield, record = Shield(**given), np.zeros(1, dtype=SETTINGS)[0]
    bounds, gains = bounds_of(shield.settings), held_gains(4, TRACKING_POLE, PERIOD)
    write_settings(record, shield.settings, PERIOD, bounds, gains)
    return settings_in(record, tuple(kind_of(shield.settings, bounds, has_tube=False, size=(1, 1))))


def spheres_at(*rows):
    """Spheres from (center, radius), at rest."""
    centers, radii = zip(*rows, strict=True)
    return MovingBodies(np.array(centers, float), np.zeros((len(rows), 3)), np.array(radii, float))


def open_fact():
    fact = np.zeros(1, dtype=FACTS)[0]
    opened(fact)
    return fact


def row_of(*chosen):
    """What is remembered and told of a vehicle: half-spaces (x, y, z, least), no stop, nothing decided."""
    spaces = np.zeros(len(chosen), dtype=HALF_SPACE)
    for space, numbers in zip(spaces, chosen, strict=True):
        space["n"], space["least"] = numbers[:3], numbers[3]
    return Row(spaces, np.zeros(1, dtype=PLAN)[0], open_fact())


@pytest.mark.interpreted
def test_free_settings_arrive_where_they_are_read():
    found = settings_of(snap_max=50.0, reserve=4.0, alpha=3.0, margin=0.1, specific_thrust_min=2.0, gravity=9.0)
    assert found.sampling[:5] == (50.0, pytest.approx(1.0 - math.exp(-3.0 * PERIOD)), 200.0, PERIOD, None)
    left = pytest.approx(1.0 - math.exp(-POLE * PERIOD))
    assert found.sampling.easing == (tuple(held_gains(4, POLE, PERIOD)), left, pytest.approx(1.075 / 1.1))
    assert found.flight.limits == FlightLimits(math.inf, 200.0, math.inf, ThrustBand(2.0, math.inf, 9.0))
    assert (found.margin, found.closing, found.is_free) == (0.1, None, True)
    assert found.flight.gains == tuple(held_gains(4, TRACKING_POLE, PERIOD))
    assert found.braking == tuple(held_gains(3, BRAKING_POLE, PERIOD))
    assert found.recovery == tuple(held_gains(3, RECOVERY_POLE, PERIOD))
    assert not settings_of(max_closing_speed=2.0).is_free


@pytest.mark.interpreted
def test_an_authority_arrives_with_a_reserve_for_the_feedback():
    found, kept = settings_of(authority=VEHICLE), VEHICLE.less(RESERVED)
    assert found.sampling[0] == kept.snap_max and found.sampling[2] == VEHICLE.snap_max
    assert found.sampling.authority == kept and not found.is_free
    band = ThrustBand(kept.specific_thrust_min, kept.specific_thrust_max, GRAVITY)
    assert found.flight.limits == FlightLimits(VEHICLE.snap_max, kept.snap_max, kept.jerk_max, band)


@pytest.mark.interpreted
@pytest.mark.parametrize("lag", [None, 1])
def test_parts_of_the_memory_fill_it_one_after_the_other_and_say_their_sizes(lag):
    n, k, delay, stops = 5, 3, 2, stops_of(lag)
    size = sampled_size(n, k, stops.itemsize) + tube_size(n, k, delay, True, stops.itemsize)
    memory = empty_memory(n, k, size, delay, True)
    assert not memory[32:].any()
    held, rest = sampled_memory(memory, n, k, stops)
    assert held.settings[0][["rows", "obstacles", "delay", "looks_ahead"]].item() == (n, k, delay, 1)
    parts = [held.settings, *held.rows, held.velocities, *tube_memory(rest, n, k, (delay, True), stops)]
    begin = memory.ctypes.data
    assert [part.size > 0 for part in parts[-2:]] == [lag is not None] * 2
    for part in (part for part in parts if part.size):
        assert part.ctypes.data == begin and begin % 8 == 0 and np.shares_memory(part, memory)
        begin += part.nbytes
    assert begin == memory.ctypes.data + memory.nbytes
    assert held.rows.plans.dtype == (LED_PLAN if lag else PLAN)
    # Where no answer can be on its way or lost, nothing is kept of what comes.
    assert tube_size(n, k, 0, False) == n * k * 8


@pytest.mark.interpreted
def test_stops_keep_their_distance_but_where_the_vehicle_is_nearer():
    plan = np.zeros(1, dtype=PLAN)[0]
    write_stop(plan, HOVER, (0.0, 0.0, 0.0), 0, PERIOD)
    x = HOVER._replace(r=(0.0, 0.01, 0.0))  # 1 cm off the stop
    spheres = spheres_at(((3.0, 0.0, 0.0), 1.0), ((0.0, 1.015, 0.0), 1.0), ((9.0, 0.0, 0.0), 0.0))
    ahead, stored, bare = distances_to_keep(plan, x, spheres, settings_of(margin=0.1), None)
    # Half of the margin, or where the vehicle is; the radius and twice what it is off, wherever the stop is.
    assert ahead.keep_out == pytest.approx([1.05, 1.005, 0.0], abs=1e-11)
    assert stored.keep_out == pytest.approx([1.02, 1.02, 0.0], abs=2e-9)
    assert bare.keep_out.tolist() == [1.0, 1.0, 0.0]
    assert ahead.keep_out[1] < 1.005
    for part in (ahead, stored, bare):
        assert part.center is spheres[0] and part.velocity is spheres[1]


@pytest.mark.interpreted
def test_a_stop_that_counts_has_a_clear_tube_and_the_vehicle_in_it():
    rng, counting, refused = np.random.default_rng(5), 0, 0
    settings = settings_of()
    for _ in range(600):
        plan = np.zeros(1, dtype=PLAN)[0]
        write_stop(plan, Flat(*(tuple(row) for row in rng.normal(size=(4, 3)) * 0.3)), NOTHING, 2, PERIOD)
        for _ in range(int(rng.integers(5))):
            advance_stop(plan, PERIOD)
        ref, way = reference(plan, PERIOD), rng.normal(size=3)
        off = rng.uniform(0.0, 0.01)
        x = ref._replace(r=tuple(np.array(ref.r) + off * way / np.linalg.norm(way)))
        side = rng.normal(size=3)
        center = np.array(ref.r) + rng.uniform(0.49, 0.55) * side / np.linalg.norm(side)
        spheres = spheres_at((center, 0.5))
        kept = distances_to_keep(plan, x, spheres, settings, None)
        flight = settings.flight
        if standing(plan, x, PERIOD, kept, flight.limits, flight.gains) != STOPPED:
            refused += 1
            continue
        counting += 1
        assert np.linalg.norm(np.array(x.r) - center) >= 0.5 + off - 1e-9
        y, h = Flat(*(tuple(row) for row in plan["begin"])), segment_periods(plan, PERIOD) * PERIOD
        for _ in range(int(plan["segments_left"])):
            snap = dead_beat_snap(y, NOTHING, h)
            for t in np.linspace(0.0, h, 21):
                assert np.linalg.norm(np.array(flown(y, snap, t).r) - center) >= 0.5 + 2 * off - 1e-9
            y = flown(y, snap, h)
    assert counting > 50 and refused > 50


@pytest.mark.interpreted
def test_in_a_tube_every_distance_is_kept_and_only_more_than_errors_counts_as_off():
    plan = np.zeros(1, dtype=PLAN)[0]
    write_stop(plan, HOVER, (0.0, 0.0, 0.0), 0, PERIOD)
    x = HOVER._replace(r=(0.0, 0.05, 0.0))
    spheres = spheres_at(((3.0, 0.0, 0.0), 1.0), ((0.0, 1.015, 0.0), 1.0), ((9.0, 0.0, 0.0), 0.0))
    for estimate, off in ((0.06, 0.0), (0.02, 0.06)):
        ahead, stored, bare = distances_to_keep(
            plan, x, spheres, settings_of(margin=0.1), Width(0.01, estimate)
        )
        assert ahead.keep_out == pytest.approx([1.05, 1.05, 0.0], abs=1e-12)
        assert stored.keep_out == pytest.approx([1.0 + off, 1.0 + off, 0.0], abs=2e-9)
        assert bare.keep_out == pytest.approx([0.99, 0.99, 0.0], abs=1e-12)


@pytest.mark.interpreted
def test_what_a_flight_begins_outside_of_may_get_no_worse():
    limits = FlightLimits(380.0, 360.0, 40.0, ThrustBand(5.0, 19.0, GRAVITY))
    assert limits_at(HOVER, limits, None) == limits
    x = HOVER._replace(a=(0.0, 0.0, 12.0), j=(30.0, 40.0, 0.0))
    found = limits_at(x, limits, None)
    assert limits_at(x, limits, Width(0.0, 0.0)) == limits
    assert found.jerk_max == pytest.approx(50.0, rel=1e-11) and found.jerk_max > 50.0
    assert found.band.most == pytest.approx(21.81, rel=1e-11) and found.band.most > 21.81
    assert found.band.least == 5.0 and found[:2] == (380.0, 360.0)
    sinking = limits_at(HOVER._replace(a=(0.0, 0.0, -7.0)), limits, None).band
    assert sinking.least == pytest.approx(2.81, rel=1e-11) and sinking.least < 2.81 and sinking.most == 19.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("kind", "is_outside", "expected"),
    [
        (ACCEPTED, True, (0, 0, 1, 0)),
        (ACCEPTED, False, (0, 0, 0, 1)),
        (BLENDED, True, (1, 0, 1, 0)),
        (STOPPED, True, (1, 1, 1, 1)),
        (ASTRAY, True, (1, 1, 0, 1)),
        (UNCERTIFIED, True, (1, 0, 0, 1)),
    ],
)
def test_what_was_flown_is_told(kind, is_outside, expected):
    fact = open_fact()
    note_kind(fact, kind, is_outside)
    assert fact[["refused", "stopped", "certified", "fallback"]].item() == expected


@pytest.mark.interpreted
def test_the_backup_brakes_and_pushes_off():
    settings, away = settings_of(), row_of((-1.0, 0.0, 0.0, -1e9))
    x, far = HOVER._replace(v=(1.0, 0.0, 0.0)), spheres_at(((9.0, 0.0, 0.0), 1.0))
    brake = braking(x.v, x.a, x.j, settings.braking)
    assert backup_snap(x, far, away, settings) == brake and brake[0] < 0.0
    # A sphere ahead asks for more than braking, and gets no more than that.
    ahead = spheres_at(((1.1, 0.0, 0.0), 1.0))
    u, is_feasible = nearest_snap(x, brake, False, ahead, row_of((-1.0, 0.0, 0.0, 0.0)), settings)
    assert is_feasible and u[0] < brake[0]
    assert backup_snap(x, ahead, row_of((-1.0, 0.0, 0.0, 0.0)), settings) == u
    # Between two spheres that come from both sides and ask for opposite things: off the one that asks more.
    both = spheres_at(((1.1, 0.0, 0.0), 1.0), ((-1.15, 0.0, 0.0), 1.0))
    both.velocity[:, 0] = -4.0, 4.0
    row = row_of((-1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    u = backup_snap(HOVER, both, row, settings)
    assert u == tuple(600.0 * row.chosen[int(row.fact["obstacle"])]["n"]) and row.fact["obstacle"] in (0.0, 1.0)
    # In a sphere: out of it, whatever else is near.
    inside = spheres_at(((0.9, 0.0, 0.0), 1.0), ((-1.05, 0.0, 0.0), 1.0))
    u = backup_snap(HOVER, inside, row, settings)
    assert row.fact["obstacle"] == 0.0
    assert np.linalg.norm(u) == pytest.approx(settings.recovery[0] * RECOVERY_SPEED)
    # No longer than the authority's snap.
    bound, absent = settings_of(authority=VEHICLE), spheres_at(((9.0, 0.0, 0.0), 0.0))
    u = backup_snap(HOVER._replace(v=(500.0, 0.0, 0.0)), absent, away, bound)
    assert np.linalg.norm(u) <= VEHICLE.snap_max * (1.0 + 1e-12)


@pytest.mark.interpreted
def test_a_half_space_enters_once_and_only_if_the_snap_is_outside():
    spaces, u = no_half_spaces(2), (1.0, 0.0, 0.0)
    assert spaces.normals.shape == (2 * 2 + LIMITS, 3) and (spaces.offsets == -math.inf).all()
    inside, touched, outside = (Demand((1.0, 0.0, 0.0), least, 0.0, True) for least in (0.5, 1.0, 2.0))
    assert not enter(spaces, 1, inside, u) and not enter(spaces, 1, touched, u)
    assert spaces.offsets[1] == -math.inf
    assert enter(spaces, 1, outside, u)
    assert spaces.normals[1].tolist() == [1.0, 0.0, 0.0] and spaces.offsets[1] == 2.0
    assert not enter(spaces, 1, outside._replace(least=3.0), u) and spaces.offsets[1] == 2.0


@pytest.mark.interpreted
def test_the_largest_correction_names_the_sphere_and_the_largest_input_is_the_reserve():
    fact, u = open_fact(), (0.0, 0.0, 5.0)
    first = note_demand(Demand((1.0, 0.0, 0.0), 3.0, 0.0, True), u, 4, 0.0, fact)
    second = note_demand(Demand((0.0, 0.0, 1.0), 7.0, 0.0, True), u, 6, first, fact)
    assert (first, second) == (3.0, 3.0)
    assert fact["obstacle"] == 4.0 and fact["reserve"] == 7.0
    # The first of equals.
    assert note_demand(Demand((0.0, 1.0, 0.0), 3.0, 0.0, True), u, 9, second, fact) == 3.0
    assert fact["obstacle"] == 4.0


@pytest.mark.interpreted
def test_chosen_half_spaces_enter_as_they_were_remembered():
    row = row_of((1.0, 0.0, 0.0, 2.0), (0.0, 1.0, 0.0, 9.0), (0.0, 0.0, 1.0, -1.0))
    spaces = no_half_spaces(3)
    spheres = spheres_at((NOTHING, 1.0), (NOTHING, 0.0), (NOTHING, 1.0))
    found = cut_as_chosen((0.0, 0.0, 0.0), spheres, row, spaces)
    assert found == (True, 2.0) and row.fact["obstacle"] == 0.0
    # The second sphere is absent, the third asks for nothing.
    assert spaces.offsets[:3].tolist() == [2.0, -math.inf, -math.inf]


@pytest.mark.interpreted
def test_a_snap_is_shortened_along_the_way_to_the_least_one():
    spaces = no_half_spaces(1)
    spaces.normals[0], spaces.offsets[0] = (1.0, 0.0, 0.0), 3.0
    assert shortened((3.0, 4.0, 0.0), spaces, 5.0) == (3.0, 4.0, 0.0)
    # From (3, 8, 0) towards (3, 0, 0), to length 5.
    assert shortened((3.0, 8.0, 0.0), spaces, 5.0) == pytest.approx((3.0, 4.0, 0.0), abs=1e-10)
    # From (6, 4, 0) towards (3, 0, 0): 25 s² + 18 s = 16 where (3 + 3 s, 4 s) has the length 5.
    s = (math.sqrt(18.0**2 + 4 * 25 * 16) - 18.0) / 50.0
    assert shortened((6.0, 4.0, 0.0), spaces, 5.0) == pytest.approx((3.0 + 3.0 * s, 4.0 * s, 0.0), abs=1e-10)
    # There is none of length 2 with x >= 3.
    assert shortened((3.0, 8.0, 0.0), spaces, 2.0) == (3.0, 8.0, 0.0)


@pytest.mark.interpreted
def test_directions_values_and_where_the_vehicle_is():
    settings = settings_of()
    spheres = as_one_row(spheres_at(((2.0, 0, 0), 1.0), ((0, 5.0, 0), 1.0), ((0, 0, 0), 0.0)))
    chosen, fact = np.zeros(3, dtype=HALF_SPACE), open_fact()
    rows = (spheres, Chosen(chosen, None), settings, fact)
    assert choose_directions(0, HOVER, (0.0, 0.0, 0.0), *rows) == (False, True)
    assert chosen["n"][:2].tolist() == [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    assert fact["value"] == pytest.approx(2.0 - 1.005) and chosen[2] == np.zeros(1, dtype=HALF_SPACE)[0]
    # A snap straight at the first sphere is cut; inside of a sphere the vehicle is not outside of all.
    assert choose_directions(0, HOVER, (1e6, 0.0, 0.0), *rows) == (True, True)
    inside = HOVER._replace(r=(1.5, 0.0, 0.0))
    assert not choose_directions(0, inside, (0.0, 0.0, 0.0), *rows)[1]
    on_it = HOVER._replace(r=(1.0, 0.0, 0.0))
    assert choose_directions(0, on_it, (0.0, 0.0, 0.0), *rows)[1]


@pytest.mark.interpreted
def test_the_nearest_snap_keeps_what_each_sphere_asks_for_and_changes_nothing_else():
    settings = settings_of()
    spheres = spheres_at(((1.5, 0.0, 0.0), 1.0), ((0.0, 1.4, 0.0), 1.0), ((0.0, 0.0, 0.0), 0.0))
    row = row_of((-1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    calm = (-1.0, -2.0, 3.0)
    assert nearest_snap(HOVER, calm, False, spheres, row, settings) == (calm, True)
    assert row.fact[["reserve", "obstacle"]].item() == (0.0, -1.0)
    wild = (1e5, 2e5, 7.0)
    u, is_feasible = nearest_snap(HOVER, wild, False, spheres, row, settings)
    # The two directions are square to each other: each coordinate is what its sphere admits.
    assert is_feasible and u[2] == 7.0 and row.fact["obstacle"] == 1.0
    for k, axis in ((0, 0), (1, 1)):
        distance = 1.5 - 0.1 * k
        state = np.array([[0.0, 0.0, 0.0, distance]])
        least = sampled_input(state, -wild[axis], PERIOD, 200.0, 1.005, 2.0)[0][0]
        assert u[axis] == pytest.approx(-least)


@pytest.mark.interpreted
def test_the_nearest_snap_keeps_to_an_authority():
    settings = settings_of(authority=VEHICLE)
    spheres, row = spheres_at(((9.0, 0.0, 0.0), 0.0)), row_of((0.0, 0.0, 0.0, 0.0))
    x = HOVER._replace(j=(38.0, 0.0, 0.0), a=(2.0, 0.0, 0.0))
    wanted = (1e4, 50.0, 20.0)
    u, is_feasible = nearest_snap(x, wanted, False, spheres, row, settings)
    assert is_feasible and np.linalg.norm(u) <= VEHICLE.snap_max and row.fact["obstacle"] == -1.0
    for limit in range(LIMITS):
        demand = limit_demand(limit, x, u, settings.sampling, settings.sampling.authority)
        assert excess(demand, u) <= 1e-6
    jerk = np.array(x.j) + PERIOD * np.array(u)
    assert np.linalg.norm(jerk) == pytest.approx(settings.flight.limits.jerk_max, rel=1e-2)


@pytest.mark.interpreted
def test_a_bound_on_the_closing_speed_cuts_what_the_distance_admits():
    settings = settings_of(max_closing_speed=1.0)
    spheres, row = spheres_at(((50.0, 0.0, 0.0), 1.0)), row_of((-1.0, 0.0, 0.0, 0.0))
    x, wanted = HOVER._replace(v=(0.9, 0.0, 0.0)), (2000.0, 1.0, 2.0)
    assert nearest_snap(x, wanted, False, spheres, row, settings_of())[0] == wanted
    u, is_feasible = nearest_snap(x, wanted, False, spheres, row, settings)
    least = sampled_input(np.array([[0.0, 0.0, -0.9]]), -2000.0, PERIOD, 200.0, -1.0, 2.0)[0][0]
    assert is_feasible and u == pytest.approx((-least, 1.0, 2.0))
    assert row.fact["value"] == pytest.approx(0.1) and row.fact["obstacle"] == 0.0


@pytest.mark.interpreted
def test_forgetting_a_row_empties_its_half_spaces_and_its_stop_alone():
    flat = np.zeros((3, 4, 3))
    flat[:, 1] = 0.1, 0.2, 0.3
    center, radius = np.full((3, 2, 3), 2.0), np.ones((3, 2))
    shield = Shield()
    shield.filter(flat, Obstacles.spheres(center, radius), np.zeros((3, 3)), PERIOD)

    def parts():
        return sampled_memory(shield.snapshot()["memory"], 3, 2, PLANS)[0].rows

    before = parts()
    assert before.half_spaces["n"].any(axis=(1, 2)).all() and before.plans["is_stored"].all()
    shield.reset(np.array([False, True, False]))
    after = parts()
    assert not after.half_spaces["n"][1].any() and not after.half_spaces["least"][1].any()
    assert (after.half_spaces[[0, 2]] == before.half_spaces[[0, 2]]).all()
    assert after.plans["is_stored"].tolist() == [True, False, True]
