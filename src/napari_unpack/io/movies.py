"""Movies of an unpacking, or of the bag turning round, without a window.

They go into an MP4, a GIF, or a folder of PNG images.
"""

from __future__ import annotations

import errno
import os
import re
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.atomic import checked_target, drafted, folder_written_atomically, holds_only
from napari_unpack.geometry.axes import unit
from napari_unpack.geometry.camera_glide import GLIDE_SECONDS, CameraGlide
from napari_unpack.geometry.transforms import Pose, rotation_about
from napari_unpack.geometry.view import GRAVITY_UP, STEEPEST, Camera
from napari_unpack.io.headless import decorated, packed_copy, packed_count, snapshot
from napari_unpack.io.images import straight_bytes
from napari_unpack.memory import ENCODER_BYTES, PICTURE_BYTES, check_picture
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.cpu import CANCELLING
from napari_unpack.session.framing import contained, fitted
from napari_unpack.tasks import BEAT_SECONDS, SILENT, Progress, Share, no_progress

if TYPE_CHECKING:
    from napari_unpack.session import Session

Frame = NDArray[np.uint8]
FORMATS = (".mp4", ".gif", "")
"""Suffixes of movies; a name without one is a folder of images."""

LONGEST_REASON = 300
"""Characters of what the encoder said that a message repeats."""

# GIF counts in hundredths of a second, and browsers show a frame of one hundredth for ten.
MOST_GIF_FPS = 50


def checked_movie_path(path: str | Path, size: tuple[int, int]) -> Path:
    """Return where a movie goes.

    Parameters
    ----------
    path : str or Path
    size : (int, int)
        Height and width of its frames, pixels.

    Raises
    ------
    ValueError
        If its suffix is none of `FORMATS`, or its frames do not fit into memory.
    """
    target = checked_target(path)
    if target.suffix.lower() not in FORMATS:
        raise ValueError(
            "a movie must end in .mp4 or .gif, or be a folder's name without a suffix for PNG "
            f"images; got {target.name!r}"
        )
    check_picture(size, PICTURE_BYTES + (ENCODER_BYTES if target.suffix else 0), "movie")
    return target


@contextmanager
def movie_writer(
    path: Path, size: tuple[int, int], fps: int, share: Share = SILENT
) -> Iterator[Callable[[Frame], None]]:
    """Open a movie that appears once it is whole; what it yields takes its frames.

    Parameters
    ----------
    path : Path
        From `checked_movie_path`.
    size : (int, int)
        Height and width of the frames, even.
    fps : int
    share : Share
        Of writing what the frames make, once they are all there.

    Raises
    ------
    OSError
        If it cannot be written; a finished file is kept elsewhere, and the message says where.
    """
    # Two ways to be whole or absent: a folder of images is swapped, a file is renamed.
    suffix = path.suffix.lower()
    if not suffix:
        with folder_written_atomically(path, _holds_frames) as folder:
            yield _images_writer(folder)
        return
    writing = mp4_writer if suffix == ".mp4" else _gif
    with drafted(path) as draft, writing(draft, size, fps, share) as write:
        yield write


@contextmanager
def mp4_writer(
    path: Path, size: tuple[int, int], fps: int, share: Share = SILENT
) -> Iterator[Callable[[Frame], None]]:
    """Open an H.264 movie; what it yields takes (H, W, 3) uint8 frames of an even size.

    Parameters
    ----------
    path : Path
    size : (int, int)
        Height and width, even.
    fps : int
    share : Share
        As for `movie_writer`.

    Raises
    ------
    OSError
        If it could not be written whole.
    """
    # Colour at half the resolution, which is what browsers play.
    codec = ("-vcodec", "libx264", "-pix_fmt", "yuv420p")
    # Of 0 to 51, where ffmpeg's own 23 blurs the grain of textures. The index stands in front,
    # so that a browser plays it while it loads.
    more = ("-crf", "10", "-movflags", "+faststart")
    with _encoded(path, size, fps, share, *codec, *more) as write:
        yield write


@contextmanager
def _gif(
    path: Path, size: tuple[int, int], fps: int, share: Share
) -> Iterator[Callable[[Frame], None]]:
    """Open a GIF: its 256 colours are chosen once all frames are known and kept without loss.

    A ninth as large as with colours chosen frame by frame and dithered: what stands still
    stays the same and is left out.
    """
    with TemporaryDirectory(dir=path.parent) as folder:
        # Without loss in between: a second encoder would turn noise of the first into colours.
        lossless, colors = Path(folder) / "movie.mkv", Path(folder) / "colors.png"
        with _encoded(lossless, size, fps, SILENT, "-vcodec", "ffv1", "-pix_fmt", "bgr0") as write:
            yield write
        # One picture: ffmpeg else takes a % anywhere in its path for a number.
        chosen = ("-vf", "palettegen", "-update", "1", str(colors))
        _ffmpeg(share.part(0.0, 0.4), "-i", str(lossless), *chosen)
        # No dithering: its pattern changes from frame to frame, and nothing would stand still.
        palette = "paletteuse=dither=none:diff_mode=rectangle"
        if fps > MOST_GIF_FPS:
            palette = f"fps={MOST_GIF_FPS},{palette}"
        palette_in = ("-f", "image2", "-pattern_type", "none", "-i", str(colors))
        films = ("-i", str(lossless), *palette_in, "-lavfi", palette)
        _ffmpeg(share.part(0.4, 1.0), *films, "-f", "gif", str(path))


@contextmanager
def _encoded(
    path: Path, size: tuple[int, int], fps: int, share: Share, *options: str
) -> Iterator[Callable[[Frame], None]]:
    # ffmpeg counts width first.
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[1]}x{size[0]}", "-r", str(fps))
    command = _command(*raw, "-i", "-", "-an", *options, str(path))
    # A file takes what ffmpeg says: a pipe that nobody reads would fill and stop it.
    with TemporaryFile() as said:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said
        )
        frames = process.stdin
        assert frames is not None, "it was asked for"
        broken = False
        try:
            try:
                yield lambda frame: _send(frames, frame)
                frames.close()
            except BrokenPipeError:
                # ffmpeg has ended early; what it said tells why.
                broken = True
            # imageio-ffmpeg's own writer ignores this status: a full disk left half a film.
            if _status(process, share) or broken:
                said.seek(0)
                raise _unwritten(process, said.read().decode(errors="replace"))
        finally:
            process.kill()
            process.wait()
            with suppress(BrokenPipeError):
                frames.close()


def _send(stream: IO[bytes], frame: Frame) -> None:
    stream.write(np.ascontiguousarray(frame).data)


def _ffmpeg(share: Share, *arguments: str) -> None:
    with TemporaryFile() as said:
        # No stdin: ffmpeg would read the terminal's keys.
        process = subprocess.Popen(
            _command(*arguments), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said
        )
        try:
            if _status(process, share):
                said.seek(0)
                raise _unwritten(process, said.read().decode(errors="replace"))
        finally:
            process.kill()
            process.wait()


def _status(process: subprocess.Popen[bytes], share: Share) -> int:
    """Wait for a process to end; return its exit status."""
    beats = 0
    while True:
        try:
            return process.wait(BEAT_SECONDS)
        except subprocess.TimeoutExpired:
            beats += 1
            share(beats / (beats + 1 / BEAT_SECONDS))


def _command(*arguments: str) -> list[str]:
    from imageio_ffmpeg import get_ffmpeg_exe

    return [get_ffmpeg_exe(), "-loglevel", "error", "-y", *arguments]


def _unwritten(process: subprocess.Popen[bytes], said: str) -> OSError:
    # On a full disk there is no room for words either: ffmpeg's status is the error's number.
    if not said.strip() and process.returncode == 256 - errno.ENOSPC:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    # Its last words: those before repeat them for every stream. A killed one says nothing.
    if len(said := " ".join(said.split())) > LONGEST_REASON:
        last = said[-LONGEST_REASON:]
        # From a whole word on, if it is of several.
        said = "…" + (last.partition(" ")[2] or last)
    return OSError(said or f"ffmpeg ended with status {process.returncode}")


def _images_writer(folder: Path) -> Callable[[Frame], None]:
    import imageio.v3 as iio

    count = 0

    def write(frame: Any) -> None:
        nonlocal count
        count += 1
        iio.imwrite(folder / f"frame-{count:05d}.png", frame, extension=".png")

    return write


def _holds_frames(folder: Path) -> bool:
    return holds_only(folder, lambda name: bool(re.fullmatch(r"frame-\d{5,}\.png", name)))


KINDS = ("unpacking", "turntable")
MARGIN = 1.03
"""Visible height of a turntable, in heights of the bag: its edges stay clear of the frame."""

STANDSTILL = (0.6, 0.12, 1.2)
"""Seconds before the first flight, after each, and at the end: enough to take in what is there."""


def movie(
    session: Session,
    path: str | Path,
    count: int | None = None,
    size: tuple[int, int] = (720, 960),
    fps: int = 25,
    seconds: float = 0.8,
    backend: str = "auto",
    background: object = None,
    decorations: Sequence[str] | None = None,
    progress: Progress | None = None,
    kind: str = "unpacking",
    turn_seconds: float = 8.0,
    window: tuple[int, int] | None = None,
) -> Path:
    """Make a movie of a bag being unpacked, from all packed to the last object, or turning.

    What was unpacked already leaves first, in the order in which it did, then what is next.

    Parameters
    ----------
    session : Session
        The bag, its colours, view and direction. Not changed: a copy is rendered, so this may
        run on any thread.
    path : str or Path
        .mp4 (H.264), .gif, or the name of a folder, without a suffix, for PNG images; the
        folder it stands in must exist.
    count : int, optional
        How many objects to unpack; by default all that are not hidden.
    size : (int, int)
        Height and width, pixels; odd numbers are rounded down, as video wants.
    fps : int
    seconds : float
        What one flight takes.
    backend : {"auto", "cpu", "gl"}
    background : optional
        What is behind everything, as `Background.of` takes it; by default the session's.
    decorations : sequence of str, optional
        Out of "box" and "scale"; by default the session's.
    progress : callable, optional
        Takes (fraction, text) before and during every frame; raising in it cancels and leaves
        no file.
    kind : {"unpacking", "turntable"}
        A turntable shows the session as it stands, from all around.
    turn_seconds : float
        What one turn of the turntable takes.
    window : (int, int), optional
        Height and width in pixels of the window whose layout the movie keeps: sprites stand
        where they stand there. By default the movie's own size.

    Raises
    ------
    ValueError
        If the format or the kind is unknown, or a number not positive.
    FileNotFoundError
        If the folder does not exist.
    """
    target = checked_movie_path(path, size)
    if kind not in KINDS:
        raise ValueError(f"kind must be {' or '.join(KINDS)}, got {kind!r}")
    # H.264 stores colour at half the resolution, so edges are even.
    even = int(size[0]) // 2 * 2, int(size[1]) // 2 * 2
    least = min(even[0] / 2, even[1] / 2, fps, 1 if count is None else count)
    if least < 1 or not (0 < seconds < np.inf and 0 < turn_seconds < np.inf):
        raise ValueError(
            f"count, size, fps and seconds must be positive, got {count!r}, {size!r}, {fps!r} and "
            f"{(seconds, turn_seconds)!r}"
        )
    around = decorated(session, background, decorations)
    share = Share(progress or no_progress)
    ending = Share(share.report, 0.9, 1.0, "Writing the movie")
    with movie_writer(target, even, fps, ending) as write:
        turntable = kind == "turntable"
        shown = snapshot(session) if turntable else packed_copy(session)
        shown.leave()
        shown.decorations = around
        # Before the slots are asked for, which are planned for it.
        shown.canvas_size = even if window is None else window
        shooting = _Shooting(shown, even, fps, backend, share.part(0.0, 0.9, "Rendering"))
        frames = (
            _turning(shooting, turn_seconds) if turntable else _unpacking(shooting, count, seconds)
        )
        for frame in frames:
            write(frame)
    share(1.0, "Written")
    return target


@dataclass(frozen=True, eq=False)
class _Shooting:
    """What every frame needs."""

    session: Session
    size: tuple[int, int]
    fps: int
    backend: str
    share: Share

    @property
    def camera(self) -> Camera:
        """The camera of the window's layout as things are now."""
        session = self.session
        return contained(fitted(session), session.canvas_size, self.size)

    def image(
        self,
        camera: Camera,
        share: Share,
        time: float | None = None,
        before: Mapping[int, Pose] | None = None,
        gone: float = 1.0,
    ) -> Frame:
        """Return a frame; sprites have gone so far from where they were before."""
        scene, was = self.session.scene(), before or {}
        poses = {i: was.get(i, pose).toward(pose, gone) for i, pose in scene.poses.items()}
        # Premultiplied, so over black where nothing is: movies have no alpha.
        with CANCELLING.by(share):
            image = scene_image(replace(scene, poses=poses), camera, self.size, time, self.backend)
        return straight_bytes(image[..., :3])

    def still(self, rest: float, share: Share) -> Iterator[Frame]:
        # Rendered once: nothing moves while it stands.
        frame = self.image(self.camera, share.part(0.0, 0.5))
        for _ in share.part(0.5, 1.0).over(range(self.frames(rest))):
            yield frame

    def step(self, share: Share) -> bool:
        """Go a step further; return whether anything flies."""
        with CANCELLING.by(share):
            return bool(self.session.go_to(self.session.step + 1) and self.session.flights)

    def frames(self, seconds: float) -> int:
        return max(1, round(seconds * self.fps))


def _unpacking(shooting: _Shooting, count: int | None, seconds: float) -> Iterator[Frame]:
    session, share = shooting.session, shooting.share
    packed = packed_count(session)
    wanted = packed if count is None else min(count, packed)
    # The bar goes by frames, as if the objects left one by one.
    flight = shooting.frames(max(seconds, GLIDE_SECONDS))
    flying = wanted * (flight + shooting.frames(STANDSTILL[1]))
    first, last = shooting.frames(STANDSTILL[0]), shooting.frames(STANDSTILL[2])
    begun, ending = first / (first + flying + last), 1.0 - last / (first + flying + last)
    # Without a screen, flights are off: the movie is what they are for.
    session.animated, session.seconds = True, seconds
    yield from shooting.still(STANDSTILL[0], share.part(0.0, begun))
    flights = share.part(begun, ending)
    gone, camera, poses = 0, shooting.camera, session.poses
    # A step more each time: those that a person took, then the next to leave.
    while gone < wanted and shooting.step(flights.part(gone / wanted, gone / wanted)):
        leaving = dict(session.flights)
        # Flights of a group need not start together: a step lasts until the last has landed.
        start = min(flight.start for flight in leaving.values())
        length = max(flight.start + flight.seconds for flight in leaving.values()) - start
        # And until the camera stands, or the film would jump.
        frames = shooting.frames(length := max(length, GLIDE_SECONDS))
        # As in the window: there is room for a sprite before it comes.
        glide = CameraGlide(camera, camera := shooting.camera, start)
        for i in range(frames):
            at, ended = (min((gone + len(leaving) * k / frames) / wanted, 1.0) for k in (i, i + 1))
            part = flights.part(at, ended, f"Rendering: {gone} of {wanted} objects out")
            time = start + (i + 1) * length / frames
            yield shooting.image(glide.camera(time), part, time, poses, glide.gone(time))
        for object_id in leaving:
            # By hand: no clock runs here, so none would land by itself.
            session.land(object_id)
        gone, poses = gone + len(leaving), session.poses
        at = min(gone / wanted, 1.0)
        yield from shooting.still(STANDSTILL[1], flights.part(at, at))
    yield from shooting.still(STANDSTILL[2], share.part(ending, 1.0))


def _turning(shooting: _Shooting, seconds: float) -> Iterator[Frame]:
    """Turn the bag once round the vertical; the movie may be played in a loop."""
    frames = max(2, round(seconds * shooting.fps))
    camera = _close(shooting)
    for i in range(frames):
        text = f"Rendering: {i} of {frames} images"
        part = shooting.share.part(i / frames, (i + 1) / frames, text)
        # The last image is one step before the first, so that a loop has no double frame.
        angle = 2 * np.pi * i / frames
        yield shooting.image(turned(camera, angle, shooting.session.away_from_table), part)


def _close(shooting: _Shooting) -> Camera:
    """Return the camera that just holds the bag at every turn, and what is out of it."""
    size, session, camera = shooting.size, shooting.session, shooting.camera
    # An upright image is bounded by its width.
    aspect = min(1.0, size[1] / size[0])
    half_angle = np.radians(camera.fov) / 2
    height = 2 * MARGIN * session.bag.radius_in(camera.stretch) / (aspect * np.cos(half_angle))
    # With nothing out the picture of now says nothing of the other turns.
    return replace(camera, height=max(float(height), camera.height if session.step else 0.0))


def turned(camera: Camera, angle: float, up: ArrayLike = GRAVITY_UP) -> Camera:
    """Return a camera that has gone round its centre.

    Parameters
    ----------
    camera : Camera
    angle : float
        Radians, about the vertical; about the image's where one looks along it.
    up : (3,) array_like
        What is up, see `Session.away_from_table`.
    """
    upright = unit(np.linalg.solve(camera.stretch, np.asarray(up, dtype=np.float64)))
    towards, down, _ = camera.rotation
    # Seen along the vertical, a turn about it would only spin the image.
    axis = upright if abs(float(towards @ upright)) < STEEPEST else -down
    turn = rotation_about(axis, -angle)
    return replace(camera, rotation=camera.rotation @ turn)
