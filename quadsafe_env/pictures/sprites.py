"""What is drawn small and put onto a picture: colours, a smoothed canvas, the font."""

import math
import os
from functools import cache

import numpy as np
from numpy.typing import NDArray

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
import pygame
import pygame.font

SMOOTHING = 3
EDGE = 6  # pixels of a patch around the points drawn in it
TOP, BOTTOM = (18, 23, 34), (52, 63, 82)
GRID, SHADOW = (98, 114, 142), (24, 30, 42)
OBSTACLE, GOAL, WALL = (214, 96, 76), (96, 220, 146), (140, 166, 214)
LIGHT = np.array([-0.45, -0.70, -0.55]) / math.hypot(0.45, 0.70, 0.55)  # right, down, ahead
FONT = 19 / 480  # height of the letters, as a share of the picture
LEAST_FONT = 11  # pixels; smaller letters cannot be read

Color = tuple[int, int, int]


def blend(a: Color, b: Color, share: float) -> Color:
    """Colour ``a``, with a share of ``b`` in it."""
    red, green, blue = (round(x + (y - x) * share) for x, y in zip(a, b, strict=True))
    return (red, green, blue)


@cache
def sky(size: int) -> NDArray[np.uint8]:
    """A sky (size, size, 3) that brightens downwards."""
    rows = np.linspace(TOP, BOTTOM, size, endpoint=False)
    return np.ascontiguousarray(np.broadcast_to(np.rint(rows).astype(np.uint8)[:, None], (size, size, 3)))


def font(size: int) -> pygame.font.Font:
    """The font of the readings of a picture."""
    # Another environment's window may have quit pygame, and with it every font.
    if not pygame.font.get_init():
        pygame.font.init()
        _font.cache_clear()
    return _font(max(round(FONT * size), LEAST_FONT))


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
        pygame.draw.line(self.canvas, color, *ends, max(round(width * SMOOTHING), 1))

    def dot(self, point, color: Color, radius: float) -> None:
        """A disc of ``radius`` pixels."""
        pygame.draw.circle(self.canvas, color, SMOOTHING * (point - self.corner), radius * SMOOTHING)

    def glass(self, rim, color: Color) -> None:
        """A translucent polygon with a solid rim."""
        points = SMOOTHING * (rim - self.corner)
        pygame.draw.polygon(self.canvas, (*color, 120), points)
        pygame.draw.polygon(self.canvas, color, points, SMOOTHING)

    def polygon(self, rim, color: Color) -> None:
        """A solid polygon."""
        pygame.draw.polygon(self.canvas, color, SMOOTHING * (rim - self.corner))

    def pixels(self) -> NDArray[np.uint8]:
        """The finished patch in the pixels of the frame, (h, w, 4), RGBA."""
        width, height = self.size
        shrunk = pygame.transform.smoothscale(self.canvas, self.size)
        return np.frombuffer(pygame.image.tobytes(shrunk, "RGBA"), dtype=np.uint8).reshape(height, width, 4)


@cache
def _font(height: int) -> pygame.font.Font:
    return pygame.font.Font(None, height)
