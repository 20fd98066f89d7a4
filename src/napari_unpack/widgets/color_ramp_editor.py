"""Colours along the density axis, under the opacity curve; white, the tints alone, by default."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtCore import QPointF, QRectF, QSize, Qt, Signal
from qtpy.QtGui import QColor, QLinearGradient, QPainter, QPen
from qtpy.QtWidgets import QColorDialog, QWidget

from napari_unpack.widgets.opacity_editor import (
    ADDING,
    CHOOSING,
    MARGIN,
    SMALLEST_GAP,
    neighbour,
    paint_focus,
    step_of,
)

if TYPE_CHECKING:
    from qtpy.QtGui import QKeyEvent, QMouseEvent, QPaintEvent

RGB = tuple[float, float, float]
Stop = tuple[float, RGB]

# How near to a colour's middle a press grabs it: its radius and a little more.
GRAB_PIXELS = 7.0

# Samples of the ramp: between two the gradient is linear in x, which density is not.
SHADES = 33

WHITE: RGB = (1.0, 1.0, 1.0)


class ColorRampEditor(QWidget):
    """Add, drag, recolour and remove the colours of a transfer function.

    Density runs on the opacity editor's square-root scale. A double click adds a colour, or changes
    the one under the mouse; dragging moves it; a right click or Delete removes it; Page up and Page
    down choose one, arrow keys move it, Enter changes it and + adds one. Without any, everything is
    white and objects show their tints as they are.

    `edited` carries the new stops, (density, (r, g, b)) by ascending density, while dragging too.
    """

    edited = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._stops: list[Stop] = []
        self._domain = (0.0, 1.0)
        self._chosen = -1
        self._dragging = False
        self._bags = 0
        self.setFixedHeight(22)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName("Colours along the density axis")
        self.setToolTip(
            "Colours of densities, multiplied by the tints; white leaves tints as they are. "
            "Double-click adds a colour or changes one; drag it along the densities; a right click "
            "or Delete removes it. Keys: Page up and Page down choose a colour, arrows move it "
            "(with Shift further), Enter changes it, + adds one."
        )

    def sizeHint(self) -> QSize:
        """Return the size that fits the panel."""
        return QSize(240, 22)

    @property
    def stops(self) -> list[Stop]:
        """The colours, (density, (r, g, b)) by ascending density; none for white."""
        return list(self._stops)

    def let_go(self) -> None:
        """End a drag, and take no colour that is asked for: another bag is shown from now on."""
        self._dragging = False
        self._bags += 1

    def show_colors(self, colors: Iterable[Stop] | None, domain: tuple[float, float]) -> None:
        """Show the colours of a transfer function.

        Parameters
        ----------
        colors : iterable of (float, (float, float, float)), or None
            Ascending densities and straight RGB in [0, 1].
        domain : (float, float)
            Lowest and highest density shown.
        """
        # The session sends back what is dragged, later than the mouse moves.
        if self._dragging:
            return
        self._stops = [(float(d), (rgb[0], rgb[1], rgb[2])) for d, rgb in colors or ()]
        # A volume of one density still needs an axis of some length.
        self._domain = (float(domain[0]), max(float(domain[1]), float(domain[0]) + 1e-9))
        self._chosen = min(self._chosen, len(self._stops) - 1)
        self.update()

    def position(self, density: float) -> QPointF:
        """Return where a density's colour is drawn, in pixels."""
        low, high = self._domain
        share = np.sqrt(min(max((density - low) / (high - low), 0.0), 1.0))
        return QPointF(MARGIN + share * (self.width() - 2 * MARGIN), self.height() / 2)

    def color_at(self, density: float) -> RGB:
        """Return the colour of a density, between stops linearly."""
        if not self._stops:
            return WHITE
        places = [d for d, _ in self._stops]
        red, green, blue = (
            float(np.interp(density, places, [rgb[c] for _, rgb in self._stops])) for c in range(3)
        )
        return red, green, blue

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Choose a colour, or remove it."""
        self._chosen = self._nearest(event.position())
        if event.button() == Qt.MouseButton.RightButton:
            self._remove()
        else:
            self._dragging = self._chosen >= 0
        self.update()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag the chosen colour."""
        if self._dragging:
            self._move(self._density_at(event.position().x()))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag."""
        self._dragging = False

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Add a colour, or ask for another in place of one."""
        if event.button() != Qt.MouseButton.LeftButton:
            self.mousePressEvent(event)
            return
        self._dragging = False
        self._chosen = self._nearest(event.position())
        if self._chosen >= 0:
            self._change_chosen()
            return
        self._add(self._density_at(event.position().x()))

    def _add(self, density: float) -> None:
        color = self._ask_color(self.color_at(density))
        # Two colours of one density would make the ramp ambiguous.
        if color is not None and all(d != density for d, _ in self._stops):
            self._chosen = sum(d < density for d, _ in self._stops)
            self._stops.insert(self._chosen, (density, color))
            self._emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Choose a colour, move, change or remove the chosen one, or add one."""
        # In pixels, so that a step looks the same anywhere on the square-root scale.
        steps = {Qt.Key.Key_Left: -1.0, Qt.Key.Key_Right: 1.0}
        begins = self._chosen < 0 and event.key() in steps
        if self._stops and (begins or event.key() in CHOOSING):
            self._chosen = neighbour(self._chosen, CHOOSING.get(event.key(), 1), len(self._stops))
            self.update()
        elif self._chosen >= 0 and event.key() in steps:
            x = self.position(self._stops[self._chosen][0]).x()
            self._move(self._density_at(x + steps[event.key()] * step_of(event)))
        elif event.key() in ADDING:
            self._add_beside()
        elif self._chosen >= 0 and event.key() in (Qt.Key.Key_Delete, Qt.Key.Key_Backspace):
            self._remove()
        elif self._chosen >= 0 and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._change_chosen()
        else:
            super().keyPressEvent(event)

    def _add_beside(self) -> None:
        # Halfway to the next colour, or to the end of the axis.
        ends = [self.position(density).x() for density, _ in self._stops]
        edges = [MARGIN, *ends, self.width() - MARGIN]
        index = self._chosen + 1
        if edges[index + 1] - edges[index] < 2.0:
            index = max(index - 1, 0)
        self._add(self._density_at((edges[index] + edges[index + 1]) / 2))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the ramp, and a circle for each colour."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        paint_focus(self, painter)
        painter.setOpacity(1.0 if self.isEnabled() else 0.4)
        area = QRectF(MARGIN, 5.0, self.width() - 2 * MARGIN, self.height() - 10.0)
        shade = QLinearGradient(area.topLeft(), area.topRight())
        low, high = self._domain
        for share in np.linspace(0.0, 1.0, SHADES):
            shade.setColorAt(share, QColor.fromRgbF(*self.color_at(low + share**2 * (high - low))))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(shade)
        painter.drawRoundedRect(area, 3, 3)
        ink = self.palette().text().color()
        for k, (density, rgb) in enumerate(self._stops):
            painter.setPen(QPen(ink, 2.4 if k == self._chosen else 1.2))
            painter.setBrush(QColor.fromRgbF(*rgb))
            painter.drawEllipse(self.position(density), 5.5, 5.5)
        painter.end()

    def _density_at(self, x: float) -> float:
        low, high = self._domain
        share = (x - MARGIN) / max(self.width() - 2 * MARGIN, 1.0)
        return float(low + min(max(share, 0.0), 1.0) ** 2 * (high - low))

    def _nearest(self, position: QPointF) -> int:
        distances = [abs(self.position(d).x() - position.x()) for d, _ in self._stops]
        nearest = int(np.argmin(distances)) if distances else -1
        return nearest if nearest >= 0 and distances[nearest] <= GRAB_PIXELS else -1

    def _move(self, density: float) -> None:
        k, gap = self._chosen, SMALLEST_GAP * (self._domain[1] - self._domain[0])
        below = self._stops[k - 1][0] + gap if k > 0 else -np.inf
        above = self._stops[k + 1][0] - gap if k + 1 < len(self._stops) else np.inf
        self._stops[k] = (float(max(min(density, above), below)), self._stops[k][1])
        self._emit()

    def _remove(self) -> None:
        if self._chosen >= 0:
            del self._stops[self._chosen]
            # Else the next Delete would remove a neighbour.
            self._chosen = -1
            self._emit()

    def _change_chosen(self) -> None:
        density, rgb = self._stops[self._chosen]
        color = self._ask_color(rgb)
        if color is not None:
            self._stops[self._chosen] = (density, color)
            self._emit()

    def _ask_color(self, now: RGB) -> RGB | None:
        before = self._bags, self.stops
        color = QColorDialog.getColor(QColor.fromRgbF(*now), self, "Colour of this density")
        # Meanwhile another bag may be shown, or other colours of this one.
        taken = color.isValid() and (self._bags, self._stops) == before
        return (color.redF(), color.greenF(), color.blueF()) if taken else None

    def _emit(self) -> None:
        self.update()
        self.edited.emit(self.stops)
