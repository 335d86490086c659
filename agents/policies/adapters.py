"""What was made elsewhere as an agent that flies: a function, a model, an ONNX file, or the name of one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.measure.evaluate import Agent
from agents.named import found_by_name


@runtime_checkable
class HasPredict(Protocol):
    """A model of Stable-Baselines3, or what has its ``predict``."""

    def predict(self, observation: Any) -> Any:
        """Actions and a state, as Stable-Baselines3 has them."""


@runtime_checkable
class HasReset(Protocol):
    """A controller that forgets its last flight."""

    def reset(self) -> Any:
        """Called before a flight."""


class Function:
    """A callable from one observation to one action, as an agent of one row.

    It may remember what it saw, so it flies one scene after the other; its ``reset()``, if it has one, is
    called before each.

    Args:
        function: gives the action (4,) for an observation (D,).
    """

    def __init__(self, function: Callable[[NDArray], ArrayLike]):
        self._function = function
        self._forget = function.reset if isinstance(function, HasReset) else lambda: None

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """The action (1, 4) for the observation (1, D).

        Raises:
            RuntimeError: from whatever the function raised, so that it is not taken for a setting out of range.
        """
        try:
            if np.any(episode_start):
                self._forget()
            action = self._function(observation[0])
        except (ValueError, TypeError, OSError) as error:
            raise RuntimeError(f"policy raised {type(error).__name__}: {error}") from error
        return np.asarray(action, dtype=np.float32)[None], None


def agent_from(policy: Any) -> Agent:
    """The agent that a policy is.

    Args:
        policy: a callable from an observation (D,) to an action (4,); a model of Stable-Baselines3 or anything
            with its ``predict``; the path of an ONNX file; or "module:name" for one of these.

    Raises:
        TypeError: for anything else.
        ValueError, OSError: for a name or a file that there is not, or that holds no policy.
    """
    if isinstance(policy, str | Path):
        return _named(str(policy))
    if isinstance(policy, HasPredict):
        return policy  # pyright: ignore[reportReturnType] - no more can be asked before it is called
    if callable(policy):
        return Function(cast(Callable[[NDArray], ArrayLike], policy))
    raise TypeError(
        "policy must be a callable, have Stable-Baselines3's predict, or be an ONNX file or 'module:name', "
        f"got {type(policy).__name__}"
    )


def is_name(word: str) -> bool:
    """Whether a word of the command line names a policy, and not a run folder."""
    return not Path(word).is_dir() and (":" in word or word.lower().endswith(".onnx"))


def name_of(policy: Any) -> str:
    """What records call a policy."""
    if isinstance(policy, str | Path):
        return str(policy)
    named = policy if hasattr(policy, "__qualname__") else type(policy)
    return f"{named.__module__}.{named.__qualname__}"


def _named(word: str) -> Agent:
    if word.lower().endswith(".onnx"):
        from agents.policies.onnx_file import OnnxPolicy

        return OnnxPolicy(Path(word))
    found = found_by_name("policy", "an ONNX file or 'module:name'", word)
    if isinstance(found, str | Path):
        raise TypeError(f"policy must name a callable or a model, got a {type(found).__name__} as {word!r}")
    return agent_from(found)
