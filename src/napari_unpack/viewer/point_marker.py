"""A cross in the 3D view at one point of the bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector
from napari_unpack.layers.rendered_image import FRONT
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.gl.lines import Stroke

# As arrows in the view: light, with a dark line under it for bright objects.
INK, HALO = (1.0, 0.92, 0.35, 1.0), (0.0, 0.0, 0.0, 0.6)

# Pixels from the middle to an arm's ends: the point itself stays visible.
INNER, OUTER = 4.0, 15.0

# Of what lies behind something: seen, but told from what lies before it.
HIDDEN_OPACITY = 0.7

ARMS = np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])


class PointMarker:
    """Draws a cross of four arms, full where nothing is before its point and faint elsewhere.

    Parameters
    ----------
    point_in : callable
        Returns the point in a frame's pivot space, mm, or None where there is none to show.
    """

    def __init__(self, point_in: Callable[[Frame], Vector | None]) -> None:
        self.point_in = point_in
        self._strokes = [Stroke(HALO, 3.6) for _ in ARMS] + [Stroke(INK, 1.9) for _ in ARMS]

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the cross's quads."""
        point = self.point_in(frame)
        if point is None:
            return ()
        lines = arms_of(point, frame)
        quads: list[Quad] = []
        for stroke, line in zip(self._strokes, [*lines, *lines], strict=True):
            full = stroke.quad(line, frame.camera, frame.size, 1.0)
            if full is not None:
                before = replace(full.place, ndc_depth=FRONT)
                quads += [Quad(full.image, before, HIDDEN_OPACITY), full]
        return quads


def arms_of(point: Vector, frame: Frame) -> list[NDArray[np.float64]]:
    """Return the arms of a cross, lines of two (3,) ends in pivot space.

    Parameters
    ----------
    point : (3,) ndarray of float64
        Pivot space, mm.
    frame : Frame
        In whose image the arms have one length at any depth.
    """
    camera = frame.camera
    mm = camera.height / frame.size[0] * (1.0 - point[0] / camera.distance)
    ends = np.zeros((len(ARMS), 2, 3))
    ends[:, :, 1:] = ARMS[:, None, :] * (np.array([INNER, OUTER]) * mm)[None, :, None]
    return list(point + ends)
