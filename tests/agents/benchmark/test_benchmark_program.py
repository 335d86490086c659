"""``train.py benchmark`` from its words to its files, and the words that it does not know."""

import re

import pytest

import train
from agents.benchmark.program import campaign_of
from agents.benchmark.rows import COLUMNS
from agents.experiment.benchmark_command import Benchmark
from agents.experiment.command_line import parse

WORDS = ["benchmark", "--quick", "--tasks", "avoid", "--actions", "velocity", "--conditions", "none"]
SOME = ["--methods", "ppo", "sampled", "ppo+sampled"]


def test_the_quick_table_is_flown_told_and_told_again_from_its_file(tmp_path, capsys):
    words = [*WORDS, *SOME, "-f", str(tmp_path), "--n-jobs", "1", "--n-timesteps", "64"]
    assert train.main(words) == 0
    said = capsys.readouterr().out
    assert "avoid_velocity_none: 2 of 2 agents are missing" in said and "ppo+sampled" in said
    table = (tmp_path / "benchmark.csv").read_text()
    assert table.splitlines()[0] == ",".join(COLUMNS) and len(table.splitlines()) == 4
    assert (tmp_path / "benchmark_velocity.png").stat().st_size > 10_000
    told = (tmp_path / "benchmark.md").read_text()
    assert told in said

    again = tmp_path / "again"
    assert train.main(["benchmark", "--csv", str(tmp_path / "benchmark.csv"), "-f", str(again)]) == 0
    assert (again / "benchmark.md").read_text() == told and not (again / "benchmark.csv").exists()


def test_what_is_quick_lies_in_a_folder_of_its_own():
    assert campaign_of(Benchmark()).folder.as_posix() == "logs/benchmark"
    assert campaign_of(Benchmark(quick=True)).folder.as_posix() == "logs/benchmark_quick"


def test_all_of_it_is_sixteen_cells_and_ten_seeds_in_every_one():
    command = parse(["benchmark"])
    assert isinstance(command, Benchmark)
    campaign = campaign_of(command)
    assert len(campaign.cells) == 16 and len(campaign.runs()) == 32
    assert {experiment.n_seeds for *_, experiment in campaign.runs()} == {10}
    assert campaign.runs()[0][3].n_timesteps == 400_000


@pytest.mark.parametrize(
    "words, message",
    [
        (
            ["--methods", "sampeld"],
            "each of methods must be one of 'ppo', .* got 'sampeld'; did you mean 'sampled'",
        ),
        (
            ["--filters", "nowhere.at_all:Filter"],
            "filter must name something in a module, got 'nowhere.at_all:Filter'",
        ),
        (["--n-seeds", "0"], "n_seeds must be an integer >= 1, got 0"),
        (["--csv", "missing.csv"], "missing.csv"),
    ],
)
def test_what_does_not_fit_is_one_sentence(words, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        train.main([*WORDS, *words, "-f", str(tmp_path), "--n-jobs", "1"])
    said = capsys.readouterr()
    assert ended.value.code == 2 and "Traceback" not in said.err
    assert re.search(message, said.err), said.err
