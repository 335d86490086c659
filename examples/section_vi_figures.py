"""The figures of ``section_vi_flight.py``: 1, 5 and 6 of the paper, and a wide picture of the flight."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST

if TYPE_CHECKING:
    from section_vi_flight import Flight

matplotlib.use("Agg")

STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes3d.xaxis.panecolor": "#f7f7f5",
    "axes3d.yaxis.panecolor": "#f7f7f5",
    "axes3d.zaxis.panecolor": "#f7f7f5",
    "grid.color": "#dededa",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 2.2,
}
CAPTION = "Crazyflie 2.x, 27 g · keep-out radius 1.0 m · ū = 100 m/s⁴, α = 6 1/s · 100 Hz"
NOMINAL, SAFE, OBSTACLE, INK = "#d1495b", "#1d5fa8", "#e9b872", "#30343b"
ROLES = ((NOMINAL, "--", "without shield"), (SAFE, "-", "with shield"))
TORQUES = (("#8a5aa8", "x"), ("#2a8a57", "y"), ("#8c8f94", "z"))

AZIMUTH, ELEVATION = -52.0, 14.0
_LEVEL = np.cos(np.radians(ELEVATION))
TO_VIEWER = np.array(
    [
        _LEVEL * np.cos(np.radians(AZIMUTH)),
        _LEVEL * np.sin(np.radians(AZIMUTH)),
        np.sin(np.radians(ELEVATION)),
    ]
)
LIGHT = np.array([-0.3, -0.5, 0.81])
ARM = 0.18  # m, as drawn: 4.5 times the Crazyflie's
SPACING = 0.43  # m between two drawn vehicles
FLOOR = -0.4  # m
ALONG = np.array([2.0, 1.0, 0.0]) / np.sqrt(5.0)  # level direction from start to goal


def draw_figures(nominal: "Flight", safe: "Flight", out: Path) -> None:
    """Write the four pictures into a folder, and say where."""
    out.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name, draw in (("fig1", figure_1), ("fig5", figure_5), ("fig6", figure_6)):
            save(draw(nominal, safe), out / f"section_vi_{name}.png", bbox_inches="tight")
        save(hero(nominal, safe), out / "flight.png")


def save(figure: Figure, path: Path, **options: Any) -> None:
    """Write a picture and let go of it."""
    figure.savefig(path, dpi=120, **options)
    plt.close(figure)
    print("Drawn:", path)


def figure_1(nominal: "Flight", safe: "Flight") -> Figure:
    """Fig. 1 of the paper: the vehicle turns away from the sphere and passes above it."""
    figure, ax = space((7.0, 6.4), (0.0, 0.0, 1.0, 1.0))
    draw_scene(ax, nominal, safe)
    ax.set(
        xlim=(-0.4, 4.4), ylim=(-1.6, 1.6), zlim=(FLOOR, 4.4), xlabel="x (m)", ylabel="y (m)", zlabel="z (m)"
    )
    ax.set(xticks=range(5), yticks=(-1, 0, 1), zticks=range(5))
    ax.set_aspect("equal")
    ax.legend(loc="upper left", bbox_to_anchor=(0.05, 0.95))
    add_caption(figure, 0.03)
    return figure


def hero(nominal: "Flight", safe: "Flight") -> Figure:
    """The same flight, wide and without axes, for the README."""
    # A space fills a square: this one reaches over the upper and the lower edge.
    figure, ax = space((11.0, 5.2), (0.06, -0.36, 0.85, 0.85 * 11.0 / 5.2))
    draw_floor(ax, safe)
    draw_scene(ax, nominal, safe)
    ax.text(0.75, -0.6, 2.05, "with shield", color=SAFE, fontsize=13, ha="right")
    ax.text(2.85, 0.45, 2.5, "without shield", color=NOMINAL, fontsize=13)
    ax.set(xlim=(-1.0, 5.0), ylim=(-2.4, 2.4), zlim=(FLOOR, 4.4))
    ax.set_aspect("equal")
    ax.set_axis_off()
    return figure


def figure_5(nominal: "Flight", safe: "Flight") -> Figure:
    """Fig. 5 of the paper: torques and thrust, applied and desired."""
    figure, (torque, thrust) = plt.subplots(2, 1, figsize=(7.2, 5.8), sharex=True, height_ratios=[3, 2])
    for axis, (color, name) in enumerate(TORQUES, start=1):
        torque.plot(safe.time, 1e6 * safe.desired[:, axis], "--", color=color, lw=1.4)
        torque.plot(safe.time, 1e6 * safe.applied[:, axis], color=color, lw=2.0, label=rf"$\tau_{name}$")
    torque.plot([], [], "--", color=INK, lw=1.4, label="desired")
    torque.set_ylabel("torque (µN m)")
    torque.legend(loc="upper right")
    thrust.plot(
        nominal.time, 1e3 * nominal.state[:, THRUST], ":", color=NOMINAL, lw=2.0, label="without shield"
    )
    thrust.plot(safe.time, 1e3 * safe.state[:, THRUST], color=SAFE, lw=2.0, label="with shield")
    thrust.set(xlabel="time (s)", ylabel="thrust $f_z$ (mN)", xlim=(2.5, 7.5))
    thrust.legend(loc="upper right")
    for ax in (torque, thrust):
        shade_interventions(ax, safe)
    torque.annotate("shield acts", (3.85, 150.0), color=INK, ha="right")
    add_caption(figure)
    return figure


def figure_6(nominal: "Flight", safe: "Flight") -> Figure:
    """Fig. 6 of the paper: both paths in the vertical plane that holds them, and the distance over time."""
    figure, (plane, distance) = plt.subplots(1, 2, figsize=(10.0, 4.4), width_ratios=[1.1, 1])
    plane.add_patch(Circle(tuple(in_plane(safe, safe.center)), safe.radius, color=OBSTACLE, alpha=0.6, lw=0))
    for flight, (color, style, name) in zip((nominal, safe), ROLES, strict=True):
        plane.plot(*in_plane(flight, flight.position).T, style, color=color, label=name)
        distance.plot(flight.time, flight.distance, style, color=color)
    for point, name, offset in ((safe.position[0], "start", (8, -6)), (safe.goal, "goal", (-6, -18))):
        plane.plot(*in_plane(safe, point), "o", color=INK, ms=5)
        plane.annotate(name, in_plane(safe, point), offset, textcoords="offset points", color=INK)
    plane.set(xlabel="level distance from the start (m)", ylabel="height (m)", aspect="equal")
    plane.legend(loc="upper left")
    distance.axhspan(0.0, safe.radius, color=OBSTACLE, alpha=0.6, lw=0)
    distance.annotate("keep-out sphere", (7.0, 0.8), color=INK, va="center")
    distance.set(
        xlabel="time (s)", ylabel="distance to the centre (m)", xlim=(0.0, safe.time[-1]), ylim=(0.6, 4.0)
    )
    add_caption(figure)
    return figure


def space(size: tuple[float, float], place: tuple[float, float, float, float]) -> tuple[Figure, Any]:
    """A figure of a size in inches, and an orthographic view at a place given in fractions of it."""
    figure = plt.figure(figsize=size)
    ax: Any = figure.add_axes(place, projection="3d", computed_zorder=False)
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION, azim=AZIMUTH)
    return figure, ax


def draw_scene(ax, nominal: "Flight", safe: "Flight") -> None:
    """The keep-out sphere, both paths, and the safe vehicle along its path."""
    draw_sphere(ax, safe.center, safe.radius)
    for flight, (color, style, name) in zip((nominal, safe), ROLES, strict=True):
        is_hidden = hidden(flight.position, flight.center, flight.radius)[:, None]
        behind, before = (
            np.where(is_hidden, flight.position, np.nan),
            np.where(is_hidden, np.nan, flight.position),
        )
        ax.plot(*behind.T, style, color=color, alpha=0.5, zorder=2)
        ax.plot(*before.T, style, color=color, zorder=3, label=name)
    flown = np.cumsum(np.linalg.norm(np.diff(safe.position, axis=0, prepend=safe.position[:1]), axis=1))
    for way in np.linspace(0.0, flown[-1], 1 + round(flown[-1] / SPACING)):
        draw_vehicle(ax, safe.state[np.searchsorted(flown, way)])


def draw_sphere(ax, center: NDArray, radius: float) -> None:
    """A shaded sphere, with a disc behind it that smooths its edge."""
    around, down = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 97), np.linspace(0.0, np.pi, 49))
    normal = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=-1)
    light = (normal @ LIGHT)[..., None]
    color = np.array(to_rgb(OBSTACLE)) * (0.87 + 0.13 * light) + 0.12 * np.maximum(light, 0.0) ** 3
    across = np.cross(TO_VIEWER, [0.0, 0.0, 1.0]) / _LEVEL
    rim = center + 1.006 * radius * circle(across, np.cross(TO_VIEWER, across))
    ax.add_collection3d(Poly3DCollection([rim], facecolor=OBSTACLE, lw=0, zorder=1))
    surface = np.moveaxis(center + radius * normal, -1, 0)
    mesh = {"rcount": 97, "ccount": 97, "shade": False, "lw": 0, "antialiased": False}
    ax.plot_surface(*surface, facecolors=np.clip(color, 0.0, 1.0), zorder=1.5, **mesh)


def draw_vehicle(ax, state: NDArray) -> None:
    """Two arms and four rotors."""
    attitude, position = state[ATTITUDE:OMEGA].reshape(3, 3), state[:3]
    hubs = (
        position + ARM / np.sqrt(2.0) * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) @ attitude.T
    )
    rotor = 0.62 * ARM * circle(attitude[:, 0], attitude[:, 1])
    faces = [hub + rotor for hub in hubs]
    ax.add_collection3d(Poly3DCollection(faces, facecolor=SAFE, edgecolor=SAFE, lw=0.7, alpha=0.35, zorder=4))
    for pair in ([0, 2], [1, 3]):
        ax.plot(*hubs[pair].T, color=INK, lw=1.6, zorder=5)


def draw_floor(ax, safe: "Flight") -> None:
    """A grid below the flight, and the shadows of sphere and path."""
    for x in np.arange(-1.0, 5.1, 0.5):
        ax.plot([x, x], [-2.0, 2.0], FLOOR, color="#e6e6e2", lw=0.8, zorder=-2)
    for y in np.arange(-2.0, 2.1, 0.5):
        ax.plot([-1.0, 5.0], [y, y], FLOOR, color="#e6e6e2", lw=0.8, zorder=-2)
    shadow = safe.center + safe.radius * circle(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    shadow[:, 2] = FLOOR
    ax.add_collection3d(Poly3DCollection([shadow], facecolor="#d9d6cf", lw=0, zorder=-1))
    ax.plot(*safe.position[:, :2].T, FLOOR, color="#bdbab3", lw=1.8, zorder=0)


def circle(first: NDArray, second: NDArray) -> NDArray[np.float64]:
    """The unit circle (73, 3) in the plane of two orthonormal vectors."""
    angles = np.linspace(0.0, 2.0 * np.pi, 73)[:, None]
    return np.cos(angles) * first + np.sin(angles) * second


def hidden(points: NDArray, center: NDArray, radius: float) -> NDArray[np.bool_]:
    """Whether the sphere hides points (…, 3) from the viewer, or holds them."""
    offset = points - center
    nearness = offset @ TO_VIEWER
    half_chord = np.sqrt(np.maximum(radius**2 - (np.sum(offset**2, axis=-1) - nearness**2), 0.0))
    return nearness < np.where(half_chord > 0.0, half_chord, -np.inf)


def in_plane(flight: "Flight", points: NDArray) -> NDArray[np.float64]:
    """Level distance from the start along the flight, and height, (…, 2) m."""
    return np.stack([(points - flight.position[0]) @ ALONG, points[..., 2]], axis=-1)


def shade_interventions(ax, flight: "Flight") -> None:
    """Mark the times at which the shield acts."""
    acts = flight.correction > 0.0
    transform = ax.get_xaxis_transform()
    ax.fill_between(flight.time, 0, 1, where=acts, transform=transform, color=OBSTACLE, alpha=0.3, lw=0)


def add_caption(figure: Figure, height: float = -0.01) -> None:
    """The chosen values, below the picture."""
    figure.text(0.5, height, CAPTION, ha="center", va="top", fontsize=9, color="#6b7078")
