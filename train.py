"""Train with and without the shield, and compare how often the two collide.

python train.py                  both arms on QuadSafe/Avoid-v0
python train.py -i RUN           go on with a run, or add arms and seeds to it
python train.py evaluate RUN     the agents of a run again, on held-out scenes
python train.py evaluate M:NAME  a policy of yours, a callable or a model in a module, on the same scenes
python train.py export RUN       the policy of a run as an ONNX or TorchScript file
python train.py report RUN       tables and figures again, from the CSV files of a run
python train.py watch RUN        a flight of one of its agents, in a window or as a video
python train.py watch M:NAME     a flight of a policy of yours
python train.py map FILE         a map of obstacles, with the straight ways of 50 scenes
python train.py calibrate        what a shield is to be told of a plant that others wrote
python train.py benchmark        every method on every task, in one table
"""

import sys
from collections.abc import Callable, Sequence
from typing import Any

from agents.experiment.benchmark_command import Benchmark
from agents.experiment.command_line import (
    Calibrate,
    Evaluate,
    Export,
    Map,
    Report,
    Train,
    Watch,
    parse,
)
from agents.experiment.program import called, errors_as_sentences, interrupts_end_quietly, program


def train(command: Train) -> int:
    """Train and fly every arm with every seed, report; 130 if Ctrl-C ended it early, 1 if a job failed."""
    print("Preparing; the first time, this compiles for about a minute.", flush=True)
    from agents.experiment import environments, runs
    from agents.learn import algorithms
    from agents.measure import provenance, trace
    from agents.report import reporting
    from agents.train import engines, progress_bar

    with errors_as_sentences():
        engine = engines.engine_of(command.options)
        algorithms.check_words(command.experiment, command.options)
        experiment = environments.checked(command.experiment)
        algorithms.new_policy(experiment)
        run = runs.begin_run(experiment, command.options, provenance.provenance(experiment))
        jobs = run.open_jobs()
        with engines.StopRequest(run.stop_file) as stop, progress_bar.ProgressBar(run, jobs, command.options):
            failures = engines.run_jobs(engine, run, jobs, command.options)

    for (arm, seed), failure in failures.items():
        print(f"{program()}: error: {arm}, seed {seed}: {failure}", file=sys.stderr)
    is_told = True
    try:
        trace.write_trace(run)
        print(reporting.write_report(run))
    except OSError as error:
        is_told = False
        print(f"{program()}: error: {error}", file=sys.stderr)
    if run.open_jobs():
        print(f"{'Stopped' if stop.is_set else 'Ended'} early. To go on: {called()} -i {run.folder}")
    return 130 if stop.is_set else int(bool(failures) or not is_told)


def evaluate(command: Evaluate) -> int:
    """Fly the agents of a run again, or a policy from elsewhere, and report."""
    from agents.experiment import runs
    from agents.measure import evaluate, trace
    from agents.policies import adapters, commands
    from agents.report import reporting

    with errors_as_sentences():
        if adapters.is_name(command.run):
            if command.filter:
                raise ValueError(
                    f"filter must come with a run; of a policy it is --shield filter:{command.filter}"
                )
            print(commands.evaluate_named(command))
            return 0
        refuse_of_a_policy(command)
        if command.filter:
            print(commands.evaluate_behind_filter(command))
            return 0
        run = runs.open_run(command.run)
        evaluate.evaluate_run(run, command.eval_episodes, command.num_threads)
        trace.write_trace(run)
        print(reporting.write_report(run))
    return 0


def refuse_of_a_policy(command: Evaluate | Watch) -> None:
    """Raise a ValueError for settings of a policy beside a run, which has its own."""
    if command.of_a_policy:
        raise ValueError(f"{', '.join(command.of_a_policy)} must come with a policy, got {command.run!r}")


def export(command: Export) -> int:
    """Write the policy of a run for other programs."""
    from agents.policies import commands

    with errors_as_sentences():
        print(commands.export_of_run(command))
    return 0


def report(command: Report) -> int:
    """Make the tables and figures of a run again."""
    from agents.experiment import runs
    from agents.report import reporting

    with errors_as_sentences():
        print(reporting.write_report(runs.open_run(command.run)))
    return 0


def watch(command: Watch) -> int:
    """Show a flight of an agent of a run, or of a policy from elsewhere."""
    from agents.experiment import runs
    from agents.policies import adapters, commands
    from agents.report import watch

    with errors_as_sentences():
        how = watch.Showing(not command.no_shield, command.side_by_side, command.video, command.looks)
        if adapters.is_name(command.run):
            print(commands.watch_named(command, how))
            return 0
        refuse_of_a_policy(command)
        print(watch.watch(runs.open_run(command.run), command.arm, command.seed, command.scene, how))
    return 0


def draw_map(command: Map) -> int:
    """Draw a map with the straight ways of its scenes."""
    from agents.report import reporting

    with errors_as_sentences():
        print(reporting.write_map(command.file, command.env, command.env_kwargs, command.flights, command.page))
    return 0


def calibrate(command: Calibrate) -> int:
    """Measure what a shield is to be told of a plant; 1 where there is nothing that it can be told."""
    from agents.measure import calibration

    with errors_as_sentences():
        words, is_good = calibration.calibrated(command)
    print(words)
    return int(not is_good)


def benchmark(command: Benchmark) -> int:
    """Fly what is missing of the benchmark, and report; 130 if Ctrl-C ended it early, 1 if a job failed."""
    from agents.benchmark import program as benchmark_program

    with errors_as_sentences():
        return benchmark_program.run(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, by default that of the process."""
    with errors_as_sentences():
        command = parse(arguments)
    commands: dict[type, Callable[[Any], int]] = {
        Train: train,
        Evaluate: evaluate,
        Export: export,
        Report: report,
        Watch: watch,
        Map: draw_map,
        Calibrate: calibrate,
        Benchmark: benchmark,
    }
    with interrupts_end_quietly():
        return commands[type(command)](command)


if __name__ == "__main__":
    sys.exit(main())
