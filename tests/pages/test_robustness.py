"""The measurements behind docs/robustness.md: a short run of every part, and the page against its data."""

import pytest
from house import script

SAMPLE = (
    *("chain all told 50 1", "chain all untold 50 1", "cost wind told 50 0", "body all told 50 1"),
    *("body all none 50 1", "beyond noise told 100 12", "beyond delay told exactly 100 2"),
    *("beyond delay told 100 4", "beyond rotor lag untold 100 4", "inner inner authority 100 0"),
)


@pytest.fixture(scope="module")
def bench():
    with script("benchmarks", "robustness") as module:
        yield module


@pytest.fixture(scope="module")
def found(bench):
    """Rows of a short run, by key."""
    jobs = {job.key: job for job in (*bench.chain_jobs(bench.SHORT), *bench.body_jobs(bench.SHORT))}
    return {key: jobs[key].measure() for key in SAMPLE}


@pytest.mark.slow
def test_what_is_told_holds_within_the_bounds_and_not_beyond(found):
    for key in ("chain all told 50 1", "body all told 50 1"):
        assert (found[key]["violated_episodes"], found[key]["uncertified"]) == (0, 0)
    assert found["beyond delay told exactly 100 2"]["violated_episodes"] == 0
    for key in ("chain all untold 50 1", "body all none 50 1", "beyond delay told 100 4"):
        assert found[key]["violated_episodes"] > 0
    assert found["beyond rotor lag untold 100 4"]["violated_episodes"] > 0


@pytest.mark.slow
def test_the_inner_loop_keeps_its_bound(found):
    from quadsafe_env.tasks.conditions import INNER_LOOP

    assert 0.0 < found["inner inner authority 100 0"]["least_clearance"] < INNER_LOOP


def test_every_kind_was_attacked_for_a_million_steps_and_nothing_was_found(bench):
    rows = bench.rows_of(bench.CSV)
    told = [row for row in rows if row["part"] in ("chain", "body") and row["arm"] == "told"]
    assert {(row["part"], row["kind"], row["rate"]) for row in told} == {
        *(("chain", kind, rate) for kind in bench.KINDS for rate in ("50", "200")),
        *(("body", kind, rate) for kind in (*bench.BODY, "all") for rate in ("50", "200")),
    }
    for row in told:
        assert int(row["steps"]) >= 1_000_000
        assert (int(row["violated_episodes"]), int(row["uncertified"])) == (0, 0), row["key"]


def test_the_page_has_the_tables_of_the_data(bench, tmp_path):
    from uncertain import report

    page = tmp_path / "robustness.md"
    text = bench.PAGE.read_text(encoding="utf-8")
    page.write_text(text, encoding="utf-8")
    report.write(bench.rows_of(bench.CSV), page, tmp_path / "robustness.png", bench.KINDS)
    assert page.read_text(encoding="utf-8") == text


# Behind rotors that lag


@pytest.fixture(scope="module")
def lagged():
    with script("benchmarks", "lagged_body") as module:
        yield module


def test_behind_rotors_that_lag_who_is_told_violates_nothing_and_who_is_not_does(lagged):
    rows = lagged.rows_of(lagged.CSV)
    told = [row for row in rows if row["arm"] == "both"]
    assert {(row["bodies"], row["rotors"], row["level"]) for row in told if row["action"] == "velocity"} >= {
        (bodies, rotors, f"{lag:g}")
        for bodies in lagged.ENVS
        for rotors in ("wrench", "uneven")
        for lag in lagged.LAGS
    }
    for row in told:
        assert int(row["steps"]) >= 1_000_000 and int(row["episodes"]) >= 2_000
        assert int(row["violated_episodes"]) == 0, row["key"]
        assert int(row["uncertified_episodes"]) <= 0.001 * int(row["episodes"]), row["key"]
    for arm in ("nothing", "declared"):
        assert max(int(row["violated_episodes"]) for row in rows if row["arm"] == arm) > 0


def test_the_page_has_the_tables_of_the_lagged_body(lagged, tmp_path):
    from uncertain import lag_report

    page = tmp_path / "robustness.md"
    text = lagged.PAGE.read_text(encoding="utf-8")
    page.write_text(text, encoding="utf-8")
    lag_report.write(lagged.rows_of(lagged.CSV), page, tmp_path / "lag.png")
    assert page.read_text(encoding="utf-8") == text


@pytest.mark.slow
def test_a_short_run_behind_uneven_rotors_counts_what_happens(lagged):
    told, untold = (
        lagged.measured(lagged.Cell("velocity", "spheres", "uneven", arm, 100, 72.0), 24, 250)
        for arm in ("both", "nothing")
    )
    assert (told["violated_episodes"], told["uncertified"], told["saturated_episodes"]) == (0, 0, 0)
    assert told["episodes"] >= 24 and told["steps"] == 24 * 1000 and told["least_clearance"] > 0.0
    assert untold["violated_episodes"] > 0 and untold["episodes"] > told["episodes"]
