"""What parts of the viewer ask of one another where several things fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.rendering.gl.depth_quads import Quad

# (2,) row and column of the canvas, logical pixels.
Pixel = NDArray[np.float64]


class Event(Protocol):
    """A signal of psygnal or of napari: calls what was connected to it."""

    def connect(self, callback: Callable[..., Any], /) -> Any:
        """Call back from now on."""

    def disconnect(self, callback: Callable[..., Any], /) -> Any:
        """Call back no more."""


class MouseEvent(Protocol):
    """napari's mouse event; `pos` is column and row of the canvas, `position` in its world."""

    type: str
    button: int
    pos: Sequence[float]
    position: Sequence[float]
    modifiers: Sequence[Any]
    handled: bool


class Drawing(Protocol):
    """Something drawn over the bag."""

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return what is drawn on a frame, called at every draw."""


class ClickTool(Protocol):
    """What takes the clicks in the picture in place of selecting."""

    def click(self, pixel: Pixel) -> None:
        """Take a click in the 3D view.

        Parameters
        ----------
        pixel : (2,) ndarray of float64
            Of the canvas.
        """

    def click_voxel(self, voxel: NDArray[np.float64]) -> None:
        """Take a click on a slice, of napari's or of the linked ones.

        Parameters
        ----------
        voxel : (3,) ndarray of float64
            Of the session's volume or beside it, z y x with fractions.
        """

    def cancel(self) -> None:
        """Take no more."""
