"""A window on the screen that keeps the pace of a flight."""

import os
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.pictures.camera import STRAIGHT, Steering
from quadsafe_env.pictures.sprites import pygame

# Drivers that draw where nobody sees it.
BLIND = ("dummy", "offscreen")
TURN = 0.4  # degrees of a pixel
ZOOM = 0.9  # of the distance, a notch of the wheel
AGAIN = 0.4  # s from one click to the other of two
HELP = "quadsafe: drag turns, wheel zooms, F follows, R or a double click restores the view"


def has_display() -> bool:
    """Whether a window would be seen."""
    # Without one, SDL complains on the terminal.
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    was_open = pygame.display.get_init()
    try:
        pygame.display.init()
        return pygame.display.get_driver() not in BLIND
    except pygame.error:
        return False
    finally:
        if not was_open:
            pygame.display.quit()


def is_driver_named() -> bool:
    """Whether the user has named SDL's video driver, be it one that draws where nobody sees it."""
    return any(os.environ.get(name) for name in ("SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"))


def no_display(found: str) -> OSError:
    """The sentence for a window that has no display to open on."""
    return OSError(
        f"render_mode 'human' must have a display to open a window on, got {found}; 'rgb_array' needs none"
    )


def turned(steering: Steering, right: float, down: float) -> Steering:
    """A camera dragged by pixels: the scene goes with the mouse."""
    return steering._replace(turn=steering.turn - TURN * right, tilt=steering.tilt + TURN * down)


class Window:
    """Shows frames (size, size, 3) one after the other; it opens with the first, and stays closed once closed.

    ``steering`` is what mouse and keys ask of the camera: ``HELP`` says how, in the window's title.

    Without a display SDL would draw where nobody looks, at the pace of the flight all the same. It does so only
    for who asks for it by name, with ``SDL_VIDEODRIVER=dummy``.

    Args:
        fps: frames a second.

    Raises:
        OSError: at the first frame, if there is no display.
    """

    def __init__(self, fps: int):
        self._fps, self._clock = fps, pygame.time.Clock()
        self._screen: pygame.Surface | None = None
        self.is_closed, self.steering, self._clicked = False, STRAIGHT, -AGAIN

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame when its time has come."""
        if self.is_closed:
            return
        height, width, _ = frame.shape
        screen = self._screen or self._open((width, height))
        screen.blit(pygame.image.frombuffer(frame.tobytes(), (width, height), "RGB"), (0, 0))
        self._clock.tick(self._fps)
        pygame.display.flip()
        events = pygame.event.get()
        for event in events:
            self._steer(event)
        if any(event.type == pygame.QUIT for event in events):
            self.close()

    def _steer(self, event: Any) -> None:
        """Do to the camera what an event asks for; the next picture is seen from there."""
        now = self.steering
        if event.type == pygame.MOUSEMOTION and event.buttons[0]:
            self.steering = turned(now, *event.rel)
        elif event.type == pygame.MOUSEWHEEL:
            self.steering = now._replace(zoom=now.zoom * ZOOM**event.y)
        elif event.type == pygame.KEYDOWN and event.key == pygame.K_f:
            self.steering = now._replace(is_toggled=not now.is_toggled)
        elif event.type == pygame.KEYDOWN and event.key == pygame.K_r:
            self.steering = STRAIGHT
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            before, self._clicked = self._clicked, 1e-3 * pygame.time.get_ticks()
            if self._clicked - before < AGAIN:
                self.steering = STRAIGHT

    def _open(self, size: tuple[int, int]) -> pygame.Surface:
        if not (is_driver_named() or has_display()):
            raise no_display("none")
        try:
            pygame.display.init()
            self._screen = pygame.display.set_mode(size)
        except pygame.error as error:
            raise no_display(repr(str(error))) from error
        pygame.display.set_caption(HELP)
        return self._screen

    def close(self) -> None:
        """Close the window, should it be open."""
        self.is_closed = True
        if self._screen is not None:
            self._screen = None
            pygame.display.quit()
