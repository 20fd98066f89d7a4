"""Where films go: MP4, GIF, or a folder of PNG pictures."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
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
    with _encoded(
        path,
        size,
        fps=fps,
        codec="libx264",
        quality=8,
        macro_block_size=2,
        output_params=["-movflags", "+faststart"],
    ) as write:
        yield write


@contextmanager
def _gif(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    """Open a GIF: its 256 colours are chosen once all frames are known and kept without loss.

    A ninth as large as with colours chosen frame by frame and dithered: what stands still
    stays the same and is left out.
    """
    with TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}-") as folder:
        film, colors = Path(folder) / "film.mkv", Path(folder) / "colors.png"
        with _encoded(
            film, size, fps=fps, codec="ffv1", pix_fmt_out="bgr0", macro_block_size=2
        ) as write:
            yield write
        _ffmpeg("-i", str(film), "-vf", "palettegen", str(colors))
        palette = "paletteuse=dither=none:diff_mode=rectangle"
        _ffmpeg("-i", str(film), "-i", str(colors), "-lavfi", palette, "-f", "gif", str(path))


@contextmanager
def _encoded(
    path: Path, size: tuple[int, int], **options: Any
) -> Iterator[Callable[[Frame], None]]:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path), (size[1], size[0]), ffmpeg_log_level="error", **options
    )
    writer.send(None)
    try:
        yield lambda frame: writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


def _ffmpeg(*arguments: str) -> None:
    from imageio_ffmpeg import get_ffmpeg_exe

    command = [get_ffmpeg_exe(), "-loglevel", "error", "-y", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        raise OSError(f"the film could not be written: {done.stderr.strip()[-300:]}")


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
