"""Videos: `.mp4` through ffmpeg, the system's or that of a package, `.webp` and `.gif` with Pillow."""

import shutil
import subprocess
from collections.abc import Iterable
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.experiment.files import write_safely
from quadsafe_core.checks import one_of

KINDS = (".webp", ".gif", ".mp4")


def check_video(path: Path) -> None:
    """Whether a video can be written there.

    Raises:
        ValueError: for another ending than those of ``KINDS``.
        FileNotFoundError: for ``.mp4`` without ffmpeg.
    """
    one_of("the ending of video", path.suffix.lower(), KINDS)
    if path.suffix.lower() == ".mp4" and ffmpeg() is None:
        raise FileNotFoundError(
            'video must end in .webp or .gif where there is no ffmpeg (pip install "quadsafe[video]"), '
            f"got {str(path)!r}"
        )


def ffmpeg() -> str | None:
    """The program: the system's, else that of the package imageio-ffmpeg, else None."""
    found = shutil.which("ffmpeg")
    if found is None and find_spec("imageio_ffmpeg") is not None:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    return found


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> int:
    """Write frames (H, W, 3) at a rate in 1/s; returns how many there were.

    Raises:
        ValueError, OSError: as ``check_video``, and if the file could not be written.
    """
    check_video(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return (_write_mp4 if path.suffix.lower() == ".mp4" else _write_images)(path, frames, fps)


def _write_images(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> int:
    from PIL import Image

    first, *others = (Image.fromarray(frame) for frame in frames)
    kind = path.suffix.lower().removeprefix(".")
    # Whole milliseconds, without drift.
    ends = np.rint(1000.0 / fps * np.arange(len(others) + 2))
    durations = np.diff(ends).astype(int).tolist()
    settings = {"duration": durations, "loop": 0, "save_all": True, "append_images": others}
    write_safely(
        path, lambda file: first.save(file, kind, **settings, **({"method": 2} if kind == "webp" else {}))
    )
    return 1 + len(others)


def _write_mp4(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> int:
    temporary, count = path.with_name(f".{path.name}.part.mp4"), 0
    frames = iter(frames)
    first = next(frames)
    height, width, _ = first.shape
    command = [ffmpeg() or "ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-pix_fmt", "yuv420p", str(temporary)]
    try:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            count = _feed(process, first, frames)
            _, stderr = process.communicate()
        if process.returncode != 0:
            raise OSError(
                f"{path} could not be written: ffmpeg says {stderr.decode(errors='replace').strip()!r}"
            )
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return count


def _feed(process: subprocess.Popen, first: NDArray[np.uint8], frames: Iterable[NDArray[np.uint8]]) -> int:
    assert process.stdin is not None
    count = 0
    try:
        for frame in chain((first,), frames):
            process.stdin.write(frame.tobytes())
            count += 1
    except BrokenPipeError:
        # What went wrong, ffmpeg says itself.
        pass
    return count
