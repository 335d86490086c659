"""The figures of a run, each with its title and its words."""

from agents.experiment.arms import arm_of
from agents.experiment.runs import Run
from agents.measure import results
from agents.measure.results import Row
from agents.measure.trace import Trace, read_trace
from agents.page.html_page import CaptionedFigure
from agents.report import curves, figures, flight_figures
from agents.report.curves import Curve
from agents.report.logged import logged_figure
from agents.report.rates import in_words


def run_figures(run: Run, rows: list[Row]) -> list[CaptionedFigure]:
    """The figures that the files of a run have data for.

    Args:
        run: the run.
        rows: from ``agents.measure.results.result_rows``.
    """
    trace = read_trace(run)
    found = [*_training(run, rows), *logged_figure(run), *_flights(run, rows)]
    return found if trace is None else [*found, *_scene(trace)]


def training_curves(run: Run, arms: list[str]) -> tuple[int, dict[str, Curve], dict[str, Curve]]:
    """How arms with finished episodes learned: a window in steps, success within it, collisions so far."""
    seeds = {
        arm: [results.training_episodes(run, arm, seed) for seed in results.trained_seeds(run, arm)]
        for arm in arms
    }
    steps = max(int(episodes["timestep"].max()) for arm in seeds for episodes in seeds[arm] if len(episodes))
    rows_at_once = run.experiment.hyperparams.get("n_envs", 1)
    longest = max(int(episodes["length"].max()) for arm in seeds for episodes in seeds[arm] if len(episodes))
    window = max(longest * rows_at_once, steps // curves.POINTS)
    success = {arm: curves.success_curve(of_arm, steps, window) for arm, of_arm in seeds.items()}
    collisions = {arm: curves.violation_curve(of_arm, steps) for arm, of_arm in seeds.items()}
    return window, success, collisions


def _training(run: Run, rows: list[Row]) -> list[CaptionedFigure]:
    trained = {row["arm"]: row for row in rows if row["phase"] == "training" and row["episodes"]}
    if not trained:
        return []
    window, success, collisions = training_curves(run, list(trained))
    episodes = {arm: row["episodes"] for arm, row in trained.items()}
    n = max(row["seeds"] for row in trained.values())
    return [
        CaptionedFigure(
            "learning",
            "Learning",
            f"Success of the episodes that ended in the last {window:,} steps. {_band(n)}",
            figures.learning_curves(success),
        ),
        CaptionedFigure(
            "violations",
            "Collisions while learning",
            f"Episodes with a collision since the start of the training. {_band(n)} {_clean(trained)}".strip(),
            figures.violations(collisions, episodes),
        ),
    ]


def _flights(run: Run, rows: list[Row]) -> list[CaptionedFigure]:
    flown = [row for row in rows if row["phase"] == "evaluation" and row["episodes"]]
    if not flown:
        return []
    arms = dict.fromkeys(row["arm"] for row in flown)
    return [
        CaptionedFigure(
            "forest",
            "What the shield costs and buys",
            "Every agent on the same held-out scenes. Rates: interquartile mean over seeds with its 95 % "
            "interval; of a single seed, and where all seeds agree, the exact bounds. Differences (Δ) are to "
            "the agent trained and flown without a shield, paired by seed; of a single seed without interval.",
            figures.forest(flown),
        ),
        CaptionedFigure(
            "clearance",
            "Least clearance",
            "Share of the held-out flights, of all seeds, that come nearer to what is kept free than each "
            "distance. Left of the line is inside; the height at which a curve crosses it is the rate of "
            "collisions.",
            figures.clearances({arm: results.clearances(run, arm) for arm in arms}),
        ),
    ]


def _scene(trace: Trace) -> list[CaptionedFigure]:
    scene = trace.scene
    who = f"{arm_of(scene['arm']).title}, seed {scene['seed']}, scene {scene['scene']}"
    return [
        CaptionedFigure(
            "flights",
            "One scene, without and with the shield",
            f"The same agent ({who}), the same start. Drag to turn, scroll to come nearer, click in the legend "
            "to hide a flight, play or move the slider to see where both are at a time.",
            flight_figures.flights(trace),
            flight_figures.duration(trace),
        ),
        CaptionedFigure(
            "timeline",
            "What the shield does to the command",
            "The snap that the policy asks for and the snap that is flown with the shield, in the last control "
            "period of each policy step; below, the clearance of both flights. Shaded: policy steps in which "
            "the shield acts.",
            flight_figures.timeline(trace),
        ),
    ]


def _band(seeds: int) -> str:
    if seeds == 1:
        return "One seed, so no band."
    return f"Line: interquartile mean of {seeds} seeds; band: 95 % bootstrap over seeds."


def _clean(trained: dict[str, Row]) -> str:
    """The arms without a collision, in words, with the exact bound over their episodes."""
    clean = [row for row in trained.values() if not row["violations"]]
    if not clean:
        return ""
    bounds = [
        f"{row['title']}, 0 of {row['episodes']:,} episodes ({in_words(row, 'violation_rate')})"
        for row in clean
    ]
    return f"On the line at zero: {'; '.join(bounds)}."
