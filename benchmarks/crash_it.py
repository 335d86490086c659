"""How long the script of the page "Try to crash it" takes a frame, in a browser without a graphics card.

The attack pilot flies. Frames in which shaders were compiled are left out. Beside the time on the clock, which
others on the machine make longer, stands the mean of the processor time of the page's thread.
"""

import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))

from browser import Browser  # noqa: E402 # pyright: ignore[reportMissingImports]

SIZES = {"phone": (390, 844), "desktop": (1280, 720)}
WARM_UP, MEASURED = 6.0, 10.0  # s
TOLD = """(() => {
    const work = [...page.work].sort((a, b) => a - b);
    const at = (share) => work[Math.floor(share * (work.length - 1))];
    return [work.length, at(0.5), at(0.99)];
})()"""


def script_time(browser: Browser) -> float:
    """Processor time of all scripts so far, s."""
    metrics = browser.call("Performance.getMetrics")["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "ScriptDuration")


def measured(browser: Browser, width: int, height: int) -> tuple[int, float, float, float]:
    """Frames, the median and 99 % of their script and the mean of its processor time, ms."""
    browser.open(ROOT / "docs" / "crash-it" / "index.html", width, height)
    browser.ask("page.press('attack')")
    time.sleep(WARM_UP)
    begun = script_time(browser)
    browser.ask("page.work.length = 0")
    time.sleep(MEASURED)
    frames, median, most = browser.ask(TOLD)
    return frames, median, most, 1e3 * (script_time(browser) - begun) / frames


def main():
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile)) as browser:
        browser.call("Performance.enable", timeDomain="threadTicks")
        for name, size in SIZES.items():
            frames, median, most, cpu = measured(browser, *size)
            clock = f"{median:.1f} ms, 99 % {most:.1f} ms"
            print(f"{name} {size}: {frames / MEASURED:.0f} frames/s, {clock}, mean {cpu:.1f} ms of a core")


if __name__ == "__main__":
    main()
