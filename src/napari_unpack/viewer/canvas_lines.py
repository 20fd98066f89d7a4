"""Lines over the picture, painted into one image that is made anew only where they change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import QPointF, Qt
from qtpy.QtGui import QColor, QImage, QPainter, QPen, QPolygonF

from napari_unpack.rendering.gl.depth_quads import ImageTexture, Quad
from napari_unpack.viewer.canvas_text import bytes_of, text_quad

# Dark on each side of a line, or it would be lost on bright objects; logical pixels.
HALO, RIM = (0.0, 0.0, 0.0, 0.55), 1.0


@dataclass(frozen=True, eq=False)
class Line:
    """A line of straight pieces.

    Parameters
    ----------
    points : (N, 2) ndarray of float64
        Row and column of the view, device pixels.
    ink : (r, g, b, a)
        Straight, 0 to 1.
    width : float
        Logical pixels.
    """

    points: NDArray[np.float64]
    ink: tuple[float, float, float, float]
    width: float = 2.0

    @property
    def key(self) -> tuple[object, ...]:
        """What tells it from lines that look otherwise."""
        # Finer than can be seen.
        return np.round(self.points, 1).tobytes(), self.ink, self.width


class CanvasLines:
    """Makes the quad of lines: a quad for each piece would take a millisecond each.

    Parameters
    ----------
    pixel_scale : callable
        Returns the device pixels of a logical pixel.
    """

    def __init__(self, pixel_scale: Callable[[], float]) -> None:
        self._pixel_scale = pixel_scale
        self._key: object = None
        self._drawn: tuple[ImageTexture, tuple[int, int]] | None = None

    def quads(self, lines: Sequence[Line], size: tuple[int, int]) -> list[Quad]:
        """Return the one quad that shows lines, before everything else; none where none is seen.

        Parameters
        ----------
        lines : sequence of Line
        size : (int, int)
            Height and width of the view, pixels.
        """
        key = size, self._pixel_scale(), tuple(line.key for line in lines)
        if key != self._key:
            self._key, self._drawn = key, painted(lines, size, self._pixel_scale())
        if self._drawn is None:
            return []
        image, (row, col) = self._drawn
        return [text_quad(image, row, col, size)]


def painted(
    lines: Sequence[Line], size: tuple[int, int], scale: float
) -> tuple[ImageTexture, tuple[int, int]] | None:
    """Paint lines; return their image and its first row and column; None where none is seen.

    Parameters
    ----------
    lines : sequence of Line
    size : (int, int)
        Height and width of the view, pixels.
    scale : float
        Device pixels of a logical pixel.
    """
    if not lines:
        return None
    margin = scale * (max(line.width for line in lines) / 2 + RIM) + 1
    corners = np.concatenate([line.points for line in lines])
    low = np.clip(np.floor(corners.min(axis=0) - margin), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0) + margin) + 1, 0, size).astype(int)
    if not (low < high).all():
        return None
    height, width = (int(n) for n in high - low)
    image = QImage(width, height, QImage.Format.Format_RGBA8888_Premultiplied)
    image.fill(0)
    painter = QPainter(image)
    # Qt's pixels begin at whole numbers, where ours have their centres.
    draw_lines(painter, lines, 0.5 - low, scale)
    painter.end()
    return ImageTexture(bytes_of(image)), (int(low[0]), int(low[1]))


def draw_lines(
    painter: QPainter, lines: Sequence[Line], shift: NDArray[np.float64], scale: float
) -> None:
    """Draw lines with a dark rim.

    Parameters
    ----------
    painter : QPainter
    lines : sequence of Line
    shift : (2,) ndarray of float64
        From their rows and columns to the painter's.
    scale : float
        Of the painter's pixels in a logical pixel.
    """
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    # All dark rims first, so that none lies over another line.
    for under in (True, False):
        for line in lines:
            alpha = line.ink[3]
            color = QColor.fromRgbF(*((*HALO[:3], HALO[3] * alpha) if under else line.ink))
            pen = QPen(color, scale * (line.width + (2 * RIM if under else 0)))
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
            painter.setPen(pen)
            shifted = line.points + shift
            painter.drawPolyline(QPolygonF([QPointF(float(x), float(y)) for y, x in shifted]))
