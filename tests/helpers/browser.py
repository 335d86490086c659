"""A headless Chromium, driven through the pipe of its developer tools."""

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest

CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="needs Debian's chromium: apt-get install --no-install-recommends chromium"
)

QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    # WebGL without a graphics card.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
ENDS = 120.0  # s, after which a browser that does not answer has failed


class Page(NamedTuple):
    """What a browser made of a page: its document, the errors of its console, what it asked for."""

    dom: str
    errors: list[str]
    requests: list[str]


def opened(path: Path, profile: Path, width: int = 1200, until: str = "true") -> Page:
    """Open a file in a browser of its own.

    Args:
        path: of the page.
        profile: folder for what the browser keeps.
        width: of the window, px.
        until: expression that becomes true when the page is ready, after it was loaded.
    """
    with Browser(profile) as browser:
        browser.open(path, width)
        browser.until(until)
        return Page(browser.ask("document.documentElement.outerHTML"), browser.errors, browser.requests)


class Browser:
    """One tab; ``errors`` and ``requests`` hold what its console and its network told since the start."""

    def __init__(self, profile: Path):
        theirs_in, self._write = os.pipe()
        self._read, theirs_out = os.pipe()
        # The browser reads file 3 and writes file 4; other shells know no files above 9.
        command = f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}'
        assert CHROMIUM is not None
        arguments = [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"]
        self._process = subprocess.Popen(
            ["bash", "-c", command, "bash", *arguments],
            pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._ids, self._rest, self._session, self._events = itertools.count(1), b"", None, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.terminate()
        self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def call(self, method: str, **parameters):
        """The answer to a command of the protocol."""
        message = {"id": next(self._ids), "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._message()).get("id") != message["id"]:
            self._events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def open(self, path: Path, width: int, height: int = 900) -> None:
        """Open a file in a window of this size, until it is loaded."""
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.call("Emulation.setDeviceMetricsOverride", **screen)
        self.call("Page.navigate", url=path.as_uri())
        self.until("document.readyState === 'complete' && location.protocol === 'file:'")

    def ask(self, script: str):
        """The value of an expression, awaited if it is a promise."""
        told = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told
        return told["result"].get("value")

    def until(self, script: str) -> None:
        """Wait for an expression to be true."""
        end = time.monotonic() + ENDS
        while not self.ask(script):
            assert time.monotonic() < end, f"{script} must become true"
            time.sleep(0.05)

    def screenshot(self, path: Path, selector: str) -> Path:
        """A picture of one element, all of it."""
        box = self.ask(
            f"(({{x, y, width, height}}) => ({{x: x + scrollX, y: y + scrollY, width, height}}))"
            f"(document.querySelector({selector!r}).getBoundingClientRect())"
        )
        clip = {**box, "scale": 1}
        picture = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)["data"]
        path.write_bytes(base64.b64decode(picture))
        return path

    @property
    def errors(self) -> list[str]:
        """Errors and uncaught exceptions of the console."""
        told = [(event.get("method"), event.get("params")) for event in self._events]
        return [
            json.dumps(event)
            for method, event in told
            if method == "Runtime.exceptionThrown"
            or (method == "Runtime.consoleAPICalled" and event["type"] in ("error", "assert"))
            or (method == "Log.entryAdded" and event["entry"]["level"] == "error")
        ]

    @property
    def requests(self) -> list[str]:
        """Addresses that were asked for, but those that hold their own data."""
        sent = [event["params"] for event in self._events if event.get("method") == "Network.requestWillBeSent"]
        urls = [parameters["request"]["url"] for parameters in sent]
        return [url for url in urls if not url.startswith(("data:", "blob:"))]

    def _message(self):
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._read], [], [], ENDS)
            part = os.read(self._read, 1 << 20) if ready else b""
            assert part, "the browser must answer"
            self._rest += part
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)
