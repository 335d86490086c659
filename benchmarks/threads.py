"""One vector env flown by two threads against one, beside what two threads gain on this machine at all.

    python benchmarks/threads.py                 QuadSafe/Avoid-v0 at its own rates, random actions
    python benchmarks/threads.py --rows 1024     of so many rows
    python benchmarks/threads.py --torch         each step after torch has asked a policy in two threads

In turn: a step of one thread, a step of two, and the reference, code that does nothing but count for as long
as the step of one, half of it after the other half and beside it. Where others use the cores too, the
reference shows how much of the second one they leave.
"""

import argparse
import time
from collections.abc import Callable

import gymnasium
import numpy as np

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.kernels.jit import kernel, released
from quadsafe_core.kernels.threads import side_by_side
from shields import VectorShieldWrapper

ROWS = (1024, 4096, 16384)
ACTIONS = ("velocity", "snap")
BUDGET = 4.0  # s per line
COUNTED = 4e8  # turns of the reference in a second, roughly


@kernel
def counted(turns):
    """A sum that no compiler shortens."""
    x = 1.0
    for _ in range(turns):
        x = x * 0.5 + 1.0
    return x


def stepper(n: int, threads: int, is_shielded: bool, action: str) -> Callable[[], object]:
    """A function that steps an env which has flown a while."""
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", n, threads=threads, action=action)
    env = VectorShieldWrapper(env) if is_shielded else env
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (16, n, 4)).astype(np.float32)
    taken = iter(np.tile(np.arange(16), 100_000))
    for _ in range(20):
        env.step(actions[next(taken)])
    return lambda: env.step(actions[next(taken)])


def policy(n: int) -> Callable[[], object]:
    """A function that asks a policy for n actions in two threads of torch."""
    import torch

    torch.set_num_threads(2)
    net = torch.nn.Sequential(
        torch.nn.Linear(20, 64), torch.nn.Tanh(), torch.nn.Linear(64, 64), torch.nn.Tanh()
    )
    seen = torch.zeros(n, 20)

    def ask() -> object:
        with torch.no_grad():
            return net(seen)

    return ask


def took(call: Callable[[], object]) -> float:
    """Seconds of a call."""
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def compared(n: int, is_shielded: bool, action: str, before: Callable[[], object]) -> str:
    """One line: µs of a step in one thread and in two, and their ratio, of fast steps and of the median."""
    alone, both = (stepper(n, threads, is_shielded, action) for threads in (1, 2))
    free, turns = released(counted), int(COUNTED * min(took(alone) for _ in range(5)) / 2)
    calls = [lambda: free(turns)] * 2
    table = []
    end = time.perf_counter() + BUDGET
    while time.perf_counter() < end:
        row = []
        for call in (alone, both, lambda: [count() for count in calls], lambda: side_by_side(calls)):
            before()
            row.append(1e6 * took(call))
        table.append(row)
    told = []
    for name, q in (("fast", 0.05), ("median", 0.5)):
        one, two, apart, beside = np.quantile(table, q, axis=0)
        told.append(f"{name} {one:.0f} and {two:.0f} µs, {one / two:.2f}, reference {apart / beside:.2f}")
    return "; ".join(told)


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare two threads with one.")
    parser.add_argument("--torch", action="store_true", help="ask a policy before every step")
    parser.add_argument("--rows", type=int, nargs="+", default=ROWS, help="numbers of rows")
    given = parser.parse_args()
    for n in given.rows:
        for action in ACTIONS:
            for is_shielded in (False, True):
                before = policy(n) if given.torch else int
                line = compared(n, is_shielded, action, before)
                print(
                    f"N = {n:6}, {action:8}, {'with' if is_shielded else 'without'} shield: {line}", flush=True
                )


if __name__ == "__main__":
    main()
