"""The ring around what has the keyboard, and events that are not what they say."""

from __future__ import annotations

from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPointF, Qt
from qtpy.QtGui import QFocusEvent, QMouseEvent
from qtpy.QtWidgets import QWidget

from napari_unpack.widgets.focus_ring import FocusRing


class MistakenEvent(QMouseEvent):
    """A mouse event that says it is of focus, as PyQt hands one over in its place."""

    def type(self) -> QEvent.Type:
        return QEvent.Type.FocusIn


def test_it_shows_by_keys_and_an_event_of_another_class_raises_nothing(qtbot: QtBot) -> None:
    canvas = QWidget()
    qtbot.addWidget(canvas)
    canvas.show()
    ring = FocusRing(canvas)
    left, none = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    press = QEvent.Type.MouseButtonPress
    mistaken = MistakenEvent(press, QPointF(1, 1), QPointF(1, 1), left, left, none)
    assert ring.eventFilter(canvas, mistaken) is False
    assert not ring.isVisible()
    ring.eventFilter(canvas, QFocusEvent(QEvent.Type.FocusIn, Qt.FocusReason.TabFocusReason))
    assert ring.isVisible()
    ring.end()
