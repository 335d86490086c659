"""Typing errors on the command line are told before what takes seconds is imported."""

import subprocess
import sys

import pytest

from agents.experiment.command_line import ACTIONS, ALGORITHM_NAMES, parse
from agents.learn.algorithms import ALGORITHMS, SBX_PPO
from quadsafe_env.vehicle.actions import INTERFACES

WRONG = {
    ("--env", "QuadSafe/Avoyd-v0"): r"^env must be one of .*; did you mean 'QuadSafe/Avoid-v0'\?$",
    ("--action", "atitude"): r"^action must be one of .*, got 'atitude'; did you mean 'attitude'\?$",
    ("--algo", "pp"): r"^algo must be one of .*, got 'pp'; did you mean 'ppo'\?$",
    ("--algorithm", "sbx:ppo"): r"^algo must be one of .*, got 'sbx:ppo'; did you mean 'sbx:PPO'\?$",
    ("--env-kwargs", "action:snap"): r"^env_kwargs must leave out action, which is --action, got 'snap'$",
}


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_word_is_a_sentence(words):
    with pytest.raises(ValueError, match=WRONG[words]):
        parse(words)


def test_the_right_words_are_those_that_there_are():
    assert ACTIONS == INTERFACES and set(ALGORITHM_NAMES) == {*ALGORITHMS, SBX_PPO}
    for action in ACTIONS:
        assert parse(["--action", action]).experiment.action == action  # type: ignore[union-attr]


def test_a_wrong_word_loads_neither_numba_nor_torch():
    code = (
        "import sys, contextlib\n"
        "from agents.experiment.command_line import parse\n"
        "with contextlib.suppress(ValueError):\n    parse(['--env', 'QuadSafe/Avoyd-v0'])\n"
        "print({'torch', 'numba', 'numpy'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
