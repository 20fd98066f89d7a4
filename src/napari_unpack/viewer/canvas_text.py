"""Writing on the canvas: words with a rim that keeps them legible on anything behind them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import QPointF, Qt
from qtpy.QtGui import (
    QColor,
    QFont,
    QFontMetrics,
    QGuiApplication,
    QImage,
    QPainter,
    QPainterPath,
    QPen,
)

from napari_unpack.layers.rendered_image import FRONT
from napari_unpack.rendering.gl.depth_quads import ImageTexture, Quad, ScreenPlace

LIGHT, DARK = QColor(245, 247, 252), QColor(22, 24, 30)
# Logical pixels: the size of napari's own labels, and a rim as thick as the strokes of letters.
SIZE, RIM = 12, 3
# Before an inspected object too, which stands before all else; normalised device coordinates.
NEAREST = (FRONT - 1.0) / 2
# Words kept; each takes some ten kilobytes.
MOST_KEPT = 300


class CanvasText:
    """Makes quads of words; words drawn before keep their textures.

    Parameters
    ----------
    pixel_scale : callable
        Returns the device pixels of a logical pixel.
    """

    def __init__(self, pixel_scale: Callable[[], float]) -> None:
        self._pixel_scale = pixel_scale
        self._kept: OrderedDict[tuple[str, bool, float], ImageTexture] = OrderedDict()

    def image(self, words: str, on_light: bool, longest: float = np.inf) -> ImageTexture:
        """Return the image of words.

        Parameters
        ----------
        words : str
        on_light : bool
            Whether they are to be dark, for a light background.
        longest : float
            Longer ones lose their middle, device pixels.
        """
        scale = self._pixel_scale()
        key = elided(words, longest, scale), on_light, scale
        if key not in self._kept:
            self._kept[key] = written(*key)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]


def elided(words: str, longest: float, scale: float) -> str:
    """Return words, without their middle where they are too long.

    Parameters
    ----------
    words : str
    longest : float
        With their rim, device pixels.
    scale : float
        Device pixels of a logical pixel.
    """
    if not np.isfinite(longest):
        return words
    room = max(0, int(longest - 2 * RIM * scale))
    return str(QFontMetrics(_font(scale)).elidedText(words, Qt.TextElideMode.ElideMiddle, room))


def _font(scale: float) -> QFont:
    # Qt and not Pillow, whose one font lacks most alphabets.
    font = QGuiApplication.font()
    font.setPixelSize(max(1, round(SIZE * scale)))
    return font


def written(words: str, on_light: bool, scale: float) -> ImageTexture:
    """Write words; takes a millisecond or two.

    Parameters
    ----------
    words : str
    on_light : bool
        Whether they are to be dark.
    scale : float
        Device pixels of a logical pixel.
    """
    font, rim = _font(scale), RIM * scale
    measured = QFontMetrics(font)
    width = int(np.ceil(measured.horizontalAdvance(words) + 2 * rim))
    height = int(np.ceil(measured.height() + rim))
    image = QImage(width, height, QImage.Format.Format_RGBA8888_Premultiplied)
    image.fill(0)
    painter = QPainter(image)
    painter.setFont(font)
    draw_words(painter, QPointF(rim, rim / 2 + measured.ascent()), words, on_light, rim)
    painter.end()
    return ImageTexture(bytes_of(image))


def draw_words(
    painter: QPainter, at: QPointF, words: str, on_light: bool = False, rim: float = RIM
) -> None:
    """Draw words with a rim, in the painter's font.

    Parameters
    ----------
    painter : QPainter
    at : QPointF
        Where their baseline begins.
    words : str
    on_light : bool
        Whether they are to be dark.
    rim : float
        The painter's pixels.
    """
    path = QPainterPath()
    path.addText(at, painter.font(), words)
    ink, around = (DARK, LIGHT) if on_light else (LIGHT, DARK)
    faint = QColor(around)
    faint.setAlphaF(0.75)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    joined = Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin
    painter.strokePath(path, QPen(faint, rim, *joined))
    painter.fillPath(path, ink)


def bytes_of(image: QImage) -> NDArray[np.uint8]:
    """Return the (h, w, 4) pixels of an image of bytes, a copy."""
    height, width = image.height(), image.width()
    rows = np.frombuffer(image.constBits().asarray(image.sizeInBytes()), np.uint8)
    lines = rows.reshape(height, image.bytesPerLine())[:, : 4 * width]
    return lines.reshape(height, width, 4).copy()


def text_quad(
    image: ImageTexture, row: float, col: float, size: tuple[int, int], opacity: float = 1.0
) -> Quad:
    """Return the quad of an image that stands before everything else.

    Parameters
    ----------
    image : ImageTexture
    row, col : float
        Where its first pixel is in the view.
    size : (int, int)
        Height and width of the view, pixels.
    opacity : float
    """
    # At whole pixels, or letters would blur.
    spot = round(float(row)), round(float(col))
    place = ScreenPlace.of_pixels(*spot, image.size, size)
    return Quad(image, replace(place, ndc_depth=NEAREST), opacity)
