"""The wheel as a stranger has it: built, installed into a fresh environment, used from a folder of its own.

    python .ci/wheel.py [options of pip install, as -c constraints-cpu.txt]

Says a line for each step, when it is done, and ends with the first thing that is not as it should be: a module
that is missing, a warning, a picture that an index would not show. `make test-wheel` calls it.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from email.parser import Parser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("agents", "quadsafe", "quadsafe_core", "quadsafe_env", "shields")
URL = "https://example.org/us/quadsafe"
# A build folder would bring modules that are no more, an environment is large, and runs are nobody's business.
NOT_OF_THE_SOURCE = shutil.ignore_patterns(
    ".git", ".venv", "build", "logs", "*.egg-info", "__pycache__", ".*_cache"
)
BEGAN = time.perf_counter()
STEPS = 1_000  # of the example's 20,000
FILES = ("own_room.py", "own_room.json")
ENDS = ("--env-kwargs", "start:[0.8,0,1.2]", "goal:[6.2,0,1.2]")
PILOT = "def policy(observation):\n    return [*(4.0 * observation[:3]).clip(-1.0, 1.0), 0.0]\n"
IMPORTS = f"""
import sys
import agents, quadsafe, quadsafe_core, quadsafe_env, shields
for package in (agents, quadsafe, quadsafe_core, quadsafe_env, shields):
    assert package.__file__.startswith(sys.prefix), package.__file__
assert not [path for path in sys.path if path.startswith({str(ROOT)!r})], sys.path
for name in quadsafe.__all__:
    getattr(quadsafe, name)
"""


def main(options: list[str]) -> None:
    """Build, look, install, use."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder).resolve()
        # What others leave behind in the folder for temporary files, Stable-Baselines3's log say, goes with it.
        os.environ["TMPDIR"] = str(home)
        wheel = built(home)
        look_inside(wheel)
        tell(f"{wheel.name}: the modules of the tree, typed, its pictures where {URL} has them")
        python = installed(home, wheel, options)
        tell("installed into a fresh environment without a warning")
        stranger = home / "stranger"
        stranger.mkdir()
        look_around(python, stranger)
        tell("imported with warnings as errors, and the command quadsafe: silent, from a folder of its own")
        use(python, stranger)


def tell(what: str) -> None:
    """A line of what is done, and after how long."""
    print(f"{time.perf_counter() - BEGAN:4.0f} s  {what}", flush=True)


def built(home: Path) -> Path:
    """The wheel of a copy of the tree, as for a package index."""
    shutil.copytree(ROOT, home / "source", ignore=NOT_OF_THE_SOURCE)
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        str(home),
        "./source",
    ]
    subprocess.run(command, cwd=home, check=True, env={**os.environ, "PROJECT_URL": URL})
    (wheel,) = home.glob("*.whl")
    return wheel


def look_inside(wheel: Path) -> None:
    """The wheel has every module, ``py.typed`` and the plants' files, nothing else, and says what it is."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(about).decode("utf-8"))
    tree = {path.relative_to(ROOT).as_posix() for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    plants = ROOT / "quadsafe_env/plants"
    data = [path for ending in ("json", "c") for path in plants.glob(f"*.{ending}")]
    tree |= {path.relative_to(ROOT).as_posix() for path in data}
    expected = tree | {"train.py"} | {f"{name}/py.typed" for name in PACKAGES}
    assert names == expected, (
        f"the wheel must have the modules of the tree, differs in {sorted(names ^ expected)[:9]}"
    )
    assert "Typing :: Typed" in metadata.get_all("Classifier", [])
    assert any(URL in link for link in metadata.get_all("Project-URL", []))
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", str(metadata.get_payload()))
    assert pictures, "the README must have a picture"
    for link in pictures:
        shown, path = link.partition(f"{URL}/raw/HEAD/")[1:]
        assert shown and (ROOT / path).is_file(), f"a picture must be a file of {URL}, got {link}"


def installed(home: Path, wheel: Path, options: list[str]) -> Path:
    """The interpreter of a fresh environment with the wheel and what a film takes."""
    subprocess.run([sys.executable, "-m", "venv", home / "venv"], check=True)
    python = home / "venv/bin/python"
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    subprocess.run([*pip, *options, f"{wheel}[video]"], cwd=ROOT, check=True)
    # Once more alone: what is said of other packages and of an index is not ours.
    again = [*pip, "--no-deps", "--no-index", "--force-reinstall", wheel]
    said = subprocess.run(again, check=True, capture_output=True, text=True)
    assert not said.stdout + said.stderr, f"an install must be silent, said {said.stdout + said.stderr}"
    subprocess.run([python, "-m", "pip", "check"], check=True, stdout=subprocess.DEVNULL)
    return python


def look_around(python: Path, folder: Path) -> None:
    """Import all of it with warnings as errors, and ask the command: neither says more than it was asked."""
    told = said(folder, python, "-W", "error", "-c", IMPORTS, stderr=subprocess.STDOUT)
    assert not told, f"an import must be silent, said {told}"
    told = said(folder, python.with_name("quadsafe"), "--version", stderr=subprocess.STDOUT)
    assert re.fullmatch(r"quadsafe \S+\n", told), told


def use(python: Path, folder: Path) -> None:
    """Run the example and the command side by side, as each compiles on one core; all is written into logs."""
    for name in FILES:
        shutil.copy(ROOT / "examples" / name, folder)
    (folder / "pilot.py").write_text(PILOT, encoding="utf-8")
    with ThreadPoolExecutor() as pool:
        for done in [pool.submit(way, python, folder) for way in (run_the_example, run_the_command)]:
            done.result()
    written = {path.name for path in folder.iterdir()} - {"__pycache__"}
    assert written == {*FILES, "pilot.py", "logs"}, f"all must be written into logs, got {sorted(written)}"


def run_the_example(python: Path, folder: Path) -> None:
    """From a user's map to a table, a report and a film."""
    told = said(folder, python, "own_room.py", "--steps", str(STEPS))
    logs = folder / "logs/own_room"
    assert "[<= " in told and "given policy" in told, told
    for name in ("flight.mp4", "sac.zip"):
        assert str(Path("logs/own_room") / name) in told and (logs / name).stat().st_size > 10_000, told
    (report,) = logs.glob("*/report.html")
    assert report.stat().st_size > 1_000_000
    tell(f"own_room.py: from a map through {STEPS:,} steps to a table, a report and a film")


def run_the_command(python: Path, folder: Path) -> None:
    """Evaluate a function of one's own, and draw the map."""
    quadsafe = python.with_name("quadsafe")
    told = said(folder, quadsafe, "evaluate", "pilot:policy", "--eval-episodes", "4")
    assert "given policy" in told, told
    tell("quadsafe evaluate: flew a function of pilot.py")
    assert "2 scenes" in said(folder, quadsafe, "map", "own_room.json", "--flights", "2", *ENDS)
    tell("quadsafe map: drew own_room.json")


def said(folder: Path, *command: str | Path, stderr: int | None = None) -> str:
    """What a command prints, run from a folder with nothing of this process's paths."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        command, cwd=folder, env=clean, check=False, stdout=subprocess.PIPE, stderr=stderr, text=True
    )
    assert not done.returncode, f"{command} must succeed, ended with {done.returncode}: {done.stdout}"
    return done.stdout


if __name__ == "__main__":
    main(sys.argv[1:])
