"""The command line of ``train.py``."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from agents.experiment.benchmark_command import Benchmark
from agents.experiment.config import Experiment, Options, check_positive
from agents.experiment.pairs import Pairs
from agents.experiment.program import program
from quadsafe_core.nearest_word import did_you_mean
from quadsafe_core.registration import IDS

# Those of quadsafe_env.vehicle.actions and of agents.learn.algorithms, which are too slow to ask for a word.
ACTIONS = ("velocity", "snap", "wrench", "rates", "attitude")
ALGORITHM_NAMES = ("a2c", "ddpg", "dqn", "ppo", "sac", "td3", "sbx:PPO")


@dataclass(frozen=True)
class Train:
    """Train with and without the shield, and compare how often the two collide.

    `train.py -i RUN` goes on with a run that was stopped, or adds arms and seeds to it. `train.py evaluate RUN`
    flies the agents of a run again, `train.py evaluate MODULE:NAME` a policy of yours, `train.py export RUN`
    writes one for other programs, `train.py report RUN` makes its tables and figures again,
    `train.py watch RUN` shows a flight, `train.py map FILE` a map of obstacles, `train.py calibrate` measures
    what a shield is to be told of a plant that others wrote, `train.py benchmark` compares every method; each
    has --help. `train.py --version` prints the version.
    """

    experiment: Annotated[Experiment, tyro.conf.arg(name="")] = field(default_factory=Experiment)
    options: Annotated[Options, tyro.conf.arg(name="")] = field(default_factory=Options)


@dataclass(frozen=True)
class Evaluate:
    """Fly every agent of a run, or a policy of yours, on held-out scenes, each with the shield on and off.

    What stands under "of a policy" decides how a policy is flown; a run has its own.
    """

    run: tyro.conf.Positional[str]
    """Run folder, as logs/QuadSafe-Avoid-v0_1; or a policy: module:name of a callable from an observation to an
    action or of a model with Stable-Baselines3's predict, or an ONNX file."""
    eval_episodes: int | None = None
    """Number of held-out scenes, when another than that of the run; 200 of a policy."""
    num_threads: int = 1
    """Threads of torch."""
    filter: str = ""
    """Of a run: fly every agent behind this filter of others, hocbf, predictive, geometric or module:Class, and
    leave tables and report as they are."""
    env: str | None = None
    """Of a policy: id of the environment, QuadSafe/Avoid-v0 unless given."""
    action: str | None = None
    """Of a policy: what it commands, velocity unless given."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Of a policy: further keywords of the environment, as params:racer policy_hz:50."""
    shield: Pairs = field(default_factory=dict)
    """Of a policy: settings of the shield, as alpha:4.0."""
    log_folder: Annotated[Path | None, tyro.conf.arg(aliases=["-f"])] = None
    """Of a policy: folder for the run folder, logs unless given."""

    def __post_init__(self):
        check_positive(self, "num_threads", *(["eval_episodes"] if self.eval_episodes is not None else []))

    @property
    def of_a_policy(self) -> dict[str, Any]:
        """What was given that only a policy is asked."""
        return given(self, "env", "action", "env_kwargs", "shield", "log_folder")


@dataclass(frozen=True)
class Export:
    """Write the policy of a run for other programs: from observations (N, D) to the actions that it flies.

    Or its flights in held-out scenes, as a Minari data set or a Parquet table.
    """

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""
    arm: str | None = None
    """Whose policy; the last that was trained unless given."""
    seed: int | None = None
    """Which of its trainings; its first unless given."""
    format: Literal["onnx", "torchscript", "minari", "parquet"] = "onnx"
    """Kind of file; minari and parquet are its flights. All but torchscript need an extra: pip install
    "quadsafe[onnx]", "quadsafe[minari]", "quadsafe[parquet]"."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """File to write; policy.onnx, policy.ts, flights.parquet or the folder flights beside the weights unless
    given."""


@dataclass(frozen=True)
class Report:
    """Make the tables and figures of a run again, from its CSV files."""

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""


@dataclass(frozen=True)
class Watch:
    """Watch a flight of an agent of a run, or of a policy of yours, in a window or as a video.

    Without a display it is a video.

    In the window the mouse turns the view, the wheel zooms, F follows, R or a double click restores it. What
    stands under "of a policy" decides how a policy is flown; a run has its own.
    """

    run: tyro.conf.Positional[str]
    """Run folder, as logs/QuadSafe-Avoid-v0_1; or a policy: module:name, or an ONNX file, as for evaluate."""
    arm: str | None = None
    """Who flies; that of the report's scene unless given."""
    seed: int | None = None
    """Which of its trainings."""
    scene: int | None = None
    """Scene integer, as in flights.csv; that of the report unless given."""
    no_shield: bool = False
    """Take the shield away."""
    side_by_side: bool = False
    """Write a video of the scene without and with the shield, side by side."""
    video: Path | None = None
    """Write this .webp, .gif or .mp4 (with ffmpeg, see quadsafe[video]) in place of opening a window."""
    render_size: int | None = None
    """Side of the picture, pixels, 480 unless given."""
    camera: Pairs = field(default_factory=dict)
    """Where it is seen from, as azimuth:20 elevation:30 distance:8 follow:true; the whole map unless given."""
    env: str | None = None
    """Of a policy: id of the environment, QuadSafe/Avoid-v0 unless given."""
    action: str | None = None
    """Of a policy: what it commands, velocity unless given."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Of a policy: further keywords of the environment, as params:racer policy_hz:50."""
    shield: Pairs = field(default_factory=dict)
    """Of a policy: settings of the shield, as alpha:4.0."""

    def __post_init__(self):
        if self.side_by_side and self.no_shield:
            raise ValueError("no_shield must not come with side_by_side, which shows both")

    @property
    def of_a_policy(self) -> dict[str, Any]:
        """What was given that only a policy is asked."""
        return given(self, "env", "action", "env_kwargs", "shield")

    @property
    def looks(self) -> dict[str, Any]:
        """What was given of the keywords of the environment that decide how it looks."""
        return given(self, "render_size", "camera")


@dataclass(frozen=True)
class Map:
    """Draw a map of obstacles with sampled starts and goals, before anything is trained on it."""

    file: tyro.conf.Positional[Path]
    """File of obstacles, see docs/maps.md."""
    env: str = "QuadSafe/Avoid-v0"
    """Id of the environment that flies among them."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Further keywords of the environment, as start:[-2,0,1] goal:[[2,-1,1],[3,1,2]] blocked:0.8."""
    flights: int = 50
    """Number of scenes: 0, 1, 2, …"""
    page: Path | None = None
    """HTML file to write; logs/maps/NAME.html unless given."""

    def __post_init__(self):
        check_positive(self, "flights")


@dataclass(frozen=True)
class Calibrate:
    """Measure what a shield is to be told of a plant that others wrote, by flights in free space.

    Prints the Uncertainty to declare, and writes it as a JSON file for uncertainty="FILE.json", with a picture
    of what was asked, what flew, and the bound around it.
    """

    plant: str = "mujoco"
    """Name of the plant, see docs/plants.md."""
    options: Pairs = field(default_factory=dict)
    """Options of the plant, as vehicle:hummingbird step:0.002."""
    speed: float = 2.0
    """Of the velocity commands at most, m/s."""
    period: float = 0.01
    """For which a snap is held, s."""
    flights: int = 32
    """Flights to measure, and as many to check."""
    seconds: int = 4
    """Of each flight."""
    factor: float = 1.25
    """On the greatest residuals."""
    seed: int = 0
    """Of the excitations."""
    out: Path = Path("logs/calibrate")
    """Folder for the JSON file and the picture."""


COMMANDS: dict[str, type] = {
    "evaluate": Evaluate,
    "export": Export,
    "report": Report,
    "watch": Watch,
    "map": Map,
    "calibrate": Calibrate,
    "benchmark": Benchmark,
}
Command = Train | Evaluate | Export | Report | Watch | Map | Calibrate | Benchmark


def parse(arguments: Sequence[str] | None = None) -> Command:
    """The command spelled by ``arguments`` (default: those of the process).

    Exits on --help, --version and errors.

    Raises:
        ValueError, OSError: for an unknown command, -i with a folder that is no run, --config with a file that
            is no experiment.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words == ["--version"]:
        print(f"quadsafe {version('quadsafe')}")
        raise SystemExit(0)
    if words and words[0] in COMMANDS:
        return _spelled(COMMANDS[words[0]], words[1:], f"{program()} {words[0]}")
    if words and not words[0].startswith("-"):
        nearest = did_you_mean(words[0], COMMANDS)
        raise ValueError(
            f"command must be one of {', '.join(COMMANDS)}, or none to train, got {words[0]!r}{nearest}"
        )
    command = _spelled(Train, words, program())
    given = _given(command.options)
    # What is not said again is that of the run or the file.
    command = command if given is None else _spelled(Train, words, program(), Train(given))
    _check_words(command.experiment)
    return command


def given(command: Evaluate | Watch, *names: str) -> dict[str, Any]:
    """Those of the named settings of a command that were given."""
    return {name: getattr(command, name) for name in names if getattr(command, name) not in (None, {})}


def _given(options: Options) -> Experiment | None:
    """The experiment of a run to go on with, or of a file of settings."""
    if options.trained_agent is None and options.config is None:
        return None
    from agents.experiment.runs import open_run, read_experiment

    if options.trained_agent is not None:
        return open_run(options.trained_agent).experiment
    return read_experiment(options.config)  # type: ignore[arg-type]


def _check_words(experiment: Experiment) -> None:
    """What is known before anything is imported that takes seconds.

    Raises:
        ValueError: for a word that there is not.
    """
    for name, known in (("env", tuple(IDS)), ("action", ACTIONS), ("algo", ALGORITHM_NAMES)):
        word = getattr(experiment, name)
        if word not in known:
            listed = ", ".join(map(repr, known))
            raise ValueError(f"{name} must be one of {listed}, got {word!r}{did_you_mean(word, known)}")
    if "action" in experiment.env_kwargs:
        raise ValueError(
            f"env_kwargs must leave out action, which is --action, got {experiment.env_kwargs['action']!r}"
        )


def _spelled(kind: type, words: list[str], name: str, *default: Train) -> Any:
    keywords: dict[str, Any] = {"default": default[0]} if default else {}
    return tyro.cli(kind, args=words, prog=name, config=(tyro.conf.FlagCreatePairsOff,), **keywords)
