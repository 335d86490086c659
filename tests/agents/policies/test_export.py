"""Policies written for other programs give the actions that they flew."""

import numpy as np
import pytest
import torch
from made_run import made_run

import agents
import train
from agents.experiment.config import Experiment
from agents.learn.algorithms import new_policy, save_policy
from agents.policies import export, onnx_file
from agents.policies.adapters import agent_from

OBSERVATIONS = np.random.default_rng(1).normal(0.0, 3.0, (50, 20)).astype(np.float32)
KINDS = ("onnx", "torchscript")


def need(kind):
    if kind == "onnx":
        for name in ("onnx", "onnxscript", "onnxruntime"):
            pytest.importorskip(name)


@pytest.fixture
def policy():
    return new_policy(Experiment())


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "sac", "td3"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_file_gives_the_same_actions(algo, kind, tmp_path):
    need(kind)
    policy, path = new_policy(Experiment(algo=algo)), tmp_path / export.DEFAULT_NAMES[kind]
    assert "to within" in export.export_policy(policy, path, kind)
    expected, _ = policy.predict(OBSERVATIONS, deterministic=True)
    read = {"onnx": export._read_onnx, "torchscript": export._read_torchscript}[kind]
    np.testing.assert_allclose(read(path)(OBSERVATIONS), expected, atol=1e-5)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_actions_at_their_ends_are_cut_as_predict_cuts_them(policy, tmp_path):
    with torch.no_grad():
        policy.action_net.weight *= 1000.0
    export.export_policy(policy, tmp_path / "policy.ts", "torchscript")
    actions = export._read_torchscript(tmp_path / "policy.ts")(OBSERVATIONS)
    assert np.abs(actions).max() == 1.0 and (np.abs(actions) == 1.0).mean() > 0.5


def test_a_file_that_gives_other_actions_is_not_written(policy, tmp_path, monkeypatch):
    def other(path):
        return lambda observations: policy.predict(observations, deterministic=True)[0] + 1e-3

    monkeypatch.setitem(export.WAYS, "torchscript", (export._torchscript_bytes, other))
    with pytest.raises(
        ValueError, match=r"policy.ts must give the actions of the policy to within 1e-05, got 0.001"
    ):
        export.export_policy(policy, tmp_path / "policy.ts", "torchscript")
    assert list(tmp_path.iterdir()) == []


def test_the_checks_of_torch_are_as_they_were(policy, tmp_path):
    checks = torch.distributions.Distribution._validate_args
    export.export_policy(policy, tmp_path / "policy.ts", "torchscript")
    assert torch.distributions.Distribution._validate_args is checks


def test_the_command_writes_beside_the_weights(tmp_path, policy, capsys):
    run = made_run(tmp_path / "run", n_seeds=1, is_traced=False)
    save_policy(run.folder_of("none", 0) / "policy.pt", policy)
    assert train.main(["export", str(run.folder), "--arm", "none", "--format", "torchscript"]) == 0
    path = run.folder_of("none", 0) / "policy.ts"
    assert path.exists() and f"Arm none, seed 0. {path} gives its actions" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        train.main(["export", str(run.folder), "--arm", "cbf"])
    assert "arm and seed must be of none, shield with seed 0" in capsys.readouterr().err


def test_without_the_packages_the_sentence_names_the_extra(policy, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r'pip install "quadsafe\[onnx\]"'):
        export.export_policy(policy, tmp_path / "policy.onnx")
    assert onnx_file.MISSING.startswith("ONNX files need")


@pytest.mark.slow
def test_an_exported_policy_flies_as_its_own(policy, tmp_path):
    need("onnx")
    export.export_policy(policy, tmp_path / "policy.onnx")
    own, read = (agents.evaluate(one, scenes=4) for one in (policy, tmp_path / "policy.onnx"))
    # Flights are chaotic at most near a collision; single precision is enough for a few seconds.
    np.testing.assert_allclose(read.without["return"], own.without["return"], atol=1e-2)
    assert read.without["length"].tolist() == own.without["length"].tolist()


def test_a_file_for_one_observation_flies_row_by_row(tmp_path):
    need("onnx")
    import onnx
    from onnx import TensorProto, helper

    node = helper.make_node("Slice", ["observation", "from", "to", "axis"], ["action"])
    ends = [
        helper.make_tensor(n, TensorProto.INT64, [1], [v]) for n, v in (("from", 0), ("to", 4), ("axis", 1))
    ]
    shapes = (("observation", [1, 20]), ("action", [1, 4]))
    ports = [[helper.make_tensor_value_info(n, TensorProto.FLOAT, shape)] for n, shape in shapes]
    graph = helper.make_graph([node], "first_four", *ports, initializer=ends)
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), tmp_path / "one.onnx")
    actions, _ = agent_from(tmp_path / "one.onnx").predict(OBSERVATIONS)
    np.testing.assert_array_equal(actions, OBSERVATIONS[:, :4])


def test_a_file_that_is_no_network_is_said(tmp_path):
    need("onnx")
    (tmp_path / "bad.onnx").write_bytes(b"no network")
    with pytest.raises(ValueError, match=r"bad.onnx must be an ONNX file, got: "):
        agent_from(tmp_path / "bad.onnx")
