"""The pieces a frame is put together from: colours, lit balls, glassy shells, and a smoothed canvas."""

import math
import os
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
import pygame
import pygame.font

SIZE = 480  # pixels of a frame's side
SPRITE = 256  # pixels of a sprite's side, before it is scaled
SMOOTHING = 3
EDGE = 6  # pixels of a patch around the points drawn in it
TOP, BOTTOM = (18, 23, 34), (52, 63, 82)
LIGHT = np.array([-0.45, -0.70, -0.55]) / math.hypot(0.45, 0.70, 0.55)  # right, down, ahead

Color = tuple[int, int, int]


def blend(a: Color, b: Color, share: float) -> Color:
    """Colour ``a``, with a share of ``b`` in it."""
    red, green, blue = (round(x + (y - x) * share) for x, y in zip(a, b, strict=True))
    return (red, green, blue)


@lru_cache(maxsize=128)
def ball(color: Color, side: int) -> pygame.Surface:
    """A lit ball that fills its sprite of ``side`` pixels."""
    return pygame.transform.smoothscale(_ball(color), (side, side))


@lru_cache(maxsize=128)
def shell(color: Color, side: int) -> pygame.Surface:
    """A glassy shell that fills its sprite of ``side`` pixels: faint in the middle, bright at the rim."""
    return pygame.transform.smoothscale(_shell(color), (side, side))


def backdrop() -> pygame.Surface:
    """A fresh canvas with a sky that brightens downwards."""
    return _sky().copy()


def font() -> pygame.font.Font:
    """The font of the readings."""
    # Another environment's window may have quit pygame, and with it every font.
    if not pygame.font.get_init():
        pygame.font.init()
        _font.cache_clear()
    return _font()


@cache
def circle(count: int) -> NDArray[np.float64]:
    """Points (count, 2) on the unit circle."""
    angle = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


class Patch:
    """A small transparent canvas, drawn enlarged and then shrunk, which smooths every edge.

    Points are pixels of the frame; the patch holds the given ones (…, 2), and ``EDGE`` more on every side;
    ``corner`` is the frame's pixel at its upper left.
    """

    def __init__(self, points: NDArray[np.float64], background: Color):
        self.corner = np.floor(points.min(axis=0)) - EDGE
        width, height = (np.ceil(points.max(axis=0)) + EDGE - self.corner).tolist()
        self.size = (int(width), int(height))
        self.canvas = pygame.Surface((SMOOTHING * self.size[0], SMOOTHING * self.size[1]), pygame.SRCALPHA, 32)
        # Shrinking mixes in the colour of transparent pixels.
        self.canvas.fill((*background, 0))

    def line(self, start, end, color: Color, width: float) -> None:
        """A line between two points, ``width`` pixels wide."""
        ends = (SMOOTHING * (start - self.corner), SMOOTHING * (end - self.corner))
        pygame.draw.line(self.canvas, color, *ends, round(width * SMOOTHING))

    def dot(self, point, color: Color, radius: float) -> None:
        """A disc of ``radius`` pixels."""
        pygame.draw.circle(self.canvas, color, SMOOTHING * (point - self.corner), radius * SMOOTHING)

    def glass(self, rim, color: Color) -> None:
        """A translucent polygon with a solid rim."""
        points = SMOOTHING * (rim - self.corner)
        pygame.draw.polygon(self.canvas, (*color, 120), points)
        pygame.draw.polygon(self.canvas, color, points, SMOOTHING)

    def shrunk(self) -> pygame.Surface:
        """The finished patch, in the pixels of the frame."""
        return pygame.transform.smoothscale(self.canvas, self.size)


@cache
def _ball(color: Color) -> pygame.Surface:
    x, y, edge = _disc()
    z = -np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    toward = x * LIGHT[0] + y * LIGHT[1] + z * LIGHT[2]
    mirrored = np.maximum(LIGHT[2] - 2.0 * toward * z, 0.0)
    diffuse = 0.34 + 0.66 * np.maximum(toward, 0.0)
    return _sprite(np.multiply.outer(diffuse, color) + 90.0 * mirrored[..., None] ** 24, 255.0 * edge)


@cache
def _shell(color: Color) -> pygame.Surface:
    x, y, edge = _disc()
    rim = np.minimum(x * x + y * y, 1.0)
    return _sprite(np.broadcast_to(color, (*x.shape, 3)), edge * (18.0 + 190.0 * rim**7))


def _disc():
    axis = (np.arange(SPRITE) + 0.5) / (0.5 * SPRITE) - 1.0
    x, y = np.meshgrid(axis, axis, indexing="ij")
    return x, y, np.clip((1.0 - np.hypot(x, y)) * 0.5 * SPRITE, 0.0, 1.0)


def _sprite(color, alpha) -> pygame.Surface:
    surface = pygame.Surface((SPRITE, SPRITE), pygame.SRCALPHA, 32)
    pygame.surfarray.pixels3d(surface)[...] = np.clip(color, 0.0, 255.0)
    pygame.surfarray.pixels_alpha(surface)[...] = alpha
    return surface


@cache
def _sky() -> pygame.Surface:
    surface = pygame.Surface((SIZE, SIZE), 0, 32)
    for y in range(SIZE):
        pygame.draw.line(surface, blend(TOP, BOTTOM, y / SIZE), (0, y), (SIZE, y))
    return surface


@cache
def _font() -> pygame.font.Font:
    return pygame.font.Font(None, 19)
