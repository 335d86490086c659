"""What each private or undocumented piece of quadsafe_core/kernels pays: with it, and in the plain public way.

    python benchmarks/kernels.py                  every piece, against the tree as it is
    python benchmarks/kernels.py carved one_row   these alone
    NUMBA_CPU_NAME=sapphirerapids python benchmarks/kernels.py wide_vectors    with the code for another CPU

Each piece is replaced in a copy of the sources. The copies are compiled from nothing (CPU time above that of a
process with compiled code), then timed in new processes, one after the other in every round; medians. A line
says what the plain way costs more, in percent.
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from itertools import cycle
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("quadsafe_core", "quadsafe_env", "shields")
KERNELS = "quadsafe_core/kernels"
# Name of a piece: file, what is taken out, what stands there instead.
PIECES = {
    "linked": ("jit.py", "return self._callee.get_", "return super().get_"),
    "optimised": ("jit.py", "passes.run(self._final_module, builder)", "pass"),
    "gc_off": ("jit.py", "if not gc.isenabled():", "if True:"),
    "no_cfunc_wrapper": ("jit.py", "no_cfunc_wrapper=True, ", ""),
    "borrowed": ("borrow.py", "carved(array, 0, array, array.shape)", "array"),
    "one_row": ("borrow.py", "carved(array, 0, array, (1, *array.shape))", "array.reshape((1, *array.shape))"),
    "carved": (
        "borrow.py",
        "return carray(_pointer(memory.ctypes, start), shape, like.dtype)",
        "count = like.itemsize\n        for length in shape:\n            count *= length\n"
        "        return memory.view(np.uint8)[start : start + count].view(like.dtype).reshape(shape)",
    ),
    "wide_vectors": ("lanes.py", '"prefer-vector-width"="512"', '"no-wide-vectors"'),
    "fma": (
        "lanes.py",
        "builder.fma(*arguments)",
        "builder.fadd(builder.fmul(*arguments[:2]), arguments[2])",
    ),
    "tiles": ("lanes.py", "if count == LANES and width % TILE == 0:", "if False:"),
    "aligned": ("lanes.py", "first = LINE - memory.ctypes.data // 8 % LINE", "first = 1"),
}


def copy_without(piece: str | None, folder: Path) -> Path:
    """A copy of the sources, a piece replaced."""
    for room in ROOMS:
        shutil.copytree(ROOT / room, folder / room, ignore=shutil.ignore_patterns("__pycache__"))
    if piece is not None:
        name, taken, plain = PIECES[piece]
        file = folder / KERNELS / name
        source = file.read_text(encoding="utf-8")
        assert taken in source, f"{piece}: {taken!r} is not in {name}"
        file.write_text(source.replace(taken, plain), encoding="utf-8")
    return folder


def figures(tree: Path) -> tuple[float, dict[str, float]]:
    """CPU time of a new process in a tree, s, and what it timed, ns."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    outcome = subprocess.run(
        [sys.executable, __file__, "--here"],
        env=os.environ | {"PYTHONPATH": str(tree)},
        check=True,
        capture_output=True,
        text=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return took, json.loads(outcome.stdout.splitlines()[-1])


def here() -> dict[str, float]:
    """Times with the packages on the path, ns: of a call from Python, or of a row in a batch."""
    import gymnasium
    import numpy as np
    from plant import NAME, RATES
    from shield import PERIOD, corrected, median, scene

    from quadsafe_core.kernels.lanes import aligned_rows
    from quadsafe_core.shapes import Obstacles
    from quadsafe_env.vehicle.dynamics import step
    from quadsafe_env.vehicle.state import hover_state
    from shields import Shield

    def call(flat, center, radius, snap) -> float:
        shield, spheres = Shield(), Obstacles.spheres(center, radius)
        return median(lambda: shield.filter(flat, spheres, snap, PERIOD).snap)

    rng, times = np.random.default_rng(0), {}
    states, wrenches = aligned_rows(4096, 20), np.zeros((4096, 4))
    states[:] = hover_state(rng.uniform(-1, 1, (4096, 3)), "crazyflie")
    times["RK4 step"] = median(lambda: step(states, wrenches, "crazyflie", 0.002)) / 4096
    env = gymnasium.make_vec(NAME, 1024, **RATES)
    env.reset(seed=0)
    actions = cycle(rng.uniform(-1, 1, (32, 1024, 4)).astype(np.float32))
    times["env of 1,024"] = median(lambda: env.step(next(actions))) / 1024
    times["shield alone"] = call(*(array[0] for array in scene(1, 1)))
    times["corrected"] = call(*corrected())
    times["shield of 1,024"] = call(*scene(1024, 1)) / 1024
    return {name: 1e9 * time for name, time in times.items()}


def medians(cold: float, warm: tuple[float, ...], times: tuple[dict[str, float], ...]) -> dict[str, float]:
    """A line of the table: CPU time of compilation, s, and times, ns."""
    of_each = {what: statistics.median(run[what] for run in times) for what in times[0]}
    return {"compiled anew, s": cold - statistics.median(warm)} | of_each


def weigh(pieces: list[str], rounds: int) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        trees = {name: copy_without(name, Path(folder) / str(name)) for name in (None, *pieces)}
        cold = {name: figures(tree)[0] for name, tree in trees.items()}
        runs = {name: [] for name in trees}
        for _ in range(rounds):
            for name, tree in trees.items():
                runs[name].append(figures(tree))
    rows = {name: medians(cold[name], *zip(*of_one, strict=True)) for name, of_one in runs.items()}
    print(f"{'':18}" + "".join(f"{what:>17}" for what in rows[None]))
    print(f"{'as it is, s and ns':18}" + "".join(f"{number:17.1f}" for number in rows[None].values()))
    for name in pieces:
        more = (100.0 * (rows[name][what] / own - 1.0) for what, own in rows[None].items())
        print(f"{name:18}" + "".join(f"{number:+15.0f} %" for number in more))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pieces", nargs="*", metavar="piece", help=", ".join(PIECES))
    parser.add_argument("--rounds", type=int, default=5, help="processes for each piece")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if unknown := set(chosen.pieces) - set(PIECES):
        parser.error(f"no piece {', '.join(sorted(unknown))}; there are {', '.join(PIECES)}")
    if chosen.here:
        print(json.dumps(here()))
    else:
        weigh(chosen.pieces or list(PIECES), chosen.rounds)


if __name__ == "__main__":
    main()
