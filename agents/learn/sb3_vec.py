"""A native Gymnasium vector env as the vector env that Stable-Baselines3 trains on."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from agents.learn.episodes import EpisodeCounter
from quadsafe_core.shapes import Obstacles

# Names of the plant that have a leading N in the vector env and none in the single env.
PER_ROW = ("state", "goal", "obstacles", "flat_state", "render")


class Sb3VectorEnv(VecEnv):
    """N rows of one world behind Stable-Baselines3's ``VecEnv``.

    Each row's info holds the flat entries of the vector env's info, which describe the transition just made.
    A row that ended has also ``terminal_observation``, ``TimeLimit.truncated`` and Monitor's ``episode``:
    return ``r``, length ``l`` and ``t``, the seconds flown in that row, so that equal runs give equal infos.
    Whoever counts reads whole arrays: ``transition`` is the vector env's info of the last step, ``finished``
    the episodes that ended in it (see ``agents.learn.episodes``).

    Args:
        env: vector env that resets an ended row in the same step.

    Raises:
        ValueError: for another autoreset mode.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]):
        mode = env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"env must reset ended rows in the same step, got autoreset_mode {mode}")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._period = 1.0 / env.metadata["render_fps"]
        self._counter = EpisodeCounter(env)
        self._steps = 0
        self._actions: NDArray | None = None
        self.transition: dict[str, Any] = {}
        self.finished = np.zeros(0, self._counter.dtype)

    def reset(self):
        """Start an episode in every row; seeds and options set before are used once."""
        seeds: Any = None if None in self._seeds else self._seeds
        observations, info = self.env.reset(seed=seeds, options=self._merged_options())
        self._reset_seeds()
        self._reset_options()
        self._counter.start()
        self.reset_infos = rows_of(info)
        return observations

    def step_async(self, actions: NDArray) -> None:
        """Keep the actions (N, action_dim) for ``step_wait``."""
        self._actions = actions

    def step_wait(self):
        """Fly one policy step in every row."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        self._steps += 1
        self.transition = info
        self.finished = self._counter.add(rewards, terminated, truncated, info)
        infos, ended = rows_of(info), terminated | truncated
        for i, episode in zip(np.flatnonzero(ended), self.finished, strict=True):
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            infos[i]["episode"] = self._monitor(episode)
        return observations, rewards.astype(np.float32), ended, infos

    def snapshot(self) -> dict[str, dict[str, NDArray]]:
        """All that the rows remember, as copies, for ``restore``: the plant's, the shield's and the counts."""
        shield = attribute(self.env, "shield", None)
        return {
            "plant": self.env.unwrapped.snapshot(),  # type: ignore[attr-defined]
            "shield": {} if shield is None else shield.snapshot(),
            "counter": self._counter.snapshot(),
            "steps": {"steps": np.array(self._steps)},
        }

    def restore(self, snapshot: dict[str, dict[str, NDArray]]) -> None:
        """Go on, bit for bit, where an equal vector env was when it gave this snapshot.

        Raises:
            ValueError: for the snapshot of another one.
        """
        self.env.unwrapped.restore(snapshot["plant"])  # type: ignore[attr-defined]
        shield = attribute(self.env, "shield", None)
        if shield is not None:
            shield.restore(snapshot["shield"])
        self._counter.restore(snapshot["counter"])
        self._steps = int(snapshot["steps"]["steps"])

    def _monitor(self, episode) -> dict[str, float | int]:
        return {
            "r": float(episode["return"]),
            "l": int(episode["length"]),
            "t": round(self._steps * self._period, 6),
        }

    def _merged_options(self) -> dict[str, list] | None:
        if not any(self._options):
            return None
        return {name: [options[name] for options in self._options] for name in self._options[0]}

    def close(self) -> None:
        """Close the vector env."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray | None]:
        """One RGB frame a row, None without a render mode."""
        frames: Any = self.env.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:
        """The row's part of what the plant keeps per row, else the value all rows share."""
        return self._by_row(attr_name, attribute(self.env, attr_name), indices)

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        """Set an attribute that all rows share, or that of some rows if the plant keeps it per row.

        Raises:
            ValueError: if only some rows are given and all share the attribute.
        """
        rows = list(self._get_indices(indices))
        plant = self.env.unwrapped
        if attr_name in PER_ROW:
            values = getattr(plant, attr_name)
            values[rows] = value
            setattr(plant, attr_name, values)
        elif len(rows) < self.num_envs:
            raise ValueError(f"indices must be left out: all rows share {attr_name!r}, got {indices!r}")
        else:
            setattr(plant, attr_name, value)

    def env_method(self, method_name: str, *method_args, indices=None, **method_kwargs) -> list[Any]:
        """Call a method of the vector env once, and give each row its part as in ``get_attr``."""
        result = attribute(self.env, method_name)(*method_args, **method_kwargs)
        return self._by_row(method_name, result, indices)

    def env_is_wrapped(self, wrapper_class, indices=None) -> list[bool]:
        """Whether the vector env is wrapped with this class; Monitor's statistics are always there."""
        found, env = wrapper_class is Monitor, self.env
        while isinstance(env, VectorWrapper):
            found |= isinstance(env, wrapper_class)
            env = env.env
        return [found for _ in self._get_indices(indices)]

    def _by_row(self, name: str, value: Any, indices) -> list[Any]:
        rows = self._get_indices(indices)
        if name not in PER_ROW or value is None:
            return [value for _ in rows]
        if isinstance(value, Obstacles):
            worlds = list(value)
            return [Obstacles.pack(worlds[i], value.keep_out) for i in rows]
        return [value[i] for i in rows]


def attribute(env: VectorEnv, name: str, *default: Any) -> Any:
    """Attribute of the outermost layer that has it."""
    while isinstance(env, VectorWrapper) and not hasattr(env, name):
        env = env.env
    return getattr(env, name, *default)


def rows_of(info: dict[str, Any]) -> list[dict[str, Any]]:
    """One dict per row from the flat entries of a vector info."""
    columns = {name: value for name, value in info.items() if f"_{name}" in info and np.ndim(value) == 1}
    # Most entries are zero in most rows: what is not, is written into copies of a dict of zeros.
    zeros = {name: column.dtype.type(0).item() for name, column in columns.items()}
    rows = [zeros.copy() for _ in next(iter(columns.values()), ())]
    for name, column in columns.items():
        hits = column.nonzero()[0]
        for i, value in zip(hits.tolist(), column[hits].tolist(), strict=True):
            rows[i][name] = value
    return rows
