"""What a run has not done yet, and what its folder lacks."""

from agents.experiment.arms import arm_of
from agents.experiment.runs import Run
from agents.measure.results import COUNTED_FROM
from agents.train.progress_bar import last_row

EVERY_RUN = ("provenance.yml",)
EVERY_TRAINING = (*COUNTED_FROM, "progress.csv")
TRACE = ("trace.csv", "trace.json")


def condition(run: Run) -> list[tuple[str, str]]:
    """Titles and sentences on trainings that stopped and files that are missing; none of a whole run."""
    open_jobs, missing = "; ".join(stopped(run)), ", ".join(missing_files(run))
    parts = [
        ("Stopped early", f"{open_jobs}. python train.py -i with the folder of the run goes on.", open_jobs),
        ("Missing", f"There is no {missing} in the folder, so what is told by it is left out.", missing),
    ]
    return [(title, text) for title, text, is_said in parts if is_said]


def stopped(run: Run) -> list[str]:
    """Each unfinished training, and where it is: "no shield, seed 1, stopped at step 8,192 of 60,000"."""
    jobs = [job for job in run.experiment.jobs() if arm_of(job[0]).is_trained and not run.is_trained(*job)]
    return [f"{arm_of(arm).title}, seed {seed}, {_where(run, arm, seed)}" for arm, seed in jobs]


def missing_files(run: Run) -> list[str]:
    """The files that a run of now would have by now, by their paths in the folder of the run."""
    names: list[str] = [*EVERY_RUN]
    for arm, seed in run.experiment.jobs():
        if arm_of(arm).is_trained and run.is_trained(arm, seed):
            names += [f"{run.folder_of(arm, seed).name}/{name}" for name in EVERY_TRAINING]
    if any(run.is_done(*job) for job in run.experiment.jobs()):
        names += TRACE
    return [name for name in names if not (run.folder / name).exists()]


def _where(run: Run, arm: str, seed: int) -> str:
    row = last_row(run.folder_of(arm, seed) / "progress.csv")
    if row is None:
        return "not begun"
    return f"stopped at step {int(row['time/total_timesteps']):,} of {run.experiment.n_timesteps:,}"
