"""Reports of runs that stopped, or that lack files: said in words, and drawn from what is there."""

import re

import numpy as np
import pytest
from made_run import AVOID, STEPS, TRACK, made_run, write_progress
from run_files import table

from agents.experiment.runs import open_run
from agents.measure.results import result_rows, seed_rows
from agents.report import logged, tables
from agents.report.condition import condition
from agents.report.reporting import write_report


def test_a_whole_run_has_nothing_to_tell(tmp_path):
    run = made_run(tmp_path)
    run.folder.joinpath("provenance.yml").write_text("python: 3.11\n")
    assert condition(run) == []


def test_a_training_that_stopped_is_told_with_its_step_and_drawn(tmp_path):
    run = made_run(tmp_path, n_seeds=2, is_flown=False, is_traced=False)
    for seed, last in ((0, 5_000), (1, None)):
        folder = run.folder_of("none", seed)
        for file in folder.iterdir():
            file.unlink()
        if last is not None:
            write_progress(run, "none", seed, np.random.default_rng(0), last)
    (title, text), *_ = condition(run)
    assert title == "Stopped early"
    assert text.startswith("no shield, seed 0, stopped at step 5,000 of 20,000; no shield, seed 1, not begun.")
    curve = logged.logged_curves(run)["train/value_loss"]["none"]
    known = curve.steps[np.isfinite(curve.middle)]
    assert 5_000 - STEPS / 100 < known[-1] <= 5_000 and np.isnan(curve.low).all()
    write_report(run)
    assert "stopped at step 5,000 of 20,000" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("name", ["episodes.csv", "training.json", "progress.csv"])
def test_a_file_that_is_missing_is_told_and_the_rest_is_reported(tmp_path, name):
    run = made_run(tmp_path, n_seeds=2, is_traced=False)
    (run.folder_of("none", 1) / name).unlink()
    write_report(open_run(tmp_path))
    page = (tmp_path / "report.html").read_text()
    assert f"none_seed1/{name}, trace.csv, trace.json" in page and "none_seed0/" not in page
    counted = {row["arm"]: row["seeds"] for row in result_rows(seed_rows(run)) if row["phase"] == "training"}
    assert counted == {"none": 2 if name == "progress.csv" else 1, "shield": 2}


def test_what_is_logged_is_drawn_as_the_files_have_it(tmp_path):
    run = made_run(tmp_path, n_seeds=1, is_flown=False, is_traced=False)
    found = logged.logged_curves(run)
    # What counts or stays as it is tells nothing.
    assert list(found) == ["rollout/ep_rew_mean", "train/value_loss", "train/policy_gradient_loss"]
    rows = table(run.folder_of("shield", 0) / "progress.csv")
    curve = found["train/value_loss"]["shield"]
    assert curve.middle[-1] == pytest.approx(float(rows[-1]["train/value_loss"]))
    # Nothing was learned before the second row.
    assert np.isnan(curve.middle[curve.steps < float(rows[1]["time/total_timesteps"])]).all()


@pytest.mark.parametrize("env", [AVOID, TRACK])
def test_every_head_of_a_table_is_explained(tmp_path, env):
    rows = result_rows(seed_rows(made_run(tmp_path, is_traced=False, env=env)))
    heads = {*tables.training_table(rows[:1])[0], *tables.evaluation_table(rows[-1:])[0]}
    assert heads == set(tables.legend_of(rows)) and ("rms error, m" in heads) == (env == TRACK)
    assert set(re.findall(r"^(\S.*?): ", tables.legend_text(rows), re.MULTILINE)) == heads


def test_a_run_that_follows_tells_how_far_off_it_was_and_no_other_does(tmp_path):
    texts, pages = {}, {}
    for env in (AVOID, TRACK):
        run = made_run(tmp_path / env, n_seeds=3, is_traced=False, env=env)
        texts[env], pages[env] = write_report(run), (run.folder / "report.html").read_text()
        assert ("rms_error" in (run.folder / "results.csv").read_text()) == (env == TRACK)
        assert ("rms_error" in (run.folder / "seeds.csv").read_text()) == (env == TRACK)
    rows = {
        (row["arm"], row["flown"]): row for row in result_rows(seed_rows(run)) if row["phase"] == "evaluation"
    }
    row = rows["shield", "on"]
    cell = f"{row['rms_error']:.2f} [{row['rms_error_low']:.2f}, {row['rms_error_high']:.2f}]"
    assert 0.25 < row["rms_error_low"] < row["rms_error"] < row["rms_error_high"] < 0.35
    assert row["rms_error_difference_low"] > 0.1
    for told in (texts, pages):
        assert cell in told[TRACK] and "rms error" not in told[AVOID]
    assert "kept to its reference" in pages[TRACK] and "reached the goal" not in pages[TRACK]
    assert "reached the goal" in pages[AVOID]


def test_settings_are_rows_and_what_is_no_yaml_is_told(tmp_path):
    file = tmp_path / "config.yml"
    file.write_text(
        "env: A\nshield: {}\narms: [none, shield]\nhyperparams:\n  gamma: 0.97\n  net_arch: [64, 64]\n"
    )
    assert tables.settings(file) == [
        ["env", "A"],
        ["shield", "none"],
        ["arms", "none, shield"],
        ["hyperparams.gamma", "0.97"],
        ["hyperparams.net_arch", "64, 64"],
    ]
    for text in ("a: [", "word"):
        file.write_text(text)
        with pytest.raises(ValueError, match=r"config\.yml must be"):
            tables.settings(file)
