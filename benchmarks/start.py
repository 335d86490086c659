"""How long a start takes, in new processes: ``python benchmarks/start.py [--cold]``.

Import, first step with a warm cache, and with ``--cold`` everything that the default training flies compiled
from nothing, in a copy of the sources. Medians of five; the cold start is measured once.
"""

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IMPORT = "import quadsafe_env"
FIRST = (
    "import gymnasium, quadsafe_env; from shields import ShieldWrapper; "
    "env = ShieldWrapper(gymnasium.make('QuadSafe/Avoid-v0')); "
    "env.reset(seed=0); env.step(env.action_space.sample())"
)
VECTOR = (
    "import gymnasium, numpy, quadsafe_env; from shields import VectorShieldWrapper\n"
    "for shield in (False, True):\n"
    "    env = gymnasium.make_vec('QuadSafe/Avoid-v0', 64)\n"
    "    env = VectorShieldWrapper(env) if shield else env\n"
    "    env.reset(seed=0)\n"
    "    for _ in range(60): env.step(env.action_space.sample())"
)


def seconds(code: str, folder: str | None = None) -> float:
    """Wall time of a new process that runs the code in a folder, s."""
    started = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, cwd=folder)
    return time.perf_counter() - started


def median(code: str) -> float:
    """Median of five, after one that warms the cache."""
    seconds(code)
    return statistics.median(seconds(code) for _ in range(5))


def main() -> None:
    parser = argparse.ArgumentParser(description="Time imports, the first step, and compilation.")
    parser.add_argument("--cold", action="store_true", help="also compile everything from nothing")
    is_cold = parser.parse_args().cold
    nothing = median("pass")
    print(f"python -c pass                         {nothing:7.2f} s")
    print(f"import quadsafe_env                    {median(IMPORT) - nothing:7.2f} s more")
    print(f"make, shield, reset, step, warm cache  {median(FIRST):7.2f} s in all")
    if is_cold:
        print(f"default rows, all compiled anew        {cold():7.2f} s in all")


def cold() -> float:
    """Wall time of rows with and without the shield from sources that were never compiled, s."""
    with tempfile.TemporaryDirectory() as folder:
        for room in ("quadsafe_core", "quadsafe_env", "shields"):
            shutil.copytree(ROOT / room, Path(folder) / room, ignore=shutil.ignore_patterns("__pycache__"))
        return seconds(VECTOR, folder)


if __name__ == "__main__":
    main()
