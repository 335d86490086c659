"""The hyperparameters for RL Baselines3 Zoo: in its format, and those that train.py has."""

import inspect

import gymnasium
import pytest
import yaml
from house import ROOT
from stable_baselines3 import PPO
from torch import nn

import quadsafe_env  # noqa: F401
import shields
from agents.experiment.config import Experiment, default_hyperparams
from quadsafe_env.registration import IDS

TABLE = yaml.safe_load((ROOT / "hyperparams" / "ppo.yml").read_text())
# What the zoo takes for itself; the rest goes to the constructor of PPO.
OF_THE_ZOO = {"n_timesteps", "n_envs", "env_wrapper", "policy"}
OF_THE_POLICY = {"log_std_init", "net_arch", "activation_fn"}


def policy_kwargs(name):
    """As the zoo reads them, which evaluates a string."""
    return eval(TABLE[name]["policy_kwargs"], {"nn": nn})


def test_every_id_is_there_and_registered():
    assert set(TABLE) == set(IDS) and all(name in gymnasium.registry for name in TABLE)


@pytest.mark.parametrize("name", IDS)
def test_every_key_is_one_of_the_zoo_or_of_ppo(name):
    own = set(inspect.signature(PPO).parameters)
    assert set(TABLE[name]) - OF_THE_ZOO <= own
    policy = set(inspect.signature(PPO.policy_aliases[TABLE[name]["policy"]]).parameters)
    assert set(policy_kwargs(name)) <= OF_THE_POLICY <= policy


@pytest.mark.parametrize("name", IDS)
def test_the_values_are_those_of_a_training_here(name):
    entry = TABLE[name]
    flat = {**entry, **policy_kwargs(name)}
    if "activation_fn" in flat:
        flat["activation_fn"] = flat["activation_fn"].__name__
    wanted = default_hyperparams(name, "ppo")
    assert {key: flat[key] for key in wanted} == wanted
    # Nothing beyond them is set.
    assert set(flat) - {*OF_THE_ZOO, "policy_kwargs"} == set(wanted) - {"n_envs"}
    assert entry["n_timesteps"] == Experiment().n_timesteps


@pytest.mark.parametrize("name", IDS)
def test_the_wrapper_is_the_shield(name):
    module, _, wrapper = TABLE[name]["env_wrapper"].rpartition(".")
    assert module == "shields"
    env = getattr(shields, wrapper)(gymnasium.make(name))
    _, info = env.reset(seed=0)
    assert "shield" in info
