"""Every public constructor against a wrong type, shape, scale of units and sign, and an unknown name.

What a constructor has no shape or scale for is not in its row; the counter-case is its own good arguments.
"""

import inspect
import math
import re

import gymnasium
import pytest

import agents
import quadsafe
import shields
from quadsafe import (
    Authority,
    Box,
    Capsule,
    Conditions,
    Cylinder,
    Ellipsoid,
    GoalConditioned,
    HalfSpace,
    Hull,
    Monitor,
    Obstacles,
    QuadrotorEnv,
    QuadrotorParams,
    QuadrotorVectorEnv,
    Shield,
    ShieldWrapper,
    Sphere,
    Uncertainty,
    VectorShieldWrapper,
)

NAME = "QuadSafe/Avoid-v0"
ORIGIN = (0.0, 0.0, 0.0)


def wrapped(**settings):
    return ShieldWrapper(gymnasium.make(NAME), **settings)


def wrapped_rows(**settings):
    return VectorShieldWrapper(gymnasium.make_vec(NAME, 2), **settings)


def flown_in(**keywords):
    """An env whose first scene was drawn."""
    return QuadrotorEnv(**keywords).reset(seed=0)


def asked(period):
    return Shield().filter([[-2.0, 0, 0], *[ORIGIN] * 3], [[0, 0, 0, 0.5]], snap=ORIGIN, period=period)


WRAPPER = {
    "type": ({"alpha": "2"}, "alpha must be a finite number > 0, got '2'"),
    "shape": ({"alpha": [2.0, 2.0]}, "alpha must be a finite number > 0, got [2.0, 2.0]"),
    "scale": ({"gravity": 9810.0}, "gravity must be the plant's 9.81 m/s², got 9810"),
    "sign": ({"margin": -0.1}, "margin must be a finite number >= 0, got -0.1"),
    "name": ({"margn": 0.1}, "got an unexpected keyword argument 'margn'; did you mean 'margin'?"),
}
# What makes one, good arguments, and for each kind of mistake the arguments over those and what is said.
CONSTRUCTORS = {
    "Shield": (
        Shield,
        {},
        {
            **WRAPPER,
            "scale": (
                {"specific_thrust_max": 0.02},
                "specific_thrust_min and specific_thrust_max must enclose gravity 9.81, got",
            ),
            "sign": ({"snap_max": -200.0}, "snap_max must be a finite number > 0, got -200.0"),
            "name": ({"snapmax": 1.0}, "Shield must get keywords among 'method', 'snap_max', "),
            "unused": (
                {"method": "cbf", "jerk_max": 40.0},
                "jerk_max must be left out with method 'cbf', got 40.0",
            ),
            "word": ({"method": "sample"}, "got 'sample'; did you mean 'sampled'?"),
            "field": ({"uncertainty": {"positon": 0.1}}, "got 'positon'; did you mean 'position'?"),
            "authority": ({"authority": {"snapmax": 1}}, "got 'snapmax'; did you mean 'snap_max'?"),
        },
    ),
    "ShieldWrapper": (wrapped, {}, WRAPPER),
    "Monitor": (
        Monitor,
        {"shield": Shield()},
        {"type": ({"shield": {"margin": 0.0}}, "shield must be a Shield, got dict")},
    ),
    "GoalConditioned": (
        GoalConditioned,
        {"env": gymnasium.make("QuadSafe/Avoid-v0")},
        {
            "type": ({"env": "Avoid"}, "env must be a single environment of quadsafe_env, got str"),
            "shape": ({"env": gymnasium.make("QuadSafe/Gates-v0")}, "env must have no openings"),
        },
    ),
    "VectorShieldWrapper": (wrapped_rows, {}, WRAPPER),
    "Authority": (
        Authority,
        {
            "snap_max": 380.0,
            "jerk_max": 44.0,
            "specific_thrust_min": 5.2,
            "specific_thrust_max": 20.0,
            "gravity": 9.81,
        },
        {
            "type": ({"snap_max": "380"}, "authority.snap_max must be a finite number > 0, got '380'"),
            "shape": ({"jerk_max": [44.0]}, "authority.jerk_max must be a finite number > 0, got [44.0]"),
            # Newtons of a small vehicle in place of m/s².
            "scale": (
                {"specific_thrust_max": 0.6},
                "authority must have specific_thrust_min < gravity < specific_thrust_max, got",
            ),
            "sign": ({"jerk_max": -44.0}, "authority.jerk_max must be a finite number > 0, got -44.0"),
            "name": ({"jerkmax": 44.0}, "argument 'jerkmax'; did you mean 'jerk_max'?"),
            # Of a vehicle, N.
            "old name": ({"thrust_max": 20.0}, "'thrust_max'; did you mean 'specific_thrust_max'?"),
        },
    ),
    "Uncertainty": (
        Uncertainty,
        {"position": 0.01},
        {
            "type": ({"losses": 1}, "uncertainty.losses must be True or False, got 1"),
            "shape": ({"position": [0.1] * 3}, "uncertainty.position must be a finite number >= 0, got"),
            "scale": ({"gain": 5.0}, "uncertainty.gain must be < 1, got 5.0"),
            "sign": ({"wind": -0.3}, "uncertainty.wind must be a finite number >= 0, got -0.3"),
            "name": ({"windd": 0.3}, "Uncertainty must get keywords among 'position', "),
        },
    ),
    "Conditions": (
        Conditions,
        {"wind": 0.3},
        {
            "type": ({"delay": 1.5}, "delay must be an integer >= 0, got 1.5"),
            "shape": ({"wind": [0.1] * 3}, "wind must be a finite number >= 0, got"),
            "scale": ({"loss": 10}, "loss must be in [0, 1], got 10"),
            "sign": ({"drag": -0.1}, "drag must be a finite number >= 0, got -0.1"),
            "name": ({"turbulance": 1.0}, "argument 'turbulance'; did you mean 'turbulence'?"),
        },
    ),
    "QuadrotorParams": (
        QuadrotorParams.from_airframe,
        {"mass": 1.2, "arm": 0.2, "motor_thrust_max": 7.0},
        {
            "type": ({"mass": "1.2"}, "mass must be a finite number > 0, got '1.2'"),
            "shape": ({"inertia": [0.1, 0.1]}, "inertia must have shape (…, 3), got (2,)"),
            "not finite": ({"arm": math.nan}, "arm must be a finite number > 0, got nan"),
            "sign": ({"mass": -1.2}, "mass must be a finite number > 0, got -1.2"),
            # Grams, millimetres, millinewtons, and grams of thrust.
            "scale": ({"mass": 1200.0}, "thrust_min and thrust_max must enclose the hover thrust 11772 N, got"),
            "scale of arm": ({"arm": 200.0}, "mass and arm must be in kg and m, with mass / arm³ from 10 to"),
            "scale of thrust": ({"motor_thrust_max": 7000.0}, "thrust_max must be in N, at most 30 times the"),
            "grams of thrust": ({"motor_thrust_max": 714.0}, "thrust_max must be in N, at most 30 times the"),
            "scale of propeller": (
                {"propeller_radius": 127.0},
                "must be in m, at most 20 times arm 0.2 m",
            ),
            "scale of moment": ({"moment_ratio": 16.0}, "must be in m, at most arm 0.2 m, got 16"),
            "scale of inertia": ({"inertia": [12e3, 12e3, 24e3]}, "inertia about x must fit mass 1.2 kg and"),
        },
    ),
    "QuadrotorEnv": (
        flown_in,
        {},
        {
            "type": ({"rotor_limits": "yes"}, "rotor_limits must be True or False, got 'yes'"),
            "shape": ({"bounds": [-3, 3]}, "bounds must have shape (2, 3), got (2,)"),
            # Grams, and millimetres.
            "scale": ({"params": {"mass": 27}}, "thrust_min and thrust_max must enclose the hover thrust"),
            "scale of obstacles": ({"obstacles": [[0, 0, 0, 500]]}, "must leave start and goal 0.15 m clear"),
            "scale of rates": ({"policy_hz": 0.04}, "policy_hz must be an integer >= 1, got 0.04"),
            "sign": ({"obstacles": [[0, 0, 0, -1]]}, "obstacles[0].radius must be 0 or more, got -1.0"),
            "name": ({"obstacle": []}, "argument 'obstacle'; did you mean 'obstacles'?"),
            "word": ({"action": "velocty"}, "got 'velocty'; did you mean 'velocity'?"),
            "preset": ({"params": "crazyfly"}, "got 'crazyfly'; did you mean 'crazyflie'?"),
            "field of params": ({"params": {"mas": 1}}, "got 'mas'; did you mean 'mass'?"),
            "conditions": ({"conditions": "indor"}, "got 'indor'; did you mean 'indoor'?"),
            "field of conditions": ({"conditions": {"lossy": 0.1}}, "got 'lossy'; did you mean 'loss'?"),
        },
    ),
    "QuadrotorVectorEnv": (
        QuadrotorVectorEnv,
        {"num_envs": 2},
        {
            "type": ({"num_envs": 2.0}, "num_envs must be an integer >= 1, got 2.0"),
            "shape": ({"sphere_radius": 0.3}, "sphere_radius must have shape (2,), got ()"),
            "scale": ({"physics_hz": 0.002}, "physics_hz must be an integer >= 1, got 0.002"),
            "sign": ({"max_episode_steps": -5}, "max_episode_steps must be an integer >= 1, got -5"),
            "name": (
                {"autoreset": "Disabled"},
                "gymnasium.make_vec must get keywords among 'max_episode_steps'",
            ),
        },
    ),
    "Sphere": (
        Sphere,
        {"center": ORIGIN, "radius": 0.5},
        {
            "type": ({"radius": "0.5"}, "radius must be a finite number, got '0.5'"),
            "shape": ({"center": (0.0, 0.0)}, "center must have shape (3,), got (2,)"),
            "sign": ({"radius": -0.5}, "radius must be 0 or more, got -0.5"),
        },
    ),
    "Capsule": (
        Capsule,
        {"start": ORIGIN, "end": (0.0, 0.0, 1.0), "radius": 0.1},
        {
            "type": ({"end": "up"}, "end must be an array of real numbers, got 'up'"),
            "shape": ({"start": (0.0,)}, "start must have shape (3,), got (1,)"),
            "sign": ({"radius": -0.1}, "radius must be 0 or more, got -0.1"),
        },
    ),
    "Cylinder": (
        Cylinder,
        {"start": ORIGIN, "end": (0.0, 0.0, 1.0), "radius": 0.1},
        {
            "type": ({"radius": None}, "radius must be a finite number, got None"),
            "shape": ({"end": ORIGIN * 2}, "end must have shape (3,), got (6,)"),
            "sign": ({"radius": -0.1}, "radius must be 0 or more, got -0.1"),
        },
    ),
    "Box": (
        Box,
        {"center": ORIGIN, "size": (1.0, 1.0, 1.0)},
        {
            "type": ({"size": "large"}, "size must be an array of real numbers, got 'large'"),
            "shape": ({"size": (1.0, 1.0)}, "size must have shape (3,), got (2,)"),
            "sign": ({"size": (1.0, 1.0, -1.0)}, "size must be 0 or more, got [1.0, 1.0, -1.0]"),
        },
    ),
    "Hull": (
        Hull,
        {"points": [ORIGIN, (1.0, 0.0, 0.0)]},
        {
            "type": ({"points": "cube"}, "points must be an array of real numbers, got 'cube'"),
            "shape": (
                {"points": [(0.0, 0.0)]},
                "points must have shape (V, 3) with V of 1 or more, got (1, 2)",
            ),
            "sign": ({"radius": -1.0}, "radius must be 0 or more, got -1.0"),
        },
    ),
    "Ellipsoid": (
        Ellipsoid,
        {"center": ORIGIN, "axes": (1.0, 2.0, 3.0)},
        {
            "type": ({"axes": [True] * 3}, "axes must be an array of real numbers, got [True, True, True]"),
            "shape": ({"axes": 1.0}, "axes must have shape (3,), got ()"),
            "sign": ({"axes": (1.0, 1.0, -1.0)}, "axes must be 1e-50 or more, got [1.0, 1.0, -1.0]"),
        },
    ),
    "HalfSpace": (
        HalfSpace,
        {"normal": (0.0, 0.0, 1.0), "offset": 0.0},
        {
            "type": ({"offset": "floor"}, "offset must be a finite number, got 'floor'"),
            "shape": ({"normal": (0.0, 1.0)}, "normal must have shape (3,), got (2,)"),
        },
    ),
    "Obstacles": (
        Obstacles.pack,
        {"shapes": [[0.0, 0.0, 0.0, 0.5]]},
        {
            "type": ({"shapes": "walls"}, "obstacles must be a list of shapes, mappings or rows"),
            "shape": ({"shapes": [[0.0, 0.0, 0.5]]}, "obstacles[0] must be a shape, a mapping or a row"),
            "sign": ({"keep_out": -0.1}, "keep_out must be a finite number >= 0, got -0.1"),
        },
    ),
    "Filtered": (
        asked,
        {"period": 0.01},
        {
            "type": ({"period": "0.01"}, "period must be a finite number > 0, got '0.01'"),
            "scale": ({"period": 10}, "period must be in seconds and at most 1, got 10"),
            "sign": ({"period": -0.01}, "period must be a finite number > 0, got -0.01"),
        },
    ),
}
MISTAKES = [(name, kind) for name, (_, _, mistakes) in CONSTRUCTORS.items() for kind in mistakes]


@pytest.mark.parametrize(("name", "kind"), MISTAKES)
def test_a_mistake_gets_one_sentence(name, kind):
    make, good, mistakes = CONSTRUCTORS[name]
    wrong, sentence = mistakes[kind]
    # Warnings are errors here: units that are hardly meant are flown, with a warning.
    with pytest.raises((TypeError, ValueError, UserWarning), match=re.escape(sentence)) as caught:
        make(**(good | wrong))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", CONSTRUCTORS)
def test_the_good_arguments_are_taken(name):
    make, good, _ = CONSTRUCTORS[name]
    make(**good)


def test_every_public_class_has_its_row():
    classes = {name for name in quadsafe.__all__ if inspect.isclass(getattr(quadsafe, name))}
    # A list of what a file holds; an airframe is checked like the vehicle that is made of one.
    assert classes - {"Map", "Airframe"} == set(CONSTRUCTORS)


@pytest.mark.parametrize("env", [None, NAME, 3])
def test_a_wrapper_goes_around_an_environment(env):
    for wrapper in (ShieldWrapper, VectorShieldWrapper):
        with pytest.raises(TypeError, match=rf"^env must be a gymnasium (Vector)?Env, got {env!r}; "):
            wrapper(env)


def test_each_wrapper_names_the_other_one():
    with pytest.raises(TypeError, match=r"; VectorShieldWrapper takes vector environments$"):
        ShieldWrapper(gymnasium.make_vec(NAME, 2))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"; ShieldWrapper takes single ones$"):
        VectorShieldWrapper(gymnasium.make(NAME))  # type: ignore[arg-type]


def test_an_evaluation_and_a_film_name_what_does_not_fit():
    with pytest.raises(TypeError, match=r"^shield must be None or a mapping of settings, got 3$"):
        agents.evaluate(lambda observation: observation[:4], scenes=1, shield=3)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^path must be the path of a video, got 3$"):
        agents.film(gymnasium.make(NAME), lambda observation: observation[:4], 3)  # type: ignore[arg-type]


def test_a_run_is_a_path():
    with pytest.raises(TypeError, match=r"^run must be a path, got 3$"):
        quadsafe.load(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "call", "keyword", "nearest"),
    [
        ("Sphere", lambda **k: quadsafe.Sphere(ORIGIN, 1.0, **k), "raduis", "radius"),
        ("Box", lambda **k: quadsafe.Box(ORIGIN, **k), "sise", "size"),
        ("Obstacles.pack", lambda **k: quadsafe.Obstacles.pack([], **k), "keepout", "keep_out"),
        ("Obstacles.spheres", lambda **k: quadsafe.Obstacles.spheres(ORIGIN, 1.0, **k), "velocty", "velocity"),
        ("LowerSet", lambda **k: shields.LowerSet([0.0], **k), "umax", "u_max"),
        ("BoxSet", lambda **k: shields.BoxSet([0.0], **k), "uper", "upper"),
        ("load_obstacles", lambda **k: quadsafe.load_obstacles("room.json", **k), "scal", "scale"),
        ("QuadrotorParams.from_airframe", quadsafe.QuadrotorParams.from_airframe, "mas", "mass"),
    ],
)
def test_an_unknown_keyword_is_told_with_the_nearest_there_is(name, call, keyword, nearest):
    with pytest.raises(TypeError, match=rf"^{name} must get keywords among ") as caught:
        call(**{keyword: 1.0})
    assert str(caught.value).endswith(f"argument {keyword!r}; did you mean {nearest!r}?")


@pytest.mark.parametrize("period", [1.0 + 1e-9, 10.0, 0.0, -0.01, float("nan")])
def test_a_period_that_is_hardly_in_seconds_is_refused(period):
    with pytest.raises(ValueError, match=r"^period must be "):
        asked(period)
    asked(1.0)
