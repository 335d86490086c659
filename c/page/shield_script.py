"""Compile the C shield and the plant of the page to WebAssembly: docs/crash-it/shield.js.

A page that is opened from a folder may fetch nothing, so the module stands in a script, as base64.
"""

import base64
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
OUT = ROOT / "docs" / "crash-it" / "shield.js"
SOURCES = ("c/page/plant.c", "c/quadsafe.c")
# WASI for its libm alone: the module imports nothing.
FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-O2", "-ffp-contract=off"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-gnu-folding-constant"),
    *("-Ic", "-DQS_MAX_OBSTACLES=24", "-Wl,--strip-all"),
)


def compiled() -> bytes:
    """The module, by the C compiler of the wheel ziglang."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "shield.wasm"
        subprocess.run(
            [sys.executable, "-m", "ziglang", "cc", *FLAGS, *SOURCES, "-o", str(out)], check=True, cwd=ROOT
        )
        return out.read_bytes()


def script(module: bytes) -> str:
    """A script that holds the module."""
    text = base64.b64encode(module).decode()
    return f'// Made by c/page/shield_script.py.\nconst SHIELD_WASM = "{text}";\n'


if __name__ == "__main__":
    OUT.write_text(script(compiled()))
