"""The layer of all that is still packed: the paper's first layer, cached.

The packed layer's background and the bag's box, as cards of the canvas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.decorations import box_edges
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.compat import PictureLayer, register
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage, to_bytes
from napari_unpack.layers.view_camera import Frame
from napari_unpack.layers.vispy_adapter import QuadsAdapter
from napari_unpack.rendering.gl.depth_quads import ImageTexture, Quad, ScreenPlace
from napari_unpack.rendering.gl.lines import Stroke

OWN = "napari"
"""Name of the background that is napari's own canvas colour."""

FARTHEST = ScreenPlace(ndc_depth=1.0)


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

    @classmethod
    def of(cls, session: Any) -> Backdrop:
        """Return the backdrop of a session's bag."""
        boxes, spacing = session.boxes, np.asarray(session.spacing, dtype=np.float64)
        lower = (boxes.lower.min(axis=0) - 0.5) * spacing
        upper = (boxes.upper.max(axis=0) - 0.5) * spacing
        return cls(lower, upper, session.surroundings)

    def show(self, around: Decorations) -> None:
        """Show other surroundings."""
        self.around, self._ground, self._edges = around, None, None
        self._strokes = []

    def behind(self, frame: Frame) -> list[Quad]:
        """Return the background's card; none where one colour of the canvas will do."""
        ground = self.around.background
        if ground.is_plain:
            return []
        size = frame.size if ground.picture is not None else (frame.size[0], 2)
        if self._ground is None or self._ground[0] != size:
            self._ground = size, ImageTexture(to_bytes(ground.paint(size)))
        return [Quad(self._ground[1], FARTHEST)]

    def edges(self, frame: Frame, opacity: float) -> list[Quad]:
        """Return the cards of the box's edges."""
        if not self.around.box:
            return []
        if self._edges is None or self._edges[0] is not frame:
            ends = box_edges(self.lower, self.upper, frame.camera)
            if not self._strokes:
                self._strokes = [Stroke(self.around.ink) for _ in ends]
            pairs = zip(self._strokes, ends, strict=True)
            drawn = [stroke.quad(pair, frame.camera, frame.size, opacity) for stroke, pair in pairs]
            self._edges = frame, [card for card in drawn if card is not None]
        return self._edges[1]


def dress(viewer: Any, around: Decorations) -> None:
    """Give a viewer's canvas the colour and the scale bar that surroundings ask for."""
    ground = around.background
    plain = None if ground.name == OWN else (*ground.colors[0][:3], 1.0)
    viewer.canvas.background_color_override = plain
    bar = viewer.canvas.overlays.scale_bar
    if bar.visible != around.scale:
        bar.visible = around.scale
    if around.scale:
        bar.colored, bar.color = True, (*around.ink[:3], 1.0)


class PackedLayer(PictureLayer):
    """The picture of the packed bag. It is kept; drawing it again casts no ray.

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
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        self._shot: RenderedImage | CanvasImage | None = None
        self._before: RenderedImage | None = None
        self._mix = 1.0
        self.drawn, self.drawn_at = False, 0.0
        self.backdrop: Backdrop | None = None
        self._cards: tuple[Quad, ...] = ()
        self._cards_for: Camera | None = None
        self.dimming = 1.0
        self.on_draw: Callable[[], None] = _nothing
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    @property
    def shot(self) -> RenderedImage | CanvasImage | None:
        """What is shown."""
        return self._shot

    def show(
        self,
        shot: RenderedImage | CanvasImage | None,
        before: RenderedImage | None = None,
        resting: bool = True,
    ) -> None:
        """Show another picture, at once or with `mix` from one that it covers.

        While the bag is turned, not `resting`, the small picture in the layer list waits: it
        costs half a redraw.
        """
        self._shot, self._cards_for, self.drawn = shot, None, False
        self._before, self._mix = before, 1.0 if before is None else 0.0
        if resting:
            self.come_to_rest()
        self.repaint()

    def come_to_rest(self) -> None:
        """Show what is shown in the layer list too."""
        shot = self._shot
        if shot is not None and self.frame is not None and shot.size == self.frame.size:
            self.set_picture(shot.thumbnail)

    def mix(self, part: float) -> None:
        """Show so much of the new picture, the rest of the one before; 1 forgets that one."""
        if self._before is not None:
            self._mix = part
            if part >= 1.0:
                self._before, self._cards_for = None, None
            self.repaint()

    def dim(self, factor: float) -> None:
        """Multiply the layer's opacity, for the time something else is looked at."""
        self.dimming, self._cards_for = factor, None
        self.repaint()

    def cards_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the picture's card and what is around it.

        The picture moves with the camera while a new one is cast.
        """
        super().cards_at(frame)
        self.on_draw()
        self.drawn, self.drawn_at = True, monotonic()
        cards = self._bag_cards(frame)
        if self.backdrop is None:
            return cards
        edges = self.backdrop.edges(self.frame, self.dimming)
        return [*self.backdrop.behind(frame), *cards, *edges]

    def _bag_cards(self, frame: Frame) -> Sequence[Quad]:
        if self._shot is None:
            return ()
        if self._cards_for is not self.frame.camera:
            card = self._shot.card(frame.camera, self.dimming)
            self._cards = () if card is None else (card,)
            self._cards_for = self.frame.camera
        if self._before is None:
            return self._cards
        return [replace(c, before=self._before.picture, mix=self._mix) for c in self._cards]


def _nothing() -> None:
    """Do nothing."""


register(
    PackedLayer,
    QuadsAdapter,
    "The objects that are still packed. Their colours and opacity are set in the Virtual Unpacking "
    "panel.",
)
