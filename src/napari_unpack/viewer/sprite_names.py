"""The names of unpacked objects beside their sprites."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.viewer.canvas_text import CanvasText, text_quad
from napari_unpack.viewer.multi_selection import sprite_pixels

if TYPE_CHECKING:
    from napari_unpack.session import Session

# (2, 2): first and last row and column, pixels of the frame.
Box = NDArray[np.float64]

# Logical pixels between a sprite and its name, and the room below which a name tells nothing.
GAP, LEAST_ROOM = 2.0, 40.0
# How much wider than its sprite's cell a name may be where nothing is beside it.
WIDER = 1.5
# Of a name so much may lie over another sprite: its rectangle has empty corners.
MOST_COVERED = 0.25


class SpriteNames:
    """Writes each sprite's name below it, or where there is room.

    Parameters
    ----------
    session : Session
    sprites : SpriteLayer
        Whose sprites they are.
    pixel_scale : callable
        Returns the device pixels of a logical pixel.
    repaint : callable
        Has the canvas drawn again.
    """

    def __init__(
        self,
        session: Session,
        sprites: SpriteLayer,
        pixel_scale: Callable[[], float],
        repaint: Callable[[], None],
    ) -> None:
        self._session, self._sprites, self._repaint = session, sprites, repaint
        self._pixel_scale, self._text = pixel_scale, CanvasText(pixel_scale)
        self._shown = False
        self._names: tuple[object, Mapping[int, str]] = (None, {})

    @property
    def shown(self) -> bool:
        """Whether names are written."""
        return self._shown

    @shown.setter
    def shown(self, shown: bool) -> None:
        self._shown = bool(shown)
        self._repaint()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the quads of all names; none during an inspection."""
        sprites = self._sprites
        if not self._shown or not sprites.visible or sprites.dimming < 1.0:
            return ()
        return [quad for _, _, quad in self.written_at(frame)]

    def written_at(self, frame: Frame) -> Iterator[tuple[int, Box, Quad]]:
        """Yield the objects whose names are written, where, and their quads.

        Parameters
        ----------
        frame : Frame
            What the canvas shows.
        """
        scale, names = self._pixel_scale(), self._names_now()
        on_light = self._session.decorations.background.is_light
        boxes = {i: sprite_pixels(s, frame) for i, s in self._sprites.sprites.items() if i in names}
        cell = self._session.slots.cell_mm * frame.size[0] / frame.camera.height
        taken: list[Box] = []
        for object_id, box in boxes.items():
            room = max(cell, float(np.ptp(box[:, 1])))
            if room < LEAST_ROOM * scale:
                continue
            others = [other for i, other in boxes.items() if i != object_id]
            # A name that must lose its middle is the second choice.
            for longest in (WIDER * room, room):
                image = self._text.image(names[object_id], on_light, round(longest))
                spots = places(box, image.size, frame.size, GAP * scale)
                found = first_free(spots, taken, others)
                if found is not None:
                    taken.append(found)
                    yield object_id, found, text_quad(image, found[0, 0], found[0, 1], frame.size)
                    break

    def _names_now(self) -> Mapping[int, str]:
        # The table is a copy of all facts: too much for every draw.
        session = self._session
        known_for = (session.state.names, session.label_data)
        before = self._names[0]
        if not isinstance(before, tuple) or any(
            a is not b for a, b in zip(before, known_for, strict=True)
        ):
            self._names = known_for, {int(i): str(v) for i, v in session.objects["name"].items()}
        return self._names[1]


def places(box: Box, size: tuple[int, int], canvas: tuple[int, int], gap: float) -> Iterator[Box]:
    """Yield where a name may stand, the best place first: below, above, or over the lower edge.

    Parameters
    ----------
    box : (2, 2) ndarray of float64
        Of the sprite.
    size : (int, int)
        Height and width of the name.
    canvas : (int, int)
        Height and width of the view, which the name does not leave.
    gap : float
        Between both.
    """
    height, width = size
    left = float(np.clip(box[:, 1].mean() - width / 2, 0, max(canvas[1] - width, 0)))
    for top in (box[1, 0] + gap, box[0, 0] - gap - height, box[1, 0] - height):
        if 0 <= top <= canvas[0] - height:
            yield np.array([(top, left), (top + height, left + width)])


def first_free(spots: Iterable[Box], taken: Sequence[Box], others: Sequence[Box]) -> Box | None:
    """Return the first place clear of other names, and of other sprites but for a corner.

    Parameters
    ----------
    spots : iterable of (2, 2) ndarray of float64
    taken : sequence of (2, 2) ndarray of float64
        Of the names that are written.
    others : sequence of (2, 2) ndarray of float64
        Of the other sprites.
    """
    for spot in spots:
        area = float(np.prod(spot[1] - spot[0]))
        covered = max((_common(spot, other) for other in others), default=0.0)
        if not any(_common(spot, name) for name in taken) and covered <= MOST_COVERED * area:
            return spot
    return None


def _common(a: Box, b: Box) -> float:
    """Return the area that two rectangles share."""
    edges = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    return float(np.prod(edges)) if (edges > 0).all() else 0.0
