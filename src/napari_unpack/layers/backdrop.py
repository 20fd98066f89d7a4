"""The packed layer's background and the bag's box, as cards of the canvas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Surroundings
from napari_unpack.appearance.decorations import box_edges
from napari_unpack.layers.shots import to_bytes
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.visuals.cards import Card
from napari_unpack.rendering.visuals.pictures import Picture
from napari_unpack.rendering.visuals.places import ScreenPlace
from napari_unpack.rendering.visuals.strokes import Stroke

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
    around: Surroundings = field(default_factory=Surroundings.of)
    _ground: tuple[object, Picture] | None = None
    _strokes: list[Stroke] = field(default_factory=list)
    _edges: tuple[Frame, list[Card]] | None = None

    @classmethod
    def of(cls, session: Any) -> Backdrop:
        """Return the backdrop of a session's bag."""
        boxes, spacing = session.boxes, np.asarray(session.spacing, dtype=np.float64)
        lower = (boxes.lower.min(axis=0) - 0.5) * spacing
        upper = (boxes.upper.max(axis=0) - 0.5) * spacing
        return cls(lower, upper, session.surroundings)

    def show(self, around: Surroundings) -> None:
        """Show other surroundings."""
        self.around, self._ground, self._edges = around, None, None
        self._strokes = []

    def behind(self, frame: Frame) -> list[Card]:
        """Return the background's card; none where one colour of the canvas will do."""
        ground = self.around.background
        if ground.is_plain:
            return []
        size = frame.size if ground.picture is not None else (frame.size[0], 2)
        if self._ground is None or self._ground[0] != size:
            self._ground = size, Picture(to_bytes(ground.paint(size)))
        return [Card(self._ground[1], FARTHEST)]

    def edges(self, frame: Frame, opacity: float) -> list[Card]:
        """Return the cards of the box's edges."""
        if not self.around.box:
            return []
        if self._edges is None or self._edges[0] is not frame:
            ends = box_edges(self.lower, self.upper, frame.camera)
            if not self._strokes:
                self._strokes = [Stroke(self.around.ink) for _ in ends]
            pairs = zip(self._strokes, ends, strict=True)
            drawn = [stroke.card(pair, frame.camera, frame.size, opacity) for stroke, pair in pairs]
            self._edges = frame, [card for card in drawn if card is not None]
        return self._edges[1]


def dress(viewer: Any, around: Surroundings) -> None:
    """Give a viewer's canvas the colour and the scale bar that surroundings ask for."""
    ground = around.background
    plain = None if ground.name == OWN else (*ground.colors[0][:3], 1.0)
    viewer.canvas.background_color_override = plain
    bar = viewer.canvas.overlays.scale_bar
    if bar.visible != around.scale:
        bar.visible = around.scale
    if around.scale:
        bar.colored, bar.color = True, (*around.ink[:3], 1.0)
