"""The opacity curve of the master transfer function, drawn over the density histogram."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from qtpy.QtCore import QPointF, QRectF, QSize, Qt, Signal
from qtpy.QtGui import QBrush, QColor, QLinearGradient, QPainter, QPen, QPolygonF
from qtpy.QtWidgets import QWidget

from napari_unpack.geometry.length_unit import density_text
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard

if TYPE_CHECKING:
    from qtpy.QtGui import QKeyEvent, QMouseEvent, QPaintEvent

Point = tuple[float, float]

# Pixels around the curve, so that points at its ends can be grabbed whole.
MARGIN = 8.0

# How near to a point a press grabs it: twice its radius, for hands that are not steady.
GRAB_PIXELS = 9.0

# Between neighbouring points, as a share of the densities shown: curves must ascend.
SMALLEST_GAP = 1e-3

# Below the curve, pixels: the numbers of the density axis.
AXIS = 14.0

# Opacities with a number, on the cubic-root scale.
MARKED = (0.01, 0.1, 0.5, 1.0)

# Of the histogram: about one for two pixels of the editor.
BINS = 128

# What the keys do in drawn controls.
CHOOSING = {Qt.Key.Key_PageUp: -1, Qt.Key.Key_PageDown: 1}
ADDING = (Qt.Key.Key_Plus, Qt.Key.Key_Insert)
# With Shift an arrow key crosses the control in a few presses.
LEAP = 10.0

# Voxels counted at most: a million show the shape, and take milliseconds.
SAMPLES = 1 << 20


def histogram(volume: ArrayLike, domain: tuple[float, float]) -> NDArray[np.float64]:
    """Count densities on a logarithmic scale, from a million voxels at most.

    Bins are of one width on the editor's square-root scale of densities.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Densities.
    domain : (float, float)
        Lowest and highest density shown.

    Returns
    -------
    (128,) ndarray of float64
        Heights in [0, 1].
    """
    values = np.asarray(volume).reshape(-1)
    values = values[:: max(1, values.size // SAMPLES)]
    # Squares, as the editor draws densities on a square-root scale.
    edges = domain[0] + (domain[1] - domain[0]) * np.linspace(0.0, 1.0, BINS + 1) ** 2
    counts, _ = np.histogram(values[np.isfinite(values)], bins=edges)
    # Air would flatten everything else on a linear scale.
    heights = np.log1p(counts.astype(np.float64))
    return heights / max(float(heights.max()), 1e-9)


def paint_focus(widget: QWidget, painter: QPainter) -> None:
    """Draw a ring where a drawn control has the keyboard, as the style sheet does for others.

    Parameters
    ----------
    widget : QWidget
    painter : QPainter
        Of the widget.
    """
    if widget.hasFocus():
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(widget.palette().text().color(), 2))
        painter.drawRoundedRect(QRectF(widget.rect()).adjusted(1, 1, -1, -1), 4, 4)
        painter.setPen(Qt.PenStyle.NoPen)


def step_of(event: QKeyEvent) -> float:
    """Return the pixels that a press of an arrow key goes."""
    return LEAP if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1.0


def neighbour(chosen: int, way: int, count: int) -> int:
    """Return which of some points is chosen next.

    Parameters
    ----------
    chosen : int
        Negative for none so far.
    way : {-1, 1}
    count : int
    """
    if chosen < 0:
        return 0 if way > 0 else count - 1
    return (chosen + way) % count


def round_densities(low: float, high: float) -> list[float]:
    """Return some round densities of an axis with a square-root scale.

    Parameters
    ----------
    low, high : float
        Its ends.
    """
    found = []
    for share in np.linspace(0.0, 1.0, 7):
        value = low + share**2 * (high - low)
        step = 10.0 ** np.floor(np.log10(max(high - low, 1e-9) * max(share, 0.1) / 2))
        rounded = float(np.round(value / step) * step)
        if low <= rounded <= high and rounded not in found:
            found.append(rounded)
    return found


class OpacityEditor(KeepsKeyboard, QWidget):
    """Drag, add and remove the points of a piecewise linear opacity curve.

    Opacity runs on a cubic-root scale, since what matters for translucency lies near zero; density
    on a square-root scale, since metal reaches far above everything else. Drag a point; double-
    click adds one; Delete or a right click removes one; Page up and Page down choose one, arrow
    keys move it, + adds one beside it; dragging the background moves the whole curve along the
    density axis (level), with Shift it widens or narrows it (window).

    `edited` carries the new points, while dragging too.
    """

    edited = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._points: list[Point] = [(0.0, 0.0), (1.0, 1.0)]
        self._domain = (0.0, 1.0)
        self._heights: NDArray[np.float64] = np.zeros(BINS)
        self._chosen = -1
        self._dragged: float | None = None
        # What is to be shown once the mouse lets go.
        self._late_domain: tuple[float, float] | None = None
        self._late_heights: NDArray[np.float64] | None = None
        self._widening = False
        self._accent = QColor("#5b7cf0")
        self.setMinimumHeight(110)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName("Opacity curve")
        self.setToolTip(
            "Opacity of a voxel over its density, on the histogram of the volume. "
            "Drag points; double-click adds one, a right click or Delete removes one; "
            "drag beside the points to move the whole curve (level), with Shift to widen it "
            "(window). Keys: Page up and Page down choose a point, arrows move it (with Shift "
            "further), + adds one."
        )

    def sizeHint(self) -> QSize:
        """Return the size that fits the panel."""
        return QSize(240, 126)

    @property
    def points(self) -> list[Point]:
        """The curve, (density, opacity) by ascending density."""
        return list(self._points)

    def let_go(self) -> None:
        """End a drag: the curve of another bag is shown from now on."""
        self._dragged = self._late_domain = self._late_heights = None

    def show_curve(self, points: Iterable[Point], domain: tuple[float, float]) -> None:
        """Show a curve; of one that comes while another is dragged, the domain after that.

        Parameters
        ----------
        points : iterable of (float, float)
            Density and opacity in [0, 1], ascending.
        domain : (float, float)
            Lowest and highest density shown.
        """
        if self._dragged is not None:
            self._late_domain = domain
            return
        shown = [(float(d), float(a)) for d, a in points]
        # The session sends an edited curve back late, and the chosen point must stay chosen; in a
        # curve from elsewhere none is.
        if self._without_chosen(shown) != self._without_chosen(self._points):
            self._chosen = -1
        self._points = shown
        self._domain = (float(domain[0]), max(float(domain[1]), float(domain[0]) + 1e-9))
        self.update()

    def _without_chosen(self, points: list[Point]) -> list[Point]:
        return [point for k, point in enumerate(points) if k != self._chosen]

    def show_histogram(self, heights: NDArray[np.float64]) -> None:
        """Show a histogram of the domain, heights in [0, 1]; after a drag where there is one."""
        if self._dragged is not None:
            self._late_heights = heights
            return
        self._heights = heights
        self.update()

    def set_accent(self, color: str) -> None:
        """Draw the curve in a colour of the theme."""
        self._accent = QColor(color)
        self.update()

    def _area(self) -> QRectF:
        return QRectF(self.rect()).adjusted(MARGIN, MARGIN, -MARGIN, -MARGIN - AXIS)

    def position(self, point: Point) -> QPointF:
        """Return where a point of the curve is drawn, in pixels."""
        area, (low, high) = self._area(), self._domain
        share = max(point[0] - low, 0.0) / (high - low)
        x = area.left() + np.sqrt(share) * area.width()
        return QPointF(x, area.bottom() - np.cbrt(point[1]) * area.height())

    def _point_at(self, position: QPointF) -> Point:
        area, (low, high) = self._area(), self._domain
        share = (position.x() - area.left()) / max(area.width(), 1.0)
        height = (area.bottom() - position.y()) / max(area.height(), 1.0)
        return low + max(share, 0.0) ** 2 * (high - low), float(np.clip(height, 0.0, 1.0)) ** 3

    def _nearest(self, position: QPointF) -> int:
        spots = [self.position(p) for p in self._points]
        distances = [np.hypot(s.x() - position.x(), s.y() - position.y()) for s in spots]
        nearest = int(np.argmin(distances))
        return nearest if distances[nearest] <= GRAB_PIXELS else -1

    def _move(self, index: int, point: Point) -> None:
        low, high = self._domain
        gap = SMALLEST_GAP * (high - low)
        # The whole curve may have been dragged past an end of the axis.
        below = self._points[index - 1][0] + gap if index > 0 else min(low, self._points[0][0])
        last = index + 1 == len(self._points)
        above = max(high, self._points[-1][0]) if last else self._points[index + 1][0] - gap
        # Points may not pass each other: the curve is a function of density.
        density = max(min(point[0], above), below)
        self._points[index] = (density, min(max(point[1], 0.0), 1.0))
        self._emit()

    def _shift(self, by: float) -> None:
        self._points = [(density + by, opacity) for density, opacity in self._points]
        self._emit()

    def _widen(self, by: float) -> None:
        """Widen the window: the whole curve is stretched about the middle of where it rises."""
        low, high = self._points[0][0], self._points[-1][0]
        shows = [density for density, opacity in self._points if opacity > 0] or [low, high]
        middle, width = (shows[0] + shows[-1]) / 2, high - low
        # Twice, because both ends move; and never through zero, which would mirror the curve.
        stretch = max(1.0 + 2.0 * by / width, 0.05)
        self._points = [(middle + stretch * (d - middle), opacity) for d, opacity in self._points]
        self._emit()

    def _remove(self, index: int) -> None:
        # A line needs two points.
        if index >= 0 and len(self._points) > 2:
            del self._points[index]
            self._chosen = -1
            self._emit()

    def _emit(self) -> None:
        self.update()
        self.edited.emit(self.points)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Choose a point, or begin to drag the whole curve."""
        self._chosen = self._nearest(event.position())
        if event.button() == Qt.MouseButton.RightButton:
            self._remove(self._chosen)
        else:
            self._dragged = self._point_at(event.position())[0]
            self._widening = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        self.update()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag the chosen point, or the whole curve."""
        if self._dragged is None:
            return
        point = self._point_at(event.position())
        if self._chosen >= 0:
            self._move(self._chosen, point)
        else:
            (self._widen if self._widening else self._shift)(point[0] - self._dragged)
            self._dragged = point[0]

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag."""
        domain, heights = self._late_domain, self._late_heights
        self.let_go()
        if domain is not None:
            self.show_curve(self._points, domain)
        if heights is not None:
            self.show_histogram(heights)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Add a point."""
        if event.button() != Qt.MouseButton.LeftButton:
            self.mousePressEvent(event)
            return
        if self._nearest(event.position()) >= 0:
            return
        point = self._point_at(event.position())
        index = sum(density < point[0] for density, _ in self._points)
        if any(density == point[0] for density, _ in self._points):
            return
        self._points.insert(index, point)
        self._chosen = index
        self._emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Choose a point, move or remove the chosen one, or add one."""
        steps = {
            Qt.Key.Key_Left: (-1.0, 0.0),
            Qt.Key.Key_Right: (1.0, 0.0),
            Qt.Key.Key_Up: (0.0, -1.0),
            Qt.Key.Key_Down: (0.0, 1.0),
        }
        if event.key() in CHOOSING or (self._chosen < 0 and event.key() in steps):
            self._chosen = neighbour(self._chosen, CHOOSING.get(event.key(), 1), len(self._points))
            self.update()
        elif event.key() in steps:
            way = QPointF(*steps[Qt.Key(event.key())]) * step_of(event)
            spot = self.position(self._points[self._chosen])
            self._move(self._chosen, self._point_at(spot + way))
        elif event.key() in ADDING:
            self._add_beside()
        elif self._chosen >= 0 and event.key() in (Qt.Key.Key_Delete, Qt.Key.Key_Backspace):
            self._remove(self._chosen)
        else:
            super().keyPressEvent(event)

    def _add_beside(self) -> None:
        # Halfway to the next point; there is none after the last.
        index = min(max(self._chosen, 0), len(self._points) - 2)
        before, after = (self.position(point) for point in self._points[index : index + 2])
        point = self._point_at((before + after) / 2)
        if self._points[index][0] < point[0] < self._points[index + 1][0]:
            self._points.insert(index + 1, point)
            self._chosen = index + 1
            self._emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the histogram, the curve and its points."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ink = self.palette().text().color()
        painter.setPen(Qt.PenStyle.NoPen)
        ground = QColor(ink)
        ground.setAlphaF(0.06)
        painter.setBrush(ground)
        painter.drawRoundedRect(QRectF(self.rect()), 4, 4)
        paint_focus(self, painter)
        self._paint_histogram(painter, ink)
        # A window dragged along the axis leaves it on one side.
        painter.setClipRect(self.rect())
        self._paint_curve(painter)
        self._paint_axes(painter, ink)
        self._paint_label(painter, ink)
        painter.end()

    def _paint_histogram(self, painter: QPainter, ink: QColor) -> None:
        area = self._area()
        width = area.width() / len(self._heights)
        shade = QColor(ink)
        shade.setAlphaF(0.28 if self.isEnabled() else 0.1)
        outline = [area.bottomLeft()]
        for k, height in enumerate(self._heights):
            y = area.bottom() - height * area.height()
            outline += [
                QPointF(area.left() + k * width, y),
                QPointF(area.left() + (k + 1) * width, y),
            ]
        painter.setBrush(shade)
        painter.drawPolygon(QPolygonF([*outline, area.bottomRight()]))

    @property
    def label_text(self) -> str:
        """The chosen point's density and opacity, empty where none is chosen."""
        if self._chosen < 0:
            return ""
        density, opacity = self._points[self._chosen]
        return f"density {density_text(density)}, opacity {opacity:.2g}"

    def _paint_axes(self, painter: QPainter, ink: QColor) -> None:
        """Write round densities under the curve, and opacities at its left."""
        area, faint = self._area(), QColor(ink)
        faint.setAlphaF(0.75)
        painter.setPen(faint)
        small = self.font()
        small.setPointSizeF(max(small.pointSizeF() - 2.0, 6.0))
        painter.setFont(small)
        end = -np.inf
        for density in round_densities(*self._domain):
            words = f"{density:g}"
            wide = painter.fontMetrics().horizontalAdvance(words)
            x = self.position((density, 0.0)).x()
            left = min(max(x - wide / 2, 2.0), self.width() - wide - 2.0)
            # Where two numbers would run into each other the first stays.
            if left > end + 6:
                painter.drawText(QPointF(left, self.height() - 4.0), words)
                painter.drawLine(QPointF(x, area.bottom()), QPointF(x, area.bottom() + 3.0))
                end = left + wide
        for opacity in MARKED:
            y = self.position((self._domain[0], opacity)).y()
            painter.drawText(QPointF(area.left() + 2.0, y + 4.0), f"{opacity:g}")
        painter.setFont(self.font())

    def _paint_label(self, painter: QPainter, ink: QColor) -> None:
        """Write the chosen point's density and opacity, over the curve."""
        if not self.label_text:
            return
        where = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop
        plate = QColor(self.palette().window().color())
        plate.setAlphaF(0.8)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(plate)
        bounds = painter.boundingRect(self._area(), where, self.label_text)
        painter.drawRoundedRect(bounds.adjusted(-4, -1, 4, 1), 3, 3)
        painter.setPen(ink)
        painter.drawText(self._area(), where, self.label_text)

    def _paint_curve(self, painter: QPainter) -> None:
        area, accent = self._area(), QColor(self._accent)
        accent.setAlphaF(1.0 if self.isEnabled() else 0.4)
        spots = [self.position(p) for p in self._points]
        line = [
            QPointF(area.left(), spots[0].y()),
            *spots,
            QPointF(area.right(), spots[-1].y()),
        ]
        fade = QLinearGradient(area.topLeft(), area.bottomLeft())
        strong, weak = QColor(accent), QColor(accent)
        strong.setAlphaF(0.35 * accent.alphaF())
        weak.setAlphaF(0.05)
        fade.setColorAt(0.0, strong)
        fade.setColorAt(1.0, weak)
        painter.setBrush(QBrush(fade))
        painter.drawPolygon(QPolygonF([area.bottomLeft(), *line, area.bottomRight()]))
        painter.setPen(QPen(accent, 2))
        painter.drawPolyline(QPolygonF(line))
        for k, spot in enumerate(spots):
            painter.setBrush(accent if k == self._chosen else self.palette().window())
            painter.drawEllipse(spot, 4.0, 4.0)
