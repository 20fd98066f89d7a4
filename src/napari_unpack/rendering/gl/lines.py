"""Straight lines among quads: thin rectangles along them, with the depths of the line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.gl.depth_quads import Frame, ImageTexture, Quad, ScreenPlace

# Depths along a line.
STEPS = 256
# Alpha across a line: texels that are interpolated, so its sides are soft.
ACROSS = (0.0, 1.0, 1.0, 0.0)


@dataclass(frozen=True)
class StrokePlace(ScreenPlace):
    """A parallelogram in normalised device coordinates.

    Parameters
    ----------
    corner, along, across : (float, float)
        Its first corner, and the way along and across the line.
    """

    corner: tuple[float, float] = (0.0, 0.0)
    along: tuple[float, float] = (0.0, 0.0)
    across: tuple[float, float] = (0.0, 0.0)

    def frame(self, clip_from_pivot: Matrix) -> Frame:
        """Return where the image's corner and edges are in clip space."""
        return (
            np.array([*self.corner, 0.0, 1.0]),
            np.array([*self.along, 0.0, 0.0]),
            np.array([*self.across, 0.0, 0.0]),
        )


class Stroke:
    """A line that is drawn again and again; its textures are kept.

    Parameters
    ----------
    ink : (r, g, b, a)
        Straight.
    width : float
        Of its full strength, pixels; a pixel on each side is softer.
    """

    def __init__(self, ink: tuple[float, float, float, float], width: float = 1.3) -> None:
        color = np.array([*ink[:3], 1.0], np.float32) * np.float32(ink[3])
        self._color = np.array(ACROSS, np.float32)[:, None, None] * color
        self._color = np.repeat(self._color, STEPS, axis=1)
        self._width = width
        self._picture: ImageTexture | None = None

    def quad(
        self, ends: NDArray[np.float64], camera: Camera, size: tuple[int, int], opacity: float
    ) -> Quad | None:
        """Return the line's quad; None where it reaches behind the eye or has no length.

        Parameters
        ----------
        ends : (2, 3) ndarray of float64
            In pivot space, mm.
        camera : Camera
        size : (int, int)
            Height and width of the view, pixels.
        opacity : float
            Of the line.
        """
        if camera.behind_eye(ends):
            return None
        pixels = camera.pixels(ends, size)
        way = pixels[1] - pixels[0]
        length = float(np.hypot(*way))
        if length < 1e-3:
            return None
        share = np.linspace(0.0, 1.0, STEPS)
        if np.isinf(camera.distance):
            t = -ends[0, 0] - share * (ends[1, 0] - ends[0, 0])
        else:
            eye = camera.distance - ends[:, 0]
            t = 1 / ((1 - share) / eye[0] + share / eye[1]) - camera.distance
        depth = np.broadcast_to(t.astype(np.float32), (len(ACROSS), STEPS))
        if self._picture is None:
            self._picture = ImageTexture(self._color, depth)
        else:
            self._picture.update(self._color, depth)
        # A texel of four is a quarter of the height; two of them are the line's own width.
        side = np.array([-way[1], way[0]]) / length * self._width
        first = pixels[0] + 0.5 - side
        ndc = np.array([-2 / size[0], 2 / size[1]])
        place = StrokePlace(
            corner=_xy(first * ndc + np.array([1.0, -1.0])),
            along=_xy(way * ndc),
            across=_xy(2 * side * ndc),
        )
        return Quad(self._picture, place, opacity)


def _xy(row_col: NDArray[np.float64]) -> tuple[float, float]:
    return float(row_col[1]), float(row_col[0])
