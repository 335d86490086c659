"""One job: train an arm with a seed, saved as it goes, and fly what it learned."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from agents.experiment.arms import arm_of
from agents.experiment.config import Options
from agents.experiment.environments import make_training_env
from agents.experiment.files import failures_name, write_csv, write_json
from agents.experiment.runs import Run, sole_use
from agents.learn.algorithms import make_model, save_policy
from agents.learn.checkpoint import load_checkpoint, save_checkpoint
from agents.learn.episodes import EPISODE
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.measure.evaluate import evaluate

RECENT = 200  # episodes of the running success rate
ROWS = 100  # about as many has the table of a training
SHOWN_EVERY = 1.0  # s, how often progress.csv is brought up to date between checkpoints
CHECKPOINT = "checkpoint.pt"


def work(run: Run, arm: str, seed: int, options: Options) -> None:
    """Do what is left of one job; a stop leaves a checkpoint to go on from.

    Raises:
        BlockingIOError: if another process is at it.
        OSError: if a file cannot be written; the last checkpoint is intact then.
    """
    torch.set_num_threads(options.num_threads)
    with sole_use(run.folder_of(arm, seed)):
        if not run.is_trained(arm, seed):
            train(run, arm, seed, options)
        if run.is_trained(arm, seed) and not run.is_done(arm, seed):
            evaluate(run, arm, seed, run.experiment.eval_episodes)


def train(run: Run, arm: str, seed: int, options: Options) -> None:
    """Train one arm with one seed, from its checkpoint if there is one; weights are there at the end."""
    folder = run.folder_of(arm, seed)
    env = Sb3VectorEnv(make_training_env(run.experiment, arm))
    model = make_model(run.experiment, env, seed, options.device, arm_of(arm).is_constrained)
    table, counter = ProgressTable(), EpisodeCallback()
    model.set_logger(Logger(None, [table, *_tensorboard(options, f"{run.folder.name}/{folder.name}")]))
    with EpisodeFile(folder / "episodes.csv", env.finished.dtype) as episodes:
        checkpoints = CheckpointCallback(folder, model, run, options.save_freq, table, counter, episodes)
        checkpoints.restore()
        left = run.experiment.n_timesteps - model.num_timesteps
        no_logs: Any = None  # the callback of the checkpoints asks for them
        model.learn(left, callback=[counter, checkpoints], log_interval=no_logs, reset_num_timesteps=False)
        checkpoints.log()
        model.logger.close()
        table.write_to(folder / "progress.csv")
        if checkpoints.is_stopped:
            return
        episodes.add(counter.take_rows())
    write_json(folder / "training.json", checkpoints.record())
    save_policy(folder / "policy.pt", model.policy)
    (folder / CHECKPOINT).unlink(missing_ok=True)


class EpisodeCallback(BaseCallback):
    """Counts every episode of a training, and logs the counts.

    ``recent`` holds the last episodes; ``counts`` is what is counted, ``counts["seconds"]`` not by this class.
    """

    def __init__(self):
        super().__init__()
        self.counts: dict[str, int] = {"episodes": 0, "violations": 0, "violation_steps": 0}
        self.recent = np.zeros(0, EPISODE)
        self._new: list[NDArray[np.void]] = []
        self._rows: list[list[Any]] = []

    def _on_training_start(self) -> None:
        env = self.training_env
        assert isinstance(env, Sb3VectorEnv)
        self._env = env
        if not self.recent.size:
            self.recent = env.finished[:0]

    def _on_step(self) -> bool:
        self.counts["violation_steps"] += int(self._env.transition["cost"].sum())
        finished = self._env.finished
        if finished.size:
            self._new.append(finished)
            self._rows += [[self.num_timesteps, *episode] for episode in finished.tolist()]
        return True

    def _on_rollout_end(self) -> None:
        if self._new:
            episodes = np.concatenate(self._new)
            self._new.clear()
            self.counts["episodes"] += episodes.size
            self.counts["violations"] += int(episodes["violation"].sum())
            self.recent = np.concatenate([self.recent, episodes])[-RECENT:]
        for name, count in self.counts.items():
            self.logger.record(f"rollout/{name}", count)
        if self.recent.size:
            steps = self.recent["length"].sum()
            self.logger.record("rollout/recent_success_rate", self.recent["is_success"].mean())
            self.logger.record("rollout/intervention_rate", self.recent["interventions"].sum() / steps)

    def _on_training_end(self) -> None:
        # A training that is stopped ends in the middle of a rollout.
        self._on_rollout_end()

    def take_rows(self) -> list[list[Any]]:
        """The episodes since the last call as [timestep of the end, fields of an episode]."""
        rows, self._rows = self._rows, []
        return rows

    def snapshot(self) -> dict[str, Any]:
        """For ``restore``."""
        return {"counts": dict(self.counts), "recent": self.recent}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on counting from there."""
        self.counts, self.recent = snapshot["counts"], snapshot["recent"]


class CheckpointCallback(BaseCallback):
    """Saves a training between rollouts, every so many steps and when it is to stop, and then ends it."""

    def __init__(
        self,
        folder: Path,
        model: BaseAlgorithm,
        run: Run,
        save_freq: int,
        table: "ProgressTable",
        counter: EpisodeCallback,
        episodes: "EpisodeFile",
    ):
        super().__init__()
        self.is_stopped = False
        self._folder, self._learner, self._save_freq = folder, model, save_freq
        self._log_freq, self._stop_file = run.experiment.n_timesteps / ROWS, run.stop_file
        self._table, self._counter, self._episodes = table, counter, episodes
        self._saved_at, self._seconds_before = 0, 0.0
        self._started = self._shown = time.perf_counter()

    def restore(self) -> None:
        """Put everything where the checkpoint was; without one, at the start."""
        path = self._folder / CHECKPOINT
        if not path.exists():
            self._episodes.cut(0)
            return
        counted = load_checkpoint(path, self._learner)
        self._counter.restore(counted["tally"])
        self._table.rows = counted["table"]
        self._episodes.cut(counted["episode_bytes"])
        self._saved_at, self._seconds_before = self._learner.num_timesteps, counted["seconds"]

    def record(self) -> dict[str, Any]:
        """What this training was, in numbers."""
        seconds, steps = self._seconds(), self._learner.num_timesteps
        rate = {"seconds": round(seconds, 3), "steps_per_second": round(steps / seconds)}
        return {"timesteps": steps, **self._counter.counts, **rate}

    def log(self) -> None:
        """Add a row to the table, if there is anything new."""
        if self._learner.num_timesteps > self._table.last_step:
            learner: Any = self._learner
            learner.dump_logs()

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._table.last_step >= self._log_freq:
            self.log()
        if self._stop_file.exists():
            self.is_stopped = True
            self._save()
        elif self.num_timesteps - self._saved_at >= self._save_freq:
            self._save()
        elif time.perf_counter() - self._shown > SHOWN_EVERY:
            self._show()

    def _on_step(self) -> bool:
        return not self.is_stopped

    def _save(self) -> None:
        counted = {
            "tally": self._counter.snapshot(),
            "table": self._table.rows,
            "episode_bytes": self._episodes.add(self._counter.take_rows()),
            "seconds": self._seconds(),
        }
        save_checkpoint(self._folder / CHECKPOINT, self._learner, counted)
        self._saved_at = self._learner.num_timesteps
        self._show()

    def _show(self) -> None:
        self._table.write_to(self._folder / "progress.csv")
        self._shown = time.perf_counter()

    def _seconds(self) -> float:
        return self._seconds_before + time.perf_counter() - self._started


class EpisodeFile:
    """A CSV file of episodes that grows, and can be cut back to where a checkpoint was.

    Args:
        path: the file.
        dtype: of the episodes.
    """

    def __init__(self, path: Path, dtype: np.dtype):
        self._path, self._file = path, path.open("a+b", buffering=0)
        self._header = ["timestep", *(dtype.names or ())]

    def __enter__(self) -> "EpisodeFile":
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()

    def cut(self, size: int) -> None:
        """Forget what comes after this many bytes; at 0 the header is written."""
        self._file.truncate(size)
        if size == 0:
            self.add([self._header])

    def add(self, rows: list[list[Any]]) -> int:
        """Append rows and wait until they are on the disk; the size of the file then."""
        text = "".join(",".join(map(str, row)) + "\n" for row in rows).encode()
        with failures_name(self._path):
            while text:
                text = text[self._file.write(text) :]
            os.fsync(self._file.fileno())
        return os.fstat(self._file.fileno()).st_size


class ProgressTable(KVWriter):
    """What Stable-Baselines3 logs, one row a time."""

    def __init__(self):
        self.rows: list[dict[str, Any]] = []

    @property
    def last_step(self) -> int:
        """Steps of the training at the last row."""
        return self.rows[-1]["time/total_timesteps"] if self.rows else 0

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Add a row."""
        kept = {k: v for k, v in key_values.items() if "csv" not in (key_excluded[k] or ())}
        self.rows.append({k: v.item() if isinstance(v, np.generic) else v for k, v in kept.items()})

    def write_to(self, path: Path) -> None:
        """All rows as a CSV file, in one move."""
        header = sorted({name for row in self.rows for name in row})
        write_csv(path, header, [[row.get(name, "") for name in header] for row in self.rows])

    def close(self) -> None:
        """Nothing to close."""


def _tensorboard(options: Options, name: str) -> list[KVWriter]:
    return (
        []
        if options.tensorboard_log is None
        else [TensorBoardOutputFormat(str(options.tensorboard_log / name))]
    )
