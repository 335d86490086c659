"""Where a picture is seen from: what a user says of it, and the view that follows at one moment."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import checked_when_made, finite_number, positive_number

FOCAL = 2.4  # sides of the picture that are one radian in its middle
FILL = 0.41  # share of the picture from its middle to what is farthest from there
TURN = 30.0  # degrees, of the camera, from square to the path
PITCH = 24.0  # degrees, of the camera, downwards
LEAST_REACH = 1.2  # m, where there is nothing but a vehicle, a start and a goal
NEAREST = 0.05  # m; what is not farther ahead of the eye has no place in the picture
SIZES = (32, 2048)  # pixels
TINY = 0.2  # m; no scene is taken for smaller: so large is the shell of a goal


def _checked(camera: "Camera") -> "Camera":
    if not isinstance(camera.follow, bool | np.bool_):
        raise TypeError(f"follow of camera must be True or False, got {camera.follow!r}")
    numbers = [
        None if value is None else check(f"{name} of camera", value)
        for name, value, check in zip(camera._fields, camera[:3], CHECKS, strict=False)
    ]
    return Camera._make((*numbers, bool(camera.follow)))


def _elevation(name: str, value: float) -> float:
    angle = finite_number(name, value)
    if abs(angle) > 90.0:
        raise ValueError(f"{name} must be in [-90, 90] degrees, got {angle}")
    return angle


CHECKS = (finite_number, _elevation, positive_number)


@checked_when_made(_checked)
class Camera(NamedTuple):
    """Where the eye is, seen from what it looks at; what is None is chosen for each scene.

    | field     | meaning                                                        | None                       |
    |-----------|----------------------------------------------------------------|----------------------------|
    | azimuth   | degrees from world x towards y                                 | beside the way, start left |
    | elevation | degrees above the horizon, −90 to 90                           | 24                         |
    | distance  | m                                                              | shows the map, the way and |
    |           |                                                                | the vehicle                |
    | follow    | whether it looks at the vehicle, else at the middle            |                            |
    """

    azimuth: float | None = None
    elevation: float | None = None
    distance: float | None = None
    follow: bool = False


BESIDE = Camera()


def camera_from(value: Any) -> Camera:
    """A camera of None, a mapping of some fields, or a Camera.

    Raises:
        TypeError, ValueError: naming the field, what was expected and what came.
    """
    if value is None:
        return BESIDE
    if isinstance(value, Camera):
        return value
    if not isinstance(value, Mapping):
        raise TypeError(f"camera must be a mapping of {', '.join(Camera._fields)}, got {value!r}")
    for name in value:
        if name not in Camera._fields:
            raise ValueError(f"camera must have fields of {', '.join(Camera._fields)}, got {name!r}")
    return Camera(**value)


def picture_size(name: str, value: int) -> int:
    """``value`` as the side of a picture in pixels, of ``SIZES``.

    Raises:
        ValueError: for anything else.
    """
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_integer or not SIZES[0] <= value <= SIZES[1]:
        raise ValueError(f"{name} must be an integer in [{SIZES[0]}, {SIZES[1]}] pixels, got {value!r}")
    return int(value)


def text(name: str, value: str) -> str:
    """``value``, a string.

    Raises:
        TypeError: for anything else.
    """
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, got {value!r}")
    return value


class View(NamedTuple):
    """A square picture of ``size`` pixels a side, and where it is seen from.

    ``eye`` (3,) m and ``axes`` (3, 3), rows right, down, ahead; then the middle of the scene (3,) and how far
    that reaches, m.
    """

    size: int
    eye: NDArray[np.float64]
    axes: NDArray[np.float64]
    middle: NDArray[np.float64]
    reach: float

    @property
    def focal(self) -> float:
        """Pixels of one radian in the middle of the picture."""
        return FOCAL * self.size

    def depths(self, points) -> NDArray[np.float64]:
        """How far ahead of the eye (…) world points (…, 3) are, m."""
        return (np.asarray(points) - self.eye) @ self.axes[2]

    def pixels(self, points) -> NDArray[np.float64]:
        """Picture coordinates (…, 2) of world points (…, 3)."""
        seen = (np.asarray(points) - self.eye) @ self.axes.T
        return 0.5 * self.size + self.focal * seen[..., :2] / np.maximum(seen[..., 2:], NEAREST)

    def holds(self, points: NDArray[np.float64]) -> bool:
        """Whether points (M, 3) are before the eye and fill no more than twice the picture."""
        extent = np.ptp(self.pixels(points), axis=0).max()
        return bool(self.depths(points).min() > NEAREST and extent < 2.0 * self.size)


NO_CORNERS = np.zeros((0, 3))


class Steering(NamedTuple):
    """What a mouse has done to a camera: degrees around and up, a factor of the distance, follow or not."""

    turn: float = 0.0
    tilt: float = 0.0
    zoom: float = 1.0
    is_toggled: bool = False


STRAIGHT = Steering()


def view_of(
    position,
    goal,
    start,
    camera: Camera = BESIDE,
    size: int = 480,
    *,
    corners: NDArray[np.float64] = NO_CORNERS,
    steering: Steering = STRAIGHT,
) -> View:
    """The view of a map, ``corners`` (M, 3), the way through it and the vehicle wherever it is, or as told."""
    middle, reach = scene_ball(start, goal, corners)
    shown = np.vstack([start, goal, position, corners])
    if camera.follow != steering.is_toggled:
        middle, reach, shown = np.array(position), LEAST_REACH, np.reshape(position, (1, 3))
    axes = _axes(goal - start, camera, steering)
    distance = camera.distance
    if distance is None:
        least = TINY if len(corners) and len(shown) > 1 else LEAST_REACH
        distance = _fitting((shown - middle) @ axes.T, least)
        reach = max(reach, least, float(np.linalg.norm(position - middle)))
    return View(size, middle - steering.zoom * distance * axes[2], axes, middle, max(reach, TINY))


def scene_ball(start, goal, corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and radius, m, of a ball around a scene: that of the way, unless the map is larger."""
    middle = 0.5 * (start + goal)
    reach = 0.5 * float(np.linalg.norm(goal - start))
    if not len(corners):
        return middle, reach
    points = np.vstack([start, goal, corners])
    if np.linalg.norm(points - middle, axis=1).max() > reach:
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())


def _axes(way, camera: Camera, steering: Steering) -> NDArray[np.float64]:
    """Right, down and ahead (3, 3) of a camera; a mouse tilts it to look straight up or down, no farther."""
    beside = math.degrees(math.atan2(way[1], way[0])) - TURN - 90.0
    azimuth = math.radians((beside if camera.azimuth is None else camera.azimuth) + steering.turn)
    tilted = (PITCH if camera.elevation is None else camera.elevation) + steering.tilt
    elevation = math.radians(min(max(tilted, -90.0), 90.0))
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    back = np.array([math.cos(azimuth), math.sin(azimuth), 0.0]) * math.cos(elevation)
    back[2] = math.sin(elevation)
    return np.array([right, np.cross(right, back), -back])


def _fitting(seen: NDArray[np.float64], least: float) -> float:
    """The distance, m, from which points (M, 3), right, down and ahead of the middle, keep to ``FILL``."""
    across = np.abs(seen[:, :2]).max(axis=1)
    needed = np.maximum(FOCAL * across / FILL, 2.0 * NEAREST) - seen[:, 2]
    return max(float(needed.max()), FOCAL * least / FILL)
