"""What is accepted is used: every public entry refuses in a sentence what it would have to ignore or guess."""

import copy
import math
import pickle

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
import shields
from agents.experiment.config import Experiment, Options
from agents.experiment.pairs import pairs_from
from agents.tracking import MinimumSnap, Tracker
from quadsafe_core.authority import acceleration_along
from quadsafe_core.shapes import Obstacles
from quadsafe_env import Conditions
from quadsafe_env.vehicle import dynamics, flatness, rotors
from quadsafe_env.vehicle.authority import YawRange, authority, steering_thrust
from quadsafe_env.vehicle.state import hover_state
from shields import Authority, BoxSet, BrakingSet, LowerSet, Shield, ShieldWrapper, Uncertainty
from shields.interface.arguments import LONGEST_PERIOD

NAME = "QuadSafe/Avoid-v0"
TEXT, TRUTH = np.array(["0", "0", "1"]), np.ones(3, dtype=bool)
HOVER = hover_state([0.0, 0.0, 0.0], "crazyflie")
LIMITS = Authority(
    snap_max=380.0, jerk_max=44.0, specific_thrust_min=5.2, specific_thrust_max=20.0, gravity=9.81
)
BOX, BRAKING = BoxSet([-1.0] * 3, [1.0] * 3, u_min=-1.0, u_max=1.0), BrakingSet(0.0, 1.0, 1.0, -1.0, 1.0)
NO_NUMBERS = "must be an array of real numbers, got "


def env(**keywords):
    made = gymnasium.make(NAME, **keywords)
    made.reset(seed=0)
    return made


def rows(**keywords):
    made = gymnasium.make_vec(NAME, 2, **keywords)
    made.reset(seed=0)
    return made


def asked(shield=None, **arguments):
    """A question to a shield with some arguments replaced."""
    flat = np.zeros((4, 3))
    flat[0, 0] = -2.0
    good = {"flat": flat, "center": np.zeros((1, 3)), "radius": [0.5], "snap": np.zeros(3), "period": 0.01}
    shield, given = shield or Shield(), good | arguments
    spheres = {name: given.pop(name) for name in ("center", "radius", "velocity") if name in given}
    return shield, shield.filter(**({"obstacles": Obstacles.spheres(**spheres)} | given))


def set_state(plant, value):
    plant.unwrapped.state = value


# What is asked, and how the sentence begins that refuses it.
REFUSED = {
    # reset
    "options, another key": (
        lambda: env().reset(options={"scenes": 1}),
        "a key of options must be one of 'scene'",
    ),
    "options, of the vector env": (
        lambda: env().reset(options={"reset_mask": np.array([True])}),
        "a key of options must be one of 'scene', got 'reset_mask'",
    ),
    "options, pairs": (
        lambda: env().unwrapped.reset(options=[("scene", 1)]),
        "options must be a mapping with 'scene'",
    ),
    "options, scene None": (lambda: env().reset(options={"scene": None}), "scene must be an integer in"),
    "options, shielded": (
        lambda: ShieldWrapper(env()).reset(options={"x": 1}),
        "a key of options must be one of",
    ),
    "rows, another key": (
        lambda: rows().reset(options={"scenes": [1, 2]}),
        "a key of options must be one of 'scene', 'reset_mask', got 'scenes'",
    ),
    "rows, shielded": (
        lambda: shields.VectorShieldWrapper(rows()).reset(options={"x": 1}),
        "a key of options must be one of",
    ),
    "rows, a word": (
        lambda: rows().reset(options="scene"),
        "options must be a mapping with 'scene', 'reset_mask'",
    ),
    "rows, one scene": (lambda: rows().reset(options={"scene": 1}), "scene must have one integer for each"),
    "rows, scenes as floats": (
        lambda: rows().reset(options={"scene": [1.0, 2.0]}),
        r"scene\[0\] must be an integer",
    ),
    "rows, mask of integers": (
        lambda: rows().reset(options={"reset_mask": np.array([1, 0])}),
        "reset_mask must be a boolean array",
    ),
    "seed, text": (lambda: rows().reset(seed=["1", "2"]), r"seed\[0\] must be an integer in"),
    # step
    "step before reset": (
        lambda: gymnasium.make(NAME).unwrapped.step(np.zeros(4)),
        "reset must be called before",
    ),
    "rows before reset": (
        lambda: gymnasium.make_vec(NAME, 2).step(np.zeros((2, 4))),
        "reset must be called before",
    ),
    "action, text": (lambda: env().unwrapped.step(["0", "1", "0", "0"]), f"action {NO_NUMBERS}"),
    "action, truth": (lambda: env().unwrapped.step([True] * 4), f"action {NO_NUMBERS}"),
    "action, complex": (lambda: env().unwrapped.step(np.ones(4) * 1j), f"action {NO_NUMBERS}"),
    "action, nothing": (lambda: env().unwrapped.step([None] * 4), f"action {NO_NUMBERS}"),
    "actions, truth": (lambda: rows().step(np.ones((2, 4), dtype=bool)), f"actions {NO_NUMBERS}"),
    # state
    "state, text": (lambda: set_state(env(), HOVER.astype(str)), f"state {NO_NUMBERS}"),
    "state, complex": (lambda: set_state(env(), HOVER + 0j), f"state {NO_NUMBERS}"),
    # keywords of gym.make
    "keyword, unknown": (
        lambda: gymnasium.make(NAME, colour="red"),
        "gymnasium.make must get keywords among 'render_mode', .*, got an unexpected keyword argument 'colour'",
    ),
    "action, a list": (
        lambda: gymnasium.make(NAME, action=["snap"]),
        r"action must be one of .*, got \['snap'\]",
    ),
    "action, an array": (
        lambda: gymnasium.make(NAME, action=np.array(["snap", "wrench"])),
        "action must be one of",
    ),
    "obstacles, text": (
        lambda: gymnasium.make(NAME, obstacles=[["0", "0", "0", "1"]]),
        rf"obstacles\[0\].center {NO_NUMBERS}",
    ),
    "obstacles, truth": (
        lambda: gymnasium.make(NAME, obstacles=[[True] * 4]),
        rf"obstacles\[0\].center {NO_NUMBERS}",
    ),
    "obstacles, complex": (
        lambda: gymnasium.make(NAME, obstacles=[[0, 0, 0, 1j]]),
        r"obstacles\[0\].radius must be a finite number, got 1j",
    ),
    "rate, truth": (
        lambda: gymnasium.make(NAME, policy_hz=True),
        "policy_hz must be an integer >= 1, got True",
    ),
    "rate, text": (
        lambda: gymnasium.make(NAME, physics_hz="500"),
        "physics_hz must be an integer >= 1, got '500'",
    ),
    "sphere_radius, text": (
        lambda: gymnasium.make(NAME, sphere_radius=["0.2", "0.3"]),
        f"sphere_radius {NO_NUMBERS}",
    ),
    "sphere_radius, truth": (
        lambda: gymnasium.make(NAME, sphere_radius=[True, True]),
        f"sphere_radius {NO_NUMBERS}",
    ),
    "sphere_count of one sphere": (
        lambda: gymnasium.make(NAME, sphere_count=3),
        "sphere_count must be left out",
    ),
    "rotor_limits, a word": (
        lambda: gymnasium.make(NAME, rotor_limits="no"),
        "rotor_limits must be True or False",
    ),
    "params, text": (
        lambda: gymnasium.make(NAME, params={"mass": "0.1"}),
        "mass must be a finite number > 0, got '0.1'",
    ),
    "params, truth": (
        lambda: gymnasium.make(NAME, params={"mass": np.True_}),
        "mass must be a finite number > 0",
    ),
    "params, text in a triple": (
        lambda: gymnasium.make(NAME, params={"inertia": TEXT}),
        f"inertia {NO_NUMBERS}",
    ),
    "params, another field": (
        lambda: gymnasium.make(NAME, params={"weight": 1.0}),
        "a field of params must be one of",
    ),
    "conditions, another field": (
        lambda: gymnasium.make(NAME, conditions={"rain": 1}),
        "a field of conditions must be",
    ),
    "conditions, truth": (
        lambda: gymnasium.make(NAME, conditions={"loss": np.True_}),
        "loss must be a finite number",
    ),
    "conditions, True": (lambda: gymnasium.make(NAME, conditions=True), "conditions must be a preset name"),
    "num_envs, truth": (lambda: gymnasium.make_vec(NAME, True), "num_envs must be an integer >= 1, got True"),
    # named tuples, made by hand
    "Conditions, negative": (lambda: Conditions(wind=-1.0), "wind must be a finite number >= 0, got -1.0"),
    "Conditions, text": (lambda: Conditions("0.1"), "position_noise must be a finite number >= 0, got '0.1'"),
    "Conditions, a delay of 1.5": (lambda: Conditions(delay=1.5), "delay must be an integer >= 0, got 1.5"),
    "Conditions, half an impulse": (lambda: Conditions(impulse=1.0), "impulse and impulse_rate must both be"),
    "Conditions, replaced": (lambda: Conditions()._replace(loss=2.0), r"loss must be in \[0, 1\], got 2.0"),
    "Uncertainty, negative": (
        lambda: Uncertainty(position=-1),
        "uncertainty.position must be a finite number >= 0, got -1",
    ),
    "Uncertainty, by place": (
        lambda: Uncertainty(0.0, -1),
        "uncertainty.velocity must be a finite number >= 0, got -1",
    ),
    "Uncertainty, nan": (
        lambda: Uncertainty(wind=math.nan),
        "uncertainty.wind must be a finite number >= 0, got nan",
    ),
    "Uncertainty, gain": (lambda: Uncertainty(gain=1.0), "uncertainty.gain must be < 1, got 1.0"),
    "Uncertainty, delay": (
        lambda: Uncertainty(delay=0.5),
        "uncertainty.delay must be a whole number from 0 to 100",
    ),
    "Uncertainty, losses": (
        lambda: Uncertainty(losses=0.1),
        "uncertainty.losses must be True or False, got 0.1",
    ),
    "Uncertainty, replaced": (
        lambda: Uncertainty()._replace(jerk=-1),
        "uncertainty.jerk must be a finite number >= 0",
    ),
    "Authority, negative": (
        lambda: Authority(-1, 44, 5, 20, 9.81),
        "authority.snap_max must be a finite number > 0",
    ),
    "Authority, the band": (
        lambda: Authority(380, 44, 12, 20, 9.81),
        "authority must have specific_thrust_min < gravity < specific_thrust_max, got 12, 9.81 and 20",
    ),
    "Authority, replaced": (
        lambda: LIMITS._replace(jerk_max=math.inf),
        "authority.jerk_max must be a finite number > 0",
    ),
    "Authority, a share": (lambda: LIMITS.less(1.0), r"share must be in \[0, 1\), got 1.0"),
    # wrappers and shields
    "wrapper, unknown": (
        lambda: ShieldWrapper(gymnasium.make(NAME), margn=0.1),
        "ShieldWrapper must get keywords among .*'margin', .* argument 'margn'; did you mean 'margin'\\?$",
    ),
    "wrapper, penalty": (
        lambda: ShieldWrapper(gymnasium.make(NAME), intervention_penalty=True),
        "intervention_penalty must be a finite number >= 0, got True",
    ),
    "wrapper, a word": (
        lambda: ShieldWrapper(gymnasium.make(NAME), authority="Vehicle"),
        "authority must be 'vehicle'",
    ),
    "shield, truth": (lambda: Shield(margin=np.True_), "margin must be a finite number >= 0"),
    "shield, text": (lambda: Shield(alpha="2"), "alpha must be a finite number > 0, got '2'"),
    "shield, a method": (lambda: Shield(method=["cbf"]), "method must be one of"),
    "shield, losses": (
        lambda: Shield(uncertainty={"losses": 1}),
        "uncertainty.losses must be True or False, got 1",
    ),
    "period, milliseconds": (lambda: asked(period=10), "period must be in seconds and at most 1, got 10"),
    "period, text": (lambda: asked(period="0.01"), "period must be a finite number > 0, got '0.01'"),
    "period, truth": (lambda: asked(period=True), "period must be a finite number > 0, got True"),
    "velocity, nan": (
        lambda: asked(velocity=[[math.nan] * 3]),
        r"velocity must be finite, got nan at index \(0, 0, 0\)",
    ),
    "velocity, text": (lambda: asked(velocity=[TEXT]), f"velocity {NO_NUMBERS}"),
    "velocity, truth": (lambda: asked(velocity=[TRUTH]), f"velocity {NO_NUMBERS}"),
    "velocity, another shape": (lambda: asked(velocity=np.zeros(3)), "velocity must have shape "),
    "obstacles of a shield, text": (
        lambda: asked(obstacles="walls"),
        "obstacles must be a list of shapes, mappings or rows",
    ),
    "acceleration, any": (
        lambda: asked(acceleration=np.zeros((1, 3))),
        ".*unexpected keyword argument 'acceleration'",
    ),
    "flat, truth": (lambda: asked(flat=np.zeros((4, 3), dtype=bool)), f"flat {NO_NUMBERS}"),
    "radius, text": (lambda: asked(radius=["0.5"]), f"radius {NO_NUMBERS}"),
    "radius, truth": (lambda: asked(radius=[True]), f"radius {NO_NUMBERS}"),
    "snap, text": (lambda: asked(snap=TEXT), f"snap {NO_NUMBERS}"),
    "snap, nothing": (lambda: asked(snap=[None] * 3), f"snap {NO_NUMBERS}"),
    "shield, mask of integers": (lambda: Shield().reset(np.array([1, 0])), "mask must be booleans of shape"),
    "backup, an integer": (
        lambda: asked(Shield(uncertainty={"losses": True}))[0].backup(1),
        "mask must be booleans",
    ),
    "restore, another thing": (
        lambda: Shield().restore({"a": 1}),
        "snapshot must hold is_single, memory, period, size",
    ),
    # the theory
    "x, text": (lambda: shields.lower_value(["1", "2"], 1.0, 0.0), f"x {NO_NUMBERS}"),
    "x, truth": (lambda: shields.upper_value([True, False], -1.0, 0.0), f"x {NO_NUMBERS}"),
    "x, complex": (lambda: shields.flow(np.ones(2) * 1j, 0.0, 1.0), f"x {NO_NUMBERS}"),
    "u_max, truth": (lambda: shields.lower_value([1.0, 2.0], True, 0.0), f"u_max {NO_NUMBERS}"),
    "bounds, text": (lambda: LowerSet(["1", "2"], 1.0), f"lower {NO_NUMBERS}"),
    "bounds, several": (
        lambda: BrakingSet(0.0, [1.0, 2.0], 1.0, -1.0, 1.0),
        "x1_max must be a finite number > 0",
    ),
    "box_input, another set": (lambda: shields.box_input(BRAKING, [0.0] * 3, 0.0, 1.0), "box must be a BoxSet"),
    "sampled_box, another set": (
        lambda: shields.sampled_box_value(BRAKING, [0.0] * 3, 0.1),
        "box must be a BoxSet",
    ),
    "sampled_braking, another set": (
        lambda: shields.sampled_braking_value(BOX, [0.0] * 4, 0.1),
        "limits must be a BrakingSet",
    ),
    "reserve, truth": (
        lambda: shields.sampled_input([0.0, 1.0], 0.0, 0.1, 1.0, 0.0, 1.0, reserve=True),
        "reserve must be a finite number, got True",
    ),
    # the plant
    "step, text": (
        lambda: dynamics.step(HOVER.astype(str), np.zeros(4), "crazyflie", 0.01),
        f"state {NO_NUMBERS}",
    ),
    "step, dt": (
        lambda: dynamics.step(HOVER, np.zeros(4), "crazyflie", np.True_),
        "dt must be a finite number > 0",
    ),
    "flat_state, text": (lambda: flatness.flat_state(HOVER.astype(str), "crazyflie"), f"state {NO_NUMBERS}"),
    "hover, truth": (lambda: hover_state(TRUTH, "crazyflie"), f"position {NO_NUMBERS}"),
    "rotors, text": (lambda: rotors.rotor_thrusts(1.0, TEXT, "crazyflie"), f"torque {NO_NUMBERS}"),
    "authority, a share": (
        lambda: authority("crazyflie", share=True),
        "share must be a finite number > 0, got True",
    ),
    "steering, a range": (
        lambda: steering_thrust(9.8, 1.0, 1.0, YawRange(-1.0, 2.0), "crazyflie"),
        "yaw.rate must be a finite number >= 0, got -1.0",
    ),
    # the agents
    "seed of an experiment": (lambda: Experiment(seed=True), "seed must be an integer in"),
    "n_seeds": (lambda: Experiment(n_seeds=True), "n_seeds must be an integer >= 1, got True"),
    "n_jobs": (lambda: Options(n_jobs=True), "n_jobs must be an integer >= 0, got True"),
    "engine": (lambda: Options(engine="slurm"), "engine must be 'local' or 'ray', got 'slurm'"),  # type: ignore[arg-type]
    "a setting twice": (
        lambda: pairs_from(["alpha:1", "alpha:2"]),
        "alpha must be given once, got 'alpha:2' after 1",
    ),
    "a setting without a name": (lambda: pairs_from([":1"]), "':1' must be KEY:VALUE"),
    "waypoints, text": (lambda: MinimumSnap([TEXT, TEXT], [0.0, 1.0]), f"waypoints {NO_NUMBERS}"),
    "duration": (lambda: Tracker(env(action="snap"), True), "duration must be a finite number > 0, got True"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_be_ignored_or_guessed_is_refused(case):
    ask, sentence = REFUSED[case]
    with pytest.raises((TypeError, ValueError, gymnasium.error.ResetNeeded), match="^" + sentence):
        ask()


@pytest.mark.interpreted
def test_named_tuples_are_complete_and_plain_however_they_are_made():
    told = Uncertainty(position=np.float32(0.5), delay=np.int64(2), losses=np.True_)
    assert [type(entry) for entry in told] == [float] * 7 + [int, bool] + [float] * 4
    assert told == Uncertainty(0.5, delay=2, losses=True) == Uncertainty._make(told)
    for made in (told, Conditions(wind=np.float64(0.5), delay=1), LIMITS):
        assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made == made._replace()
        assert type(made)(**made._asdict()) == made and isinstance(made, tuple)
    with pytest.raises(TypeError, match="missing 4 required positional arguments"):
        Authority(1.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="unexpected keyword argument 'speed'"):
        Uncertainty(speed=1.0)  # type: ignore[call-arg]


def test_a_kernel_takes_a_checked_tuple():
    assert acceleration_along(1.0, LIMITS) == pytest.approx(LIMITS.specific_thrust_max - LIMITS.gravity)


def test_what_is_of_use_is_still_taken():
    """The counter-cases: the longest period, integers, lists, float32, one mask and one scene a row."""
    _, answer = asked(period=LONGEST_PERIOD)
    assert np.isfinite(answer.snap).all()
    _, answer = asked(flat=np.zeros((4, 3), dtype=int), radius=[1], snap=(1, 0, 0), velocity=[[0, 0, 0]])
    assert np.isfinite(answer.snap).all()
    env().reset(options={})
    env().reset(options={"scene": np.uint64(3)})
    rows().reset(options={"scene": [1, 2], "reset_mask": [True, False]})
    env().unwrapped.step(np.ones(4, dtype=int))
