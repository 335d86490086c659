"""What the C shield costs on a microcontroller: instructions a call and a period length, flash, stack.

    python benchmarks/firmware.py            # make firmware
    python benchmarks/firmware.py --out docs/data/onboard.csv

It takes Debian's gcc-arm-none-eabi and qemu-system-arm. QEMU counts instructions, not cycles: 1,500 control
periods among 1, 4 and 10 spheres, flown at the nearest at full speed, every third second by random snaps. The
stack is the deepest path of the call graph that the compiler writes, with what each function takes: of a call
among other bodies than hulls, among any, and of one that has to prepare a new period.
"""

import argparse
import csv
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
COMPILER, SIMULATOR, SIZES = "arm-none-eabi-gcc", "qemu-system-arm", "arm-none-eabi-size"
HEAD = """\
| processor | reals | level | spheres | instructions | most | flash, B | stack, B | with hulls | new period |
|---|---|---|---:|---:|---:|---:|---:|---:|---:|"""
SHOWN = ("mean", "most", "flash", "stack_no_hull", "stack", "stack_preparing")
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
FLAGS = ["-std=c99", *WARNINGS, "-mthumb", "-ffunction-sections", "-ffp-contract=off"]
HARNESS_FLAGS = [flag for flag in FLAGS if flag != "-Wpedantic"]
LINK = ["-nostartfiles", "-Wl,--gc-sections", "-lm"]


class Target(NamedTuple):
    """A processor, its floats, what the compiler is to look at, and the board that QEMU has of it."""

    name: str
    processor: str
    real: str
    level: str
    board: str

    def flags(self) -> list[str]:
        """For the compiler."""
        return [*self.processor.split(), self.level, "-mfloat-abi=hard", *REALS[self.real]]


# What a program for spheres calls; the shapes come with the filter.
ROOTS = ("qs_defaults", "qs_init", "qs_prepare", "qs_sphere", "qs_filter", "qs_backup")
PREPARED = ("errors", "pushes", "a lag in an interval", "jitter", "both of these")
REALS = {"float": ["-DQS_FLOAT"], "double": []}
M4, M7 = "-mcpu=cortex-m4 -mfpu=fpv4-sp-d16", "-mcpu=cortex-m7 -mfpu=fpv5-d16"
TARGETS = (
    Target("Cortex-M4F", M4, "float", "-O2", "mps2-an386"),
    Target("Cortex-M4F", M4, "float", "-Os", "mps2-an386"),
    Target("Cortex-M4F", M4, "double", "-O2", "mps2-an386"),
    Target("Cortex-M7", M7, "float", "-O2", "mps2-an500"),
    Target("Cortex-M7", M7, "double", "-O2", "mps2-an500"),
)


def run(*command: str | Path, cwd: Path = ROOT) -> str:
    """What a command prints; an error with what it said where it fails."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{command[0]} failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def library(target: Target, folder: Path) -> list[Path]:
    """Objects of the library, with the stack of its functions and their calls beside them."""
    objects = []
    for source in sorted((ROOT / "c").glob("*.c")):
        objects.append(folder / f"{source.stem}.o")
        flags = [*FLAGS, *target.flags(), "-fcallgraph-info=su", "-c"]
        run(COMPILER, *flags, source, "-o", objects[-1])
    return objects


def deepest(folder: Path, entry: str, *without: str) -> int:
    """Bytes of stack of the deepest path of calls from a function, without those of others."""
    own: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for graph in folder.glob("*.ci"):
        text = graph.read_text()
        for title, label in re.findall(r'node: { title: "([^"]+)" label: "([^"]*)"', text):
            found = re.search(r"(\d+) bytes", label)
            own[title] = int(found.group(1)) if found else own.get(title, 0)
        for caller, called in re.findall(r'edge: { sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            calls.setdefault(caller, set()).add(called)

    def depth(name: str, above: tuple[str, ...]) -> int:
        if name in above:
            raise SystemExit(f"{name} calls itself by way of {above[-1]}")
        # The compiler may have split them.
        called = (one for one in calls.get(name, ()) if not any(other in one for other in without))
        return own.get(name, 0) + max((depth(one, (*above, name)) for one in called), default=0)

    return depth(entry, ())


def flash_of(target: Target, objects: list[Path], folder: Path) -> int:
    """Bytes of the library and of what it takes of libm and libgcc, nothing else."""
    roots = [f"-Wl,-u,{name}" for name in ROOTS]
    image = folder / "library.elf"
    run(COMPILER, *target.flags(), "-mthumb", *roots, "-Wl,-e,qs_filter", *objects, *LINK, "-o", image)
    return int(run(SIZES, image).splitlines()[1].split()[0])


def measured(target: Target, folder: Path) -> tuple[list[dict[str, Any]], list[int]]:
    """Rows of the table, one for each number of spheres; instructions of ``qs_prepare``, in float."""
    folder.mkdir(parents=True, exist_ok=True)
    objects = library(target, folder)
    image, sources = folder / "count.elf", [ROOT / "c/firmware/board.c", ROOT / "c/firmware/count.c"]
    script = ["-I", ROOT / "c", "-T", ROOT / "c/firmware/cortex.ld"]
    run(COMPILER, *HARNESS_FLAGS, *target.flags(), *script, *sources, *objects, *LINK, "-o", image)
    machine = ["-M", target.board, "-nographic", "-monitor", "none", "-serial", "none"]
    machine += ["-semihosting-config", "enable=on,target=native", "-icount", "shift=7"]
    told = run(SIMULATOR, *machine, "-kernel", image)
    flash = flash_of(target, objects, folder)
    stack = {
        "stack_no_hull": deepest(folder, "qs_filter", "qs_prepare", "nearest_of_hull"),
        "stack": deepest(folder, "qs_filter", "qs_prepare"),
        "stack_preparing": deepest(folder, "qs_filter"),
    }
    rows, where = [], {"target": target.name, "real": target.real, "level": target.level}
    lines = [[int(word) for word in line.split()] for line in told.splitlines()]
    for line in lines[:3]:
        found = dict(zip(("spheres", "calls", "mean", "most", "violated"), line, strict=True))
        rows.append({**where, **found, "flash": flash, **stack})
    return rows, [used for line in lines[3:] for used in line]


def main() -> None:
    """Every target; a table, and a CSV file where one is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "logs/firmware/onboard.csv", help="CSV file")
    given = parser.parse_args()
    missing = [name for name in (COMPILER, SIMULATOR, SIZES) if shutil.which(name) is None]
    if missing:
        print(f"skipped: {', '.join(missing)} not found; Debian has gcc-arm-none-eabi and qemu-system-arm")
        sys.exit(0)
    folder = ROOT / "logs/firmware"
    found = [measured(one, folder / f"{one.name}-{one.real}{one.level}") for one in TARGETS]
    rows = [row for rows, _ in found for row in rows]
    print(HEAD)
    for row in rows:
        where = f"{row['target']} | {row['real']} | `{row['level']}` | {row['spheres']}"
        print(f"| {where} | {' | '.join(f'{row[name]:,}' for name in SHOWN)} |")
    print(
        "\n| processor | reals | level | "
        + " | ".join(PREPARED)
        + " |\n|---|---|---|"
        + "---:|" * len(PREPARED)
    )
    for target, (_, used) in zip(TARGETS, found, strict=True):
        if used:
            millions = " | ".join(f"{one / 1e6:.0f}" for one in used)
            print(f"| {target.name} | {target.real} | `{target.level}` | {millions} |")
    with given.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    if any(row["violated"] for row in rows):
        raise SystemExit("a flight violated")


if __name__ == "__main__":
    main()
