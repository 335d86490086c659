"""The experiment as data: what is trained, on what, for how long; and the command line that spells it."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from agents.experiment.arms import ARMS, OF_RUNS, arm_of, is_arm
from agents.experiment.pairs import Pairs
from quadsafe_core.nearest_word import did_you_mean
from quadsafe_core.registration import IDS

SEED_LIMIT = 2**32
# By the names of Stable-Baselines3, and what is not the constructor's: n_envs, the rows flown at once, and
# net_arch, log_std_init and activation_fn of the policy. What is not here has the default of Stable-Baselines3.
HYPERPARAMS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_envs": 128,
        "n_steps": 64,
        "batch_size": 2048,
        "n_epochs": 10,
        "learning_rate": 3e-3,
        "gamma": 0.99,
        "gae_lambda": 0.95,
        "clip_range": 0.2,
        "ent_coef": 0.0,
        "log_std_init": 0.0,
        "net_arch": [64, 64],
    },
    "sac": {"n_envs": 32, "batch_size": 512, "learning_rate": 1e-3, "gradient_steps": 8, "net_arch": [64, 64]},
    "td3": {"n_envs": 32, "batch_size": 512, "learning_rate": 1e-3, "gradient_steps": 8, "net_arch": [64, 64]},
}
# The same algorithm by sbx-rl.
HYPERPARAMS["sbx:PPO"] = HYPERPARAMS["ppo"]
# Over those of PPO where nothing is lost by it: a step takes a third of the time, and 95 % success half of it
# (docs/speed.md). In rooms they are not enough: after a million steps 61 % of the flights succeed, not 91 %.
QUICK = {"n_epochs": 5, "learning_rate": 5e-3, "net_arch": [32, 32], "activation_fn": "ReLU"}
QUICK_ENVS = ("QuadSafe/Avoid-v0", "QuadSafe/Gates-v0")
# Over those of any algorithm. A flight through openings is paid for at every step, and ends at the goal: after
# 450,000 steps in rooms nine of ten episodes ended there with 0.97, and two of ten with 0.99.
NEAR_SIGHTED = {"gamma": 0.97}
# What follows a reference is paid at every step too.
OF_ENVS = {
    "QuadSafe/Rooms-v0": NEAR_SIGHTED,
    "QuadSafe/Gates-v0": NEAR_SIGHTED,
    "QuadSafe/Track-v0": NEAR_SIGHTED,
}


def default_hyperparams(env: str, algo: str) -> dict[str, Any]:
    """What an experiment leaves out, by the id of its env and the name of its algorithm."""
    if algo not in HYPERPARAMS:
        return {}
    quick = QUICK if algo in ("ppo", "sbx:PPO") and env in QUICK_ENVS else {}
    return {**HYPERPARAMS[algo], **quick, **OF_ENVS.get(env, {})}


@dataclass(frozen=True)
class Experiment:
    """Everything that decides what is learned."""

    env: Annotated[str, tyro.conf.arg(metavar=f"{{{','.join(IDS)}}}")] = "QuadSafe/Avoid-v0"
    """Id of the environment."""
    action: str = "velocity"
    """What the policy commands: velocity, snap, wrench, rates or attitude."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Further keywords of the environment, values in YAML, as params:racer rotor_limits:true."""
    shield: Pairs = field(default_factory=dict)
    """Settings of the shield, as alpha:4.0 snap_max:80.0."""
    arms: Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{{{','.join(OF_RUNS)}}} ...")] = ("none", "shield")
    """What to compare, see agents/experiment/arms.py; also module:Class of a filter of yours, and none+NAME for
    the policies of none flown behind the filter of NAME."""
    algo: Annotated[str, tyro.conf.arg(aliases=["--algorithm"])] = "ppo"
    """Algorithm of Stable-Baselines3 that the arms learn with: ppo, sac, td3, …; or sbx:PPO, that of sbx-rl."""
    hyperparams: Annotated[Pairs, tyro.conf.arg(aliases=["-params"])] = field(default_factory=dict)
    """Hyper-parameters by the names of Stable-Baselines3, and n_envs, net_arch, log_std_init, activation_fn, as
    n_envs:64 activation_fn:ReLU; over the defaults in agents/experiment/config.py."""
    n_timesteps: Annotated[int, tyro.conf.arg(aliases=["-n"])] = 1_000_000
    """Policy steps of each training, over all rows."""
    seed: int = 0
    """First seed; of the weights, the exploration and the training scenes."""
    n_seeds: int = 1
    """Number of seeds: seed, seed + 1, …"""
    eval_episodes: int = 200
    """Held-out scenes of the evaluation."""

    def __post_init__(self):
        check_positive(self, "n_timesteps", "n_seeds", "eval_episodes")
        if not _is_integer(self.seed) or not 0 <= self.seed < SEED_LIMIT:
            raise ValueError(f"seed must be an integer in [0, 2^32), got {self.seed!r}")
        unknown = [arm for arm in self.arms if not is_arm(arm)]
        if not self.arms or len(set(self.arms)) < len(self.arms) or unknown:
            known, nearest = ", ".join(ARMS), did_you_mean(unknown[0], ARMS) if unknown else ""
            raise ValueError(f"arms must be one or several of {known}, got {list(self.arms)}{nearest}")
        alone = [a for a in self.arms if arm_of(a).policies_of not in ("", *self.arms)]
        if alone:
            whose = arm_of(alone[0]).policies_of
            raise ValueError(f"arms must have {whose} beside {alone[0]}, got {list(self.arms)}")

    @property
    def seeds(self) -> range:
        """The seeds of every arm."""
        return range(self.seed, self.seed + self.n_seeds)

    def jobs(self) -> list[tuple[str, int]]:
        """Every (arm, seed), in the order of work; an arm without seeds has the first."""
        return [(a, s) for s in self.seeds for a in self.arms if s == self.seed or arm_of(a).has_seeds]


@dataclass(frozen=True)
class Options:
    """How a command runs; nothing here decides what is learned."""

    log_folder: Annotated[Path, tyro.conf.arg(aliases=["-f"])] = Path("logs")
    """Folder for the run folders."""
    trained_agent: Annotated[Path | None, tyro.conf.arg(aliases=["-i"], metavar="RUN")] = None
    """Run folder to go on with, from its checkpoints; it keeps its settings, arms and seeds may be added."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Settings of a new run, as of a run's config.yml; what is given beside it counts in its place."""
    n_jobs: int = 0
    """Trainings at a time, each in a process of its own; 0 for one a core."""
    save_freq: int = 100_000
    """Policy steps between two checkpoints of a training."""
    engine: Literal["local", "ray"] = "local"
    """Where trainings run: processes of this machine, or tasks of Ray."""
    address: str | None = None
    """Ray cluster to run on, as HOST:6379; without one, Ray starts on this machine."""
    tensorboard_log: Annotated[Path | None, tyro.conf.arg(aliases=["-tb"])] = None
    """Folder for TensorBoard."""
    progress: Annotated[bool, tyro.conf.arg(aliases=["-P"])] = False
    """Show progress bars also where the output is no terminal."""
    device: str = "cpu"
    """Device of torch; for networks this small the CPU is the fastest."""
    num_threads: int = 1
    """Threads of torch for each training; more make networks this small slower."""

    def __post_init__(self):
        check_positive(self, "num_threads", "save_freq")
        if not _is_integer(self.n_jobs) or self.n_jobs < 0:
            raise ValueError(f"n_jobs must be an integer >= 0, got {self.n_jobs!r}")
        if self.engine not in ("local", "ray"):
            raise ValueError(f"engine must be 'local' or 'ray', got {self.engine!r}")
        if self.config is not None and self.trained_agent is not None:
            raise ValueError(f"config must be left out with -i, which keeps its own, got {str(self.config)!r}")
        if self.address is not None and self.engine != "ray":
            raise ValueError(f"address must come with --engine ray, got {self.address!r}")


def to_dict(settings: Experiment | Options) -> dict[str, Any]:
    """The settings as lists, dicts, strings and numbers, as YAML and JSON have them."""
    return _plain(dataclasses.asdict(settings))


def experiment_from_dict(table: dict[str, Any]) -> Experiment:
    """The experiment of which ``to_dict`` made the table.

    Raises:
        ValueError: for names that an experiment does not have, or a setting out of its range.
    """
    fields = {name: _entry(table, name, dict) for name in ("env_kwargs", "shield", "hyperparams")}
    names = [str(table.get(name, getattr(Experiment, name))) for name in ("env", "algo")]
    fields["hyperparams"] = _of_their_time(default_hyperparams(*names), fields["hyperparams"])
    if "arms" in table:
        fields["arms"] = tuple(_entry(table, "arms", list))
    known = [field.name for field in dataclasses.fields(Experiment)]
    unknown = sorted(map(str, set(table) - set(known)))
    if unknown:
        raise ValueError(
            f"config.yml must hold fields of Experiment only, got {unknown}{did_you_mean(unknown[0], known)}"
        )
    return Experiment(**{**table, **fields})


def check_positive(settings: Any, *names: str) -> None:
    """Raise a ValueError unless these fields are integers of at least 1."""
    # Not quadsafe_core.checks, which needs numpy: too slow for --help.
    for name in names:
        value = getattr(settings, name)
        if not _is_integer(value) or value < 1:
            raise ValueError(f"{name} must be an integer >= 1, got {value!r}")


def _entry(table: dict[str, Any], name: str, kind: type) -> Any:
    value = table.get(name, kind())
    if not isinstance(value, kind):
        raise ValueError(f"config.yml must have a {kind.__name__} as {name}, got {value!r}")
    return value


def _of_their_time(defaults: dict[str, Any], hyperparams: dict[str, Any]) -> dict[str, Any]:
    # A run from before the activation had a default spelled out all the others, and its networks had Tanh.
    is_older = defaults.keys() - hyperparams.keys() == {"activation_fn"}
    return {**hyperparams, "activation_fn": "Tanh"} if is_older else hyperparams


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
