"""The wheel as a stranger has it: built, installed into a fresh environment, used from a folder of its own.

    python .ci/wheel.py [options of pip install, as -c constraints-cpu.txt]

Ends with the first thing that is not as it should be. `make test-wheel` calls it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from email.parser import Parser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("agents", "quadsafe", "quadsafe_core", "quadsafe_env", "shields")
URL = "https://example.org/us/quadsafe"
# A build folder would bring modules that are no more, an environment is large, and runs are nobody's business.
NOT_OF_THE_SOURCE = shutil.ignore_patterns(
    ".git", ".venv", "build", "logs", "*.egg-info", "__pycache__", ".*_cache"
)
STEPS = 1_000  # of the example's 20,000
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
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder).resolve()
        wheel = built(home)
        look_inside(wheel)
        print(f"{wheel.name}: as the tree; {time.perf_counter() - began:.0f} s", flush=True)
        python = installed(home, wheel, options)
        print(f"installed without a warning; {time.perf_counter() - began:.0f} s", flush=True)
        use(python, home / "stranger")
    print(f"used from a folder of its own; {time.perf_counter() - began:.0f} s")


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
    """The wheel has every module and ``py.typed``, nothing else, and says what it is."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(about).decode("utf-8"))
    tree = {path.relative_to(ROOT).as_posix() for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    expected = tree | {"train.py"} | {f"{name}/py.typed" for name in PACKAGES}
    assert names == expected, (
        f"the wheel must have the modules of the tree, differs in {sorted(names ^ expected)[:9]}"
    )
    assert "Typing :: Typed" in metadata.get_all("Classifier", [])
    assert any(URL in link for link in metadata.get_all("Project-URL", []))
    assert f"]({URL}/raw/HEAD/docs/figures/flight.webp)" in metadata.get_payload()


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


def use(python: Path, folder: Path) -> None:
    """Import it, ask the command, and run the example from a user's map to a film."""
    folder.mkdir()
    for name in ("own_room.py", "own_room.json"):
        shutil.copy(ROOT / "examples" / name, folder)
    (folder / "pilot.py").write_text(PILOT, encoding="utf-8")
    quadsafe = str(python.with_name("quadsafe"))
    assert said(folder, quadsafe, "--version").startswith("quadsafe ")
    said(folder, python, "-W", "error", "-c", IMPORTS)
    told = said(folder, python, "own_room.py", "--steps", str(STEPS))
    assert "[<= " in told and "given policy" in told, told
    for name in ("flight.mp4", "sac.zip"):
        assert (
            str(Path("logs/own_room") / name) in told
            and (folder / "logs/own_room" / name).stat().st_size > 10_000
        )
    (report,) = (folder / "logs/own_room").glob("*/report.html")
    assert report.stat().st_size > 1_000_000
    assert "2 scenes" in said(folder, quadsafe, "map", "own_room.json", "--flights", "2", *ENDS)
    told = said(folder, quadsafe, "evaluate", "pilot:policy", "--eval-episodes", "4")
    assert "with shield" in told or "given policy" in told, told
    assert {path.name for path in folder.iterdir()} - {"__pycache__"} == {
        "own_room.py",
        "own_room.json",
        "pilot.py",
        "logs",
    }


def said(folder: Path, *command: str | Path) -> str:
    """What a command prints, run from a folder with nothing of this process's paths."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(command, cwd=folder, env=clean, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    main(sys.argv[1:])
