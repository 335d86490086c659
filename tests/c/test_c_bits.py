"""The shield in C gives the bits of the one in Python: its functions, single states, whole flights.

Both run the same operations in the same order in IEEE double, C without contraction; cos, acos, cbrt and exp
come from the same libm. What Python makes with numpy's linear algebra, gains and widths of tubes, depends on
that: of these digits are compared.
"""

import re
import shutil

import numpy as np
import pytest
from c_flights import FLIGHTS, after, attack, fly, numbers_off, random_states, random_worlds
from c_shield import CShields, Library, build, differences, library, settings_in
from house import ROOT
from random_shapes import random_shape

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import subtract, vector, write3
from quadsafe_core.maths.projection import project_batch
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import cores_of
from quadsafe_core.shapes.distance import nearest_point, signed_distance
from quadsafe_core.shapes.records import core_bytes
from quadsafe_core.shapes.support import support_height
from quadsafe_env.vehicle.flatness import flat_state, wrench_from_snap
from quadsafe_env.vehicle.params import params_from
from shields import Shield
from shields.chains.lower_bound import lower4_batch
from shields.filters.sampled import sampled_input_batch

# Of each function; of the filter in whole flights of all kinds together.
ROWS = 1_000_000
VEHICLES = 250
STEPS = ROWS // (VEHICLES * len(FLIGHTS))


def chains(rng, n):
    """States (N, 4) of all sizes, some on axes, and u_max."""
    x = rng.normal(size=(n, 4)) * 10.0 ** rng.uniform(-3.0, 3.0, (n, 4))
    x[rng.random((n, 4)) < 0.05] = 0.0
    return x, 10.0 ** rng.uniform(1.0, 3.0, n)


def test_g4_and_its_time():
    x, u_max = chains(np.random.default_rng(0), ROWS)
    found, value, t_star = np.zeros((ROWS, 2)), np.zeros(ROWS), np.zeros(ROWS)
    library().call("lower4_rows", ROWS, x, u_max, found)
    lower4_batch(x.reshape(-1), u_max, np.zeros(ROWS), value, t_star)
    assert np.array_equal(found, np.column_stack([value, t_star]))


@pytest.mark.parametrize("period", [0.004, 0.02, 0.1])
def test_least_held_input(period):
    rng = np.random.default_rng(1)
    (x, u_max), bound = chains(rng, ROWS), rng.uniform(0.0, 2.0, ROWS)
    wanted, holding = 2.0 * u_max * rng.normal(size=ROWS), np.array([period, 2.0 * period, 3.0])
    found, u, in_set = np.zeros((ROWS, 3)), np.zeros(ROWS), np.zeros(ROWS, dtype=np.bool_)
    library().call("required4_rows", ROWS, x, wanted, u_max, bound, holding, found)
    sampled_input_batch(x, wanted, u_max, bound, tuple(holding), u, in_set)
    assert np.array_equal(found[:, [0, 2]], np.column_stack([u, in_set]))
    assert 0.2 < (u > wanted).mean() < 0.8


@pytest.mark.parametrize("count", [1, 3, 8])
def test_projection(count):
    rng, n = np.random.default_rng(2), ROWS // 3
    normals, desired = rng.normal(size=(n, count, 3)), 100.0 * rng.normal(size=(n, 3))
    # Nearly parallel ones are not exchanged but taken one after the other.
    normals[: n // 4] = normals[: n // 4, :1] + 1e-3 * normals[: n // 4]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    offsets = np.where(rng.random((n, count)) < 0.2, -np.inf, 100.0 * rng.normal(size=(n, count)))
    found, out, is_feasible = np.zeros((n, 4)), np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    planes = np.concatenate([normals, offsets[..., None]], axis=-1)
    library().call("project_rows", n, count, desired, planes, found)
    project_batch(desired, normals, offsets, out, is_feasible)
    assert np.array_equal(found[:, 3], is_feasible) and np.array_equal(found[is_feasible, :3], out[is_feasible])


@kernel
def shape_batch(cores, numbers, center, points, out):
    """Rows of distance, direction away, nearest point and support height by the kernels of Python."""
    for i in range(points.shape[0]):
        x = subtract(points[i], center)
        distance, n = signed_distance(cores[0, 0], numbers, x)
        out[i, 0], out[i, 7] = distance, support_height(cores[0, 0], numbers, vector(points[i]))
        write3(out[i, 1:4], n)
        write3(out[i, 4:7], nearest_point(cores[0, 0], numbers, x))


def shape_rows(shape, points):
    """What ``shape_batch`` finds of one shape."""
    core, numbers = cores_of(core_bytes([[shape.body()]], 1), 1, 1)
    found = np.zeros((len(points), 8))
    shape_batch(core, numbers, shape.body().center, points, found)
    return found


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box", "half_space"])
def test_distances_and_supports(kind):
    rng = np.random.default_rng(3)
    for _ in range(4):
        # Five kinds.
        shape, points = random_shape(rng, kind), 2.0 * rng.normal(size=(ROWS // 20, 3))
        points[0] = shape.body().center
        body, found = record_of(shape), np.zeros((len(points), 8))
        library().call("shape_rows", len(points), body, points, found)
        assert np.array_equal(found, shape_rows(shape, points))


def record_of(shape):
    """A shape as the record in C."""
    return library().worlds(Obstacles.pack([[shape]]))[0]


@pytest.mark.parametrize("name", FLIGHTS)
def test_single_states(name):
    flight, n = FLIGHTS[name], 300
    rng = np.random.default_rng(4)
    obstacles, flats = random_worlds(rng, n, flight), random_states(rng, n)
    shield = Shield(**flight.settings)
    mine = CShields(library(), shield, n)
    snaps = attack(rng, flats, obstacles, 25)
    theirs = shield.filter(flats, obstacles, snaps, flight.period)
    assert not mine.prepare(flight.period).any()
    mine.exactly(shield, flight.period)
    answers, codes = mine.filter(flats, library().worlds(obstacles), snaps, flight.period)
    assert not codes.any() and not len(differences(answers, theirs))


@pytest.mark.parametrize("name", FLIGHTS)
def test_flights_under_attack(name):
    different, certified, _ = fly(library(), FLIGHTS[name], VEHICLES, STEPS)
    assert different == 0
    assert certified > 0.5


def test_a_stop_does_not_outlive_its_period():
    flight, n = FLIGHTS["spheres"], 300
    rng = np.random.default_rng(6)
    obstacles, flats = random_worlds(rng, n, flight), random_states(rng, n)
    shield = Shield()
    mine = CShields(library(), shield, n)
    for step, period in enumerate([0.01, 0.03, 0.03, 0.01]):
        # Nothing is wanted: every answer is a stop.
        snaps = np.full((n, 3), np.nan) if step % 2 else attack(rng, flats, obstacles, 25)
        theirs = shield.filter(flats, obstacles, snaps, period)
        assert not mine.prepare(period).any()
        mine.exactly(shield, period)
        answers, codes = mine.filter(flats, library().worlds(obstacles), snaps, period)
        assert not codes.any() and not len(differences(answers, theirs))
        flats = after(flats, theirs.snap, period)


def test_the_stored_stop_is_flown_in_these_flights():
    assert fly(library(), FLIGHTS["slow control"], 20, 120)[2] > 0.05


# A relative error of 1e-13 in a gain moves a vehicle on its stop by less than that.
@pytest.mark.parametrize("period", [0.02, 0.05])
@pytest.mark.parametrize("name", ["limits", "losses", "errors", "delay", "pushes"])
def test_gains_and_tubes_to_thirteen_digits(name, period):
    assert numbers_off(library(), FLIGHTS[name]._replace(period=period)) < 1e-13


# An exponential is squared a few times, each of which may double what rounding took; of a lag in an interval
# Python gives back what a Fourier transform may have taken, 1e-12.
COMES_SELDOM = ("uneven periods", "a lag in an interval", "a lag in an interval, uneven periods", "all")


@pytest.mark.parametrize("name", COMES_SELDOM)
def test_tubes_of_what_comes_seldom_to_eleven_digits(name):
    assert numbers_off(library(), FLIGHTS[name]) < 1e-11


# Rounding of float in exponentials and powers of a loop, 4e-4 seen.
@pytest.mark.parametrize("name", COMES_SELDOM)
def test_tubes_of_what_comes_seldom_in_float_to_a_thousandth(name):
    assert numbers_off(library(is_float=True), FLIGHTS[name]) < 1e-3


def test_settings_have_the_defaults_of_python():
    found = np.zeros((), dtype=library().settings)
    library().call("qs_defaults", found)
    assert found == settings_in(library(), Shield())


def test_flat_map():
    rng, params = np.random.default_rng(5), params_from("hummingbird")
    states, snaps, yaw = rng.normal(size=(ROWS, 20)), rng.normal(size=(ROWS, 3)), rng.normal(size=ROWS)
    states[:, 18] = np.abs(states[:, 18]) + 0.1
    body = np.array([params.mass, *params.inertia, params.gravity])
    flats, wrenches, codes = np.zeros((ROWS, 4, 3)), np.zeros((ROWS, 4)), np.zeros(ROWS, dtype=np.int32)
    library().call("flat_rows", ROWS, states, body, flats, codes)
    assert not codes.any() and np.array_equal(flats, flat_state(states, params))
    library().call("wrench_rows", ROWS, states, snaps, yaw, body, wrenches, codes)
    assert not codes.any() and np.array_equal(wrenches, wrench_from_snap(states, snaps, params, yaw))


def mutated(folder, file, before, after):
    """A library in which one text of one file is another."""
    shutil.copytree(ROOT / "c", folder / "c")
    (folder / "tests" / "c").mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "c" / "loops.c", folder / "tests" / "c")
    text = (folder / "c" / file).read_text()
    assert len(re.findall(re.escape(before), text)) >= 1
    (folder / "c" / file).write_text(text.replace(before, after, 1))
    return Library(build("-O1", source=folder / "tests" / "c" / "loops.c"))


def test_a_constant_that_is_a_little_off_is_noticed(tmp_path):
    other = mutated(tmp_path, "qs_chain.h", "EITHER(4e-15, ", "EITHER(5e-15, ")
    assert fly(library(), FLIGHTS["spheres"], 20, 60)[0] == 0
    assert fly(other, FLIGHTS["spheres"], 20, 60)[0] > 0


def test_what_comes_no_nearer_without_a_certificate_is_flown_in_these_flights(tmp_path):
    other = mutated(tmp_path, "quadsafe.c", "is_near && standing", "is_near && !all && standing")
    shells = FLIGHTS["shells wider than the gaps between shapes"]
    assert fly(library(), shells, 20, 60)[0] == 0
    assert fly(other, shells, 20, 60)[0] > 0
