"""PPO of sbx-rl: its runs have the files of any other, go on bit for bit, and need no JAX to fly."""

import shlex
import sys
from importlib.util import find_spec

import numpy as np
import pytest
import yaml
from run_files import table, weights

import agents
import train
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked, make_training_env
from agents.experiment.runs import create_run
from agents.learn import algorithms
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.train import training

needs_sbx = pytest.mark.skipif(find_spec("sbx") is None, reason='needs sbx-rl: pip install "quadsafe[sbx]"')
# TensorFlow Probability asks JAX for names that are to go.
pytestmark = pytest.mark.filterwarnings("ignore:jax:DeprecationWarning")
SMALL = {"n_envs": 8, "n_steps": 16, "batch_size": 64, "n_epochs": 2, "net_arch": [16, 8]}
SEEN = np.random.default_rng(0).normal(size=(64, 20)).astype(np.float32)


def small(**hyperparams) -> Experiment:
    wanted = {**SMALL, **hyperparams}
    return checked(Experiment(arms=("shield",), algo="sbx:PPO", hyperparams=wanted, n_timesteps=256))


def model_of(experiment: Experiment):
    return algorithms.make_model(experiment, Sb3VectorEnv(make_training_env(experiment, "shield")), seed=0)


def test_without_the_package_the_sentence_names_the_extra(monkeypatch):
    monkeypatch.setattr(algorithms, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r'^algo sbx:PPO needs sbx-rl: pip install "quadsafe\[sbx\]"$'):
        algorithms.check_words(Experiment(algo="sbx:PPO"), Options())


def test_a_policy_of_it_needs_no_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "sbx", None)
    assert type(algorithms.new_policy(small())).__module__.startswith("stable_baselines3.")


@needs_sbx
@pytest.mark.parametrize("activation", algorithms.ACTIVATIONS)
def test_the_policy_of_torch_gives_the_actions_of_the_one_of_jax(activation, tmp_path):
    experiment = small(activation_fn=activation, log_std_init=-0.5)
    policy = model_of(experiment).policy
    algorithms.save_policy(tmp_path / "policy.pt", policy)
    read = algorithms.read_policy(tmp_path / "policy.pt", experiment)
    expected, _ = policy.predict(SEEN, deterministic=True)
    np.testing.assert_allclose(read.predict(SEEN, deterministic=True)[0], expected, atol=1e-5)
    values = np.asarray(policy.vf.apply(policy.vf_state.params, SEEN))
    torch_values = read.predict_values(read.obs_to_tensor(SEEN)[0]).detach().numpy()
    np.testing.assert_allclose(torch_values, values, atol=1e-5)
    # Counter-case: another activation flies otherwise.
    other = small(activation_fn="Tanh" if activation != "Tanh" else "ReLU")
    moved = algorithms.read_policy(tmp_path / "policy.pt", other).predict(SEEN, deterministic=True)[0]
    assert np.abs(moved - expected).max() > 1e-3


def stopped_again_and_again(experiment, folder, monkeypatch):
    """The weights of a training that was stopped after every rollout."""
    run = create_run(experiment, Options(log_folder=folder), {})
    begin = training.CheckpointCallback._on_rollout_start

    def begin_or_stop(callback):
        if callback.num_timesteps > callback._saved_at:
            run.stop_file.touch()
        begin(callback)

    with monkeypatch.context() as patch:
        patch.setattr(training.CheckpointCallback, "_on_rollout_start", begin_or_stop)
        while not run.is_trained("shield", 0):
            learned(run)
            run.stop_file.unlink(missing_ok=True)
    return weights(run.folder_of("shield", 0))


def learned(run):
    run.folder_of("shield", 0).mkdir(exist_ok=True)
    training.train(run, "shield", 0, Options(save_freq=10**9))
    return run.folder_of("shield", 0)


@needs_sbx
@pytest.mark.slow
def test_a_training_stopped_after_every_rollout_is_the_uninterrupted_one(tmp_path, monkeypatch):
    experiment = small(target_kl=0.01)
    through = weights(learned(create_run(experiment, Options(log_folder=tmp_path), {})))
    assert stopped_again_and_again(experiment, tmp_path, monkeypatch) == through
    # Counter-case: without the key of the noise it goes on otherwise.
    from agents.learn import sbx_ppo

    monkeypatch.setattr(sbx_ppo, "STATE", sbx_ppo.STATE[:2])
    assert stopped_again_and_again(experiment, tmp_path, monkeypatch) != through


@needs_sbx
def test_parameters_of_another_model_are_refused():
    model = model_of(small())
    told = model.get_parameters()
    model.set_parameters(told)
    with pytest.raises(ValueError, match=r"^policy\.actor_state must have the shapes of this model, got "):
        model_of(small(net_arch=[16, 4])).set_parameters(told)
    with pytest.raises(ValueError, match=r"^parameters must be of PPO of sbx-rl, got "):
        model_of(small(target_kl=0.01)).set_parameters(told)


@needs_sbx
@pytest.mark.slow
def test_it_trains_evaluates_reports_and_exports_as_the_others(tmp_path, capsys):
    settings = [f"{name}:{value}" for name, value in SMALL.items()]
    words = shlex.split("-n 640 --algorithm sbx:PPO --arms shield --eval-episodes 4 --n-jobs 1 -params")
    assert train.main([*words, *settings, "-f", str(tmp_path)]) == 0
    run = tmp_path / "QuadSafe-Avoid-v0_1"
    assert {"sbx-rl", "jax"} <= set(yaml.safe_load((run / "provenance.yml").read_text()))
    [trained] = [row for row in table(run / "seeds.csv") if row["phase"] == "training"]
    assert int(trained["timesteps"]) == 640 and (run / "report.html").exists()
    assert train.main(["evaluate", str(run)]) == 0
    assert train.main(["export", str(run), "--format", "torchscript"]) == 0
    assert "gives its actions" in capsys.readouterr().out
    assert type(agents.load(run)).__module__.startswith("stable_baselines3.")
