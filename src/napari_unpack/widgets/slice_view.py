"""One slice, painted with its crosshair: the pointer, the wheel and the keys over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from qtpy.QtCore import QEvent, QLineF, QPointF, QRectF, QSize, Qt, Signal
from qtpy.QtGui import QColor, QImage, QPainter, QPen
from qtpy.QtWidgets import QWidget

from napari_unpack.rendering.rulers import number_places
from napari_unpack.rendering.slice_image import Plane
from napari_unpack.viewer.canvas_lines import draw_lines
from napari_unpack.viewer.canvas_text import draw_words
from napari_unpack.viewer.plain_text import show_tip
from napari_unpack.viewer.ruler_drawing import lines_of

if TYPE_CHECKING:
    from qtpy.QtGui import QKeyEvent, QMouseEvent, QPaintEvent, QWheelEvent

    from napari_unpack.viewer.linked_slices import RulerInSlice, Voxel

AXES = "zyx"
# Of the crosshair's lines, by the axis of the slices they stand for; told apart on any tint.
INKS = (QColor("#ffd84d"), QColor("#7fe08a"), QColor("#7ab8ff"))
# Dark in both themes: greys are judged against black.
GROUND = QColor("#0d0e10")

# Pixels left free around the image and around the crosshair's middle.
MARGIN, GAP = 4.0, 7.0
# A drag no longer than this is a click, as in the 3D view.
CLICK_PIXELS = 4.0
# A notch of a mouse's wheel, in Qt's eighths of a degree.
NOTCH = 120
ZOOM_STEP, MOST_ZOOM = 1.25, 40.0
# With Shift an arrow key passes a small object in a few presses.
LEAP = 10
# From so many pixels a voxel on one wants to see voxels, and not what lies between them.
VOXELS_SEEN = 3.0

HELP = (
    "Move the mouse: the other slices and the 3D view follow. The wheel goes through the slices, "
    "with Ctrl it zooms; a click selects, or sets the point that Ruler, Angle or Split waits for; "
    "a double click moves what is there into the middle; drag with the right button for contrast "
    "(sideways) and brightness (up and down), with the middle one to move the image. "
    "Keys: arrows, Page up and Page down, + and -, Home, Enter."
)


class SliceView(QWidget):
    """A slice, and the crosshair in it.

    Signals: `pointed` (voxel under the mouse or where the keys moved to), `left` (the mouse left),
    `clicked` (voxel with fractions, names of the keys held), `contrasted` (change of width and of
    level, as shares of the window).

    Parameters
    ----------
    plane : Plane
    """

    pointed = Signal(tuple)
    left = Signal()
    clicked = Signal(tuple, object)
    contrasted = Signal(float, float)

    def __init__(self, plane: Plane) -> None:
        super().__init__()
        self.plane = plane
        self.name = ""
        """What the object under the mouse is called; its tooltip."""
        self._shape, self._spacing = (1, 1, 1), np.ones(3)
        self._crosshair: Voxel | None = None
        self._pixels: NDArray[np.uint8] | None = None
        self._rulers: Sequence[RulerInSlice] = ()
        self._image = QImage()
        self._zoom = 1.0
        self._middle = np.zeros(2)
        self._pressed: QPointF | None = None
        self._last = QPointF()
        self._turned = 0
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(90, 90)
        self.setAccessibleName(f"Slice across {AXES[plane.normal]}")
        self.setAccessibleDescription(HELP)

    def sizeHint(self) -> QSize:
        """Return a size at which three fit beside each other."""
        return QSize(260, 260)

    # What is shown.

    def show_volume(self, shape: Voxel | None, spacing: NDArray[np.float64]) -> None:
        """Show slices of another volume, or none.

        Parameters
        ----------
        shape : (int, int, int) or None
            Voxels along z, y, x.
        spacing : (3,) ndarray of float64
            Voxel size in mm, z y x.
        """
        self._shape, self._spacing = shape or (1, 1, 1), np.asarray(spacing, dtype=np.float64)
        self._crosshair, self._pixels, self._image = None, None, QImage()
        self._rulers = ()
        self.fit()

    def show_image(self, pixels: NDArray[np.uint8]) -> None:
        """Show the image of a slice, (H, W, 4) uint8."""
        # Qt does not copy the pixels.
        self._pixels = pixels
        height, width = pixels.shape[:2]
        self._image = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_RGBX8888)
        self.update()

    def show_crosshair(self, voxel: Voxel) -> None:
        """Show where the three slices meet, z y x."""
        self._crosshair = voxel
        self.update()

    def show_rulers(self, rulers: Sequence[RulerInSlice]) -> None:
        """Show what was measured here."""
        self._rulers = rulers
        self.update()

    def fit(self) -> None:
        """Show the whole slice, as large as it fits."""
        self._zoom, self._middle = 1.0, self._size_mm() / 2
        self.update()

    @property
    def zoom(self) -> float:
        """Enlargement; 1 shows the whole slice."""
        return self._zoom

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """The pixels that are shown."""
        return self._pixels

    # Where things are: (2,) rows and columns, mm from the outer corner of the first voxel.

    def _in_plane(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([values[self.plane.rows], values[self.plane.cols]], dtype=np.float64)

    def _size_mm(self) -> NDArray[np.float64]:
        return self._in_plane(np.array(self._shape) * self._spacing)

    def _scale(self) -> float:
        """Return the pixels of a mm."""
        down, right = self._size_mm()
        width, height = self.width() - 2 * MARGIN, self.height() - 2 * MARGIN
        return max(min(width / right, height / down), 1e-3) * self._zoom

    def _place(self, mm: NDArray[np.float64]) -> QPointF:
        down, right = (mm - self._middle) * self._scale()
        return QPointF(self.width() / 2 + right, self.height() / 2 + down)

    def _mm_at(self, place: QPointF) -> NDArray[np.float64]:
        away = np.array([place.y() - self.height() / 2, place.x() - self.width() / 2])
        mm: NDArray[np.float64] = self._middle + away / self._scale()
        return mm

    def place_of(self, voxel: ArrayLike) -> QPointF:
        """Return where the middle of a voxel is painted, pixels of the widget."""
        return self._place(self._in_plane((np.asarray(voxel) + 0.5) * self._spacing))

    def voxel_at(self, place: QPointF) -> Voxel | None:
        """Return the voxel of the slice under a place of the widget; None beside the slice."""
        if self._crosshair is None:
            return None
        there = np.floor(self._mm_at(place) / self._in_plane(self._spacing))
        if (there < 0).any() or (there >= self._in_plane(np.array(self._shape))).any():
            return None
        return self._moved(self._crosshair, {self.plane.rows: there[0], self.plane.cols: there[1]})

    def _moved(self, voxel: Voxel, to: dict[int, float]) -> Voxel:
        z, y, x = (
            int(np.clip(to.get(axis, voxel[axis]), 0, self._shape[axis] - 1)) for axis in range(3)
        )
        return z, y, x

    # The mouse.

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin a click or a drag."""
        self._pressed = self._last = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Point, move the image, or change the contrast."""
        way, self._last = event.position() - self._last, event.position()
        if event.buttons() & Qt.MouseButton.RightButton:
            self.contrasted.emit(way.x() / self.width(), way.y() / self.height())
        elif event.buttons() & Qt.MouseButton.MiddleButton:
            self._middle = self._middle - np.array([way.y(), way.x()]) / self._scale()
            self.update()
        else:
            self._point(event.position())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Select, where the mouse was not moved."""
        pressed, self._pressed = self._pressed, None
        voxel = self.voxel_at(event.position())
        if event.button() != Qt.MouseButton.LeftButton or pressed is None or voxel is None:
            return
        if QLineF(pressed, event.position()).length() <= CLICK_PIXELS:
            there = np.array(voxel, dtype=np.float64)
            in_plane = self._mm_at(pressed) / self._in_plane(self._spacing) - 0.5
            there[[self.plane.rows, self.plane.cols]] = in_plane
            self.clicked.emit(tuple(there), _names(event.modifiers()))

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Move what is there into the middle."""
        # The release that follows is no third click.
        self._pressed = None
        if event.button() == Qt.MouseButton.LeftButton:
            self._middle = self._mm_at(event.position())
            self.update()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Go through the slices; zoom with Ctrl."""
        event.accept()
        self._turned += event.angleDelta().y()
        notches = int(self._turned / NOTCH)
        # Touchpads send less than a notch at a time.
        self._turned -= notches * NOTCH
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            self._enlarge(ZOOM_STEP**notches, event.position())
        elif notches and self._crosshair is not None:
            axis = self.plane.normal
            self.pointed.emit(self._moved(self._crosshair, {axis: self._crosshair[axis] - notches}))

    def leaveEvent(self, event: QEvent) -> None:
        """Tell that the mouse is on no object any more."""
        self.left.emit()

    def event(self, event: QEvent) -> bool:
        """Say what is under a resting mouse: the object, or else what the mouse does here."""
        if event.type() == QEvent.Type.ToolTip:
            show_tip(event.globalPos(), self.name or HELP, self)
            return True
        return bool(super().event(event))

    def _point(self, place: QPointF) -> None:
        voxel, before = self.voxel_at(place), self.name
        if voxel is None:
            self.name = ""
            self.left.emit()
        else:
            self.pointed.emit(voxel)
        if self.name != before:
            # At once: names are read while the mouse moves on.
            show_tip(self.mapToGlobal(place.toPoint()), self.name, self)

    def _enlarge(self, factor: float, around: QPointF | None = None) -> None:
        """Zoom; what is under the mouse stays there, or else the crosshair."""
        if around is None:
            known = self._crosshair
            around = QPointF(self.rect().center()) if known is None else self.place_of(known)
        kept = self._mm_at(around)
        self._zoom = float(np.clip(self._zoom * factor, 1.0, MOST_ZOOM))
        self._middle = self._middle + kept - self._mm_at(around)
        if self._zoom == 1.0:
            self.fit()
        self.update()

    # The keys.

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move the crosshair, go through the slices, zoom, select."""
        step = LEAP if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1
        rows, cols, normal = self.plane.rows, self.plane.cols, self.plane.normal
        ways = {
            Qt.Key.Key_Up: (rows, -step),
            Qt.Key.Key_Down: (rows, step),
            Qt.Key.Key_Left: (cols, -step),
            Qt.Key.Key_Right: (cols, step),
            Qt.Key.Key_PageUp: (normal, -step),
            Qt.Key.Key_PageDown: (normal, step),
        }
        zooms = {
            Qt.Key.Key_Plus: ZOOM_STEP,
            Qt.Key.Key_Equal: ZOOM_STEP,
            Qt.Key.Key_Minus: 1 / ZOOM_STEP,
        }
        known = self._crosshair
        if known is None:
            super().keyPressEvent(event)
        elif event.key() in ways:
            axis, way = ways[event.key()]
            self.pointed.emit(self._moved(known, {axis: known[axis] + way}))
        elif event.key() in zooms:
            self._enlarge(zooms[event.key()])
        elif event.key() == Qt.Key.Key_Home:
            self.fit()
        elif event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.clicked.emit(known, _names(event.modifiers()))
        else:
            super().keyPressEvent(event)

    # The picture.

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the slice, the crosshair, and the letters of the axes."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), GROUND)
        if not self._image.isNull():
            across = self._scale() * float(self._in_plane(self._spacing).min())
            smooth = QPainter.RenderHint.SmoothPixmapTransform
            painter.setRenderHint(smooth, bool(across < VOXELS_SEEN))
            painter.drawImage(
                QRectF(self._place(np.zeros(2)), self._place(self._size_mm())), self._image
            )
        if self._crosshair is not None:
            self._draw_crosshair(painter, self.place_of(self._crosshair))
            places = [[self.place_of(voxel) for voxel in ruler.voxels] for ruler in self._rulers]
            pixels = [np.array([[place.y(), place.x()] for place in each]) for each in places]
            drawn = list(zip(pixels, self._rulers, strict=True))
            _draw_rulers(painter, drawn, (self.height(), self.width()))
            self._draw_words(painter, self._crosshair)
        painter.setPen(QPen(INKS[self.plane.normal], 2.0 if self.hasFocus() else 0.6))
        painter.drawRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5))
        painter.end()

    def _draw_crosshair(self, painter: QPainter, at: QPointF) -> None:
        x, y = at.x(), at.y()
        level = (QLineF(0, y, x - GAP, y), QLineF(x + GAP, y, self.width(), y))
        upright = (QLineF(x, 0, x, y - GAP), QLineF(x, y + GAP, x, self.height()))
        # A line has the colour of the slices that it shows from the side.
        for axis, lines in ((self.plane.rows, level), (self.plane.cols, upright)):
            for ink, width in ((QColor(0, 0, 0, 110), 2.6), (INKS[axis], 1.0)):
                painter.setPen(QPen(ink, width))
                painter.drawLines(list(lines))

    def _draw_words(self, painter: QPainter, voxel: Voxel) -> None:
        normal, inside = self.plane.normal, QRectF(self.rect()).adjusted(7, 5, -7, -5)
        where, flags = f"{AXES[normal]} {voxel[normal]}", Qt.AlignmentFlag
        words = (
            (where, flags.AlignLeft | flags.AlignTop, normal),
            (f"{AXES[self.plane.cols]} →", flags.AlignRight | flags.AlignBottom, self.plane.cols),
            (f"{AXES[self.plane.rows]} ↓", flags.AlignLeft | flags.AlignBottom, self.plane.rows),
        )
        for text, corner, axis in words:
            for ink, away in ((QColor(0, 0, 0, 190), 1.0), (INKS[axis], 0.0)):
                painter.setPen(ink)
                painter.drawText(inside.translated(away, away), corner, text)


def _draw_rulers(
    painter: QPainter,
    drawn: Sequence[tuple[NDArray[np.float64], RulerInSlice]],
    size: tuple[int, int],
) -> None:
    font = painter.fontMetrics()
    for pixels, ruler in drawn:
        draw_lines(painter, lines_of(pixels, ruler.strength, 1.0), np.zeros(2), 1.0)
    measured = [(pixels, ruler) for pixels, ruler in drawn if ruler.numbers]
    boxes = [
        [(font.height(), font.horizontalAdvance(words)) for words in ruler.numbers]
        for _, ruler in measured
    ]
    places = number_places([pixels for pixels, _ in measured], boxes, size, 1.0)
    for (_, ruler), numbers, middles in zip(measured, boxes, places, strict=True):
        painter.setOpacity(ruler.strength)
        for words, box, middle in zip(ruler.numbers, numbers, middles, strict=True):
            row, col = middle - np.array(box) / 2
            draw_words(painter, QPointF(float(col), float(row) + font.ascent()), words)
    painter.setOpacity(1.0)


def _names(held: Qt.KeyboardModifier) -> set[str]:
    """Return the keys held by the names that the 3D view has for them."""
    keys = {
        "Control": Qt.KeyboardModifier.ControlModifier,
        "Shift": Qt.KeyboardModifier.ShiftModifier,
    }
    return {name for name, key in keys.items() if held & key}
