"""The activation of the networks: named, kept in the settings, and that of the defaults without one."""

from typing import Any

import numpy as np
import pytest
import torch
import yaml

from agents.experiment.command_line import parse
from agents.experiment.config import Experiment, Options, experiment_from_dict, to_dict
from agents.experiment.environments import checked
from agents.experiment.runs import open_run
from agents.learn import algorithms


def with_activation(name: Any) -> Experiment:
    return checked(Experiment(hyperparams={"activation_fn": name}))


def activations(policy: torch.nn.Module) -> set[str]:
    known = algorithms.ACTIVATIONS
    return {type(part).__name__ for part in policy.modules()} & set(known)


def test_an_activation_survives_the_files_of_a_run(tmp_path):
    experiment = with_activation("ReLU")
    policy = algorithms.new_policy(experiment)
    algorithms.save_policy(tmp_path / "policy.pt", policy)
    read = algorithms.read_policy(tmp_path / "policy.pt", experiment_from_dict(to_dict(experiment)))
    assert activations(read) == {"ReLU"}
    seen = np.full(read.observation_space.shape or (), 0.5, np.float32)
    assert np.array_equal(
        read.predict(seen, deterministic=True)[0], policy.predict(seen, deterministic=True)[0]
    )


def test_without_one_it_is_that_of_the_algorithm():
    assert activations(algorithms.new_policy(checked(Experiment()))) == {"ReLU"}
    assert activations(algorithms.new_policy(checked(Experiment(algo="a2c")))) == {"Tanh"}
    assert activations(algorithms.new_policy(checked(Experiment(env="QuadSafe/Forest-v0")))) == {"Tanh"}


def test_a_run_from_before_there_was_a_default_keeps_tanh(tmp_path):
    older = to_dict(checked(Experiment()))
    del older["hyperparams"]["activation_fn"]
    (tmp_path / "config.yml").write_text(yaml.safe_dump(older))
    run = open_run(tmp_path)
    assert activations(algorithms.new_policy(run.experiment)) == {"Tanh"}
    # It goes on as it is, and so does a new run of its settings.
    for word in (["-i", str(tmp_path)], ["--config", str(tmp_path / "config.yml")]):
        assert checked(parse(word).experiment) == run.experiment  # type: ignore[union-attr]
    # Counter-case: settings that leave out more have the defaults of now.
    del older["hyperparams"]["net_arch"]
    assert activations(algorithms.new_policy(checked(experiment_from_dict(older)))) == {"ReLU"}


@pytest.mark.parametrize("name", algorithms.ACTIVATIONS)
def test_each_that_is_listed_is_taken(name):
    experiment = with_activation(name)
    algorithms.check_words(experiment, Options())
    assert activations(algorithms.new_policy(experiment)) == {name}


@pytest.mark.parametrize("name", ["relu", "Module", 3])
def test_one_that_there_is_not_is_refused(name):
    with pytest.raises(ValueError, match="activation_fn must be one of"):
        algorithms.check_words(with_activation(name), Options())
