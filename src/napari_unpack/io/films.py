"""Films of an unpacking, without a window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.view import Camera
from napari_unpack.io.atomic import written_whole
from napari_unpack.io.headless import Progress, framed, packed_count, twin
from napari_unpack.io.images import straight_bytes
from napari_unpack.session.pictures import BACKGROUND, scene

Frame = NDArray[np.uint8]
FORMATS = (".mp4", ".gif")
REST = (0.6, 0.12, 1.2)
"""Seconds of standstill before the first flight, after each, and at the end."""


def movie(
    session: Any,
    path: str | Path,
    count: int | None = None,
    size: tuple[int, int] = (720, 960),
    fps: int = 25,
    seconds: float = 0.8,
    backend: str = "auto",
    background: Sequence[float] = BACKGROUND,
    progress: Progress | None = None,
) -> Path:
    """Film how a bag is unpacked, from everything packed to the last object.

    Parameters
    ----------
    session : Session
        The bag, its colours, view and direction. Not changed: a twin of it is filmed, so this
        may run on a thread of its own.
    path : str or Path
        .mp4 (H.264) or .gif; its folder must exist.
    count : int, optional
        How many objects to unpack; by default all that are not hidden.
    size : (int, int)
        Height and width, pixels; odd numbers are rounded down, as video wants.
    fps : int
        Frames a second.
    seconds : float
        What one flight takes.
    backend : {"auto", "cpu", "gl"}
        Who casts.
    background : sequence of 3 floats
        RGB behind everything.
    progress : callable, optional
        Takes (fraction, text) before every flight and frame; raising in it cancels and leaves
        no file.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    ValueError
        If the format is unknown, or a number not positive.
    FileNotFoundError
        If the folder does not exist.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"a film must end in {' or '.join(FORMATS)}, got {target.name!r}")
    even = int(size[0]) // 2 * 2, int(size[1]) // 2 * 2
    if min(even) < 2 or fps < 1 or not seconds > 0:
        raise ValueError(
            f"size, fps and seconds must be positive, got {size!r}, {fps!r} and {seconds!r}"
        )
    with written_whole(target) as temporary:
        writing = mp4_writer if suffix == ".mp4" else _gif
        with writing(temporary, even, fps) as write:
            filmed = twin(session)
            camera = framed(filmed, even)
            for frame in _frames(
                filmed, camera, even, count, fps, seconds, backend, background, progress
            ):
                write(frame)
    return target


def _frames(
    session: Any,
    camera: Camera,
    size: tuple[int, int],
    count: int | None,
    fps: int,
    seconds: float,
    backend: str,
    background: Sequence[float],
    progress: Progress | None,
) -> Iterator[Frame]:
    def picture(time: float | None = None) -> Frame:
        image = scene(session, camera, size, time, background, backend)
        return straight_bytes(image[..., :3])

    def still(rest: float) -> Iterator[Frame]:
        frame = picture()
        for _ in range(max(1, round(rest * fps))):
            yield frame

    packed = packed_count(session)
    wanted = packed if count is None else min(count, packed)
    session.animated, session.seconds = True, seconds
    tell = progress or (lambda fraction, text: None)
    tell(0.0, "Filming")
    yield from still(REST[0])
    gone = 0
    while gone < wanted and session.unpack(1):
        flights = dict(session.flights)
        start = min(flight.start for flight in flights.values())
        length = max(flight.start + flight.seconds for flight in flights.values()) - start
        frames = max(1, round(length * fps))
        for i in range(frames):
            part = gone + len(flights) * i / frames
            tell(min(part / wanted, 1.0), f"Filming: {gone} of {wanted} objects out")
            yield picture(start + (i + 1) * length / frames)
        for object_id in flights:
            session.land(object_id)
        gone += len(flights)
        yield from still(REST[1])
    yield from still(REST[2])
    tell(1.0, "Filmed")


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
