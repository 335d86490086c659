"""The experiment as data: what is trained, on what, for how long; and the command line that spells it."""

import ast
import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

Arm = Literal["none", "shield"]
ARMS: tuple[Arm, ...] = get_args(Arm)
SHIELDED_ARM: Arm = "shield"
SEED_LIMIT = 2**32


def _pairs(words: list[str]) -> dict[str, Any]:
    """{"alpha": 4.0} from ["alpha:4.0"]; a value that is no Python literal is a string."""
    table = {}
    for word in words:
        key, colon, value = word.partition(":")
        if not colon:
            raise ValueError(f"{word!r} must be KEY:VALUE")
        try:
            table[key] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            table[key] = value
    return table


def _words(table: dict[str, Any]) -> list[str]:
    return [f"{key}:{value}" for key, value in table.items()]


Pairs = Annotated[
    dict[str, Any],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs="*",
        metavar="[KEY:VALUE ...]",
        instance_from_str=_pairs,
        is_instance=lambda instance: isinstance(instance, dict),
        str_from_instance=_words,
    ),
]


@dataclass(frozen=True)
class PpoSettings:
    """Hyper-parameters of PPO, named as in Stable-Baselines3."""

    n_envs: int = 128
    """Rows flown at once."""
    n_steps: int = 64
    """Steps of each row between two updates."""
    batch_size: int = 2048
    """Transitions of one gradient step."""
    n_epochs: int = 10
    """Passes over the transitions of one update."""
    learning_rate: float = 3e-3
    """Step size of Adam."""
    gamma: float = 0.99
    """Discount per policy step."""
    gae_lambda: float = 0.95
    """Decay of the advantage estimator."""
    clip_range: float = 0.2
    """Bound of the policy ratio."""
    ent_coef: float = 0.0
    """Weight of the entropy."""
    log_std_init: float = 0.0
    """Logarithm of the first standard deviation of the actions."""
    net_arch: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers of policy and value."""

    def __post_init__(self):
        check_positive(self, "n_envs", "n_steps", "batch_size", "n_epochs")
        if self.n_envs * self.n_steps % self.batch_size:
            raise ValueError(
                f"batch_size must divide n_envs * n_steps = {self.n_envs * self.n_steps}, got {self.batch_size}"
            )


@dataclass(frozen=True)
class Experiment:
    """Everything that decides what is learned."""

    env: str = "QuadSafe/Avoid-v0"
    """Id of the environment."""
    action: str = "velocity"
    """What the policy commands: velocity, snap or wrench."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Further keywords of the environment, as params:racer policy_hz:50."""
    shield: Pairs = field(default_factory=dict)
    """Settings of the shield, as alpha:4.0 snap_max:80.0."""
    arms: tuple[Arm, ...] = ARMS
    """What to train: without a shield, with it."""
    n_timesteps: Annotated[int, tyro.conf.arg(aliases=["-n"])] = 1_000_000
    """Policy steps of each training, over all rows."""
    seed: int = 0
    """First seed; of the weights, the exploration and the training scenes."""
    n_seeds: int = 1
    """Number of seeds: seed, seed + 1, …"""
    eval_episodes: int = 200
    """Held-out scenes of the evaluation."""
    ppo: PpoSettings = field(default_factory=PpoSettings)

    def __post_init__(self):
        check_positive(self, "n_timesteps", "n_seeds", "eval_episodes")
        if not isinstance(self.seed, int) or not 0 <= self.seed < SEED_LIMIT:
            raise ValueError(f"seed must be an integer in [0, 2^32), got {self.seed!r}")
        if not self.arms or len(set(self.arms)) < len(self.arms) or set(self.arms) - set(ARMS):
            raise ValueError(f"arms must be one or several of {', '.join(ARMS)}, got {list(self.arms)}")

    @property
    def seeds(self) -> range:
        """The seeds of every arm."""
        return range(self.seed, self.seed + self.n_seeds)

    def trainings(self) -> list[tuple[str, int]]:
        """Every (arm, seed), in the order of training."""
        return [(arm, seed) for seed in self.seeds for arm in self.arms]


@dataclass(frozen=True)
class Options:
    """How a command runs; nothing here decides what is learned."""

    log_folder: Annotated[Path, tyro.conf.arg(aliases=["-f"])] = Path("logs")
    """Folder for the run folders."""
    progress: Annotated[bool, tyro.conf.arg(aliases=["-P"])] = False
    """Show a progress bar for each training."""
    device: str = "cpu"
    """Device of torch; for networks this small the CPU is the fastest."""
    num_threads: int = 1
    """Threads of torch; more make networks this small slower."""

    def __post_init__(self):
        check_positive(self, "num_threads")


def to_dict(settings: Experiment | Options) -> dict[str, Any]:
    """The settings as lists, dicts, strings and numbers, as YAML and JSON have them."""
    return _plain(dataclasses.asdict(settings))


def experiment_from_dict(table: dict[str, Any]) -> Experiment:
    """The experiment of which ``to_dict`` made the table.

    Raises:
        ValueError: for names that an experiment does not have, or a setting out of its range.
    """
    ppo = _entry(table, "ppo", dict)
    if "net_arch" in ppo:
        ppo = {**ppo, "net_arch": tuple(_entry(ppo, "net_arch", list))}
    fields = {name: _entry(table, name, dict) for name in ("env_kwargs", "shield")}
    if "arms" in table:
        fields["arms"] = tuple(_entry(table, "arms", list))
    return _known(Experiment, {**table, **fields, "ppo": _known(PpoSettings, ppo)})


def _entry(table: dict[str, Any], name: str, kind: type) -> Any:
    value = table.get(name, kind())
    if not isinstance(value, kind):
        raise ValueError(f"config.yml must have a {kind.__name__} as {name}, got {value!r}")
    return value


def _known(kind: type, table: dict[str, Any]):
    unknown = set(table) - {field.name for field in dataclasses.fields(kind)}
    if unknown:
        raise ValueError(
            f"config.yml must hold fields of {kind.__name__} only, got {sorted(map(str, unknown))}"
        )
    return kind(**table)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


def check_positive(settings: Any, *names: str) -> None:
    """Raise a ValueError unless these fields are integers of at least 1."""
    # Not quadsafe_core.checks, which needs numpy: too slow for --help.
    for name in names:
        value = getattr(settings, name)
        if not isinstance(value, int) or value < 1:
            raise ValueError(f"{name} must be an integer >= 1, got {value!r}")
