"""States set from outside: rotations to rounding are put right, what the model cannot fly from is refused."""

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_env.given_state import nearest_rotations
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, hover_state

pytestmark = pytest.mark.interpreted
CRAZYFLIE = PRESETS["crazyflie"]
SHEAR = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
NO_ROTATIONS = {
    "zeros": np.zeros((3, 3)),
    "a mirrored frame": np.diag([1.0, 1.0, -1.0]),
    "a point reflection": -np.eye(3),
    "shear": SHEAR,
    "1.5 I": 1.5 * np.eye(3),
    "two equal columns": np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "2e-6 too long": (1.0 + 2e-6) * np.eye(3),
    "huge": np.full((3, 3), 1e308),
}


def plant(**keywords):
    env = gymnasium.make("QuadSafe/Avoid-v0", **keywords).unwrapped
    env.reset(seed=0)
    return env


def rows_of(n=3, **keywords):
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", n, **keywords).unwrapped
    rows.reset(seed=0)
    return rows


def changed(**blocks):
    """A hovering state with other attitude, thrust or body rates."""
    state = hover_state(np.zeros(3), CRAZYFLIE)
    at = {"attitude": slice(ATTITUDE, OMEGA), "omega": slice(OMEGA, THRUST), "thrust": THRUST}
    for name, value in blocks.items():
        state[at[name]] = np.ravel(value) if name != "thrust" else value
    return state


def refused(sentence, state, **keywords):
    """Both faces refuse a state, the vector env by its row; neither has moved."""
    env, rows = plant(**keywords), rows_of(**keywords)
    before, all_before = env.state, rows.state
    with pytest.raises(ValueError, match="^state " + sentence):
        env.state = state
    mixed = all_before.copy()
    mixed[1] = state
    with pytest.raises(ValueError, match=r"^state\[1\] " + sentence):
        rows.state = mixed
    np.testing.assert_array_equal(env.state, before)
    np.testing.assert_array_equal(rows.state, all_before)


@pytest.mark.parametrize("name", NO_ROTATIONS)
def test_what_is_no_rotation_is_refused_with_what_came(name):
    asked = r"must have a rotation as its attitude, to 1e-06 in every entry"
    refused(asked + r", got \[\[.*, which is .* from the nearest$", changed(attitude=NO_ROTATIONS[name]))


@pytest.mark.parametrize("seed", range(3))
def test_a_rotation_with_rounding_errors_of_another_is_projected(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    rng = np.random.default_rng(seed)
    rough = rotation + rng.uniform(-3e-7, 3e-7, (3, 3))
    env, rows = plant(), rows_of(2)
    env.state = changed(attitude=rough)
    rows.state = np.stack([changed(attitude=rough), changed()])
    kept = env.state[ATTITUDE:OMEGA].reshape(3, 3)
    np.testing.assert_allclose(kept @ kept.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(kept) > 0.0 and np.abs(kept - rough).max() < 1e-6
    # The nearest: the polar factor, for which RᵀQ is symmetric.
    turned = kept.T @ rough
    np.testing.assert_allclose(turned, turned.T, atol=1e-15)
    np.testing.assert_array_equal(rows.state, [env.state, changed()])
    # Single precision is such a rounding.
    env.state = changed(attitude=rotation.astype(np.float32))
    assert np.abs(env.state[ATTITUDE:OMEGA].reshape(3, 3) - rotation).max() < 1e-7


def test_states_of_flight_and_of_hover_stay_bit_for_bit():
    env, rows = plant(action="wrench", rotor_limits=True), rows_of(action="wrench", rotor_limits=True)
    rng = np.random.default_rng(0)
    for _ in range(12):
        env.step(rng.uniform(-1, 1, 4))
        rows.step(rng.uniform(-1, 1, (3, 4)))
        for each in (env, rows):
            before = each.state
            each.state = before
            np.testing.assert_array_equal(each.state, before)
    hover = hover_state([0.1, 0.2, 0.3], CRAZYFLIE, yaw=0.7)
    env.state = hover
    np.testing.assert_array_equal(env.state, hover)


def test_the_callers_array_is_left_alone():
    env, rough = plant(), changed(attitude=(1.0 + 1e-7) * np.eye(3))
    given = rough.copy()
    env.state = given
    np.testing.assert_array_equal(given, rough)
    assert not np.array_equal(env.state, rough)


@pytest.mark.parametrize("thrust", [0.0, -0.1, CRAZYFLIE.thrust_min])
def test_a_thrust_at_the_floor_is_refused(thrust):
    refused(r"must have a thrust above thrust_min, 0\.0132435 N, got", changed(thrust=thrust))


def test_a_thrust_above_all_rotors_is_refused_where_they_have_limits():
    beyond = changed(thrust=1.0001 * CRAZYFLIE.thrust_max)
    refused(
        r"must have a thrust above thrust_min, 0\.0132435 N and at most thrust_max, 0\.59[0-9]* N, got 0\.59",
        beyond,
        rotor_limits=True,
    )
    plant().state = beyond
    plant(rotor_limits=True).state = changed(thrust=CRAZYFLIE.thrust_max)


@pytest.mark.parametrize(("hz", "bound"), [(500, 150.0), (100, 30.0)])
def test_body_rates_that_a_physics_step_cannot_follow_are_refused(hz, bound):
    keywords = {"physics_hz": hz}
    along = np.array([0.6, 0.0, -0.8])
    sentence = (
        rf"must turn by less than 0\.3 rad in a physics step of {1 / hz:g} s, got body rates \[.* by 0\.3003"
    )
    refused(sentence, changed(omega=1.001 * bound * along), **keywords)
    plant(**keywords).state = changed(omega=0.999 * bound * along)
    refused(r"must turn by less", changed(omega=[0.0, 0.0, 1e200]), **keywords)


def test_nearest_rotation_of_a_mirror_image_is_a_rotation():
    mirrored = Rotation.random(5, random_state=1).as_matrix() * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(np.linalg.det(nearest_rotations(mirrored)), 1.0)
