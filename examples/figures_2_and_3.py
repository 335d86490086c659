"""Figures 2 and 3 of the paper: the control-invariant sets of boxes of order 1, 2 and 3.

    python examples/figures_2_and_3.py [--out FOLDER]

Writes figure_2.png and figure_3.png; those of the docs with --out docs/figures. All bounds are ±1, and the
inputs lie in [-1, 1]; in the right box of Fig. 3 the upper bound on x_1 is 0.2.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from box_surfaces import (
    GREEN,
    PINK,
    PURPLE,
    RED,
    Array,
    Sheet,
    body_sheets,
    both_sides,
    box_edges,
    touching_edges,
    uncapped_sheets,
)
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from numpy.typing import NDArray

from shields.chains.composite import BoxSet
from shields.chains.maximality import BoxBounds

matplotlib.use("Agg")


INK, FAINT = "#30343b", "#a7abb3"
STYLE: Any = {
    "font.size": 13,
    "mathtext.fontset": "cm",
}

UNIT = BoxSet([-1.0] * 3, [1.0] * 3, -1.0, 1.0)
FLAT = BoxSet([-1.0] * 3, [0.2, 1.0, 1.0], -1.0, 1.0)

# Orthographic view: x_1 to the right, x_2 into the page, x_3 up; from the front, the right and above.
AZIMUTH, ELEVATION = np.radians(28.0), np.radians(20.0)
RIGHT = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
TO_VIEWER = np.array(
    [
        np.sin(AZIMUTH) * np.cos(ELEVATION),
        -np.cos(AZIMUTH) * np.cos(ELEVATION),
        np.sin(ELEVATION),
    ]
)
UP = np.cross(TO_VIEWER, RIGHT)
LIGHT = np.array([0.55, -0.6, 0.58])


def main(folder: Path) -> None:
    """Write both figures, and say where."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name, draw in (("figure_2", figure_2), ("figure_3", figure_3)):
            figure = draw()
            figure.savefig(folder / f"{name}.png", dpi=130)
            plt.close(figure)
            print("Drawn:", folder / f"{name}.png")


def figure_2():
    """The sets (24) of order 1, an interval, and of order 2."""
    figure, (line, plane) = plt.subplots(1, 2, figsize=(10.0, 3.9), width_ratios=[3.4, 3.4])
    figure.subplots_adjust(0.01, 0.0, 0.99, 1.0, 0.0)
    draw_interval(line)
    draw_plane(plane)
    for ax in (line, plane):
        ax.set_aspect("equal")
        ax.set_axis_off()
    return figure


def draw_interval(ax) -> None:
    """n = 1: x_1 between its bounds, each of them the zero-level set of one function."""
    ax.add_patch(
        FancyArrowPatch((-1.5, 0.0), (1.6, 0.0), arrowstyle="-|>", mutation_scale=14, color=FAINT, lw=1.0)
    )
    ax.plot([-1.0, 1.0], [0.0, 0.0], color=PINK, lw=10.0, alpha=0.4, solid_capstyle="butt")
    ax.plot([-1.0, 1.0], [0.0, 0.0], "o", color=PINK, ms=12)
    for x, name in ((-1.0, "underline"), (1.0, "overline")):
        ax.text(x, -0.16, rf"$\{name}{{x}}_1$", ha="center", va="top", fontsize=17, color=INK)
        ax.text(x, 0.17, rf"$\{name}{{g}}_1 = 0$", ha="center", fontsize=16, color=PINK)
    ax.text(0.0, 0.17, "$C$", ha="center", fontsize=18, color=INK)
    ax.text(1.66, 0.0, "$x_1$", va="center", fontsize=17, color=INK)
    ax.text(0.0, -1.25, "$n = 1$", ha="center", va="center", fontsize=16, color=INK)
    ax.set(xlim=(-1.65, 1.95), ylim=(-1.4, 1.2))


def draw_plane(ax) -> None:
    """n = 2: bounded by x_1 = ±1 and by the parabolas along which one input alone keeps x_2."""
    x1 = np.linspace(-1.0, 0.0, 100)
    floor = np.stack([np.append(x1, 1.0), np.append(0.5 * x1**2 - 1.0, -1.0)])
    ax.plot([-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1], "--", color=FAINT, lw=1.0)
    ax.fill(*np.concatenate([floor, -floor], axis=1), color=PURPLE, alpha=0.12, lw=0)
    for side in (1.0, -1.0):
        ax.plot(*(side * np.array([[-1.0, -1.0], [-0.5, 1.0]])), color=PINK, lw=3.5)
        ax.plot(*(side * floor), color=PURPLE, lw=3.5)
        tail, tip = (side * floor[:, 40]).tolist(), (side * floor[:, 58]).tolist()
        ax.add_patch(
            FancyArrowPatch(tail, tip, arrowstyle="-|>", mutation_scale=24, color=PURPLE, lw=0, zorder=4)
        )
        ax.plot(side, -side, "o", color=INK, ms=8, zorder=5)
    label_plane(ax)
    ax.set(xlim=(-1.8, 1.8), ylim=(-1.4, 1.2))


def label_plane(ax) -> None:
    """Names of the curves, the bounds, the inputs that are asked for and the two corners."""
    named = {
        (-0.94, 0.3, "left"): (r"\underline{g}_1 = 0", PINK),
        (0.94, -0.3, "right"): (r"\overline{g}_1 = 0", PINK),
        (0.4, -0.88, "center"): (r"\underline{g}_2 = 0", PURPLE),
        (-0.4, 0.88, "center"): (r"\overline{g}_2 = 0", PURPLE),
        (-0.36, -0.74, "left"): (r"u = \overline{u}", PURPLE),
        (0.36, 0.76, "right"): (r"u = \underline{u}", PURPLE),
        (1.08, -0.86, "left"): ("u = 0", INK),
        (-1.08, 0.86, "right"): ("u = 0", INK),
        (0.0, 0.0, "center"): ("C", INK),
        (-1.0, -1.15, "center"): (r"\underline{x}_1", INK),
        (1.0, -1.15, "center"): (r"\overline{x}_1", INK),
        (-1.09, -1.0, "right"): (r"\underline{x}_2", INK),
        (1.09, 1.0, "left"): (r"\overline{x}_2", INK),
        (0.0, -1.25, "center"): ("n = 2", INK),
    }
    for (x, y, side), (text, color) in named.items():
        ax.text(x, y, f"${text}$", ha=side, va="center", fontsize=16, color=color)


def figure_3():
    """The set (28) in both boxes of the paper, seen from the same side."""
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 5.6), width_ratios=[1.25, 1.0])
    figure.subplots_adjust(0.005, 0.09, 0.995, 1.0, 0.0)
    for ax, box in zip(panels, (UNIT, FLAT), strict=True):
        draw_box(ax, box)
    figure.legend(handles=list(legend_entries()), loc="lower center", ncol=6, frameon=False, handlelength=1.3)
    return figure


def legend_entries() -> Iterator[Patch | Line2D]:
    for color, name in (
        (PINK, r"$\underline{g}_1,\ \overline{g}_1$"),
        (PURPLE, r"$\underline{g}_2,\ \overline{g}_2$"),
        (RED, r"$\underline{g}_3,\ \overline{g}_3$"),
        (GREEN, r"$\underline{g}_3^b,\ \overline{g}_3^b$"),
    ):
        yield Patch(color=color, label=name)
    yield Patch(
        facecolor="#f9d5da", edgecolor=RED, label=r"$\underline{g}_3$ where $\underline{g}_3^b$ lies inside"
    )
    yield Line2D([], [], color=INK, lw=3.5, label="touching edges")


def draw_box(ax, box: BoxSet) -> None:
    """One box: its edges, the set in it, g_3 where g_3^b lies inside, and the edges that the set touches."""
    far = np.array([box.bounds.lower[0], box.bounds.upper[1], box.bounds.lower[2]])
    for edge in box_edges(box.bounds):
        is_hidden = (edge == far).all(axis=1).any()
        ax.plot(
            *projected(edge).T, color=FAINT, lw=1.0, ls=":" if is_hidden else "-", zorder=0 if is_hidden else 6
        )
    for sheet in both_sides(body_sheets, box.bounds):
        draw_sheet(ax, sheet, 1.0)
    for sheet in both_sides(uncapped_sheets, box.bounds):
        draw_sheet(ax, sheet, 0.42)
    for edge in touching_edges(box):
        is_hidden = (edge[0, [0, 2]] == far[[0, 2]]).all()
        ax.plot(*projected(edge).T, color=INK, lw=3.0, ls=(0, (1.6, 1.1)) if is_hidden else "-", zorder=7)
    label_axes(ax, box.bounds)
    ax.set_aspect("equal")
    ax.set_axis_off()


def projected(points: Array) -> Array:
    """Points (…, 3) as seen by the viewer, (…, 2)."""
    return np.stack([points @ RIGHT, points @ UP], axis=-1)


def draw_sheet(ax, sheet: Sheet, alpha: float) -> None:
    """The cells of a sheet that face the viewer: of a convex body these are all that can be seen."""
    p = sheet.points
    cells = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2)
    normal = np.cross(cells[..., 2, :] - cells[..., 0, :], cells[..., 3, :] - cells[..., 1, :])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = (
        normal / np.maximum(length, 1e-300) * np.sign(np.sum(normal * cells.mean(axis=2), axis=-1))[..., None]
    )
    seen = (normal @ TO_VIEWER > 1e-3) & (length[..., 0] > 1e-9)
    if not seen.any():
        return
    facing = np.maximum(normal[seen] @ LIGHT, 0.0)[:, None]
    color = np.array(to_rgb(sheet.color)) * (0.68 + 0.32 * facing) + 0.12 * facing**6
    polygons = list(projected(cells[seen]))
    is_solid = alpha == 1.0
    rgba = np.concatenate([np.clip(color, 0.0, 1.0), np.full((len(color), 1), alpha)], axis=1)
    edges = rgba if is_solid else "none"
    cells = PolyCollection(polygons, facecolors=rgba, edgecolors=edges, lw=1.0, zorder=2 if is_solid else 4)
    ax.add_collection(cells)
    draw_border(ax, p, seen, "white" if is_solid else RED)


def draw_border(ax, points: Array, seen: NDArray[np.bool_], color: str) -> None:
    """The outline of the part of a sheet that is seen."""
    for line, visible in (
        (points[0], seen[0]),
        (points[-1], seen[-1]),
        (points[:, 0], seen[:, 0]),
        (points[:, -1], seen[:, -1]),
    ):
        start, end = line[:-1][visible], line[1:][visible]
        if len(start):
            pieces = list(projected(np.stack([start, end], axis=1)))
            ax.add_collection(LineCollection(pieces, colors=color, lw=0.9, zorder=5, capstyle="round"))


def label_axes(ax, bounds: BoxBounds) -> None:
    """Names and bounds of x_1, x_2 and x_3 along three edges of the box."""
    lower, upper = bounds.lower, bounds.upper
    edges = (
        (0, np.array([0.0, lower[1], lower[2]]), np.array([-0.02, -0.11])),
        (1, np.array([upper[0], 0.0, lower[2]]), np.array([0.12, -0.03])),
        (2, np.array([lower[0], lower[1], 0.0]), np.array([-0.09, 0.03])),
    )
    for axis, point, offset in edges:
        middle = 0.5 * (lower[axis] + upper[axis])
        for value, name in ((lower[axis], f"{lower[axis]:g}"), (middle, ""), (upper[axis], f"{upper[axis]:g}")):
            at = projected(np.where(np.arange(3) == axis, value, point)) + offset * (1.0 if name else 1.7)
            size = 14 if name else 19
            ax.text(
                *at,
                name.replace("-", "−") or f"$x_{axis + 1}$",
                ha="center",
                va="center",
                fontsize=size,
                color=INK,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw Figures 2 and 3 of the paper.")
    parser.add_argument("--out", type=Path, default=Path("logs/figures"), help="folder for the pictures")
    main(parser.parse_args().out)
