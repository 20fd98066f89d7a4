"""What the plugin says in napari's notices."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, QRect
from qtpy.QtWidgets import QApplication, QDialog

from keys import Keys
from napari_unpack.layers import compat
from napari_unpack.widgets import notifications


@pytest.fixture
def records():
    kept = list(notification_manager.records)
    notification_manager.records.clear()
    yield notification_manager.records
    notification_manager.records[:] = kept


def test_what_stands_there_already_is_not_said_again(records) -> None:
    for _ in range(3):
        notifications.inform("There is nothing to undo.")
    notifications.warn("Cup cannot leave.")
    notifications.inform("There is nothing to undo.")
    said = [record.message for record in records]
    assert said == ["There is nothing to undo.", "Cup cannot leave.", "There is nothing to undo."]
    records[-1].date -= timedelta(seconds=5)
    notifications.inform("There is nothing to undo.")
    assert len(records) == 4


@pytest.fixture
def notices(viewer: Any, panel: Any, qtbot: QtBot) -> Any:
    """Return what tells the notifications that stand on the canvas."""
    window = compat.native_window(viewer)
    # napari counts the time of what is shown in a window that is active.
    Keys(window, qtbot)
    canvas = compat.native_canvas(viewer).native

    def shown() -> list[Any]:
        return [
            one for one in canvas.findChildren(QDialog) if one.isVisible() and hasattr(one, "timer")
        ]

    for one in shown():
        one.close()
    yield shown
    for one in shown():
        one.close()


def test_a_notification_beneath_another_goes_as_well(
    records: Any, notices: Any, qtbot: QtBot
) -> None:
    for name in ("Cup", "Key", "Tin"):
        notifications.inform(f"{name} cannot leave.")
        notices()[-1].DISMISS_AFTER = 200
        notices()[-1].timer.setInterval(200)
    assert len(notices()) == 3
    qtbot.waitUntil(lambda: not notices(), timeout=10000)


def test_a_notification_is_no_wider_than_its_canvas(
    records: Any, viewer: Any, notices: Any, qtbot: QtBot
) -> None:
    canvas = compat.native_canvas(viewer).native
    viewer.window.resize(1000, 600)
    qtbot.waitUntil(lambda: 300 < canvas.width() < 400, timeout=5000)
    notifications.warn("Cup cannot leave, because the key, the tin and the book lie upon it.")
    (one,) = notices()
    qtbot.waitUntil(lambda: one.geom_anim.state() == one.geom_anim.State.Stopped, timeout=5000)
    for width in (1000, 950):
        viewer.window.resize(width, 600)
        QApplication.processEvents()
        assert one.x() >= 0, (one.geometry(), canvas.width())
        assert one.geometry().right() < canvas.width()
        seen = one.rect()
        for part in (one.severity_icon, one.message, one.close_button):
            assert seen.contains(QRect(part.mapTo(one, QPoint(0, 0)), part.size()))
