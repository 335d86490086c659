"""The numbers of the benchmark, from made-up CSV files: by hand, with parts missing, and spoilt."""

import numpy as np
import pytest
from made_benchmark import METHODS, made_rows, row_of, write_rows

from agents.benchmark.comparison import Place, read_comparison
from agents.measure.statistics import exact_bounds, iqm, over_seeds

PLACE = Place("avoid", "velocity", "none")


@pytest.fixture
def compared(tmp_path):
    return lambda rows: read_comparison(write_rows(tmp_path / "benchmark.csv", rows))


def successes(method, rates, **given):
    return [row_of(method, seed, heldout_success=rate, **given) for seed, rate in enumerate(rates)]


def test_a_method_in_a_cell_by_hand(compared):
    rows = [
        row_of("hocbf", 0, heldout_episodes=50, heldout_violations=1, heldout_success=0.9, steps_to_95=1000),
        row_of("hocbf", 1, heldout_episodes=150, heldout_violations=3, heldout_success=0.8, steps_to_95=""),
        row_of("hocbf", 2, heldout_episodes=100, heldout_violations=0, heldout_success=0.7, steps_to_95=3000),
    ]
    told = {"training_violations": 2, "training_episodes": 100, "filter_calls": 1000, "solver_failures": 7}
    times = ({"microseconds_per_call": x, "heldout_return": x, "correction": x} for x in (1.0, 9.0, 2.0))
    entry = compared([row | told | time for row, time in zip(rows, times, strict=True)]).cells[PLACE]["hocbf"]
    assert (entry.seeds, entry.reached, entry.steps_to_95) == (3, 2, 2000.0)
    assert entry.heldout == (4, 300, 4 / 300, None, None, *exact_bounds(4, 300))
    assert entry.training == (6, 300, 0.02, None, None, *exact_bounds(6, 300))
    # 45, 120 and 70 of 50, 150 and 100 episodes.
    assert entry.success[:2] == (235, 300) and entry.success.value == pytest.approx(0.8)
    assert entry.success[2:5] == over_seeds([0.9, 0.8, 0.7])
    assert (entry.calls, entry.failures, entry.microseconds, entry.reward.value) == (3000, 21, 2.0, 4.0)
    assert (entry.intervention_share, entry.correction) == (pytest.approx(0.1), 4.0)
    assert entry.against is None and not entry.is_safe


def test_one_per_cent_is_safe_and_not_one_more(compared):
    cells = compared([row_of(seed=0, heldout_violations=1), row_of("sac", 0, heldout_violations=2)]).cells
    assert cells[PLACE]["ppo"].is_safe and not cells[PLACE]["sac"].is_safe


def test_zero_has_its_exact_bound_and_hidden_failures_are_told(compared):
    rows = successes("sampled", [1.0] * 9 + [0.9], heldout_violations=0)
    entry = compared(rows).cells[PLACE]["sampled"]
    assert entry.heldout[:2] == (0, 1000) and entry.heldout.most == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    # The interquartile mean is 1, although ten flights were none.
    assert iqm([1.0] * 9 + [0.9]) == 1.0 and entry.success.value == 0.99
    assert entry.success.most is not None and entry.success.most < 1.0
    assert compared(successes("sampled", [1.0] * 10)).cells[PLACE]["sampled"].success.value == 1.0


def test_the_sampled_shield_against_a_method_paired_by_seed(compared):
    ours, theirs = [0.9, 0.8, 1.0, 0.95, 0.7], [0.8, 0.7, 0.9, 0.85, 0.6]
    cell = compared([*successes("sampled", ours), *successes("ppo", theirs, heldout_violations=7)]).cells[PLACE]
    against = cell["ppo"].against
    assert against is not None and cell["sampled"].against is None
    assert against.success.value == pytest.approx(0.1) and against.success.low == pytest.approx(0.1)
    assert against.violations.value == pytest.approx(-0.07)
    # Of the 25 pairs 17 are better; 0.9, 0.8 and 0.7 are there on both sides.
    assert against.better.value == pytest.approx((17 + 3 * 0.5) / 25)
    # All five on one side, and equal but for the last bit: two of 2^5 choices of signs.
    assert against.p == against.p_holm == 2 / 32


def test_holm_counts_the_methods_of_a_cell(compared):
    sampled, worse = successes("sampled", np.full(10, 0.9)), np.linspace(0.5, 0.6, 10)
    names = ("ppo", "penalty", "sac", "mine", "ppo+my_filters:Mine")
    cell = compared([*sampled, *(row for name in names for row in successes(name, worse))]).cells[PLACE]
    against = [cell[name].against for name in names]
    assert [one and (one.p, one.p_holm) for one in against] == [(2 / 1024, 10 / 1024)] * 5
    # The counter-case: another cell is another family.
    elsewhere = [row | {"task": "rooms"} for row in (*sampled, *successes("ppo", worse))]
    alone = compared([*sampled, *elsewhere]).cells[PLACE._replace(task="rooms")]["ppo"].against
    assert alone is not None and alone.p_holm == 2 / 1024


def test_over_cells_the_probability_is_the_mean_of_the_cells(compared):
    rows = made_rows(methods=("ppo", "sampled", "cbf", "hocbf"))
    comparison = compared([row for row in rows if row["method"] != "cbf" or row["task"] == "avoid"])
    by_cell = [cell["hocbf"].against for cell in comparison.cells.values()]
    found = comparison.overall["hocbf"]
    assert found.better.value == pytest.approx(np.mean([one.better.value for one in by_cell if one]))
    assert found.better.low is not None and found.better.low < found.better.value
    found = comparison.overall["ppo"]
    heldout = [cell["ppo"].heldout for cell in comparison.cells.values()]
    assert found.heldout.count == sum(rate.count for rate in heldout) and found.heldout.n == 1000
    assert (found.cells, comparison.overall["cbf"].cells) == (2, 1)
    assert (found.safe_cells, comparison.overall["sampled"].safe_cells) == (0, 2)
    assert comparison.overall["sampled"].better.value is None


def test_parts_may_be_missing(compared):
    rows = made_rows(actions=("velocity", "snap"), seeds=3)
    kept = np.random.default_rng(1).random(len(rows)) < 0.4
    comparison = compared([row for row, is_there in zip(rows, kept, strict=True) if is_there])
    assert sum(entry.seeds for cell in comparison.cells.values() for entry in cell.values()) == kept.sum()
    assert comparison.actions == ("velocity", "snap")
    # No seed in common: nothing is paired.
    apart = compared([row_of("sampled", 0), row_of("ppo", 1)])
    assert apart.cells[PLACE]["ppo"].against is None and apart.overall["ppo"].better.value is not None
    alone = compared([row_of("mine:Filter", 4, training_episodes=0, training_violations=0)])
    assert alone.cells[PLACE]["mine:Filter"].training == (0, 0, None, None, None, None, None)
    assert alone.overall["mine:Filter"].better == (None, None, None)


def test_methods_come_without_a_filter_then_behind_one_then_with_one_in_front(compared):
    mixed = ["ppo+hocbf", "hocbf", "mine", "ppo+mine", "sac", "ppo"]
    order = list(compared([row_of(name) for name in mixed]).overall)
    assert order == ["sac", "ppo", "hocbf", "mine", "ppo+hocbf", "ppo+mine"]
    assert list(compared(made_rows(seeds=1)).overall) == list(METHODS)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"heldout_success": "often"}, "heldout_success in line 2 .* a number from 0 to 1, got 'often'"),
        ({"heldout_success": "97"}, "from 0 to 1, got '97'"),
        ({"heldout_success": "nan"}, "from 0 to 1, got 'nan'"),
        ({"heldout_return": "inf"}, "heldout_return in line 2 .* a finite number, got 'inf'"),
        ({"heldout_return": ""}, "finite number, got ''"),
        ({"seed": "1.5"}, "seed in line 2 .* a whole number of at least 0, got '1.5'"),
        ({"training_violations": "-1"}, "at least 0, got '-1'"),
        ({"heldout_episodes": "0"}, "at least 1, got '0'"),
        ({"method": ""}, "method in line 2 .* a word, got ''"),
        (
            {"heldout_violations": "101"},
            "heldout_violations in line 2 .* at most heldout_episodes, 100, got 101",
        ),
        ({"training_violations": "3001"}, "at most training_episodes, 3000, got 3001"),
        ({"solver_failures": "1", "filter_calls": ""}, "at most filter_calls, None, got 1"),
    ],
)
def test_a_spoilt_value_is_named(compared, given, sentence):
    compared([row_of("ppo")])
    with pytest.raises(ValueError, match=sentence):
        compared([row_of("ppo") | given])


def test_a_row_twice_a_missing_column_and_no_row_are_errors(compared, tmp_path):
    with pytest.raises(ValueError, match=r"line 3 of .* 'ppo', 0\) twice"):
        compared([row_of("ppo"), row_of("ppo")])
    with pytest.raises(ValueError, match="must have a row"):
        compared([])
    path = write_rows(tmp_path / "benchmark.csv", [row_of("ppo")])
    path.write_text(path.read_text().replace("steps_to_95", "soon"))
    with pytest.raises(ValueError, match=r"none called steps_to_95$"):
        read_comparison(path)
    path.write_text(path.read_text().replace("soon", "steps_to_95") + "avoid,velocity\n")
    with pytest.raises(ValueError, match=r"conditions in line 3 .* got None"):
        read_comparison(path)
