"""A cross in the 3D view at one point of the bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import FRONT
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.gl.lines import Stroke

# As arrows in the view: light, with a dark line under it for bright objects.
INK, HALO = (1.0, 0.96, 0.6, 1.0), (0.0, 0.0, 0.0, 0.6)

# Half the length of its lines, pixels.
REACH = 13.0

# Of what lies behind something: below one half, or it would hide the bright lines.
HIDDEN_OPACITY = 0.49


class PointMarker:
    """Draws a cross, bright where nothing is before its point and fainter elsewhere.

    Parameters
    ----------
    point_in : callable
        Returns the point in a frame's pivot space, mm, and the camera that sees it; None where
        there is none to show.
    """

    def __init__(self, point_in: Callable[[Frame], tuple[Vector, Camera] | None]) -> None:
        self.point_in = point_in
        self._halos = [Stroke(HALO, 3.6) for _ in range(2)]
        self._inks = [Stroke(INK, 2.0) for _ in range(2)]

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the cross's quads."""
        found = self.point_in(frame)
        if found is None:
            return ()
        point, camera = found
        lines = lines_of(point, camera, frame.size)
        drawn = [
            stroke.quad(line, camera, frame.size, 1.0)
            for strokes in (self._halos, self._inks)
            for stroke, line in zip(strokes, lines, strict=True)
        ]
        at_depth = [quad for quad in drawn if quad is not None]
        through = [
            replace(quad, place=replace(quad.place, ndc_depth=FRONT), opacity=HIDDEN_OPACITY)
            for quad in at_depth[len(self._halos) :]
        ]
        return at_depth + through


def lines_of(point: Vector, camera: Camera, size: tuple[int, int]) -> list[NDArray[np.float64]]:
    """Return the lines of a cross, each of two (3,) ends in pivot space.

    Parameters
    ----------
    point : (3,) ndarray of float64
        Pivot space, mm.
    camera : Camera
    size : (int, int)
        Height and width, pixels, of the image in which they have one length at any depth.
    """
    mm = REACH * camera.height / size[0] * (1.0 - point[0] / camera.distance)
    return [point + mm * np.array([-way, way]) for way in np.eye(3)[1:]]
