"""The picture of a calibration: what was asked, what flew, and the bound around it."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.residual import chain_residuals
from shields.calibration.calibrate import Calibration
from shields.calibration.excitations import FIFTHS, Recorded
from shields.calibration.fit import paths_of, residual_norms
from shields.settings.uncertainty import lag_told

Array = NDArray[np.float64]

ASKED, FLOWN, BOUND, SEEN = "#d55e00", "#0072b2", "#009e73", "#9aa0a8"
INK, GRID = "#22262b", "#e9e8e4"


def draw(found: Calibration, title: str, file: Path) -> None:
    """Draw a calibration into a PNG file.

    Above, along the axis that moves most, a held-out flight: velocities and snaps, asked and flown. Below, the
    greatest residuals of all flights at each time, and the bounds.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.4), dpi=100, layout="constrained")
    axes: Any = figure.subplots(4, 1, sharex=True, height_ratios=[1.1, 1.3, 0.8, 0.8])
    flight = found.held_out[0]
    axis = int(np.argmax(np.abs(flight.flats[:, 1]).max(axis=0)))
    _draw_velocity(axes[0], flight, axis, found.period)
    _draw_snap(axes[1], flight, axis, found)
    _draw_residuals(axes[2], found, 3, found.uncertainty.snap, "snap $d$, m/s⁴")
    _draw_residuals(axes[3], found, 1, found.uncertainty.wind, "wind $w$, m/s²")
    figure.suptitle(_title(found, title), x=0.01, ha="left", fontsize=11, color=INK)
    axes[3].set_xlabel("time, s")
    for one in axes:
        one.grid(color=GRID)
        one.set_axisbelow(True)
        one.spines[["top", "right"]].set_visible(False)
        one.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=9, frameon=False)
    axes[0].set_xlim(0.0, len(flight.snaps) * found.period)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file)


def _title(found: Calibration, title: str) -> str:
    told = ", ".join(f"{name} {value}" for name, value in found.told().items())
    return f"{title}, to be told: {told or 'nothing'}"


def _draw_velocity(axes: Any, flight: Recorded, axis: int, period: float) -> None:
    times, asked = period * np.arange(len(flight.flats)), flight.excitation.velocities[:, axis]
    axes.step(np.arange(len(asked) + 1) / FIFTHS, [*asked, asked[-1]], where="post", color=ASKED, label="asked")
    axes.plot(times, flight.flats[:, 1, axis], color=FLOWN, label="flown")
    axes.set_ylabel(f"velocity {'xyz'[axis]}, m/s")


def _draw_snap(axes: Any, flight: Recorded, axis: int, found: Calibration) -> None:
    """Of a period: the snap that was asked for, that its jerk shows, and that the lag has, with its bound."""
    told, period = found.uncertainty, found.period
    times = period * (np.arange(len(flight.snaps)) + 0.5)
    flown = np.diff(flight.flats[:, 3, axis]) / period
    lag = lag_told(told).told
    expected = flown - chain_residuals(flight.flats, flight.snaps, period, lag)[:, 3, axis]
    axes.step(times, flight.snaps[:, axis], where="mid", color=ASKED, linewidth=1.0, label="asked")
    band = (expected - told.snap, expected + told.snap)
    label = f"behind a lag of {1e3 * lag:.3g} ms, ± {told.snap:g}"
    axes.fill_between(times, *band, color=BOUND, alpha=0.35, linewidth=0.0, label=label)
    axes.plot(times, flown, color=FLOWN, linewidth=1.2, label="flown")
    axes.set_ylabel(f"snap {'xyz'[axis]}, m/s⁴")


def _draw_residuals(axes: Any, found: Calibration, order: int, bound: float, words: str) -> None:
    measured, held_out = (
        residual_norms(paths_of(flights, found.period), found.uncertainty.rotor_lag)[..., order].max(axis=0)
        for flights in (found.measured, found.held_out)
    )
    times = found.period * (np.arange(len(measured)) + 0.5)
    axes.fill_between(times, measured, color=SEEN, alpha=0.6, linewidth=0.0, label="most of all measured")
    axes.plot(times, held_out, color=FLOWN, linewidth=1.0, label="most of all held out")
    axes.axhline(bound, color=BOUND, linewidth=1.8, label=f"told, {bound:g}")
    axes.set_ylabel(words)
    axes.set_ylim(0.0, 1.1 * max(bound, float(measured.max()), float(held_out.max()), 1e-6))
