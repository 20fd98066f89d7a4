"""A bag on its stage in napari; for scripts of `on_screen.run_script`."""

from __future__ import annotations

from typing import Any

import napari
from numpy.typing import NDArray

from napari_unpack import Session
from napari_unpack.viewer.controller import Stage


def staged(
    volume: NDArray[Any], labels: NDArray[Any], size: int, **settings: Any
) -> tuple[napari.Viewer, Stage]:
    """Show a bag in a square window, and wait until all of it is drawn.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density.
    labels : (Z, Y, X) ndarray of int
        Object IDs.
    size : int
        Side of the window, pixels.
    **settings
        Attributes of the stage to set before it opens.
    """
    viewer = napari.Viewer(ndisplay=3, show=True)
    viewer.window.resize(size, size)
    stage = Stage(viewer, Session(volume, labels))
    for name, value in settings.items():
        setattr(stage, name, value)
    stage.open()
    stage.settle(300)
    return viewer, stage


def send_out(stage: Stage, count: int) -> None:
    """Have so many objects outside the bag, and wait until all is drawn."""
    stage.unpack(count)
    stage.finish()
    stage.settle(300)
