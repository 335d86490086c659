"""A vector env whose rows fly in several threads: what is told and what is raised are those of one."""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_env.simulation.slot import Passed
from shields import VectorShieldWrapper

N = 40
MOVING = [{"shape": "sphere", "center": [0, 0, 0], "radius": 0.4, "velocity": [0.1, 0, 0]}, [0, 1, 1, 0.3]]
CASES = {
    "plain": {},
    "next step": {"autoreset_mode": "NextStep"},
    "conditions": {"conditions": {"delay": 1, "loss": 0.2, "position_noise": 0.01, "wind": 0.3}},
    "moving": {"obstacles": MOVING},
    "told": {"name": "Track", "observation": "world"},
}


def made(threads, is_shielded=True, n=N, name="Avoid", **keywords) -> Any:
    env = gymnasium.make_vec(f"QuadSafe/{name}-v0", n, threads=threads, max_episode_steps=12, **keywords)
    if not is_shielded:
        return env
    told: Any = {"uncertainty": {"position": 0.02, "velocity": 0.05, "delay": 1, "losses": True, "wind": 0.4}}
    return VectorShieldWrapper(env, **(told if "conditions" in keywords else {}))


def steps(env, count, seed=0):
    """Random actions, one of them not finite, and all that is told."""
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, env.num_envs, 4)).astype(np.float32)
    actions[count // 2, -1, 0] = np.nan
    return [env.step(asked) for asked in actions]


def flight(env, count=25):
    return [env.reset(seed=3), *steps(env, count), env.unwrapped.state, env.unwrapped.flat_state()]


@pytest.mark.parametrize("is_shielded", [False, True])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore:the state that came is not the one predicted")
def test_rows_are_the_same_bits_in_any_number_of_threads(case, is_shielded):
    alone = flight(made(1, is_shielded, **CASES[case]))
    for threads in (2, 3):
        np.testing.assert_equal(flight(made(threads, is_shielded, **CASES[case])), alone)
    # And it is not because nothing happens.
    assert any("final_info" in info for *_, info in alone[1:26]) or case == "next step"


@pytest.mark.parametrize(("n", "threads", "counts"), [(5, 3, (5,)), (20, 3, (16, 4)), (40, 2, (16, 24))])
def test_few_rows_fly_in_fewer_threads(n, threads, counts):
    env = made(threads, n=n)
    assert env.unwrapped.row_counts == counts
    np.testing.assert_equal(flight(env, 5), flight(made(1, n=n), 5))


def test_rows_reset_by_hand_and_what_else_is_asked_are_those_of_one_thread():
    envs = [made(threads, autoreset_mode="Disabled", obstacles=MOVING) for threads in (1, 2)]
    mask = np.arange(N) % 3 == 0
    mask[:16] = False
    found = []
    for env in envs:
        told = [env.reset(seed=1), *steps(env, 3), env.reset(options={"reset_mask": mask})]
        plant = env.unwrapped
        told += [
            env.reset(seed=list(range(N, 0, -1)), options={"reset_mask": mask}),
            plant.goal,
            plant.is_blocked,
        ]
        plant.state = plant.state[::-1]
        found.append([*told, *steps(env, 2), [[shape.as_dict() for shape in row] for row in plant.obstacles]])
    np.testing.assert_equal(found[1], found[0])
    assert envs[0].unwrapped.obstacles == envs[1].unwrapped.obstacles


def test_snapshots_and_copies_go_on_bit_for_bit():
    env = made(2)
    flight(env, 10)
    twin, kept, shield = made(2), env.unwrapped.snapshot(), env.shield.snapshot()
    twin.unwrapped.restore(kept)
    twin.shield.restore(shield)
    others = [twin, copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    went_on = steps(env, 15, seed=1)
    for other in others:
        np.testing.assert_equal([step[:4] for step in steps(other, 15, seed=1)], [step[:4] for step in went_on])
    for target, given in ((twin.unwrapped, made(1).unwrapped.snapshot()), (made(1).unwrapped, kept)):
        with pytest.raises(ValueError, match=r"^snapshot must be one of 40 rows in equal scenes, got arrays"):
            target.restore(given)
    with pytest.raises(ValueError, match=r"^snapshot must be one of shields in 2 threads, got .*'memory'"):
        twin.shield.restore({name.partition("/")[2]: array for name, array in shield.items()})
    twin.shield.restore({})
    assert not twin.shield.snapshot()


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2", True, None])
def test_a_number_of_threads_is_a_positive_integer(threads):
    with pytest.raises((TypeError, ValueError), match=r"^threads must be "):
        made(threads)


def test_a_single_env_has_no_threads():
    with pytest.raises(TypeError, match=r"^gymnasium\.make must get keywords among "):
        gymnasium.make("QuadSafe/Avoid-v0", threads=2)


class Stern:
    """A reward that does not pay for some row."""

    goal = np.full(3, np.inf)

    def __call__(self, q):
        if (q.goal == self.goal).all(axis=-1).any():
            raise ArithmeticError("this goal is not paid for")
        return q.reward


@pytest.mark.parametrize("row", [0, 20])
def test_what_a_thread_raises_comes_out(row):
    reward = Stern()
    env = made(2, is_shielded=False, reward=reward)
    env.reset(seed=0)
    steps(env, 2)
    reward.goal = env.unwrapped.goal[row]
    with pytest.raises(ArithmeticError, match="this goal is not paid for"):
        steps(env, 1)


class Held:
    """A filter of all rows at once."""

    def filter(self, flat, obstacles, snap, period):
        return Passed(np.zeros((len(flat), 3)))

    def reset(self, mask):
        pass


def test_a_filter_of_all_rows_is_refused_and_one_for_each_range_is_flown():
    env, alone = made(2, is_shielded=False).unwrapped, made(1, is_shielded=False).unwrapped
    with pytest.raises(TypeError, match=r"^snap_filter must have parts, .* 2 ranges .*threads=1"):
        env.snap_filter = Held()
    assert not env.is_shielded
    held: Any = Held()
    held.parts = [Held(), Held()]
    env.snap_filter, alone.snap_filter = held, Held()
    assert env.is_shielded and env.snap_filter is held
    np.testing.assert_equal(flight(env, 3), flight(alone, 3))


def test_a_shield_is_taken_out_of_every_range():
    env = made(2)
    plain = env.remove()
    assert not plain.unwrapped.is_shielded
    np.testing.assert_equal(flight(plain, 3), flight(made(1, is_shielded=False), 3))
    with pytest.raises(RuntimeError, match="no longer in its environment"):
        env.reset()


def test_pictures_are_those_of_the_rows():
    frames = []
    for threads in (1, 2):
        env = made(threads, render_mode="rgb_array", render_size=32)
        env.reset(seed=0)
        steps(env, 2)
        frames.append(env.unwrapped._world.picture(20))
    np.testing.assert_array_equal(*frames)
