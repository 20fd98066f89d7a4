"""What parts of the viewer ask of one another where several things fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import napari

    from napari_unpack.layers.packed_layer import PackedLayer
    from napari_unpack.layers.sprite_layer import SpriteLayer
    from napari_unpack.layers.transition_layer import TransitionLayer
    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.rendering.gl.depth_quads import Quad
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import ControllerEvents
    from napari_unpack.viewer.cut_handle import CutHandle
    from napari_unpack.viewer.interaction import Interaction
    from napari_unpack.viewer.overlays import Overlays
    from napari_unpack.viewer.scene_renderer import SceneRenderer
    from napari_unpack.viewer.scheduler import Scheduler
    from napari_unpack.viewer.slice_sync import SliceSteps

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


class PointerTarget(Protocol):
    """What `Interaction` needs of a controller."""

    @property
    def viewer(self) -> napari.Viewer:
        """The viewer whose mouse it is."""

    @property
    def session(self) -> Session:
        """What is clicked, turned and carried."""

    @property
    def layers(self) -> tuple[PackedLayer, TransitionLayer, SpriteLayer]:
        """The three layers from below."""

    @property
    def renderer(self) -> SceneRenderer:
        """Knows what a pixel shows."""

    @property
    def interaction(self) -> Interaction:
        """Knows what is under a pixel."""

    @property
    def overlays(self) -> Overlays:
        """Follows what the mouse is on."""

    @property
    def cut_handle(self) -> CutHandle:
        """Pushes and turns the cutting plane."""

    @property
    def scheduler(self) -> Scheduler:
        """Runs what the mouse asks for."""

    @property
    def outer_session(self) -> Session | None:
        """Of an opened container: the session it is from, whose labels slices show."""

    @property
    def slice_steps(self) -> SliceSteps | None:
        """Moves the slices to what is selected."""

    @property
    def events(self) -> ControllerEvents:
        """What the user did that others follow."""

    def inspect(self, object_id: int) -> None:
        """Show an object alone."""

    def leave(self) -> None:
        """Come back from inspection."""
