"""What a session can be exported as."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from napari_unpack.widgets.job import Progress


@dataclass(frozen=True)
class Prints:
    """How pictures and films are made.

    Parameters
    ----------
    size : (int, int)
        Height and width, pixels.
    fps : int
        Pictures a second.
    seconds : float
        Of one flight.
    backend : str
        Who casts; workers have no GL context of the viewer's, "gl" is made headless.
    """

    size: tuple[int, int]
    fps: int
    seconds: float
    backend: str


@dataclass(frozen=True)
class Export:
    """One kind of export.

    Parameters
    ----------
    title : str
        In menus.
    suffixes : tuple of str
        Of its files, the usual one first.
    write : callable
        (session, path, prints, progress) -> path; runs in a worker and changes no session.
    """

    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Any, Path, Prints, Progress], Path]


def _picture(session: Any, path: Path, prints: Prints, progress: Progress) -> Path:
    from napari_unpack.io import save_png
    from napari_unpack.io.headless import twin
    from napari_unpack.session.scene import scene

    progress(0.0, "Drawing the picture")
    image = scene(twin(session, packed=False), session.camera, prints.size, backend="cpu")
    progress(0.9, "Writing the picture")
    return save_png(image, path)


def _film(kind: str) -> Callable[[Any, Path, Prints, Progress], Path]:
    def write(session: Any, path: Path, prints: Prints, progress: Progress) -> Path:
        from napari_unpack.io import movie

        return movie(
            session,
            path,
            size=prints.size,
            fps=prints.fps,
            seconds=prints.seconds,
            backend="cpu",
            progress=progress,
            kind=kind,
        )

    return write


def _page(session: Any, path: Path, prints: Prints, progress: Progress) -> Path:
    from napari_unpack.io import save_objects_page

    return save_objects_page(session, path, path.stem, progress, backend="cpu")


def _csv(session: Any, path: Path, prints: Prints, progress: Progress) -> Path:
    from napari_unpack.io import save_objects_csv

    progress(0.0, "Writing the table")
    return save_objects_csv(session.objects, path)


FILMS = (".mp4", ".gif")
EXPORTS = (
    Export("Picture", (".png",), _picture),
    Export("Film of the unpacking", FILMS, _film("unpacking")),
    Export("Film of the bag turning", FILMS, _film("turntable")),
    Export("Objects as web page", (".html",), _page),
    Export("Objects as table", (".csv",), _csv),
)
