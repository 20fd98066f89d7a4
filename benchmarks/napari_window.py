"""A bag in the 3D view of napari; for scripts of `on_screen.run_script`."""

from __future__ import annotations

from typing import Any

import napari
from numpy.typing import NDArray

from napari_unpack import Session
from napari_unpack.viewer.controller import SessionController


def opened_in_napari(
    volume: NDArray[Any], labels: NDArray[Any], size: int, **settings: Any
) -> tuple[napari.Viewer, SessionController]:
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
        Attributes of the controller to set before it opens.
    """
    viewer = napari.Viewer(ndisplay=3, show=True)
    viewer.window.resize(size, size)
    controller = SessionController(viewer, Session(volume, labels))
    for name, value in settings.items():
        setattr(controller, name, value)
    controller.open()
    controller.settle(300)
    return viewer, controller


def unpack_at_once(controller: SessionController, count: int) -> None:
    """Have so many objects outside the bag, and wait until all is drawn."""
    controller.unpack(count)
    controller.finish()
    controller.settle(300)
