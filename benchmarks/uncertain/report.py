"""The tables of docs/robustness.md and its picture, from the results."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safety_campaign.tables import Row, filled, markdown, rate
from scipy.stats import binomtest

from shields import Uncertainty
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.tube import tube_of

# A shield with free numbers as it comes: ū = 200 m/s⁴, reserve 3.
LIMITS = FlightLimits(600.0, 600.0, math.inf, ThrustBand(1.0, math.inf, 9.81))
COLORS = {"none": "#70757d", "untold": "#d55e00", "told": "#0072b2", "told exactly": "#009e73"}
LABELS = {
    "none": "no shield",
    "untold": "shield, told of nothing",
    "told": "shield, told of the bound",
    "told exactly": "shield, told of the delay itself",
}
# What grows along the axis of each panel: title, unit, value at level 1, digits.
PANELS = {
    "noise": ("noise of the position, and 3/s of it as velocity", "mm", 5.0),
    "bias": ("bias of the position", "mm", 10.0),
    "delay": ("delay at 100 Hz", "periods", 2.0),
    "loss": ("answers lost", "%", 10.0),
    "gain": ("gain error, at most", "%", 5.0),
    "mass": ("mass error, at most", "%", 2.0),
    "wind": ("wind", "m/s²", 0.3),
    "jitter": ("jitter of the period, at most", "%", 10.0),
    "rotor lag": ("rotor lag", "ms", 10.0),
}
UNITS = ("m", "m/s", "m/s²", "m/s³", "m/s⁴", "", "m/s²")


def write(rows: list[Row], page: Path, figure: Path, kinds: Mapping[str, Uncertainty]) -> None:
    """Fill in the tables of the page, and draw."""
    makers = {
        "chain": lambda rows: chain_table(rows, kinds),
        "body": body_table,
        "cost": lambda rows: cost_table(rows, kinds),
        "free flight": free_flight_table,
        "inner": inner_table,
        "randomised": randomised_table,
    }
    page.write_text(filled(page.read_text(encoding="utf-8"), rows, makers), encoding="utf-8")
    draw(rows, figure)


def rows_with(rows: list[Row], **wanted: str) -> list[Row]:
    """The rows with these entries."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def only(rows: list[Row], **wanted: str) -> Row:
    """The row with these entries."""
    (row,) = rows_with(rows, **wanted)
    return row


def described(bounds: Uncertainty) -> str:
    """The bounds that are not 0."""
    parts = [
        f"{name} {value:g} {unit}".rstrip()
        for name, value, unit in zip(bounds._fields[:7], bounds[:7], UNITS, strict=True)
        if value
    ]
    parts += [f"delay {bounds.delay} period"] if bounds.delay else []
    return ", ".join([*parts, *(["losses"] if bounds.losses else [])])


def width(bounds: Uncertainty, hz: int) -> float:
    """T_r, mm."""
    return 1e3 * float(tube_of(bounds, 1.0 / hz, LIMITS).deviation[0])


def counted(row: Row, total: str = "episodes", count: str = "violated_episodes") -> str:
    """A count and its share; beside a zero its exact bound."""
    return rate(int(row[count]), int(row[total]))


def chain_table(rows: list[Row], kinds: Mapping[str, Uncertainty]) -> str:
    """The bare chain within the bounds: told, and not told."""
    header = ("bounds", "Hz", "T_r, mm", "control steps", "told: violated steps", "uncertified steps")
    body = []
    for kind, bounds in kinds.items():
        for hz in (50, 200):
            found = only(rows, part="chain", kind=kind, rate=str(hz), arm="told")
            untold = only(rows, part="chain", kind=kind, rate=str(hz), arm="untold")
            body.append(
                [
                    f"{kind}: {described(bounds)}" if hz == 50 else "",
                    str(hz),
                    f"{width(bounds, hz):.1f}",
                    f"{int(found['steps']):,}",
                    counted(found, "steps", "violated_steps"),
                    counted(found, "steps", "uncertified"),
                    counted(untold),
                ]
            )
    return markdown((*header, "not told: violated episodes"), body)


def body_table(rows: list[Row]) -> str:
    """The rigid body within the bounds."""
    header = ("conditions", "Hz", "control steps", "told: violated flights", "uncertified steps")
    body = []
    for row in rows_with(rows, part="body", arm="told"):
        others = [
            counted(only(rows, part="body", kind=row["kind"], rate=row["rate"], arm=arm))
            for arm in ("untold", "none")
        ]
        cells = [row["kind"], row["rate"], f"{int(row['steps']):,}", counted(row)]
        body.append([*cells, counted(row, "steps", "uncertified"), *others])
    return markdown((*header, "not told: violated flights", "no shield"), body)


def cost_table(rows: list[Row], kinds: Mapping[str, Uncertainty]) -> str:
    """What being told costs when there is nothing to fear: clearance and speed of the same attack."""
    header = (
        "told of",
        "Hz",
        "T_r, mm",
        "median clearance, mm",
        "of a shield that knows, mm",
        "given away, mm",
    )
    body = []
    for kind, bounds in kinds.items():
        for hz in (50, 200):
            told, known = (
                only(rows, part="cost", kind=kind, rate=str(hz), arm=arm) for arm in ("told", "untold")
            )
            far, near = (1e3 * float(row["median_clearance"]) for row in (told, known))
            speeds = [f"{float(row['mean_speed']):.2f}" for row in (told, known)]
            cells = [
                kind,
                str(hz),
                f"{width(bounds, hz):.1f}",
                f"{far:.1f}",
                f"{near:.1f}",
                f"{far - near:.1f}",
            ]
            body.append([*cells, " / ".join(speeds)])
    return markdown((*header, "mean speed, m/s"), body)


def free_flight_table(rows: list[Row]) -> str:
    """The rigid body without any error, by what the shield was told."""
    header = ("told of", "flights", "violated", "arrived", "median time, s", "mean speed, m/s")
    body = []
    for row in rows_with(rows, part="free"):
        cells = ["no shield" if row["kind"] == "none" else row["kind"], f"{int(row['episodes']):,}"]
        cells += [counted(row), counted(row, count="arrived")]
        cells += [f"{float(row['median_time']):.2f}", f"{float(row['mean_speed']):.2f}"]
        body.append([*cells, f"{1e3 * float(row['median_clearance']):.0f}"])
    return markdown((*header, "median clearance, mm"), body)


def randomised_table(rows: list[Row]) -> str:
    """Domain randomisation, by what the shield was told of it."""
    header = ("told of", "flights", "violated", "crashed or out of bounds", "steps without a certificate")
    body = []
    for row in rows_with(rows, part="randomised"):
        uncertified = "–" if row["kind"] == "no shield" else counted(row, "steps", "uncertified")
        cells = [row["kind"], f"{int(row['episodes']):,}", counted(row), counted(row, count="lost")]
        body.append([*cells, uncertified])
    return markdown(header, body)


def inner_table(rows: list[Row]) -> str:
    """The error of the inner loop."""
    header = ("shield", "control, Hz", "periods", "99.9 % of errors below, m/s⁴", "largest, m/s⁴")
    body = [
        [
            "free numbers" if row["arm"] == "free" else "the vehicle's authority",
            row["rate"],
            f"{int(row['steps']):,}",
            f"{float(row['median_clearance']):.2f}",
            f"{float(row['least_clearance']):.2f}",
        ]
        for row in rows_with(rows, part="inner")
    ]
    return markdown(header, body)


def draw(rows: list[Row], path: Path) -> None:
    """Violations over every condition; what the shield was told ends at the dotted line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(3, 3, figsize=(12.0, 9.4), layout="constrained", sharey=True)
    for axis, (kind, (title, unit, size)) in zip(axes.flat, PANELS.items(), strict=True):
        for arm, color in COLORS.items():
            found = rows_with(rows, part="beyond", kind=kind, arm=arm)
            if found:
                line(axis, found, size, color, LABELS[arm])
        if rows_with(rows, part="beyond", kind=kind, arm="told"):
            axis.axvline(size, color="#70757d", ls=":", lw=1.2)
        axis.set_xlabel(f"{title}, {unit}")
        axis.set_ylim(-2, 72)
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("flights with a violation, %")
    handles, names = axes.flat[2].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path, dpi=130)


def line(axis: Any, rows: list[Row], size: float, color: str, label: str) -> None:
    """Shares of flights with a violation over the level of rows, with their exact bands."""
    levels = size * np.array([float(row["level"]) for row in rows])
    counts = [(int(row["violated_episodes"]), int(row["episodes"])) for row in rows]
    ends = [binomtest(*count).proportion_ci(0.95) for count in counts]
    low, high = 100 * np.array([(end.low, end.high) for end in ends]).T
    axis.fill_between(levels, low, high, color=color, alpha=0.18, lw=0)
    axis.plot(levels, [100 * count / n for count, n in counts], "o-", color=color, ms=3.5, lw=1.6, label=label)
