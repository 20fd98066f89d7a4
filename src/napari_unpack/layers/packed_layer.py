"""The layer of all that is still packed, with its background and the bag's box.

The paper's first layer: its image is kept, and drawing it again casts no ray.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.decorations import box_edges
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.compat import PictureLayer, register
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage, to_bytes
from napari_unpack.layers.scale_bar import ScaleBar
from napari_unpack.layers.view_camera import Frame, same_camera
from napari_unpack.layers.vispy_adapter import QuadsAdapter
from napari_unpack.rendering.gl.depth_quads import ImageTexture, Quad, ScreenPlace
from napari_unpack.rendering.gl.lines import Stroke

if TYPE_CHECKING:
    import napari

# Name of the background that is napari's own canvas colour.
OWN = "napari"

# Behind all, so that no depth of the scene hides what stands before it; in napari's grid it is
# behind the views of all layers.
FARTHEST = ScreenPlace(ndc_depth=1.0, in_view=False)


@dataclass(eq=False)
class Backdrop:
    """What stands behind and around the packed bag.

    Parameters
    ----------
    lower, upper : (3,) ndarray of float64
        The bag's box, world mm.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    around: Decorations = field(default_factory=Decorations.of)
    _ground: tuple[object, ImageTexture] | None = None
    _strokes: list[Stroke] = field(default_factory=list)
    _edges: tuple[Frame, list[Quad]] | None = None
    _bar: ScaleBar = field(default_factory=ScaleBar)

    def show(self, around: Decorations) -> None:
        """Show other surroundings."""
        self.around, self._ground, self._edges = around, None, None
        self._strokes = []

    def behind(self, frame: Frame) -> list[Quad]:
        """Return the background's quad; none where one colour of the canvas will do."""
        ground = self.around.background
        if ground.is_plain:
            return []
        # A gradient runs from top to bottom: two columns tell all of it.
        size = frame.size if ground.image is not None else (frame.size[0], 2)
        if self._ground is None or self._ground[0] != size:
            self._ground = size, ImageTexture(to_bytes(ground.paint(size)))
        return [Quad(self._ground[1], FARTHEST)]

    def before(self, frame: Frame) -> list[Quad]:
        """Return the quads of the scale bar."""
        return self._bar.quads(frame, self.around)

    def edges(self, frame: Frame, opacity: float) -> list[Quad]:
        """Return the quads of the box's edges.

        Parameters
        ----------
        frame : Frame
            What the canvas shows.
        opacity : float
        """
        if not self.around.box:
            return []
        # Frames of the same view are one object: lines are laid out once a view.
        if self._edges is None or self._edges[0] is not frame:
            ends = box_edges(self.lower, self.upper, frame.camera)
            if not self._strokes:
                self._strokes = [Stroke(self.around.ink) for _ in ends]
            pairs = zip(self._strokes, ends, strict=True)
            drawn = [stroke.quad(pair, frame.camera, frame.size, opacity) for stroke, pair in pairs]
            self._edges = frame, [quad for quad in drawn if quad is not None]
        return self._edges[1]


def decorate_canvas(viewer: napari.Viewer, around: Decorations) -> None:
    """Give a viewer's canvas the colour that decorations ask for, and no second scale bar.

    Parameters
    ----------
    viewer : napari.Viewer
    around : Decorations
    """
    ground = around.background
    plain = None if ground.name == OWN else (*ground.colors[0][:3], 1.0)
    viewer.canvas.background_color_override = plain
    # Ours has the session's unit, and is in pictures and films as well.
    viewer.canvas.overlays.scale_bar.visible = False


class PackedLayer(PictureLayer):
    """The image of the packed bag. It is kept; drawing it again casts no ray.

    Parameters
    ----------
    name, spacing, box, **placement
        As for `PictureLayer`; the box is the volume's.

    Attributes
    ----------
    on_draw : callable
        Called whenever the canvas draws the layer, with its context current.
    drawn : bool
        Whether the canvas has drawn what is shown.
    drawn_at : float
        When it was drawn last, s of `time.monotonic`.
    overlays : callable or None
        Given what the canvas shows, returns quads that are drawn over the bag.
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        self._image: RenderedImage | CanvasImage | None = None
        self._before: RenderedImage | None = None
        self._mix = 1.0
        self.drawn, self.drawn_at = False, 0.0
        self.backdrop: Backdrop | None = None
        self.overlays: Callable[[Frame], Sequence[Quad]] | None = None
        self._quads: tuple[Quad, ...] = ()
        self._quads_for: Camera | None = None
        self.dimming = 1.0
        self.on_draw: Callable[[], None] = do_nothing
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    @property
    def image(self) -> RenderedImage | CanvasImage | None:
        """What is shown."""
        return self._image

    def shows(self, frame: Frame) -> bool:
        """Return whether it is seen, and its image is of this view and not of one before."""
        return self.visible and (
            self._image is None or same_camera(self._image.camera, frame.camera)
        )

    def show(
        self,
        image: RenderedImage | CanvasImage | None,
        before: RenderedImage | None = None,
        with_thumbnail: bool = True,
    ) -> None:
        """Show another image.

        Parameters
        ----------
        image : RenderedImage or CanvasImage or None
        before : RenderedImage, optional
            What it covers, and replaces by `mix`; by default it is shown at once.
        with_thumbnail : bool, optional
            Show it in the layer list too. While the bag is turned that waits: it costs half a
            redraw.
        """
        self._image, self._quads_for, self.drawn = image, None, False
        self._before, self._mix = before, 1.0 if before is None else 0.0
        if with_thumbnail:
            self.update_thumbnail()
        self.repaint()

    def update_thumbnail(self) -> None:
        """Show what is shown in the layer list too."""
        image = self._image
        # A preview would look coarse there, and be replaced in a moment.
        if image is not None and self.frame is not None and image.size == self.frame.size:
            self.set_picture(image.thumbnail)

    def mix(self, part: float) -> None:
        """Show so much of the new image, the rest of the one before; 1 forgets that one."""
        if self._before is not None:
            self._mix = part
            if part >= 1.0:
                self._before, self._quads_for = None, None
            self.repaint()

    def dim(self, factor: float) -> None:
        """Multiply the layer's opacity, for the time something else is looked at."""
        self.dimming, self._quads_for = factor, None
        self.repaint()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the image's quad and what is around it.

        The image moves with the camera while a new one is cast.
        """
        super().quads_at(frame)
        self.on_draw()
        self.drawn, self.drawn_at = True, monotonic()
        over = () if self.overlays is None else self.overlays(frame)
        quads = [*self._bag_quads(frame), *over]
        if self.backdrop is None:
            return quads
        edges = self.backdrop.edges(self.frame or frame, self.dimming)
        return [*self.backdrop.behind(frame), *quads, *edges, *self.backdrop.before(frame)]

    def _bag_quads(self, frame: Frame) -> Sequence[Quad]:
        if self._image is None:
            return ()
        # A frame that shows the same as the last one is another object.
        camera = frame.camera if self.frame is None else self.frame.camera
        if self._quads_for is not camera:
            quad = self._image.quad(frame.camera, self.dimming)
            self._quads = () if quad is None else (quad,)
            self._quads_for = camera
        if self._before is None:
            return self._quads
        return [replace(c, before=self._before.texture, mix=self._mix) for c in self._quads]


def do_nothing() -> None:
    """Do nothing: what `on_draw` is where nothing is to be sent."""


register(
    PackedLayer,
    QuadsAdapter,
    "The objects that are still packed. Their colours and opacity are set in the Virtual Unpacking "
    "panel.",
)
