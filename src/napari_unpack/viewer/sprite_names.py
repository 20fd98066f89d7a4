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
# (N, 2, 2) of them.
Boxes = NDArray[np.float64]
Written = tuple[int, Box, Quad]

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
        self._written: tuple[object, Sequence[Written]] = (None, ())

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
        # In napari's grid sprites have a view of their own.
        if sprites.frame is not None and sprites.frame.corner != frame.corner:
            return ()
        return [quad for _, _, quad in self.written_at(frame)]

    def written_at(self, frame: Frame) -> Sequence[Written]:
        """Return the objects whose names are written, where, and their quads.

        Parameters
        ----------
        frame : Frame
            What the canvas shows.
        """
        scale, names = self._pixel_scale(), self._names_now()
        on_light = self._session.decorations.background.is_light
        sprites = {i: s for i, s in self._sprites.sprites.items() if i in names}
        boxes = _boxes([sprite_pixels(sprite, frame) for sprite in sprites.values()])
        cell = self._session.slots.cell_mm * frame.size[0] / frame.camera.height
        known_for = names, tuple(sprites), boxes.tobytes(), cell, frame.size, scale, on_light
        if self._written[0] == known_for:
            return self._written[1]
        written: list[Written] = []
        for k, object_id in enumerate(sprites):
            room = max(cell, float(np.ptp(boxes[k, :, 1])))
            if room < LEAST_ROOM * scale:
                continue
            others, taken = np.delete(boxes, k, axis=0), _boxes([box for _, box, _ in written])
            # A name that must lose its middle is the second choice.
            for longest in (WIDER * room, room):
                image = self._text.image(names[object_id], on_light, round(longest))
                spots = places(boxes[k], image.size, frame.size, GAP * scale)
                found = first_free(spots, taken, others)
                if found is not None:
                    quad = text_quad(image, found[0, 0], found[0, 1], frame.size)
                    written.append((object_id, found, quad))
                    break
        self._written = known_for, written
        return written

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


def first_free(spots: Iterable[Box], taken: Boxes, others: Boxes) -> Box | None:
    """Return the first place clear of other names, and of other sprites but for a corner.

    Parameters
    ----------
    spots : iterable of (2, 2) ndarray of float64
    taken : (M, 2, 2) ndarray of float64
        Of the names that are written.
    others : (N, 2, 2) ndarray of float64
        Of the other sprites.
    """
    for spot in spots:
        area = float(np.prod(spot[1] - spot[0]))
        covered = _common(spot, others).max(initial=0.0)
        if not _common(spot, taken).any() and covered <= MOST_COVERED * area:
            return spot
    return None


def _common(a: Box, boxes: Boxes) -> NDArray[np.float64]:
    """Return the (N,) areas that a rectangle shares with others."""
    edges = np.minimum(a[1], boxes[:, 1]) - np.maximum(a[0], boxes[:, 0])
    areas: NDArray[np.float64] = edges.clip(min=0.0).prod(axis=1)
    return areas


def _boxes(boxes: Sequence[Box]) -> Boxes:
    return np.array(boxes, dtype=np.float64).reshape(-1, 2, 2)
