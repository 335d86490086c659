"""Shields for Gymnasium environments with a filter slot.

A plant with a slot has, on ``env.unwrapped``, the attributes ``snap_filter`` (the slot) and ``is_shielded``.
It calls ``snap_filter.filter(flat, obstacles, snap, period)`` once per control period, batched, flies
the ``snap`` of the answer, and calls ``snap_filter.reset(mask)`` for rows that start anew. Rows that it
resets before the first call of a policy step begin an episode in that step in place of flying. Its pictures
may ask ``snap_filter.done`` what the shield did.

A vector plant that flies its rows in threads has ``row_counts`` too, how many rows each of them flies; there is
then a filter for each in ``snap_filter.parts``, and it calls these, not ``snap_filter`` itself.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from quadsafe_core.checks import keywords_of, known_keywords, non_negative_number, one_of
from quadsafe_core.kernels.jit import released
from shields.settings.plant_settings import plain_settings, settings_for
from shields.shield import Shield
from shields.slot.info import INFO_FORMATS
from shields.slot.recorder import Recorder
from shields.slot.split import SplitRecorder, SplitShield


class Installation:
    """A recorder in the slot of a plant, and the way out."""

    def __init__(self, plant: Any, recorder: Any):
        if not (hasattr(plant, "snap_filter") and hasattr(plant, "is_shielded")):
            raise TypeError(
                f"env must have a filter slot (snap_filter, is_shielded), got {type(plant).__name__}; "
                "for other plants call Shield.filter in your own loop"
            )
        if plant.is_shielded:
            raise ValueError("env must not be shielded twice: call remove() on its ShieldWrapper first")
        self._plant, self._before = plant, plant.snap_filter
        self.recorder = plant.snap_filter = recorder

    def begin(self) -> None:
        """Open a policy step; the shield must still be there."""
        if self._plant.snap_filter is not self.recorder:
            raise RuntimeError("this shield is no longer in its environment: make a new wrapper")
        self.recorder.begin()

    def remove(self) -> None:
        """Put back what was in the slot before."""
        self.begin()
        self._plant.snap_filter = self._before


class ReleasedShield(Shield):
    """A shield that lets other threads run while it filters."""

    def _begin(self, size: tuple[int, int], is_single: bool, period: float) -> None:
        super()._begin(size, is_single, period)
        self._kernels = self._kernels._replace(batch=released(self._kernels.batch))
        self._kernel = self._kernels.batch


class ShieldWrapper(gymnasium.Wrapper, RecordConstructorArgs):
    """Shields an environment with a filter slot.

    The wrapped environment itself is now shielded: the shield runs inside its control loop, once per control
    period, where a flight controller has it. For a comparison make a second environment. ``remove()`` restores
    the slot and returns the inner environment.

    ``info["shield"]`` describes the policy step, with the same keys at reset (nothing flown: snaps,
    corrections and counts are 0, ``value`` is +inf):

    | key                            | meaning                                                               |
    |--------------------------------|-----------------------------------------------------------------------|
    | `snap_desired`, `snap_applied` | (3,) m/s⁴, of the last control period; desired as it came, NaN and all|
    | `intervened`, `interventions`  | whether, and in how many control periods, the snap was changed        |
    | `correction`                   | largest ‖applied − desired‖, m/s⁴                                     |
    | `obstacle`                     | the sphere that asked for the largest correction, −1 for none         |
    | `reserve`                      | largest input a sphere asked for, in units of ū                       |
    | `value`                        | least set value, m                                                    |
    | `in_set`                       | whether it was at least 0 throughout                                  |
    | `fallback`, `fallbacks`        | whether, and how often, the backup answered in place of the desired   |
    | `refusals`                     | in how many control periods the nearest snap could not be certified   |
    | `stopped`                      | whether the stored stop was flown                                     |
    | `certified`                    | whether a clear stop was stored throughout (never with method "cbf")  |
    | `surprised`                    | whether a state came that the last one and the declared errors do not |
    |                                | allow; the first time with a RuntimeWarning                           |
    | `beyond`                       | by how much which declared bound was too small for it, the first time |
    |                                | in the step: {"position": m, "wind": m/s², "acceleration": m/s²,      |
    |                                | "snap": m/s⁴, "jitter": of the period}, 0 where nothing was           |

    Args:
        env: the environment; ``env.unwrapped`` has the slot.
        intervention_penalty: taken off the reward, times the share of the step's control periods in which
            the shield intervened.
        info_format: "nested", or "flat" for ``info["shield/correction"]`` and so on, where a logger or a tensor
            container takes no dictionaries inside ``info``.
        inner_loop: how the error is covered with which the plant flies a held snap. "proved": flights keep to
            numbers for which the plant has a bound of it, and stops keep a tube of that width clear.
            "measured": numbers as they are given; the margin covers the error in what was measured. Method
            "cbf" takes neither, and a plant that tells nothing of itself (``env.unwrapped.flight_model``) is
            taken to fly held snaps exactly.
        settings: keyword arguments of ``Shield``. What is left out the plant gives: gravity, the ends of the
            thrust band, and with "proved" snap, jerk and ``uncertainty.snap``. ``authority="vehicle"`` stands
            for the plant's own, ``env.unwrapped.authority()``, taken by itself where the plant limits its
            rotors; ``uncertainty="conditions"`` for the bounds of its conditions,
            ``env.unwrapped.uncertainty()``; ``uncertainty="plant"`` for what was measured of a plant that
            others wrote, ``env.unwrapped.plant.uncertainty()``.

    Raises:
        TypeError: if the environment has no slot.
        ValueError: if it is already shielded, or for a setting out of its range, or one that contradicts the
            plant on the unsafe side.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        *,
        intervention_penalty: float = 0.0,
        inner_loop: str = "proved",
        info_format: str = "nested",
        **settings: Any,
    ):
        _check_env(env, gymnasium.Env, "VectorShieldWrapper takes vector environments")
        self._format = _format(info_format)
        _check_settings("ShieldWrapper", settings)
        recorder = _recorder_of(env.unwrapped, settings_for(env.unwrapped, inner_loop, settings), (1,))
        penalty = non_negative_number("intervention_penalty", intervention_penalty)
        # What was given, not what the plant made of it: a rebuilt env may fly another vehicle.
        kept = {"intervention_penalty": penalty, "inner_loop": inner_loop, "info_format": info_format}
        RecordConstructorArgs.__init__(self, **{**kept, **plain_settings(settings)})
        gymnasium.Wrapper.__init__(self, env)
        self._penalty = penalty
        self._installation = Installation(env.unwrapped, recorder)

    @property
    def shield(self) -> Shield:
        """The shield in the slot."""
        return self._installation.recorder.shield

    def remove(self) -> gymnasium.Env:
        """Take the shield out of the slot; returns the inner environment, unshielded."""
        self._installation.remove()
        return self.env

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Reset the environment; ``info`` gets "shield"."""
        self._installation.begin()
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, self._with_shield(info)

    def step(self, action: Any):
        """Step the environment; ``info`` gets "shield", the reward its penalty."""
        self._installation.begin()
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self._penalty > 0.0:
            share = self._installation.recorder.intervened_share()
            reward = float(reward) - self._penalty * float(share[0])
        return observation, reward, terminated, truncated, self._with_shield(info)

    def _with_shield(self, info: dict[str, Any]) -> dict[str, Any]:
        return {**info, **self._format(self._installation.recorder.summary_of_one())}


class VectorShieldWrapper(gymnasium.vector.VectorWrapper):
    """Shields a native vector environment with a filter slot of N rows.

    As with ``ShieldWrapper``, the wrapped environment itself is now shielded, and ``remove()`` restores it.
    ``info["shield"]`` has the keys of ``ShieldWrapper``, each an array with a leading N beside its mask
    ``_key``. It describes the transition just made, also for a row that was reset in the same step;
    ``info["final_info"]["shield"]``, where there is one, is the same with the mask of the rows that ended.
    For a row that a step only resets, as in the mode "NextStep", it is that of a reset.

    With ``info_format="flat"`` it is ``info["shield/correction"]`` with its mask ``_shield/correction``, and so
    on. ``info["final_info"]`` stays a dictionary, flat inside, as Gymnasium has it.

    ``spec`` is None: a vector environment rebuilt from a spec would lose the shield without a word.

    Args:
        env: the vector environment; ``env.unwrapped`` has the slot.
        intervention_penalty: as in ``ShieldWrapper``.
        inner_loop: as in ``ShieldWrapper``.
        info_format: as in ``ShieldWrapper``.
        settings: as in ``ShieldWrapper``.

    Raises:
        TypeError: if the environment has no slot.
        ValueError: if it is already shielded, or for a setting out of its range.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv,
        *,
        intervention_penalty: float = 0.0,
        inner_loop: str = "proved",
        info_format: str = "nested",
        **settings: Any,
    ):
        _check_env(env, gymnasium.vector.VectorEnv, "ShieldWrapper takes single ones")
        super().__init__(env)
        self._format = _format(info_format)
        _check_settings("VectorShieldWrapper", settings)
        self._everyone = np.ones(env.num_envs, dtype=np.bool_)
        self._penalty = non_negative_number("intervention_penalty", intervention_penalty)
        plant: Any = env.unwrapped
        # A plant with threads of its own tells which rows each of them flies.
        counts = plant.row_counts if hasattr(plant, "row_counts") else (env.num_envs,)
        recorder = _recorder_of(plant, settings_for(plant, inner_loop, settings), counts)
        self._installation = Installation(plant, recorder)

    @property
    def autoreset_mode(self) -> gymnasium.vector.AutoresetMode | None:
        """What becomes of rows that ended, as ``metadata`` has it."""
        return self.metadata.get("autoreset_mode")

    @property
    def spec(self) -> None:
        """None, so that a rebuild fails loudly."""
        return None

    @property
    def shield(self) -> Shield | SplitShield:
        """The shield in the slot; of an env with threads one for each of them, behind one snapshot."""
        return self._installation.recorder.shield

    def remove(self) -> gymnasium.vector.VectorEnv:
        """Take the shield out of the slot; returns the inner environment, unshielded."""
        self._installation.remove()
        return self.env

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None):
        """Reset the environment; ``info`` gets "shield"."""
        self._installation.begin()
        observations, info = self.env.reset(seed=seed, options=options)
        return observations, self._with_shield(info, self._installation.recorder.begun())

    def step(self, actions: Any):
        """Step the environment; ``info`` gets "shield", the rewards their penalty."""
        self._installation.begin()
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        if self._penalty > 0.0:
            rewards = rewards - self._penalty * self._installation.recorder.intervened_share()
        return observations, rewards, terminated, truncated, self._with_shield(info, self._everyone.copy())

    def _with_shield(self, info: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
        info = {**info, **self._told(mask)}
        if "final_info" in info:
            info["final_info"] = {**info["final_info"], **self._told(info["_final_info"].copy())}
        return info

    def _told(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        return self._format(self._installation.recorder.summary(mask), mask)


def _recorder_of(plant: Any, settings: Mapping[str, Any], counts: Sequence[int]) -> Recorder | SplitRecorder:
    """What records a new shield of these settings, or one for each of several counts of rows."""
    shield = Shield(**settings)
    if hasattr(plant, "control_period"):
        shield.check_period(plant.control_period)
    if len(counts) == 1:
        return Recorder(shield, counts[0])
    return SplitRecorder(SplitShield([ReleasedShield(**settings) for _ in counts]), counts)


def _check_env(env: Any, kind: type, other: str) -> None:
    if not isinstance(env, kind):
        raise TypeError(f"env must be a {kind.__module__.split('.')[0]} {kind.__name__}, got {env!r}; {other}")


def _check_settings(wrapper: str, settings: Mapping[str, Any]) -> None:
    """Raise a TypeError for what neither the wrapper nor ``Shield`` has."""
    known_keywords(wrapper, settings, (*keywords_of(ShieldWrapper.__init__), *keywords_of(Shield.__init__)))


def _format(info_format: str) -> Callable[..., dict[str, Any]]:
    return INFO_FORMATS[one_of("info_format", info_format, tuple(INFO_FORMATS))]
