"""Where films go: MP4, GIF, or a folder of PNG pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.atomic import folder_written_whole, written_whole

Frame = NDArray[np.uint8]
FORMATS = (".mp4", ".gif", "")
"""Suffixes of films; a name without one is a folder of pictures."""


def checked_film(path: str | Path) -> Path:
    """Return where a film goes; raise `ValueError` where that is no known format."""
    target = Path(path)
    if target.suffix.lower() not in FORMATS:
        raise ValueError(
            "a film must end in .mp4 or .gif, or be a folder's name without a suffix for PNG "
            f"pictures; got {target.name!r}"
        )
    return target


@contextmanager
def film_writer(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    """Open a film that appears once it is whole; what it yields takes its frames.

    Parameters
    ----------
    path : Path
        From `checked_film`.
    size : (int, int)
        Height and width of the frames, even.
    fps : int
        Frames a second.
    """
    suffix = path.suffix.lower()
    if not suffix:
        with folder_written_whole(path, _holds_frames) as folder:
            yield _pictures_writer(folder)
        return
    writing = mp4_writer if suffix == ".mp4" else _gif
    with written_whole(path) as temporary, writing(temporary, size, fps) as write:
        yield write


@contextmanager
def mp4_writer(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    """Open an H.264 film; what it yields takes (H, W, 3) uint8 frames of an even size."""
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path),
        (size[1], size[0]),
        fps=fps,
        codec="libx264",
        quality=8,
        macro_block_size=2,
        output_params=["-movflags", "+faststart"],
        ffmpeg_log_level="error",
    )
    writer.send(None)
    try:
        yield lambda frame: writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


@contextmanager
def _gif(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    import imageio.v2 as iio

    with iio.get_writer(path, format="GIF", mode="I", duration=1000 / fps, loop=0) as writer:
        yield writer.append_data  # type: ignore[attr-defined]


def _pictures_writer(folder: Path) -> Callable[[Frame], None]:
    import imageio.v3 as iio

    count = 0

    def write(frame: Any) -> None:
        nonlocal count
        count += 1
        iio.imwrite(folder / f"frame-{count:05d}.png", frame, extension=".png")

    return write


def _holds_frames(folder: Path) -> bool:
    return all(p.name.startswith("frame-") and p.suffix == ".png" for p in folder.iterdir())
