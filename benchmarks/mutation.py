"""How many small faults of shields/ the tests notice: mutation testing with the JIT off.

    python benchmarks/mutation.py                          the first 300 mutants, into logs/data/mutation.csv
    python benchmarks/mutation.py --out docs/data/mutation.csv    those of the page
    python benchmarks/mutation.py --skip 300 --count 150   the next ones: a fresh sample
    python benchmarks/mutation.py --again                  the survivors once more
    python benchmarks/mutation.py --out docs/data/mutation_later.csv    a sample of other sources
    python benchmarks/mutation.py --table                  the tables of docs/mutation.md, from docs/data

All mutants (benchmarks/mutants.py) are put in one random order. Each changes one place of a copy of the tree;
then the interpreted tests that execute its lines run until the first fails. A run that was cut off goes on
where it stopped. What no test can tell from the original is in benchmarks/mutation_equivalents.yml, with why.
"""

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import coverage
import yaml
from mutants import Mutant, shuffled_mutants
from safety_campaign.results import ROOT
from safety_campaign.tables import filled, markdown

CSV, PAGE = ROOT / "docs/data/mutation.csv", ROOT / "docs/mutation.md"
# A fresh sample of later sources, in an order of their own.
LATER = ROOT / "docs/data/mutation_later.csv"
EQUIVALENTS = ROOT / "benchmarks/mutation_equivalents.yml"
COLUMNS = ["draw", "file", "line", "was", "becomes", "status", "test"]
SEED = 0  # of the order of all mutants
SAMPLE = 300  # mutants for which tests were written; later draws are fresh
TIME_LIMIT = 180  # s; all the tests together need a third of it
LEFT_OUT = (".git", ".venv", "build", "docs", "logs", "__pycache__", "*.egg-info")


def pytest(tree: Path, limit: float, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A run of pytest in a copy of the tree, in which mutants leave no byte code."""
    environment = os.environ | {
        "PYTHONPATH": str(tree),
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-m", "pytest", "-x", "-rfE", "--tb=no", "--hypothesis-seed=0", *arguments]
    return subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, timeout=limit, check=False
    )


def tests_of_lines(tree: Path) -> dict[tuple[str, int], set[str]]:
    """The tests that execute each line; all of them for a line that runs at import."""
    data = tree / ".coverage"
    os.environ["COVERAGE_FILE"] = str(data)
    run = pytest(
        tree, 4 * TIME_LIMIT, "-m", "interpreted", "--cov=shields", "--cov-context=test", "--cov-report="
    )
    if run.returncode != 0:
        raise SystemExit(f"the tests must pass before a mutant is made:\n{run.stdout}{run.stderr}")
    measured = coverage.CoverageData(str(data))
    measured.read()
    found = {}
    for path in (tree / "shields").rglob("*.py"):
        for line, contexts in measured.contexts_by_lineno(str(path)).items():
            found[path.relative_to(tree).as_posix(), line] = {context.partition("|")[0] for context in contexts}
    everything = set().union(*found.values()) - {""}
    return {place: everything if "" in tests else tests for place, tests in found.items()}


def verdict(tree: Path, mutant: Mutant, tests: list[str]) -> tuple[str, str]:
    """What became of a mutant, and the first test that failed."""
    if not tests:
        return "not covered", ""
    path, chosen = tree / mutant.file, tree / "tests.txt"
    source = path.read_text(encoding="utf-8")
    chosen.write_text("\n".join(tests), encoding="utf-8")
    shutil.rmtree(tree / ".hypothesis", ignore_errors=True)
    try:
        path.write_text(mutant.applied(source), encoding="utf-8")
        run = pytest(tree, TIME_LIMIT, f"@{chosen}")
    except subprocess.TimeoutExpired:
        return "time-out", ""
    finally:
        path.write_text(source, encoding="utf-8")
    if run.returncode == 0:
        return "survived", ""
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", run.stdout, re.M)
    return "killed", failed[1] if failed else "import"


def rows_of(path: Path) -> list[dict[str, str]]:
    """The mutants of a CSV, none if there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def run(mutants: dict[int, Mutant], again: bool, path: Path) -> None:
    """Run the mutants that have no row in the CSV yet, and with ``again`` those that survived."""
    rows = {int(row["draw"]): row for row in rows_of(path)}
    told = {draw: mutant.told((ROOT / mutant.file).read_text("utf-8")) for draw, mutant in mutants.items()}
    fresh = {d for d in told if d not in rows or any(rows[d][name] != text for name, text in told[d].items())}
    path.parent.mkdir(parents=True, exist_ok=True)
    todo = fresh | {d for d in told if again and d in rows and rows[d]["status"] in ("survived", "not covered")}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*LEFT_OUT))
        tests = tests_of_lines(tree)
        for draw in sorted(todo):
            mutant = mutants[draw]
            chosen = set().union(*(tests.get((mutant.file, line), set()) for line in mutant.lines))
            status, test = verdict(tree, mutant, sorted(chosen))
            rows[draw] = {"draw": str(draw), **told[draw], "status": status, "test": test}
            print(draw, mutant.file, mutant.start[0], status, test, flush=True)
            with path.open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows[d] for d in sorted(rows))


def is_equivalent(row: dict[str, str]) -> bool:
    """Whether a mutant is listed with the reason why no test can tell it from the original."""
    place = {name: row[name] for name in ("file", "was", "becomes")} | {"line": int(row["line"])}
    return any(place.items() <= item.items() for item in yaml.safe_load(EQUIVALENTS.read_text("utf-8")))


def lives(row: dict[str, str]) -> bool:
    return row["status"] in ("survived", "not covered")


def samples() -> dict[str, list[dict[str, str]]]:
    """The results, by sample."""
    first = rows_of(CSV)
    return {
        f"the {SAMPLE} that the tests were written for": [r for r in first if int(r["draw"]) < SAMPLE],
        "drawn afterwards": [r for r in first if int(r["draw"]) >= SAMPLE],
        "drawn of the later sources": rows_of(LATER),
    }


def scores(parts: dict[str, list[dict[str, str]]]) -> str:
    """Every sample: counts, and the share that the tests noticed, of all and of those that they can."""
    body = []
    for name, part in parts.items():
        alive = [row for row in part if lives(row)]
        same = sum(map(is_equivalent, alive))
        counts = [
            len(part),
            len(part) - len(alive),
            sum(r["status"] == "time-out" for r in part),
            len(alive),
            same,
        ]
        shares = [100 * counts[1] / max(n, 1) for n in (len(part), len(part) - same)]
        body.append([name, *map(str, counts), *(f"{share:.1f} %" for share in shares)])
    header = "sample, mutants, killed, of these by time-out, alive, of these equivalent, killed of all, "
    return markdown((header + "killed of the others").split(", "), body)


def survivors(parts: dict[str, list[dict[str, str]]]) -> str:
    """The mutants that live and are not known to be equivalent."""
    alive = [row for part in parts.values() for row in part if lives(row) and not is_equivalent(row)]
    body = [
        [f"`{r['file']}`", r["line"], *(f"`{r[k]}`".replace("|", "\\|") for k in ("was", "becomes"))]
        for r in alive
    ]
    return markdown(["file", "line", "was", "becomes"], body)


def main() -> None:
    parser = argparse.ArgumentParser(description="Count the small faults of shields/ that the tests notice.")
    parser.add_argument("--skip", type=int, default=0, help="mutants of that order to pass over")
    parser.add_argument("--count", type=int, default=SAMPLE, help="mutants to run")
    parser.add_argument("--out", type=Path, default=ROOT / "logs/data/mutation.csv", help="the results")
    parser.add_argument("--again", action="store_true", help="also run survivors again")
    parser.add_argument("--table", action="store_true", help="fill in the page from docs/data, run nothing")
    options = parser.parse_args()
    if not options.table:
        order = dict(enumerate(shuffled_mutants(ROOT / "shields", SEED)))
        run(
            {d: order[d] for d in range(options.skip, options.skip + options.count)}, options.again, options.out
        )
        print(scores({"in this file": rows_of(options.out)}))
        print("Written:", options.out)
        return
    parts = samples()
    tables = {"scores": lambda _: scores(parts), "survivors": lambda _: survivors(parts)}
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), [], tables), encoding="utf-8")
    print(scores(parts))
    print("Written:", PAGE)


if __name__ == "__main__":
    main()
