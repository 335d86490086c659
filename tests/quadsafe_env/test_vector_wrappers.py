"""Every vector wrapper of Gymnasium, around the native vector env with and without its shield."""

import sys
import types
from collections.abc import Callable
from importlib.metadata import version
from typing import NamedTuple

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers as single_wrappers
from gymnasium.error import DependencyNotInstalled
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers import vector as wrappers

import quadsafe_env  # noqa: F401 - registers the ids
from shields import VectorShieldWrapper

ROWS, STEPS = 3, 20
SAME_STEP, NEXT_STEP, DISABLED = AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED
ANY, NOT_SAME, NEXT_ONLY = (SAME_STEP, NEXT_STEP, DISABLED), (NEXT_STEP, DISABLED), (NEXT_STEP,)
# Before 1.4 Gymnasium's counts of episodes take the first step after a reset for the reset, in SAME_STEP too.
COUNTS_SAME_STEP = tuple(int(part) for part in version("gymnasium").split(".")[:2]) >= (1, 4)


class Tried(NamedTuple):
    """A wrapper: the modes that it takes, how it goes around an env, and what it makes of what passes."""

    modes: tuple[AutoresetMode, ...]
    around: Callable
    seen: Callable | None = np.asarray  # from the observations of the env; None: any finite ones
    acted: Callable = np.asarray  # from the actions of the env
    given: Callable = np.asarray  # the kind of arrays that it is given


def transformed(env, to, space):
    """The env with observations of another kind."""
    batch = batch_space(space, env.num_envs)
    return wrappers.TransformObservation(env, to, observation_space=batch, single_observation_space=space)


def in_a_dictionary(env):
    spaces = {"first": Box(-1.0, 1.0, (1,), np.float32), "rest": Box(-1.0, 1.0, (19,), np.float32)}
    return transformed(env, lambda seen: {"first": seen[:, :1], "rest": seen[:, 1:]}, Dict(spaces))


def as_pictures(env):
    """Each observation as a picture of four by five pixels, all three colours alike."""

    def painted(seen):
        return np.repeat((127.0 * (seen + 1.0)).astype(np.uint8).reshape(-1, 4, 5, 1), 3, axis=3)

    return transformed(env, painted, Box(0, 255, (4, 5, 3), np.uint8))


def to_torch(array):
    import torch

    return torch.as_tensor(array)


def imported_late(name):
    """A wrapper that Gymnasium imports when it is asked for."""

    def around(env):
        return getattr(wrappers, name)(env)

    return around


TRIED = {
    "VectorizeTransformObservation": Tried(
        NOT_SAME,
        lambda env: wrappers.VectorizeTransformObservation(
            env,
            wrapper=single_wrappers.TransformObservation,
            func=np.negative,
            observation_space=env.single_observation_space,
        ),
        np.negative,
    ),
    "VectorizeTransformAction": Tried(
        ANY,
        lambda env: wrappers.VectorizeTransformAction(
            env,
            wrapper=single_wrappers.TransformAction,
            func=np.negative,
            action_space=env.single_action_space,
        ),
        acted=np.negative,
    ),
    "VectorizeTransformReward": Tried(
        ANY,
        lambda env: wrappers.VectorizeTransformReward(
            env, wrapper=single_wrappers.TransformReward, func=np.negative
        ),
    ),
    "DictInfoToList": Tried(ANY, wrappers.DictInfoToList),
    "TransformObservation": Tried(
        NOT_SAME, lambda env: wrappers.TransformObservation(env, np.negative), np.negative
    ),
    "FilterObservation": Tried(
        NOT_SAME,
        lambda env: wrappers.FilterObservation(in_a_dictionary(env), ["first"]),
        lambda seen: {"first": seen[:, :1]},
    ),
    "FlattenObservation": Tried(NOT_SAME, lambda env: wrappers.FlattenObservation(in_a_dictionary(env))),
    "GrayscaleObservation": Tried(NOT_SAME, lambda env: wrappers.GrayscaleObservation(as_pictures(env)), None),
    "ResizeObservation": Tried(
        NOT_SAME, lambda env: wrappers.ResizeObservation(as_pictures(env), (8, 10)), None
    ),
    "ReshapeObservation": Tried(
        NOT_SAME, lambda env: wrappers.ReshapeObservation(env, (4, 5)), lambda seen: seen.reshape(-1, 4, 5)
    ),
    "RescaleObservation": Tried(
        NOT_SAME,
        lambda env: wrappers.RescaleObservation(env, np.float32(-2.0), np.float32(2.0)),
        lambda seen: np.float32(2.0) * seen,
    ),
    "DtypeObservation": Tried(
        NOT_SAME, lambda env: wrappers.DtypeObservation(env, np.float16), lambda seen: seen.astype(np.float16)
    ),
    "NormalizeObservation": Tried(NEXT_ONLY, wrappers.NormalizeObservation, None),
    "TransformAction": Tried(ANY, lambda env: wrappers.TransformAction(env, np.negative), acted=np.negative),
    "ClipAction": Tried(ANY, wrappers.ClipAction),
    "RescaleAction": Tried(
        ANY,
        lambda env: wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0)),
        acted=lambda actions: np.float32(2.0) * actions,
    ),
    "TransformReward": Tried(ANY, lambda env: wrappers.TransformReward(env, np.negative)),
    "ClipReward": Tried(ANY, lambda env: wrappers.ClipReward(env, -0.01, 0.01)),
    "NormalizeReward": Tried(ANY, wrappers.NormalizeReward),
    "RecordEpisodeStatistics": Tried(ANY, wrappers.RecordEpisodeStatistics),
    "RecordVideo": Tried(ANY, lambda env: wrappers.RecordVideo(env, "videos", episode_trigger=bool)),
    "HumanRendering": Tried(ANY, wrappers.HumanRendering),
    "ArrayConversion": Tried(ANY, lambda env: wrappers.ArrayConversion(env, env_xp=np, target_xp=np)),
    "JaxToNumpy": Tried(ANY, imported_late("JaxToNumpy")),
    "JaxToTorch": Tried(ANY, imported_late("JaxToTorch"), given=to_torch),
    "NumpyToTorch": Tried(ANY, imported_late("NumpyToTorch"), given=to_torch),
}


def native(mode, shield=None, **keywords):
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", ROWS, autoreset_mode=mode, max_episode_steps=7, **keywords)
    return env if shield is None else VectorShieldWrapper(env, **shield)


class Clip:
    """In place of a video file: how many frames it has."""

    made: list[int] = []  # noqa: RUF012 - emptied by the fixture

    def __init__(self, frames, fps):
        self.made.append(len(frames))

    def write_videofile(self, path, logger):
        pass


@pytest.fixture
def clips(monkeypatch):
    """MoviePy without a video encoder, and a display that is not there."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    module = types.ModuleType("moviepy.video.io.ImageSequenceClip")
    module.ImageSequenceClip = Clip
    for name in ("moviepy", "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    Clip.made.clear()
    return Clip.made


def check_seen(found, expected):
    """Observations against those that are expected."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        found, expected = list(found.values()), list(expected.values())
    if expected is None:
        assert np.isfinite(np.asarray(found)).all()
    else:
        # Single precision, and what a wrapper makes of it.
        np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("shield", [None, {}, {"info_format": "flat"}], ids=["bare", "shielded", "flat"])
@pytest.mark.parametrize("mode", ANY)
@pytest.mark.parametrize("name", wrappers.__all__)
@pytest.mark.filterwarnings("ignore:.*autoreset mode is same-step", "ignore:.*precision lowered by casting")
def test_wrapper_flies_what_the_env_flies(name, mode, shield, clips, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tried = TRIED[name]
    keywords = {"render_mode": "rgb_array"} if name in ("RecordVideo", "HumanRendering") else {}
    env, bare = native(mode, shield, **keywords), native(mode, shield)
    if mode not in tried.modes:
        with pytest.raises((ValueError, AssertionError)):
            tried.around(env)
        return
    try:
        wrapped = tried.around(env)
        observations, _ = wrapped.reset(seed=4)
    except (DependencyNotInstalled, ModuleNotFoundError) as error:
        pytest.skip(str(error))
    ended, seen = 0, tried.seen or (lambda _: None)
    check_seen(observations, seen(bare.reset(seed=4)[0]))
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        actions = rng.uniform(-1.0, 1.0, (ROWS, 4)).astype(np.float32)
        outcome, expected = wrapped.step(tried.given(tried.acted(actions))), bare.step(actions)
        check_seen(outcome[0], seen(expected[0]))
        assert [np.asarray(part).tolist() for part in outcome[2:4]] == [part.tolist() for part in expected[2:4]]
        done = expected[2] | expected[3]
        ended += int(done.sum())
        if mode == DISABLED and done.any():
            wrapped.reset(options={"reset_mask": tried.given(done)})
            bare.reset(options={"reset_mask": done})
    assert ended >= 2 * ROWS
    wrapped.close()
    assert (len(clips) > 0) == (name == "RecordVideo")


@pytest.mark.parametrize("shield", [None, {}], ids=["bare", "shielded"])
@pytest.mark.parametrize("mode", ANY)
def test_episodes_are_counted_in_every_mode(mode, shield):
    if mode == SAME_STEP and not COUNTS_SAME_STEP:
        pytest.skip("Gymnasium below 1.4 counts one step too few in SAME_STEP")
    counted = wrappers.RecordEpisodeStatistics(native(mode, shield))
    counted.reset(seed=0)
    rng, episodes = np.random.default_rng(0), 0
    for _ in range(40):
        _, _, terminated, truncated, info = counted.step(rng.uniform(-0.2, 0.2, (ROWS, 4)).astype(np.float32))
        done = terminated | truncated
        if done.any():
            assert (info["episode"]["l"][info["_episode"]] == 7).all()
            episodes += int(info["_episode"].sum())
        if mode == DISABLED and done.any():
            counted.reset(options={"reset_mask": done})
    # In NEXT_STEP the reset takes a step of its own: 40 = 5 · 8, else 5 · 7 + 5.
    assert episodes == 5 * ROWS
