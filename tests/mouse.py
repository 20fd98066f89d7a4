"""The mouse over a widget, as Qt tells of it.

`QTest.mouseMove` moves the pointer of the screen instead, and what the screen then sends comes
when it comes: on a busy machine after the button was let go.
"""

from __future__ import annotations

from typing import Any

from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, QPointF, Qt
from qtpy.QtGui import QMouseEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

LEFT = Qt.MouseButton.LeftButton
NONE = Qt.MouseButton.NoButton
PLAIN = Qt.KeyboardModifier.NoModifier


def move(widget: Any, at: QPoint, button: Any = NONE, modifiers: Any = PLAIN) -> None:
    """Move the mouse to a place on a widget."""
    local, there = QPointF(at), QPointF(widget.mapToGlobal(at))
    kind = QEvent.Type.MouseMove
    QApplication.sendEvent(widget, QMouseEvent(kind, local, there, NONE, button, modifiers))


def drag(widget: Any, start: QPoint, way: QPoint, qtbot: QtBot, modifiers: Any = PLAIN) -> None:
    """Press the left button, move in three steps, and let go."""
    QTest.mousePress(widget, LEFT, modifiers, pos=start)
    for part in (0.3, 0.6, 1.0):
        at = QPoint(round(way.x() * part), round(way.y() * part))
        move(widget, start + at, LEFT, modifiers)
        # napari hears of at most one movement in 5 ms.
        qtbot.wait(20)
    QTest.mouseRelease(widget, LEFT, modifiers, pos=start + way)
