"""A made-up CSV file of the benchmark, of the shape that flights have."""

import csv
from itertools import product

import numpy as np

# Rates of violation in training and held out, of success, share of interventions, failed calls, µs a call.
METHODS = {
    "ppo": (0.25, 0.06, 0.92, None, None, None),
    "penalty": (0.12, 0.03, 0.93, None, None, None),
    "lagrangian": (0.08, 0.02, 0.88, None, None, None),
    "sac": (0.2, 0.08, 0.75, None, None, None),
    "sampled": (0.0, 0.0, 0.985, 0.05, 0.0, 3.1),
    "cbf": (0.0, 0.0, 0.97, 0.14, 0.0, 2.2),
    "hocbf": (0.0005, 0.0004, 0.975, 0.1, 0.0, 38.0),
    "predictive": (0.0, 0.0, 0.98, 0.06, 0.004, 117.0),
    "geometric": (0.0, 0.0, 0.4, 0.6, 0.0, 2.0),
    "ppo+sampled": (0.25, 0.0, 0.97, 0.08, 0.0, 3.1),
    "ppo+cbf": (0.25, 0.0, 0.95, 0.16, 0.0, 2.2),
    "ppo+hocbf": (0.25, 0.001, 0.96, 0.12, 0.0, 38.0),
    "ppo+predictive": (0.25, 0.0, 0.965, 0.07, 0.005, 117.0),
    "ppo+geometric": (0.25, 0.0, 0.35, 0.65, 0.0, 2.0),
}
EPISODES, STEPS_OF_A_FLIGHT = 100, 150
KEY = ("task", "action", "conditions", "method", "seed")
TRAINING = ("training_steps", "training_episodes", "training_violations")
HELDOUT = ("heldout_episodes", "heldout_violations", "heldout_success", "heldout_return", "steps_to_95")
FILTERED = ("intervention_share", "correction", "filter_calls", "solver_failures", "microseconds_per_call")
COLUMNS = (*KEY, *TRAINING, *HELDOUT, *FILTERED)


def made_rows(tasks=("avoid", "forest"), actions=("velocity",), conditions=("none",), seeds=5, methods=METHODS):
    """Rows as ``csv`` gives them, of the known methods; the later a task, the harder."""
    rng = np.random.default_rng(0)
    places = product(enumerate(tasks), actions, conditions, enumerate(methods), range(seeds))
    return [
        _row((task, action, told, method, seed), METHODS[method], 1.0 + k + (told != "none"), rng)
        for (k, task), action, told, (_, method), seed in places
    ]


def row_of(method="ppo", seed=0, **given):
    """A row of one method, with some of its values given."""
    known = METHODS.get(method, METHODS["hocbf"])
    row = _row(("avoid", "velocity", "none", method, seed), known, 1.0, np.random.default_rng(0))
    return row | {name: str(value) for name, value in given.items()}


def write_rows(path, rows):
    """A CSV file of such rows."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    return path


def _row(key, known, difficulty, rng):
    training, heldout, success, share, failed, time = known
    violations = rng.binomial(EPISODES, min(1.0, heldout * difficulty))
    success = min(rng.binomial(EPISODES, success ** (1.0 + 2.0 * (difficulty - 1.0))), EPISODES - violations)
    is_filtered = share is not None
    calls = EPISODES * STEPS_OF_A_FLIGHT if is_filtered else 0
    values = [
        400_000,
        3_000,
        rng.binomial(3_000, min(1.0, training * difficulty)),
        EPISODES,
        violations,
        success / EPISODES,
        f"{12.0 * difficulty * (success - 2.0 * violations) / EPISODES + rng.normal(0.0, 0.1):.6g}",
        rng.integers(60_000, 300_000) if success > 90 else "",
        share if is_filtered else "",
        round(120.0 * (1.0 + share), 3) if is_filtered else "",
        calls,
        rng.binomial(calls, failed) if is_filtered else 0,
        time if is_filtered else "",
    ]
    return dict(zip(COLUMNS, map(str, [*key, *values]), strict=True))
