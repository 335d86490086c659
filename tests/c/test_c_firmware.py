"""The app layer for a Crazyflie compiles, and what counts instructions keeps clear on a host too."""

import re
import shutil
import subprocess

import pytest
from house import ROOT

if shutil.which("cc") is None:
    pytest.skip("there is no C compiler, cc", allow_module_level=True)

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
APP = ROOT / "examples" / "onboard" / "crazyflie"
# The board of the host: it prints, and counts calls of its own clock.
HOST = """
#include "board.h"
#include <stdio.h>
static unsigned now;
void board_say(const char *text) { fputs(text, stdout); }
unsigned board_ticks(void) { return ++now; }
unsigned board_instructions(unsigned before, unsigned after) { return after - before; }
"""


def compiled(*words):
    subprocess.run(["cc", *map(str, words)], check=True)


def test_the_app_layer_compiles_against_the_stubs_in_float_and_promotes_nothing(tmp_path):
    flags = ("-std=c11", *WARNINGS, "-Wdouble-promotion", "-DQS_FLOAT", "-I", APP / "stubs", "-I", ROOT / "c")
    compiled(*flags, "-c", APP / "shield_app.c", "-o", tmp_path / "app.o")
    assert (tmp_path / "app.o").stat().st_size > 0


@pytest.mark.parametrize("real", [(), ("-DQS_FLOAT",)])
def test_the_counted_flights_keep_clear(tmp_path, real):
    (tmp_path / "board.c").write_text(HOST)
    firmware = ROOT / "c" / "firmware"
    sources = (tmp_path / "board.c", firmware / "count.c", ROOT / "c" / "quadsafe.c")
    flags = ("-std=c99", *WARNINGS, "-O2", "-ffp-contract=off", *real, "-I", ROOT / "c", "-I", firmware)
    compiled(*flags, *sources, "-lm", "-o", tmp_path / "count")
    told = subprocess.run([tmp_path / "count"], capture_output=True, text=True, check=True).stdout
    assert re.findall(r"^(\d+) 1500 1 1 (\d+) $", told, re.M) == [("1", "0"), ("4", "0"), ("10", "0")]
