"""The command that measures a plant: its files, what it prints, and the sentences for what it cannot."""

import json

import pytest

import train
from shields import Shield

pytest.importorskip("mujoco")


def test_it_writes_what_a_shield_takes_and_how_it_was_measured(tmp_path, capsys, monkeypatch):
    words = ["calibrate", "--plant", "mujoco", "--flights", "2", "--seconds", "1", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["train.py", *words])
    assert train.main() == 0
    file, picture = tmp_path / "mujoco.json", tmp_path / "mujoco.png"
    printed = capsys.readouterr().out
    assert printed.startswith("Uncertainty(") and str(file) in printed and str(picture) in printed
    assert Shield(uncertainty=str(file)).settings["uncertainty"]["rotor_lag"] == pytest.approx(0.0375, rel=0.01)
    measured = json.loads(file.read_text())["measured"]
    assert measured["plant"]["kind"] == "MujocoPlant" and measured["packages"]["mujoco"]
    assert measured["command"] == "python " + " ".join(["train.py", *words])
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--plant", "mujocco"], "plant must be one of 'mujoco', "),
        (["--options", "steps:1"], "unexpected keyword argument 'steps'"),
        (["--factor", "0.5"], "factor must be >= 1, got 0.5"),
    ],
)
def test_what_it_cannot_measure_is_a_sentence(words, sentence, capsys):
    with pytest.raises(SystemExit) as ended:
        train.main(["calibrate", *words])
    assert ended.value.code == 2 and sentence in capsys.readouterr().err
