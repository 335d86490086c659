"""The sentences of a report, from rows whose numbers are known."""

import pytest

from agents.measure.results import MEASURES, result_rows
from agents.report.headline import against, arrived, collided, headline, is_shown, shifted
from agents.report.rates import at_least, at_most, interval, percentage


def row(arm, flown, violations, successes, episodes, phase="evaluation", seed=0, **more):
    """What one seed did, as ``agents.measure.results.seed_rows`` tells it."""
    numbers = dict.fromkeys(MEASURES, 1.0)
    counts = dict.fromkeys(("out_of_bounds", "crashes", "invalid_actions", "timeouts", "fallbacks"), 0)
    told = {
        "phase": phase,
        "arm": arm,
        "flown": flown,
        "seed": seed,
        "episodes": episodes,
        "steps": 10,
        "path": 1.0,
    }
    rates = {"violation_rate": violations / episodes, "success_rate": successes / episodes}
    extremes = {"clearance": 0.1, "largest_correction": 0.0, "steps_per_second": 1000}
    return {
        **numbers,
        **counts,
        **told,
        "violations": violations,
        "successes": successes,
        **rates,
        **extremes,
        **more,
    }


def told(*rows):
    return dict(headline(result_rows(list(rows))))


BARE, SHIELDED = row("none", "off", 40, 50, 100), row("shield", "on", 0, 100, 100, intervention_rate=0.214)


def test_training_is_told_with_counts_and_the_exact_bound_of_zero():
    rows = row("none", "off", 3000, 5, 5000, "training"), row("shield", "on", 0, 5, 2593, "training")
    words = told(*rows)["In training"]
    assert words.startswith("Without a shield, 3,000 of 5,000 episodes collided (60.0 %, 58.6 to 61.4); ")
    # 1 − 0.05^(1/2593) = 0.1155 %.
    assert "with the shield, 0 of 2,593 (at most 0.12 %): 60.0 points fewer." in words


@pytest.mark.parametrize(
    "arm, flown, start", [("none", "off", "Without a shield, 7 of 50"), ("shield", "on", "With")]
)
def test_one_arm_alone_is_compared_with_nothing(arm, flown, start):
    words = told(row(arm, flown, 7, 5, 50, "training"), row(arm, "off", 7, 5, 50), row(arm, "on", 0, 5, 50))
    assert words["In training"].startswith(start)
    if arm == "shield":
        assert not any(word in " ".join(words.values()) for word in ("against", "points", "no difference"))
    else:
        assert "What the shield costs" not in words and "What the shield buys" not in words


def test_without_flights_only_training_is_told():
    assert set(told(row("none", "off", 1, 2, 50, "training"))) == {"In training", "How sure"}


def test_an_empty_run_says_so():
    assert headline([]) == [("Nothing yet", "No training is finished.")]


def test_what_the_shield_buys_and_costs():
    words = told(BARE, SHIELDED)
    assert "in 0 of 100 held-out flights (at most 3.0 %)" in words["What the shield buys"]
    assert "40 of 100 (40.0 %, 30.3 to 50.3): 40.0 points fewer." in words["What the shield buys"]
    assert "in 100 of 100 (at least 97.0 %)" in words["What the shield buys"]
    assert words["What the shield costs"].startswith("The shield acts in 21.4 % of the steps")
    assert "one seed, so no interval" in words["What the shield costs"]


def test_the_shield_at_deployment_only_is_the_arm_without_one_flown_with_it():
    words = told(BARE, row("none", "on", 0, 90, 100))["Shield at deployment only"]
    assert "collided in 0 of 100 held-out flights (at most 3.0 %), flown without in 40 of 100" in words


def test_a_shield_taken_away_and_other_agents_are_told():
    words = told(
        BARE,
        row("shield", "off", 42, 50, 100),
        row("tracker", "off", 20, 0, 20),
        row("tracker", "on", 0, 9, 20),
    )
    assert words["Taken away after training"].endswith(
        "against the one that never had a shield: no difference shown."
    )
    assert "the tracker, 20 of 20 (at least 86.0 %) and 0 of 20 (at most 14.0 %)" in " ".join(words.values())


def test_no_difference_is_claimed_where_the_bounds_overlap():
    few = row("none", "off", 3, 5, 12), row("shield", "on", 0, 5, 12)
    reference, shielded = result_rows(list(few))
    assert not is_shown(shielded, reference, "violation_rate")
    assert against(shielded, reference, "violation_rate") == "no difference shown"


def test_no_difference_is_claimed_where_seeds_disagree():
    # Pooled, 60 of 300 and 120 of 300 are far apart; but in one seed it is the other way round.
    off = [row("none", "off", n, 0, 100, seed=s) for s, n in enumerate((20, 20, 20))]
    on = [row("shield", "on", n, 0, 100, seed=s) for s, n in enumerate((100, 19, 1))]
    reference, shielded = result_rows(off + on)
    assert shielded["violation_rate_least"] > reference["violation_rate_most"]
    assert against(shielded, reference, "violation_rate") == "no difference shown"


def test_a_difference_that_all_seeds_show_has_its_interval():
    off = [row("none", "off", n, 0, 100, seed=s) for s, n in enumerate((40, 50, 60))]
    on = [row("shield", "on", 0, 0, 100, seed=s, **{"return": 3.0 + s}) for s in range(3)]
    reference, shielded = result_rows(off + on)
    assert against(shielded, reference, "violation_rate") == "50.0 points fewer, 40.0 to 60.0"
    assert shifted(shielded, "return", 2) == "3.00 more, 2.00 to 4.00"
    assert "3 seeds" in dict(headline([reference, shielded]))["How sure"]


def test_counts_with_their_bounds():
    (some,) = result_rows([row("none", "off", 3, 17, 20)])
    assert collided(some, " flights") == "3 of 20 flights (15.0 %, 3.2 to 37.9)"
    assert arrived(some) == "17 of 20 (85.0 %, 62.1 to 96.8)"


def test_seeds_that_agree_get_exact_bounds_and_not_an_interval_of_width_zero():
    (agreed,) = result_rows([row("none", "off", 1, 1, 50, seed=s) for s in range(3)])
    assert interval(agreed, "violation_rate") == (agreed["violation_rate_least"], agreed["violation_rate_most"])
    assert agreed["violation_rate_least"] < 0.02 < agreed["violation_rate_most"]


def test_a_trimmed_mean_of_zero_is_not_told_as_no_violation():
    seeds = [row("none", "off", n, 1, 50, seed=s) for s, n in enumerate((0, 0, 0, 0, 2))]
    (trimmed,) = result_rows(seeds)
    assert trimmed["violation_rate"] == 0.0 and trimmed["violations"] == 2
    assert "<=" not in percentage(trimmed, "violation_rate") and "at most" not in collided(trimmed)


def test_bounds_are_rounded_away_from_what_was_seen():
    assert (at_most(0.001141), at_most(0.0199), at_most(0.02)) == ("0.12", "2.0", "2.0")
    assert (at_least(0.99886), at_least(0.9809)) == ("99.88", "98.0")


def test_a_given_policy_is_told_by_its_own_two_ways():
    bare, shielded = row("policy", "off", 40, 50, 100), row("policy", "on", 0, 97, 100, intervention_rate=0.1)
    words = told(bare, shielded)
    assert set(words) == {"The given policy", "How sure"}
    assert words["The given policy"].startswith(
        "Flown with the shield, it collided in 0 of 100 held-out flights (at most 3.0 %), flown without in "
        "40 of 100 (40.0 %, 30.3 to 50.3): 40.0 points fewer. "
    )
    assert words["The given policy"].endswith("The shield acts in 10.0 % of its steps.")
    assert words["How sure"].startswith("One policy.")
