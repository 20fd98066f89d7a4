"""A ring around the 3D view while it has the keyboard and was reached by it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.compat import isalive
from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtGui import QColor, QFocusEvent, QPainter, QRegion
from qtpy.QtWidgets import QWidget

if TYPE_CHECKING:
    from qtpy.QtGui import QPaintEvent

# Pixels: as wide as the eye needs at the edge of a large dark picture.
WIDTH = 2

BY_KEYS = (
    Qt.FocusReason.TabFocusReason,
    Qt.FocusReason.BacktabFocusReason,
    Qt.FocusReason.ShortcutFocusReason,
)


class FocusRing(QWidget):
    """Lies upon a canvas, lets the mouse through, and covers only its edge.

    Parameters
    ----------
    canvas : QWidget
        napari's, that has the keyboard itself or within the widget that it fills.
    """

    def __init__(self, canvas: QWidget) -> None:
        super().__init__(canvas)
        self._color = QColor()
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.hide()
        for widget in self._watched():
            widget.installEventFilter(self)

    def _watched(self) -> list[QWidget]:
        """Return the canvas and the widget that it fills; not kept, or they would live on."""
        # Either takes Tab, and hands its keys to the viewer.
        canvas = self.parentWidget()
        above = canvas.parentWidget()
        while above is not None and not above.focusPolicy() & Qt.FocusPolicy.TabFocus:
            above = above.parentWidget()
        return [canvas] if above is None else [canvas, above]

    def take_keyboard(self) -> None:
        """Give the canvas the keyboard, and show so."""
        self.parentWidget().setFocus(Qt.FocusReason.ShortcutFocusReason)

    def paint_in(self, color: str) -> None:
        """Take a CSS colour."""
        self._color = QColor(color)
        self.update()

    def end(self) -> None:
        """Take it away, unless it went with the canvas."""
        if isalive(self):
            for widget in self._watched():
                widget.removeEventFilter(self)
            self.deleteLater()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow who has the keyboard, and the size.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        kind = event.type()
        # PyQt may take a new event for one of the same place that somebody still holds.
        reason = event.reason() if isinstance(event, QFocusEvent) else None
        if kind == QEvent.Type.FocusIn and reason in BY_KEYS:
            self._fit()
            self.show()
            self.raise_()
        elif kind in (QEvent.Type.FocusOut, QEvent.Type.MouseButtonPress):
            # Whoever takes the mouse looks where it is.
            self.hide()
        elif kind == QEvent.Type.Resize:
            self._fit()
        return False

    def _fit(self) -> None:
        whole = self.parentWidget().rect()
        self.setGeometry(whole)
        inner = whole.adjusted(WIDTH, WIDTH, -WIDTH, -WIDTH)
        self.setMask(QRegion(whole).subtracted(QRegion(inner)))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Fill what the mask leaves."""
        QPainter(self).fillRect(self.rect(), self._color)
