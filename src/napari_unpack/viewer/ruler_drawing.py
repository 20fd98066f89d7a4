"""Measurements as they are drawn in the 3D view and in slices: lines, an arc, and numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from psygnal import Signal

from napari_unpack.layers.placement import data_to_world, units_of
from napari_unpack.layers.slice_frame import SliceFrame
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.rulers import (
    INK,
    Pixels,
    number_places,
    ruler_pixels,
    strokes_of,
)
from napari_unpack.session.measurements import Measurement, SurfacePoint
from napari_unpack.viewer.canvas_lines import CanvasLines, Line
from napari_unpack.viewer.canvas_text import CanvasText, text_quad

if TYPE_CHECKING:
    from napari_unpack.viewer.controller import SessionController

# Voxels from the slice within which a point counts as in it, and how faint a line is that is not.
IN_SLICE, FAINT = 1.0, 0.35

Drawn = tuple[Pixels, Measurement | None, float]


class RulerDrawing:
    """Draws the measurements of a session, and the points clicked for the next one.

    Parameters
    ----------
    target : SessionController
    pixel_scale : callable
        Returns the device pixels of a logical pixel.
    repaint : callable
        Has the canvas drawn again.

    Attributes
    ----------
    picked : Signal
        The points clicked for the next measurement, whenever there is another.
    """

    picked = Signal(tuple)

    def __init__(
        self,
        target: SessionController,
        pixel_scale: Callable[[], float],
        repaint: Callable[[], None],
    ) -> None:
        self._target, self._pixel_scale, self._repaint = target, pixel_scale, repaint
        self._text = CanvasText(pixel_scale)
        self._lines = CanvasLines(pixel_scale)
        self._pending: tuple[SurfacePoint, ...] = ()

    @property
    def pending(self) -> tuple[SurfacePoint, ...]:
        """Points of a measurement that is being made."""
        return self._pending

    @pending.setter
    def pending(self, points: tuple[SurfacePoint, ...]) -> None:
        self._pending = points
        self._repaint()
        self.picked.emit(points)

    def changed(self) -> None:
        """Draw what there is now."""
        self._repaint()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the measurements whose objects all stand where they can be measured."""
        found = ((self._in_view(points, frame), one) for points, one in self._all())
        drawn = [(pixels, one, 1.0) for pixels, one in found if pixels is not None]
        return self._quads(drawn, frame.size)

    def slice_quads_at(self, frame: SliceFrame) -> Sequence[Quad]:
        """Return the measurements at the slice; faint where a point lies beside it."""
        target = self._target
        # Slices show the bag that an opened container is from, which was not measured.
        if target.outer_session is not None:
            return ()
        there = np.asarray(target.viewer.dims.point, dtype=np.float64)[-3:]
        world_from_data = data_to_world(target.layers[0], units_of(target.viewer))
        slice_at = np.linalg.solve(world_from_data, np.append(there, 1.0))[:3]
        across = ({0, 1, 2} - set(frame.axes)).pop()
        drawn = self.near_slice(across, float(slice_at[across]))
        flat = [(frame.pixels(voxels), one, strength) for voxels, one, strength in drawn]
        return self._quads(flat, frame.size)

    def near_slice(self, axis: int, index: float) -> Iterator[Drawn]:
        """Return what is in a slice or goes through it: points, measurement, and how strong.

        Parameters
        ----------
        axis : int
            Across the slice.
        index : float
            Voxel along it.

        Returns
        -------
        iterator of ((N, 3) ndarray of float64, Measurement or None, float)
            Voxels z y x; None for one that is being made.
        """
        for points, measurement in self._all():
            voxels = np.array([point.at for point in points]) / self._target.session.spacing
            beside = voxels[:, axis] - index
            near = np.abs(beside) <= IN_SLICE
            if near.any() or np.ptp(np.sign(beside)) > 1:
                yield voxels, measurement, 1.0 if near.all() else FAINT

    def _all(self) -> Iterator[tuple[tuple[SurfacePoint, ...], Measurement | None]]:
        measurements = self._target.session.measurements
        for measurement in measurements if measurements.shown else ():
            yield measurement.points, measurement
        if self._pending:
            yield self._pending, None

    def _in_view(self, points: tuple[SurfacePoint, ...], frame: Frame) -> Pixels | None:
        known = self._target.session.states
        owners = {p.object_id if p.object_id in known else 0 for p in points}
        inspected = self._target.renderer.inspected
        # The inspected object stands before all others, and before what was measured on them.
        if inspected and owners != {inspected}:
            return None
        ends = np.array([point.at for point in points])
        where = partial(self._target.renderer.picker.projection_of, frame=frame)
        return ruler_pixels(frozenset(owners), ends, where, frame.size)

    def _quads(self, drawn: Sequence[Drawn], size: tuple[int, int]) -> list[Quad]:
        scale = self._pixel_scale()
        lines = [line for pixels, _, opacity in drawn for line in lines_of(pixels, opacity, scale)]
        quads = self._lines.quads(lines, size)
        return quads + self._numbers(drawn, size)

    def _numbers(self, drawn: Sequence[Drawn], size: tuple[int, int]) -> list[Quad]:
        on_light = self._target.session.decorations.background.is_light
        unit = self._target.session.length_unit
        measured = [(pixels, one, opacity) for pixels, one, opacity in drawn if one is not None]
        images = [
            [self._text.image(words, on_light) for words in one.numbers_in(unit)]
            for _, one, _ in measured
        ]
        boxes = [[image.size for image in numbers] for numbers in images]
        places = number_places([done[0] for done in measured], boxes, size, self._pixel_scale())
        quads = []
        for (_, _, opacity), numbers, middles in zip(measured, images, places, strict=True):
            for image, middle in zip(numbers, middles, strict=True):
                row, col = middle - np.array(image.size) / 2
                quads.append(text_quad(image, row, col, size, opacity))
        return quads


def lines_of(pixels: Pixels, opacity: float, scale: float) -> list[Line]:
    """Return the lines of a measurement.

    Parameters
    ----------
    pixels : (N, 2) ndarray of float64
        Its points.
    opacity : float
    scale : float
        Device pixels of a logical pixel.
    """
    return [Line(line, (*INK, opacity)) for line in strokes_of(pixels, scale)]
