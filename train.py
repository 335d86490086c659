"""Train PPO with and without the shield, and compare how often the two collide.

python train.py                  both arms on QuadSafe/Avoid-v0
python train.py evaluate RUN     the models of a run again, on held-out scenes
"""

import sys
from collections.abc import Sequence

from agents.command_line import Evaluate, Train, errors_as_sentences, interrupts_end_quietly, parse


def train(command: Train) -> int:
    """Train every arm with every seed, evaluate, report; 130 if Ctrl-C ended it early."""
    print("Preparing; the first time, this compiles for about a minute.", flush=True)
    from agents import build, evaluate, ppo, report, runs

    with errors_as_sentences():
        ppo.check_device(command.options.device)
        experiment = build.checked(command.experiment)
        run = runs.create_run(experiment, command.options)

    with ppo.StopRequest() as stop:
        for arm, seed in experiment.trainings():
            ppo.train(run, arm, seed, command.options, stop)
            if stop.is_set:
                print(report.write_report(run))
                print(f"Stopped early. To fly what was learned: python train.py evaluate {run.folder}")
                return 130

    evaluate.evaluate_run(run)
    print(report.write_report(run))
    return 0


def evaluate(command: Evaluate) -> int:
    """Evaluate the models of a run and report."""
    from agents import evaluate, report, runs

    with errors_as_sentences():
        run = runs.open_run(command.run)
        evaluate.evaluate_run(run, command.eval_episodes, command.num_threads)
    print(report.write_report(run))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, by default that of the process."""
    with errors_as_sentences():
        command = parse(arguments)
    with interrupts_end_quietly():
        return evaluate(command) if isinstance(command, Evaluate) else train(command)


if __name__ == "__main__":
    sys.exit(main())
