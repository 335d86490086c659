"""Where a picture is seen from: what a user says of it, and the view that follows at one moment."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import checked_when_made, finite_number, positive_number

FOCAL = 2.4  # sides of the picture that are one radian in its middle
FILL = 0.43  # share of the picture that half the path takes
TURN = 30.0  # degrees, of the camera, from square to the path
PITCH = 24.0  # degrees, of the camera, downwards
LEAST_REACH = 1.2  # m
NEAREST = 0.05  # m; what is not farther ahead of the eye has no place in the picture
SIZES = (32, 2048)  # pixels


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
    | distance  | m                                                              | shows way and vehicle      |
    | follow    | whether it looks at the vehicle, else at the middle of the way |                            |
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


def view_of(position, goal, start, camera: Camera = BESIDE, size: int = 480) -> View:
    """The view of the middle of the path, from far enough to see the vehicle wherever it is, or as told."""
    middle, path = 0.5 * (start + goal), goal - start
    reach = max(LEAST_REACH, 0.5 * float(np.linalg.norm(path)), float(np.linalg.norm(position - middle)))
    if camera.follow:
        middle, reach = np.array(position), LEAST_REACH
    beside = math.degrees(math.atan2(path[1], path[0])) - TURN - 90.0
    azimuth = math.radians(beside if camera.azimuth is None else camera.azimuth)
    elevation = math.radians(PITCH if camera.elevation is None else camera.elevation)
    distance = FOCAL * reach / FILL if camera.distance is None else camera.distance
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    back = np.array([math.cos(azimuth), math.sin(azimuth), 0.0]) * math.cos(elevation)
    back[2] = math.sin(elevation)
    axes = np.array([right, np.cross(right, back), -back])
    return View(size, middle + distance * back, axes, middle, reach)
