"""PPO of sbx-rl, which computes in JAX: what it learned and how it goes on, as the files of a run hold them.

Only a training needs JAX: its weights are those of Stable-Baselines3's policy of the same shape.
"""

from collections.abc import Mapping
from operator import attrgetter
from typing import Any

import jax  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
from flax.serialization import from_state_dict, to_state_dict  # pyright: ignore[reportMissingImports]
from sbx import PPO  # pyright: ignore[reportMissingImports]
from sbx.ppo.policies import PPOPolicy  # pyright: ignore[reportMissingImports]

# By the names of torch's modules, see ``agents.learn.algorithms``.
FUNCTIONS = {
    "Tanh": jax.nn.tanh,
    "ReLU": jax.nn.relu,
    "ELU": jax.nn.elu,
    "LeakyReLU": jax.nn.leaky_relu,
    "SiLU": jax.nn.silu,
    "Hardtanh": jax.nn.hard_tanh,
    "Softsign": jax.nn.soft_sign,
}
# All that an update or an action of PPO changes; with a target_kl it changes the learning rate too.
STATE = ("policy.actor_state", "policy.vf_state", "key", "policy.key", "policy.noise_key")
RATE = "adaptive_lr.current_adaptive_lr"


class SbxPolicy(PPOPolicy):
    """The networks of sbx-rl, told by the names of ``ActorCriticPolicy`` of Stable-Baselines3."""

    def __init__(self, *arguments: Any, activation_fn: type[torch.nn.Module] = torch.nn.Tanh, **keywords: Any):
        super().__init__(*arguments, activation_fn=FUNCTIONS[activation_fn.__name__], **keywords)

    def state_dict(self, *arguments: Any, **keywords: Any) -> dict[str, torch.Tensor]:
        """Weights for ``load_state_dict`` of Stable-Baselines3's policy with the same ``net_arch``."""
        actor, critic = (state.params["params"] for state in (self.actor_state, self.vf_state))
        found = {
            "log_std": actor["log_std"],
            **_layers(actor, "policy_net", "action_net"),
            **_layers(critic, "value_net", "value_net"),
        }
        return {name: torch.tensor(np.asarray(value)) for name, value in found.items()}


class SbxPPO(PPO):
    """``sbx.PPO``, whose parameters are all that decides how it goes on, as arrays and numbers."""

    policy_aliases = {"MlpPolicy": SbxPolicy}  # noqa: RUF012 - as in the class above

    def get_parameters(self) -> dict[str, Any]:
        """Networks, optimisers and random keys; ``{}``, ``sbx.PPO`` would say."""
        names = STATE if self.target_kl is None else (*STATE, RATE)
        return {name: _plain(to_state_dict(attrgetter(name)(self))) for name in names}

    def set_parameters(
        self, load_path_or_dict: Mapping[str, Any], exact_match: bool = True, device: Any = "auto"
    ) -> None:
        """Take those that ``get_parameters`` of an equal model gave.

        Raises:
            ValueError: for those of another one.
        """
        if load_path_or_dict.keys() != self.get_parameters().keys():
            raise ValueError(f"parameters must be of PPO of sbx-rl, got {sorted(load_path_or_dict)}")
        for name, value in load_path_or_dict.items():
            before = attrgetter(name)(self)
            after = from_state_dict(before, value)
            if _shapes(after) != _shapes(before):
                raise ValueError(f"{name} must have the shapes of this model, got {_shapes(after)}")
            owner, _, last = name.rpartition(".")
            setattr(attrgetter(owner)(self) if owner else self, last, after)


def _layers(network: Mapping[str, Any], inner: str, outer: str) -> dict[str, Any]:
    """Weights of one network: flax has them (in, out), torch (out, in) with an activation between two."""
    count = sum(name.startswith("Dense_") for name in network)
    names = [*(f"mlp_extractor.{inner}.{2 * i}" for i in range(count - 1)), outer]
    dense = [network[f"Dense_{i}"] for i in range(count)]
    return {
        f"{name}.{kind}": value
        for name, layer in zip(names, dense, strict=True)
        for kind, value in (("weight", layer["kernel"].T), ("bias", layer["bias"]))
    }


def _plain(tree: Any) -> Any:
    return jax.tree.map(lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, tree)


def _shapes(tree: Any) -> list[tuple[int, ...]]:
    return [np.shape(leaf) for leaf in jax.tree.leaves(tree)]
