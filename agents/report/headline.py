"""What a run found, in sentences made of its numbers, and saying no more than they do.

A zero comes with its exact bound. Two rates differ only if their exact bounds are apart and the interval of
their paired difference, where there is one, leaves out zero.
"""

from agents.experiment.arms import GIVEN
from agents.learn.episodes import TRACKING
from agents.measure.results import Row
from agents.report.rates import IN_WORDS, in_words, metres

Rows = dict[tuple[str, str, str], Row]
WAYS = {
    "none": "without a shield",
    "lagrangian": "by PPO-Lagrangian and without a shield",
    "shield": "with the shield",
    "collision-penalty": "with a collision penalty and no shield",
    "shield-penalty": "with the shield and a penalty on its interventions",
    "cbf": "with the shield of method cbf",
    "slow-shield": "with the shield as set for snap commands",
}
FLIERS = {"tracker": "the tracker", "random": "random actions"}
FEW_SEEDS = 5


def headline(rows: list[Row]) -> list[tuple[str, str]]:
    """Titles and their sentences, from the rows of ``agents.measure.results.result_rows``; those that apply."""
    found = {(row["phase"], row["arm"], row["flown"]): row for row in rows if row["episodes"]}
    parts = [
        ("In training", _training(found)),
        ("The given policy", _given(found)),
        ("What the shield buys", _bought(found)),
        ("Shield at deployment only", _deployed(found)),
        ("What the shield costs", _costs(found)),
        ("Taken away after training", _taken_away(found)),
        ("Other agents on the same scenes", _others(found)),
        ("How sure", _caution(rows)),
    ]
    return [(title, text) for title, text in parts if text] or [("Nothing yet", "No training is finished.")]


def collided(row: Row, of: str = "") -> str:
    """A count, its total and its rate: "3 of 20 flights (15.0 %, 3.2 to 37.9)", "0 of 20 (at most 14.0 %)"."""
    return f"{row['violations']:,} of {row['episodes']:,}{of} ({in_words(row, 'violation_rate')})"


def arrived(row: Row, of: str = "") -> str:
    """As ``collided``, of the episodes that were a success."""
    return f"{row['successes']:,} of {row['episodes']:,}{of} ({in_words(row, 'success_rate')})"


def succeeded(row: Row) -> str:
    """What a success is: at the goal, or with a reference to the time limit."""
    return "kept to its reference" if TRACKING in row else "reached the goal"


def is_shown(row: Row, other: Row, rate: str) -> bool:
    """Whether two rates differ by more than chance explains."""
    low, high = row[f"{rate}_difference_low"], row[f"{rate}_difference_high"]
    is_more = row[f"{rate}_least"] > other[f"{rate}_most"] and (low is None or low > 0.0)
    is_less = row[f"{rate}_most"] < other[f"{rate}_least"] and (high is None or high < 0.0)
    return is_more or is_less


def against(row: Row, reference: Row, rate: str) -> str:
    """How a rate differs from that of the reference: "12.0 points fewer", "no difference shown"."""
    if not is_shown(row, reference, rate):
        return "no difference shown"
    change = row[f"{rate}_difference"]
    if change is None:
        change = row[rate] - reference[rate]
    return f"{100.0 * abs(change):.1f} points {'more' if change > 0.0 else 'fewer'}{_paired(row, rate, 100.0)}"


def shifted(row: Row, measure: str, places: int) -> str:
    """How a mean differs from that of the reference, in words, where there are several seeds to tell from."""
    low, high, change = (row[f"{measure}_difference{end}"] for end in ("_low", "_high", ""))
    if low is None:
        return "one seed, so no interval"
    if low <= 0.0 <= high:
        return "no difference shown"
    return f"{abs(change):.{places}f} {'more' if change > 0.0 else 'less'}{_paired(row, measure, 1.0, places)}"


def _paired(row: Row, measure: str, scale: float, places: int = 1) -> str:
    low, high = row[f"{measure}_difference_low"], row[f"{measure}_difference_high"]
    if low is None or low == high:
        return ""
    ends = sorted((scale * abs(low), scale * abs(high)))
    return f", {ends[0]:.{places}f} to {ends[1]:.{places}f}"


def _training(found: Rows) -> str:
    trained = {arm: row for (phase, arm, _), row in found.items() if phase == "training"}
    pair = [arm for arm in ("none", "shield") if arm in trained]
    rest = [arm for arm in trained if arm not in pair]
    sentences = [f"{_listed(pair, trained)}{_verdict(trained)}.", f"{_listed(rest, trained)}."]
    return " ".join(text for arms, text in zip((pair, rest), sentences, strict=True) if arms)


def _listed(arms: list[str], rows: dict[str, Row]) -> str:
    """What each arm did in training, one after the other."""
    of = [" episodes collided", *[""] * len(arms)]
    words = "; ".join(f"{WAYS.get(arm, arm)}, {collided(rows[arm], of[i])}" for i, arm in enumerate(arms))
    return words[:1].upper() + words[1:]


def _verdict(trained: dict[str, Row]) -> str:
    if "none" not in trained or "shield" not in trained:
        return ""
    return f": {against(trained['shield'], trained['none'], 'violation_rate')}"


def _bought(found: Rows) -> str:
    row, bare = found.get(("evaluation", "shield", "on")), found.get(("evaluation", "none", "off"))
    if row is None:
        return ""
    return _pair("The policy trained and flown with the shield", row, "the one trained and flown without", bare)


def _given(found: Rows) -> str:
    row, bare = (found.get(("evaluation", GIVEN, flown)) for flown in ("on", "off"))
    if row is None:
        return ""
    acts = f"The shield acts in {_share(row)} of its steps."
    return f"{_pair('Flown with the shield, it', row, 'flown without', bare)} {acts}"


def _deployed(found: Rows) -> str:
    late, bare = found.get(("evaluation", "none", "on")), found.get(("evaluation", "none", "off"))
    if late is None:
        return ""
    return _pair("The policy trained without a shield, but flown with it,", late, "flown without", bare)


def _pair(who: str, row: Row, other: str, reference: Row | None) -> str:
    """How often an agent collided and arrived, and the reference, and how they differ."""
    first = f"{who} collided in {collided(row, ' held-out flights')}"
    if reference is None:
        return f"{first} and {succeeded(row)} in {arrived(row)}.{_tracked(row, '')}"
    return (
        f"{first}, {other} in {collided(reference)}: {against(row, reference, 'violation_rate')}. "
        f"It {succeeded(row)} in {arrived(row)}, {other} in {arrived(reference)}: "
        f"{against(row, reference, 'success_rate')}."
        f"{_tracked(row, f'; {other}, {metres(reference, IN_WORDS)}')}"
    )


def _tracked(row: Row, other: str) -> str:
    """How far an agent was from what it followed, and the other; nothing where nothing is followed."""
    if TRACKING not in row:
        return ""
    return f" Its rms error, until a flight ended, was {metres(row, IN_WORDS)}{other}."


def _costs(found: Rows) -> str:
    return " ".join([*_costs_in_flight(found), *_costs_in_training(found)])


def _costs_in_flight(found: Rows) -> list[str]:
    row, bare = found.get(("evaluation", "shield", "on")), found.get(("evaluation", "none", "off"))
    if row is None:
        return []
    late = found.get(("evaluation", "none", "on"))
    other = "" if late is None else f", in {_share(late)} of one trained without"
    acts = f"The shield acts in {_share(row)} of the steps of a policy trained with it{other}."
    if bare is None:
        return [acts]
    return [
        acts,
        f"Return {row['return']:.2f} against {bare['return']:.2f} without: {shifted(row, 'return', 2)}.",
        f"Steps a flight {row['length']:.0f} against {bare['length']:.0f}: {shifted(row, 'length', 0)}; "
        "a flight ends where it collides.",
    ]


def _costs_in_training(found: Rows) -> list[str]:
    row, bare = found.get(("training", "shield", "on")), found.get(("training", "none", "off"))
    if row is None or bare is None:
        return []
    return [
        f"In training, {arrived(row, ' episodes')} {succeeded(row)} with the shield, {arrived(bare)} without: "
        f"{against(row, bare, 'success_rate')}.",
        f"Training ran at {row['steps_per_second']:,} steps a second with the shield, at "
        f"{bare['steps_per_second']:,} without.",
    ]


def _share(row: Row) -> str:
    return f"{100.0 * row['intervention_rate']:.1f} %"


def _taken_away(found: Rows) -> str:
    row, bare = found.get(("evaluation", "shield", "off")), found.get(("evaluation", "none", "off"))
    if row is None:
        return ""
    who = "The policy trained with the shield, but flown without it,"
    text = f"{who} collided in {collided(row, ' held-out flights')}"
    if bare is None:
        return f"{text}."
    return f"{text}; against the one that never had a shield: {against(row, bare, 'violation_rate')}."


def _others(found: Rows) -> str:
    known = ("none", "shield", GIVEN)
    arms = dict.fromkeys(arm for phase, arm, _ in found if phase == "evaluation" and arm not in known)
    words = [f"{FLIERS.get(arm) or f'trained {WAYS.get(arm, arm)}'}, {_both_ways(found, arm)}" for arm in arms]
    return "Collisions without and with the shield: " + "; ".join(words) + "." if words else ""


def _both_ways(found: Rows, arm: str) -> str:
    rows = [found.get(("evaluation", arm, flown)) for flown in ("off", "on")]
    return " and ".join(collided(row) for row in rows if row is not None)


def _caution(rows: list[Row]) -> str:
    seeds = max((row["seeds"] for row in rows if row["episodes"]), default=FEW_SEEDS)
    if seeds >= FEW_SEEDS:
        return ""
    if seeds == 1 and any(row["arm"] == GIVEN for row in rows):
        return "One policy. Intervals are exact for its flights, and say nothing about others trained alike."
    if seeds == 1:
        return "One seed. Intervals are exact for its episodes, and say nothing about other seeds."
    return (
        f"{seeds} seeds. Intervals over so few reach about from the lowest seed to the highest, and may be too "
        "narrow."
    )
