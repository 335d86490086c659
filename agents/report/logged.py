"""What the algorithm logs while it learns, reward and losses, from progress.csv of each training."""

import csv
import math

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from agents.experiment.runs import Run
from agents.measure.results import trained_seeds
from agents.page.html_page import CaptionedFigure
from agents.page.style import QUIET, styled
from agents.report.curves import POINTS, Curve, over_seeds
from agents.report.figures import add_curve

STEP, COLUMNS = "time/total_timesteps", 2
COUNTS = ("train/n_updates",)
# Panels that come first, and what the names of Stable-Baselines3 mean.
MEANINGS = {
    "rollout/ep_rew_mean": "return of the last 100 episodes, as it is learned from, penalties included",
    "rollout/ep_len_mean": "policy steps of these episodes",
    "train/value_loss": "squared error of the value function",
    "train/policy_gradient_loss": "objective of PPO with its sign turned",
    "train/entropy_loss": "negative entropy of the actions",
    "train/approx_kl": "how far an update moved the policy",
    "train/actor_loss": "negative value of the policy's actions",
    "train/critic_loss": "squared error of the critics",
    "train/ent_coef": "weight of the entropy",
    "train/loss": "all that is minimised together, of the last batch",
    "train/explained_variance": "share of the variance of returns that the value function explains",
    "train/clip_fraction": "share of samples at the limit of an update",
    "train/std": "standard deviation of the explored actions",
}
Log = dict[str, NDArray[np.float64]]


def progress(run: Run, arm: str, seed: int) -> Log:
    """The columns of progress.csv, NaN where nothing was logged; none where there is no such file."""
    path = run.folder_of(arm, seed) / "progress.csv"
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in (rows[0] if rows else ())}


def logged_curves(run: Run) -> dict[str, dict[str, Curve]]:
    """For each logged quantity that changes, the curve of each arm; of stopped trainings if none ended."""
    logs = {arm: found for arm in run.experiment.arms if (found := _logs(run, arm))}
    every = [log for of_arm in logs.values() for log in of_arm]
    names = dict.fromkeys([*MEANINGS, *sorted(name for log in every for name in log)])
    shown = [name for name in names if _is_shown(name, every)]
    steps = max((log[STEP].max() for log in every), default=0.0)
    times = np.linspace(0.0, steps, POINTS + 1)
    return {
        name: {
            arm: over_seeds(times, np.array([_at(times, log, name) for log in of_arm]))
            for arm, of_arm in logs.items()
            if all(name in log for log in of_arm)
        }
        for name in shown
    }


def logged_figure(run: Run) -> list[CaptionedFigure]:
    """Reward and losses over the steps of training; nothing of a run that has no progress.csv."""
    panels = logged_curves(run)
    if not panels:
        return []
    words = [f"{_short(name)}: {MEANINGS[name]}" for name in panels if name in MEANINGS]
    caption = f"As Stable-Baselines3 logs them, over seeds as above. {'; '.join(words)}."
    return [CaptionedFigure("logged", "Reward and losses while learning", caption, small_panels(panels))]


def small_panels(panels: dict[str, dict[str, Curve]]) -> go.Figure:
    """A panel for each quantity, with a curve and its band for each arm."""
    rows = math.ceil(len(panels) / COLUMNS)
    titles = [_short(name) for name in panels]
    figure = make_subplots(
        rows, COLUMNS, subplot_titles=titles, vertical_spacing=0.28 / rows, horizontal_spacing=0.1
    )
    styled(figure, 110 + 190 * rows, margin_t=80)
    named: set[str] = set()
    for i, curves in enumerate(panels.values()):
        row, col = i // COLUMNS + 1, i % COLUMNS + 1
        for arm, curve in curves.items():
            add_curve(figure, arm, curve, is_in_legend=arm not in named, row=row, col=col)
            named.add(arm)
        if i >= len(panels) - COLUMNS:
            figure.update_xaxes(title_text="policy steps", row=row, col=col)
    figure.update_layout(legend={"y": 1.0, "yref": "container", "yanchor": "top"})
    return figure.update_annotations(font={"size": 14, "color": QUIET})


def _logs(run: Run, arm: str) -> list[Log]:
    begun = {seed: progress(run, arm, seed) for a, seed in run.experiment.jobs() if a == arm}
    ended = [seed for seed in trained_seeds(run, arm) if begun[seed]] or [seed for seed in begun if begun[seed]]
    return [begun[seed] for seed in ended]


def _is_shown(name: str, logs: list[Log]) -> bool:
    """Whether a quantity of reward or learning changes in some training."""
    if name in COUNTS or not (name.startswith("train/") or name in MEANINGS):
        return False
    values = [log[name][np.isfinite(log[name])] for log in logs if name in log]
    return any(np.ptp(of_log) > 0.0 for of_log in values if of_log.size)


def _at(times: NDArray[np.float64], log: Log, name: str) -> NDArray[np.float64]:
    known = np.isfinite(log[name])
    if not known.any():
        return np.full(len(times), np.nan)
    return np.interp(times, log[STEP][known], log[name][known], left=np.nan, right=np.nan)


def _short(name: str) -> str:
    return name.partition("/")[2].replace("_", " ")
