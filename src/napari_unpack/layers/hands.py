"""What the pointer asks of the stage: what is under it, and what it does to things."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qtpy.QtGui import QCursor
from qtpy.QtWidgets import QToolTip

from napari_unpack.geometry.axes import Matrix
from napari_unpack.layers import compat
from napari_unpack.layers.arrow import drawn_direction, surface_normal
from napari_unpack.layers.overlays import Overlays
from napari_unpack.layers.placement import units_of, voxel_at
from napari_unpack.layers.projector import Projector, mark
from napari_unpack.layers.slice_steps import SliceSteps
from napari_unpack.layers.sprites import SpriteLayer
from napari_unpack.layers.tables import describe
from napari_unpack.layers.view_camera import Frame


class Hands:
    """The pointer's side of a `Stage`; pixels are the canvas's own, row and column."""

    viewer: Any
    session: Any
    overlays: Overlays
    layers: Any
    sprites: SpriteLayer
    events: Any
    _projector: Projector
    _pointed: int
    _steps: SliceSteps
    around: Any
    drawing = False
    """Whether the next drag in the picture draws the direction in which objects leave."""

    @property
    def frame(self) -> Frame | None:
        """What the canvas showed last."""
        return self._projector.frame

    def sprite_at(self, pixel: NDArray[np.float64]) -> int:
        """Return the object whose sprite is at a pixel of the canvas (row, column), or 0."""
        return self._projector.sprite_at(*self.device_pixel(pixel))

    def packed_at(self, pixel: NDArray[np.float64]) -> list[int]:
        """Return the packed objects at a pixel of the canvas, the most visible first."""
        return self._projector.packed_at(*self.device_pixel(pixel))

    def in_slice(self, position: Sequence[float]) -> int:
        """Return the object at a point of the viewer's world, 0 for none; as slices show it."""
        if self.around is not None:
            return 0
        packed, labels = self.layers[0], self.session.labels
        there = np.asarray(position, dtype=np.float64)[-3:]
        if len(there) < 3 or not np.isfinite(there).all():
            return 0
        voxel = voxel_at(packed, there, units_of(self.viewer))
        if (voxel < 0).any() or (voxel >= labels.shape).any():
            return 0
        return int(labels[tuple(voxel)])

    def point_at(self, object_id: int) -> None:
        """Show which object the mouse is on, 0 for none."""
        if object_id == self._pointed:
            return
        self._pointed = object_id
        words = describe(self.session, object_id) if object_id else ""
        for layer in self.layers:
            layer.words = words
        self.viewer.status = words or "Ready"
        # Beside a sprite its name; in the bag names would lie over what they are of.
        self._tell_name(words if object_id in self.session.poses else "")
        self.overlays.ghost.point_at(0 if self._projector.inspected else object_id)
        self._mark()

    def select(self, object_id: int) -> None:
        """Select an object, 0 for none."""
        self.session.select([object_id] if object_id else [])

    def select_in_slice(self, position: Sequence[float]) -> None:
        """Select the object at a point of the viewer's world; the slice stays."""
        with self._steps.held():
            self.select(self.in_slice(position))

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand."""
        self._projector.turn(object_id, rotation)

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        self._projector.turned(object_id)

    def put_back(self) -> None:
        """End an inspection at once: the view is again what it was before."""
        self._projector.end_inspection()

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, from world axes to pivot axes."""
        return self._projector.rotation_of(object_id)

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite along with the hand."""
        self._projector.move(object_id, self._scale() * pixels)

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""
        self._projector.moved(object_id)

    def draw(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> None:
        """Show an arrow under the hand."""
        self.overlays.arrow.drawn = np.array([self.device_pixel(start), self.device_pixel(end)])
        self._projector.transition.repaint()

    def drawn(self, start: NDArray[np.float64], end: NDArray[np.float64], out: bool) -> None:
        """Let objects leave along an arrow that was drawn.

        Parameters
        ----------
        start, end : (2,) ndarray of float64
            Pixels of the canvas.
        out : bool
            Along the normal of the surface under its start instead; towards the viewer where
            there is none.
        """
        self.overlays.arrow.drawn = None
        self.drawing = False
        frame = self.frame
        if frame is not None:
            pixels = np.array([self.device_pixel(start), self.device_pixel(end)])
            found = drawn_direction(pixels, frame.camera)
            if out:
                row, col = (round(v) for v in pixels[0])
                depth = self._projector.depth()
                mm = frame.camera.height / frame.size[0]
                found = surface_normal(depth, row, col, mm, frame.camera)
            if found is not None:
                self.session.direction = tuple(float(v) for v in found)
        self._projector.transition.repaint()
        self.events.drawn.emit()

    def _tell_name(self, words: str) -> None:
        canvas = compat.native_canvas(self.viewer)
        if canvas is not None:
            QToolTip.showText(QCursor.pos(), words, canvas.native)

    def _scale(self) -> float:
        return 1.0 if self.frame is None else self.frame.size[0] / self.viewer.canvas.size[0]

    def _mark(self) -> None:
        mark(self.sprites, self.session.selected, self._pointed)
        self.overlays.renew()

    def device_pixel(self, pixel: NDArray[np.float64]) -> tuple[float, float]:
        """Return the frame's pixel (row, column) of one of the canvas."""
        height, width = self.viewer.canvas.size
        rows, cols = (height, width) if self.frame is None else self.frame.size
        return (
            float((pixel[0] + 0.5) * rows / height - 0.5),
            float((pixel[1] + 0.5) * cols / width - 0.5),
        )
