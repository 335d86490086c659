"""N quadrotors as a ``gymnasium.vector.VectorEnv``: the same world as the single env, row by row."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import positive_integer
from quadsafe_core.kernels.threads import row_counts
from quadsafe_core.maths.counter_rng import KEY_LIMIT, key_words
from quadsafe_core.shapes import Obstacles
from quadsafe_env.autoreset import MODES, mode_from, vector_info
from quadsafe_env.given_state import given_states
from quadsafe_env.plain_spec import PlainSpec
from quadsafe_env.plant_access import PlantAccess
from quadsafe_env.settings import (
    action_array,
    build_worlds,
    check_begun,
    check_keywords,
    check_render_mode,
    known_options,
    scene_integer,
)
from quadsafe_env.simulation.surroundings import copied
from quadsafe_env.split_world import joined

RENDER_MODES = ("rgb_array",)
OWN_KEYWORDS = ("max_episode_steps", "render_mode", "autoreset_mode", "threads")


class QuadrotorVectorEnv(PlainSpec, PlantAccess, VectorEnv):
    """N rows of ``QuadrotorEnv`` in one world; spaces, rewards and info keys are those of the single env.

    Row i of ``reset(seed=s)`` is the single env's ``reset(seed=s + i)``, bit for bit, and so is every step
    after it. A row whose action is not finite ends with ``invalid_action``, unless the env is shielded. As with
    ``gym.make``, an episode that ends by itself in the very step of its time limit is both terminated and
    truncated.

    What becomes of rows that ended is ``autoreset_mode``, as in Gymnasium's own vector envs:

    - "SameStep": they are reset in the same step. ``info["final_obs"]`` and ``info["final_info"]`` hold their
      last observation and info, with masks ``_final_obs`` and ``_final_info``. The rest of the info always
      describes the transition just made, also for a row that was reset; Gymnasium's own put the reset's there.
    - "NextStep": the next step ignores their action and resets them, with reward 0 and the info of a reset.
    - "Disabled": they wait for ``reset(options={"reset_mask": mask})``; ``step`` raises
      ``gymnasium.error.ResetNeeded`` until then, before it flies any row.

    Args:
        num_envs: number of rows N.
        max_episode_steps: time limit, policy steps; None for no limit.
        render_mode: None or "rgb_array": ``render()`` gives one frame a row.
        autoreset_mode: ``gymnasium.vector.AutoresetMode``, or the value or name of one.
        threads: how many threads fly the rows, each a range of whole blocks of sixteen; they are the same bits
            with any number. A filter in the slot needs ``parts`` then, see ``quadsafe_env.split_world``, and
            functions given as observation and reward are called from several threads.
        settings: see ``quadsafe_env.settings.build_worlds``.
    """

    metadata = {  # noqa: RUF012 - Gymnasium's attribute
        "render_modes": list(RENDER_MODES),
        "render_fps": 25,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        threads: int = 1,
        **settings: Any,
    ):
        check_keywords("gymnasium.make_vec", settings, OWN_KEYWORDS)
        self.num_envs = positive_integer("num_envs", num_envs)
        self.render_mode = check_render_mode(render_mode, RENDER_MODES)
        self.row_counts = row_counts(self.num_envs, positive_integer("threads", threads))
        """How many rows each thread flies; a shield has a memory of its own for each."""
        self._world = joined(build_worlds(self.row_counts, self.render_mode, **settings))
        mode = mode_from(autoreset_mode)
        self.metadata = {**self.metadata, "render_fps": self._world.rates.policy, "autoreset_mode": mode}
        self.single_action_space = Box(-1.0, 1.0, (4,), np.float32)
        self.single_observation_space = self._world.observation_space
        self.action_space = _space_of_rows(self.single_action_space, self.num_envs)
        self.observation_space = _space_of_rows(self.single_observation_space, self.num_envs)
        # Without a limit, no count of steps reaches it.
        limit = (
            np.inf if max_episode_steps is None else positive_integer("max_episode_steps", max_episode_steps)
        )
        self._episodes = MODES[mode](self._world, limit)
        self._is_seeded = False

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """What becomes of rows that ended; fixed when the env is made."""
        return self._episodes.mode

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        """Start an episode in every row.

        Args:
            seed: s for the scenes s, s + 1, …; or one integer a row, None for a row that carries on.
            options: {"scene": [k_0, …]} flies given scenes; {"reset_mask": (N,) bool} resets some rows only,
                and the masks of the info are then those rows.

        Raises:
            TypeError, ValueError: for a seed or scene out of range, or not one a row, another kind of mask, or
                another option.
        """
        options = dict(known_options(options, ("scene", "reset_mask")))
        rows = self._rows(options.get("reset_mask"))
        self._seed(rows, seed)
        if "scene" in options:
            scenes = self._one_a_row("scene", options["scene"])
            self._world.reset_to(rows, key_words([scene_integer(f"scene[{i}]", scenes[i]) for i in rows]))
        else:
            self._world.reset(rows)
        self._episodes.steps[rows] = 0
        mask = np.zeros(self.num_envs, dtype=np.bool_)
        mask[rows] = True
        return self._world.observed(), vector_info(self._world.outcome()[2], mask)

    def step(self, actions: ArrayLike):
        """Fly one policy step in every row.

        Raises:
            TypeError, ValueError: for no numbers or a wrong shape.
            gymnasium.error.ResetNeeded: before the first reset; in the mode "Disabled", for a row that ended.
        """
        check_begun(self._is_seeded)
        return self._episodes.step(action_array("actions", actions, (self.num_envs, 4)))

    def snapshot(self) -> dict[str, NDArray]:
        """All that the rows remember, as copies, for ``restore``; the filter in the slot has its own memory."""
        return {**self._world.snapshot(), "steps": self._episodes.steps.copy()}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on, bit for bit, where an equal vector env was when it gave this snapshot.

        Raises:
            ValueError: for the snapshot of another size.
        """
        self._world.restore({name: array for name, array in snapshot.items() if name != "steps"})
        self._episodes.steps[:] = snapshot["steps"]
        self._is_seeded = True

    def render(self):
        """One RGB frame (render_size, render_size, 3) a row, or None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._world.picture(i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the plants that others wrote."""
        # Gymnasium closes an env whose settings were refused, too.
        if hasattr(self, "_world"):
            self._world.close()

    def _rows(self, mask: Any) -> NDArray[np.intp]:
        if mask is None:
            return np.arange(self.num_envs)
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(
                f"reset_mask must be a boolean array of shape ({self.num_envs},), "
                f"got {mask.dtype} of shape {mask.shape}"
            )
        return np.flatnonzero(mask)

    def _seed(self, rows: NDArray[np.intp], seed: int | Sequence[int | None] | None) -> None:
        if not self._is_seeded:
            self._world.seed(np.arange(self.num_envs), self._in_a_row(int(self.np_random.integers(2**63))))
            self._is_seeded = True
        if isinstance(seed, int | np.integer):
            first = scene_integer("seed", seed)
            super().reset(seed=first)
            self._world.seed(rows, self._in_a_row(first)[rows])
        elif seed is not None:
            seeds = self._one_a_row("seed", seed)
            given = np.array([i for i in rows if seeds[i] is not None], dtype=np.intp)
            self._world.seed(given, key_words([scene_integer(f"seed[{i}]", seeds[i]) for i in given]))

    def _in_a_row(self, first: int) -> NDArray[np.int64]:
        return key_words([(first + i) % KEY_LIMIT for i in range(self.num_envs)])

    def _one_a_row(self, name: str, values: Any) -> list:
        values = list(np.atleast_1d(np.asarray(values, dtype=object)))
        if len(values) != self.num_envs:
            raise ValueError(
                f"{name} must have one integer for each of the {self.num_envs} rows, got {len(values)}"
            )
        return values

    def flat_state(self) -> NDArray[np.float64]:
        """Flat states (N, 4, 3): r, ṙ, r̈, r⃛ in the world frame."""
        return self._world.flat_states()

    @property
    def state(self) -> NDArray[np.float64]:
        """The plant's states (N, 20), a copy; see ``quadsafe_env.vehicle.state``.

        Setting them starts every episode over from there, in its present scene; time limits run on. What the
        model cannot fly from is refused: ``quadsafe_env.given_state.given_states``.
        """
        return self._world.states.copy()

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._world.start_from(given_states(value, (self.num_envs,), self._world))

    @property
    def goal(self) -> NDArray[np.float64]:
        """The goals (N, 3), m, a copy."""
        return self._world.scenes.goal.copy()

    @property
    def reference(self) -> NDArray[np.float64]:
        """In Track, position to snap of the references now, (N, 5, 3); else an error."""
        return self._references()

    @property
    def is_blocked(self) -> NDArray[np.bool_]:
        """Whether the straight way of each row is blocked, (N,), see ``quadsafe_env.tasks.ends``."""
        return self._world.blocked_ways()

    @property
    def obstacles(self) -> Obstacles:
        """What there is as it stands now, packed in a copy; iterating gives a list of shapes for each row."""
        return copied(self._world.obstacles)


def _space_of_rows(space: Box, n: int) -> Box:
    """``batch_space`` with bounds that are one row's, seen n times: their copies took 240 bytes a row."""
    rows, shape = cast(Box, batch_space(space, n)), (n, *(space.shape or ()))
    for name in ("low", "high", "bounded_below", "bounded_above"):
        setattr(rows, name, np.broadcast_to(getattr(space, name), shape))
    return rows
