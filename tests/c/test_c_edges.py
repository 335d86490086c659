"""The shield in C at its edges: bad input, sanitizers, float, shapes as they are made, what it links."""

import ctypes
import re
import subprocess

import numpy as np
import pytest
from c_flights import after
from c_shield import (
    BAD_COUNT,
    BAD_OBSTACLE,
    BAD_PERIOD,
    BAD_SETTINGS,
    BAD_STATE,
    BAD_TIME,
    BAD_UNCERTAINTY,
    DONE,
    FLAGS,
    KINDS,
    CShields,
    library,
    made_in_c,
)
from house import ROOT
from random_shapes import random_shape

from quadsafe_core.shapes import Hull, Obstacles
from shields import Shield, Uncertainty

PERIOD, NONE = 0.01, Uncertainty()
WARNED = ["cc", *FLAGS[:-1]]
STRICT = ("-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
LIBM = {"acos", "cbrt", "cos", "exp", "expm1", "fma", "rint", "sqrt"}
STRINGS = {"memcpy", "memset", "memcmp", "memmove"}


@pytest.mark.parametrize("real", [(), ("-DQS_FLOAT",)], ids=["double", "float"])
def test_whatever_comes_in_under_sanitizers(tmp_path, real):
    out = tmp_path / "fuzz"
    files = [str(ROOT / "tests" / "c" / "fuzz.c"), str(ROOT / "c" / "quadsafe.c")]
    subprocess.run([*WARNED, "-O0", *STRICT, *real, *files, "-o", str(out), "-lm"], check=True)
    found = subprocess.run([str(out), "300", "7"], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (0, "300 rounds\n"), found.stdout + found.stderr


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The object file of the shield."""
    out = tmp_path_factory.mktemp("c") / "quadsafe.o"
    subprocess.run([*WARNED, "-O1", "-c", str(ROOT / "c" / "quadsafe.c"), "-o", str(out)], check=True)
    return str(out)


def test_it_links_nothing_but_mathematics_and_keeps_no_state(compiled):
    symbols = [line.split() for line in subprocess.check_output(["nm", compiled], text=True).splitlines()]
    assert {name for *_, kind, name in symbols if kind == "U"} <= LIBM | STRINGS
    assert not [name for *_, kind, name in symbols if kind in "bBdDC"]
    shown = {name for *_, kind, name in symbols if kind == "T"}
    assert all(name.startswith("qs_") for name in shown) and "qs_filter" in shown


def test_the_example_on_board(compiled, tmp_path):
    out, loop = str(tmp_path / "onboard"), str(ROOT / "examples" / "onboard" / "loop.c")
    subprocess.run([*WARNED, "-O1", f"-I{ROOT / 'c'}", loop, compiled, "-o", out, "-lm"], check=True)
    said = subprocess.check_output([out], text=True)
    assert "never nearer than 0.00" in said and "at rest at x = 3.99" in said


def test_the_page_counts_files_and_lines_as_they_are():
    files = sorted((ROOT / "c").glob("*.[ch]"))
    lines = [line for file in files for line in file.read_text().splitlines()]
    code = [line for line in lines if not re.match(r"\s*$|\s*(/\*|\*)", line)]
    said = f"{len(files)} files and {len(lines):,} lines, of which {len(code):,} are"
    assert said in (ROOT / "docs" / "onboard.md").read_text(encoding="utf-8")


def one(settings=None, is_float=False):
    """A shield in C at PERIOD that has a stop in store, and what it was given last."""
    found = library(is_float=is_float)
    mine = CShields(found, Shield(**(settings or {})), 1)
    flats, world = np.zeros((1, 4, 3)), found.worlds(Obstacles.spheres([[[2.0, 0.0, 0.0]]], [[0.5]]))
    flats[0, 1] = 1.0, 0.2, 0.0
    answers, codes = mine.filter(flats, world, np.zeros((1, 3)), PERIOD)
    assert codes[0] == DONE and answers["certified"][0]
    return mine, after(flats, answers["snap"], PERIOD), world


def changed(world, name, value):
    world = world.copy()
    world[name] = value
    return world


BAD_CALLS = {
    "state": (lambda f, w: (np.full_like(f, np.nan), w, PERIOD), BAD_STATE),
    "large state": (lambda f, w: (f + 1e31, w, PERIOD), BAD_STATE),
    "radius": (lambda f, w: (f, changed(w, "radius", -1.0), PERIOD), BAD_OBSTACLE),
    "center": (lambda f, w: (f, changed(w, "center", np.inf), PERIOD), BAD_OBSTACLE),
    "kind": (lambda f, w: (f, changed(w, "kind", 99), PERIOD), BAD_OBSTACLE),
    "hull of nothing": (lambda f, w: (f, changed(w, "kind", KINDS.index("hull")), PERIOD), BAD_OBSTACLE),
    "another count": (lambda f, w: (f, np.repeat(w, 2, axis=1), PERIOD), BAD_COUNT),
    "too many": (lambda f, w: (f, np.repeat(w, 17, axis=1), PERIOD), BAD_COUNT),
    "period in milliseconds": (lambda f, w: (f, w, 10.0), BAD_PERIOD),
    "period": (lambda f, w: (f, w, np.nan), BAD_PERIOD),
}


@pytest.mark.parametrize("name", BAD_CALLS)
def test_a_bad_call_is_answered_by_the_stored_stop(name):
    (mine, flats, world), (spoil, code) = one(), BAD_CALLS[name]
    (other, _, _), lost = one(), np.ones(1, dtype=bool)
    bad_flats, bad_world, period = spoil(flats, world)
    answers, codes = mine.filter(bad_flats, bad_world, np.ones((1, 3)), period)
    assert codes[0] == code
    assert answers["stopped"] and answers["fallback"] and answers["intervened"] and not answers["certified"]
    # The same stop, from the state that was told where one was.
    good, _ = other.filter(flats, world, np.full((1, 3), np.nan), PERIOD)
    stop = other.backup(lost)
    assert np.allclose(answers["snap"], stop, rtol=0, atol=1e-9) and np.abs(stop).max() > 1.0
    assert good["fallback"]


def test_a_period_of_unknown_length_is_answered_by_the_stored_stop_and_a_told_one_is_not():
    mine, flats, world = one({"uncertainty": {"jitter": 0.2}})
    for seconds in (0.0, -1.0, np.nan, np.inf, 1.1):
        assert mine.held_for([seconds])[0] == BAD_TIME
    answers, codes = mine.filter(flats, world, np.zeros((1, 3)), PERIOD)
    assert codes[0] == BAD_TIME and answers["stopped"] and not answers["certified"]
    assert mine.held_for([1.1 * PERIOD])[0] == DONE
    answers, codes = mine.filter(after(flats, answers["snap"], 1.1 * PERIOD), world, np.zeros((1, 3)), PERIOD)
    assert codes[0] == DONE and answers["certified"]
    assert one()[0].held_for([PERIOD])[0] == BAD_SETTINGS


def test_after_any_number_of_bad_calls_the_vehicle_rests():
    mine, flats, world = one()
    for _ in range(200):
        answers, codes = mine.filter(np.full_like(flats, np.nan), world, np.zeros((1, 3)), PERIOD)
        assert codes[0] == BAD_STATE
        flats = after(flats, answers["snap"], PERIOD)
    assert np.abs(flats[0, 1:]).max() < 1e-9
    assert mine.filter(flats, world, np.zeros((1, 3)), PERIOD)[1][0] == DONE


def test_a_watchdog_that_asks_again_and_again_brings_the_vehicle_to_rest():
    mine, flats, world = one()
    answers, _ = mine.filter(flats, world, np.full((1, 3), 50.0), PERIOD)
    for _ in range(200):
        flats = after(flats, mine.backup(np.ones(1, dtype=bool)), PERIOD)
    assert answers["certified"] and np.abs(flats[0, 1:]).max() < 1e-9
    assert np.linalg.norm(flats[0, 0] - (2.0, 0.0, 0.0)) > 0.5


def test_without_a_stop_or_a_measurement_the_vehicle_brakes():
    mine = CShields(library(), Shield(), 1)
    flats, world = np.zeros((1, 4, 3)), mine.library.worlds(Obstacles.spheres([[[0.0, 0.0, 0.0]]], [[1.0]]))
    flats[0, 1] = 3.0, 0.0, 0.0
    answers, _ = mine.filter(flats, world, np.zeros((1, 3)), PERIOD)
    assert not answers["certified"]
    for _ in range(600):
        flats = after(flats, answers["snap"], PERIOD)
        answers, codes = mine.filter(np.full_like(flats, np.nan), world, np.zeros((1, 3)), PERIOD)
        assert codes[0] == BAD_STATE and not answers["stopped"]
    assert np.abs(flats[0, 1:]).max() < 1e-3


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"snap_max": 0.0}, BAD_SETTINGS),
        ({"snap_max": np.nan}, BAD_SETTINGS),
        ({"reserve": 0.5}, BAD_SETTINGS),
        ({"held_snap_max": 599.0}, BAD_SETTINGS),
        ({"specific_thrust_min": 9.81}, BAD_SETTINGS),
        ({"alpha": 0.0}, BAD_SETTINGS),
        ({"margin": -0.1}, BAD_SETTINGS),
        ({"uncertainty": {"gain": 1.0}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"position": -1.0}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"delay": 5}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"impulse": 0.1}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"impulse_gap": 1.0}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"impulse": np.inf, "impulse_gap": 1.0}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"rotor_lag": 0.03, "rotor_lag_most": 0.02}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"rotor_lag_most": 0.02}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"jitter": 1.0}}, BAD_UNCERTAINTY),
        ({"uncertainty": {"jitter": -0.1}}, BAD_UNCERTAINTY),
    ],
)
def test_bad_settings_are_told_and_the_shield_answers_with_nothing(changes, code):
    mine = CShields(library(), Shield(), 1)
    for name, value in changes.items():
        for field, inner in value.items() if isinstance(value, dict) else ():
            mine.settings[name][field] = inner
        if not isinstance(value, dict):
            mine.settings[name] = value
    mine.library.call("init_rows", 1, mine.memory, mine.settings, mine.codes)
    assert mine.codes[0] == code
    answers, codes = mine.filter(
        np.zeros((1, 4, 3)), np.zeros((1, 0), mine.library.obstacle), np.ones((1, 3)), PERIOD
    )
    assert codes[0] == BAD_SETTINGS and not answers["snap"].any() and answers["fallback"]


@pytest.mark.parametrize(
    "errors",
    [
        {"wind": 100.0},
        {"impulse": 1e-3, "impulse_gap": 0.9 * PERIOD},
        {"rotor_lag": 0.01, "rotor_lag_most": 0.02},
        {"jitter": 0.6},
        {"rotor_lag": 0.036, "rotor_lag_most": 0.042, "jitter": 0.1},
    ],
)
def test_errors_that_leave_no_stop_are_told(errors):
    mine = CShields(library(), Shield(), 1)
    for name, bound in errors.items():
        mine.settings["uncertainty"][name] = bound
    mine.library.call("init_rows", 1, mine.memory, mine.settings, mine.codes)
    assert mine.codes[0] == DONE and mine.prepare(PERIOD)[0] == BAD_UNCERTAINTY


ULPS = 4 * np.finfo(float).eps


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box", "half_space", "hull"])
def test_shapes_are_those_of_python(kind):
    # hypot of Python is another than a square root of squares: a length is off by a rounding or two.
    rng = np.random.default_rng(0)
    for _ in range(50):
        shape = random_shape(rng, kind)
        body, made = shape.body(), made_in_c(shape)
        assert made["kind"] == KINDS.index(kind)
        assert np.allclose(made["center"], body.center, rtol=ULPS, atol=ULPS)
        assert np.isclose(made["radius"], body.radius, rtol=0, atol=0)
        assert np.allclose(made["half"], body.half, rtol=ULPS, atol=0)
        assert np.allclose(made["axes"], body.axes, rtol=0, atol=ULPS)


def test_what_is_no_shape_is_invalid():
    nan, invalid = float("nan"), KINDS.index("invalid")
    at = (0.0, 0.0, 0.0)
    bodies = [
        ("sphere", (nan, 0.0, 0.0), 1.0, None),
        ("sphere", at, -1.0, None),
        ("sphere", None, 1.0, None),
        ("capsule", None, at, 1.0, None),
        ("capsule", at, None, 1.0, None),
        ("cylinder", at, at, 1.0, None),
        ("box", None, at, None, None),
        ("box", at, (1.0, -1.0, 1.0), None, None),
        ("box", at, (1.0, 1.0, 1.0), (1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), None),
        ("box", at, (1.0, 1.0, 1.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0), None),
        ("half_space", at, 1.0),
        ("half_space", (float("inf"), 0.0, 0.0), 1.0),
        ("half_space", (0.0, 0.0, 1.0), nan),
        ("hull", None, 1, 1.0, None),
    ]
    assert [int(library().body(*body)["kind"]) for body in bodies] == [invalid] * len(bodies)


def test_a_matrix_of_few_digits_becomes_a_rotation():
    turned = np.array([0.6, -0.8, 0.0, 0.8, 0.6, 0.0, 0.0, 0.0, 1.0]) + 1e-10
    axes = library().body("box", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), turned, None)["axes"]
    assert np.abs(axes @ axes.T - np.eye(3)).max() < 1e-15


def test_distances_from_hulls_are_those_of_python_to_rounding():
    # Without facets the nearest point is found by rounds, which end within a rounding of the size.
    rng = np.random.default_rng(1)
    for _ in range(20):
        shape = Hull(rng.normal(size=(rng.integers(4, 20), 3)))
        points = 3.0 * rng.normal(size=(500, 3))
        found = np.zeros((500, 8))
        library().call("shape_rows", 500, made_in_c(shape), points, found)
        distance = shape.distance(points)
        outside = distance > 1e-6
        assert np.abs(found[outside, 0] - distance[outside]).max() < 1e-12
        assert (np.abs(found[~outside, 0]) < 1e-6).all()


def flown_at(found, shapes, steps, seed, met=NONE, told=NONE):
    """The least distance to shapes, m, of vehicles that are attacked behind a shield in C; a double plant."""
    rng, n = np.random.default_rng(seed), 30
    flats = np.zeros((n, 4, 3))
    flats[:, 0] = 4.0 * rng.normal(size=(n, 3))
    while (inside := np.min([s.distance(flats[:, 0]) for s in shapes], axis=0) < 0.3).any():
        flats[inside, 0] = 4.0 * rng.normal(size=(inside.sum(), 3))
    mine, least = CShields(found, Shield(uncertainty=told), n), np.inf
    world = np.repeat(np.array([[made_in_c(s, found) for s in shapes]]), n, axis=0)
    assert not mine.prepare(PERIOD).any()
    for step in range(steps):
        if step % 80 == 0:
            goal = np.array([s.body().center for s in shapes])[rng.integers(0, len(shapes), n)]
        way = goal - flats[:, 0]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        pull = 216.0 * (2.0 * way - flats[:, 1]) - 108.0 * flats[:, 2] - 18.0 * flats[:, 3]
        snaps = pull if step // 40 % 2 == 0 else rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(0, 3, (n, 1))
        answers, codes = mine.filter(flats, world, snaps, PERIOD)
        assert not codes.any()
        lasted = PERIOD * (1.0 + met.jitter * rng.uniform(-1.0, 1.0, (n, 1)))
        flats = after(flats, np.array(answers["snap"], dtype=float), lasted)
        if told.jitter > 0.0:
            assert not mine.held_for(lasted[:, 0]).any()
        if met.impulse > 0.0 and step % int(1.25 * met.impulse_gap / PERIOD) == 0:
            flats[:, 1] += met.impulse * way
        least = min(least, *(s.distance(flats[:, 0]).min() for s in shapes))
    return least


@pytest.mark.parametrize("is_float", [False, True], ids=["double", "float"])
def test_hulls_and_other_shapes_are_not_entered(is_float):
    rng = np.random.default_rng(2)
    shapes = [random_shape(rng, kind) for kind in ("hull", "hull", "box", "sphere", "capsule")]
    least = flown_at(library(is_float=is_float), shapes, 400, seed=3)
    assert 0.0 < least < 0.05


@pytest.mark.parametrize("is_float", [False, True], ids=["double", "float"])
def test_pushes_and_uneven_periods_enter_no_shape_where_they_were_told_of(is_float):
    rng = np.random.default_rng(6)
    shapes = [random_shape(rng, kind) for kind in ("box", "sphere", "capsule")]
    met, found = Uncertainty(impulse=0.3, impulse_gap=0.5, jitter=0.1), library(is_float=is_float)
    assert flown_at(found, shapes, 600, seed=5, met=met, told=met) > 0.0
    assert flown_at(found, shapes, 600, seed=5, met=met) < 0.0


def test_float_flies_as_double_does_but_for_rounding():
    mine, flats, world = one(is_float=True)
    theirs, _, other = one()
    snaps = np.array([[100.0, 20.0, -5.0]])
    near, exact = mine.filter(flats, world, snaps, PERIOD)[0], theirs.filter(flats, other, snaps, PERIOD)[0]
    assert near["certified"] and exact["certified"]
    assert np.allclose(near["snap"], exact["snap"], rtol=1e-3) and np.isclose(
        near["value"], exact["value"], rtol=1e-3
    )
    assert not np.array_equal(near["snap"], exact["snap"]) or near["value"] != exact["value"]


def test_the_flat_map_refuses_what_has_no_answer():
    states, snaps, yaw = np.ones((5, 20)), np.ones((5, 3)), np.zeros(5)
    states[1, 18], states[2, 3], snaps[3, 0], yaw[4] = 0.0, np.nan, np.inf, np.nan
    body = np.array([0.5, 0.01, 0.01, 0.02, 9.81])
    flats, wrenches, codes = np.zeros((5, 12)), np.zeros((5, 4)), np.zeros(5, dtype=np.int32)
    library().call("flat_rows", 5, states, body, flats, codes)
    assert codes.tolist() == [DONE, DONE, BAD_STATE, DONE, DONE]
    library().call("wrench_rows", 5, states, snaps, yaw, body, wrenches, codes)
    assert codes.tolist() == [DONE, *[BAD_STATE] * 4]
    library().call("wrench_rows", 5, states, snaps, yaw, np.zeros(5), wrenches, codes)
    assert codes.tolist() == [BAD_STATE] * 5


def test_null_is_a_code():
    c = library().c
    assert c.qs_init(None, None) == 1
    assert c.qs_filter(None, None, None, 0, None, ctypes.c_double(PERIOD), None) == 1
