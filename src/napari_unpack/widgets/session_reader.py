"""Saved sessions dropped on napari: they open in the panel, on the stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

LayerData = tuple[Any, ...]
NOTHING: list[LayerData] = [(None,)]
"""What napari takes for a reader that has seen to everything itself."""

PLUGIN, PANEL = "napari-unpack", "Virtual Unpacking"


def get_session_reader(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """Return a reader for a saved session, None where it is none; looks at names alone.

    Parameters
    ----------
    path : str or sequence of str
        What napari was asked to open.
    """
    from napari_unpack.io.session_stores import holds_session

    if not isinstance(path, str):
        if len(path) != 1:
            return None
        path = path[0]
    return open_dropped if holds_session(Path(path)) else None


def open_dropped(path: str | Sequence[str]) -> list[LayerData]:
    """Open a session in the panel; without a window, as an Image and Labels.

    Parameters
    ----------
    path : str or sequence of str
        As for `get_session_reader`.

    Returns
    -------
    list of (data, attributes, layer type)
        Nothing where the panel opens it, in a worker.
    """
    from napari import current_viewer

    first = Path(path if isinstance(path, str) else path[0])
    viewer = current_viewer()
    if viewer is not None:
        _, panel = viewer.window.add_plugin_dock_widget(PLUGIN, PANEL)
        panel.files.open_from(first)
        return NOTHING
    return _layers(first)


def _layers(path: Path) -> list[LayerData]:
    from napari_unpack.io import open_session
    from napari_unpack.io.sessions import standing_of
    from napari_unpack.session.record import given_labels

    session = open_session(path)
    about: dict[str, Any] = {"scale": tuple(session.spacing), "units": ("mm",) * 3}
    about["affine"] = standing_of(path)
    return [
        (session.volume, {**about, "name": path.stem, "colormap": "gray"}, "image"),
        (given_labels(session), {**about, "name": f"{path.stem} objects"}, "labels"),
    ]
