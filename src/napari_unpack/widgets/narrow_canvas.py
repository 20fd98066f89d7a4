"""napari's notifications fit into a canvas that is narrower than they are."""

from __future__ import annotations

from qtpy.compat import isalive
from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import QDialog, QLabel, QWidget

# Pixels between a notification and the edges of the canvas: napari's own.
EDGE = 8
# Pixels of a notification's icon and of the narrowest one: beside less, nothing can be read.
ICON, LEAST = 30, 120


class NarrowCanvas(QObject):
    """Has notifications be no wider than the canvas: their first words would stand outside.

    Parameters
    ----------
    canvas : QWidget
        napari's, upon which it lays them.
    """

    def __init__(self, canvas: QWidget) -> None:
        super().__init__(canvas)
        canvas.installEventFilter(self)

    def end(self) -> None:
        """Leave them as they are, unless it went with the canvas."""
        if isalive(self):
            self.parent().removeEventFilter(self)
            self.deleteLater()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow what comes upon the canvas, and its size.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        if event.type() == QEvent.Type.ChildPolished:
            self._fit(event.child())
        elif event.type() == QEvent.Type.Resize:
            for child in watched.children():
                self._fit(child)
        return False

    def _fit(self, child: QObject) -> None:
        # What else napari lays there stays, and is narrow.
        if not isinstance(child, QDialog) or not child.testAttribute(
            Qt.WidgetAttribute.WA_DeleteOnClose
        ):
            return
        canvas = self.parent().width()
        if child.width() + 2 * EDGE > canvas:
            for label in child.findChildren(QLabel):
                label.setMinimumWidth(min(label.minimumWidth(), ICON))
            child.setFixedWidth(max(canvas - 2 * EDGE, LEAST))
            child.move(canvas - child.width() - EDGE, child.y())
