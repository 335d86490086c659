"""The process of a firmware: what is refused before one flies."""

import shutil
import socket
import sys
from pathlib import Path

import pytest

from quadsafe_env.plants import sitl

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)


def folders():
    return set(Path(sitl.tempfile.gettempdir()).glob("sitl-*"))


# One test, as the ports are the same.
def test_a_firmware_that_ends_at_once_a_port_in_use_and_no_compiler_are_sentences(monkeypatch, tmp_path):
    before = folders()
    ended = Path(str(shutil.which("false")))
    with pytest.raises(RuntimeError, match="betaflight must start, it ended"):
        sitl.Sitl(ended, [])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((sitl.HOST, sitl.STATE))
        with pytest.raises(RuntimeError, match="port 9003 must be free"):
            sitl.Sitl(ended, [])
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="the clock of betaflight must compile, cc "):
        sitl.Sitl(ended, [])
    # Nothing is left of them.
    assert folders() == before
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((sitl.HOST, sitl.MOTORS))
