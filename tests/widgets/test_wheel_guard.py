"""Scrolling over the panel changes no setting."""

from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import (
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QScrollArea,
    QScrollBar,
    QSpinBox,
)

from mouse import LEFT, NONE, PLAIN

KINDS = (QComboBox, QAbstractSpinBox, QAbstractSlider)


def _notch(widget: Any, up: int = -1) -> None:
    """Turn the wheel by one notch over the middle of a widget."""
    at = QPointF(widget.rect().center())
    there, angle = QPointF(widget.mapToGlobal(at)), QPoint(0, 120 * up)
    phase = Qt.ScrollPhase.NoScrollPhase
    event = QWheelEvent(at, there, QPoint(), angle, NONE, PLAIN, phase, False)
    QApplication.sendEvent(widget, event)


def _value(widget: Any) -> object:
    if isinstance(widget, QComboBox):
        return widget.currentText()
    return widget.value()


@pytest.fixture
def scrolling(panel: Any, piled: Any, qtbot: QtBot) -> Any:
    """Return the panel with a session, too low for all its steps, and the focus elsewhere."""
    panel.segment.fold.setChecked(False)
    panel.unpack.step_slider.slider.setFocus()
    panel.unpack.step_slider.slider.clearFocus()
    return panel


def test_the_wheel_over_every_box_and_slider_scrolls_and_changes_nothing(scrolling: Any) -> None:
    controls = [w for kind in KINDS for w in scrolling.findChildren(kind)]
    controls = [w for w in controls if not isinstance(w, QScrollBar)]
    assert len(controls) > 15
    scroll = scrolling.findChild(QScrollArea).verticalScrollBar()
    moved = 0
    for control in controls:
        before = _value(control)
        scroll.setValue(scroll.minimum())
        _notch(control)
        _notch(control, 1)
        _notch(control)
        assert _value(control) == before
        assert not control.hasFocus()
        moved += scroll.value() > 0
    # Those in folded parts and other scroll areas have nothing of the panel's to scroll.
    assert moved == len([w for w in controls if _first_scroll_area(w) is scroll])


def _first_scroll_area(widget: Any) -> Any:
    while not isinstance(widget, QScrollArea):
        widget = widget.parent()
    return widget.verticalScrollBar()


def test_the_table_in_its_dock_is_guarded_too(scrolling: Any, qtbot: QtBot) -> None:
    scrolling.objects.table_button.button.click()
    dock = scrolling.objects.table_button.dock
    qtbot.waitUntil(dock.isVisible, timeout=5000)
    boxes = dock.findChildren(QComboBox)
    assert boxes
    for box in boxes:
        _notch(box)
        assert box.currentIndex() == 0


def test_a_box_with_the_focus_follows_the_wheel(scrolling: Any, qtbot: QtBot) -> None:
    box = scrolling.unpack.count
    scrolling.activateWindow()
    QTest.mouseClick(box, LEFT, pos=QPoint(box.width() // 2, box.height() // 2))
    qtbot.waitUntil(box.hasFocus, timeout=5000)
    before = box.value()
    _notch(box, 1)
    assert box.value() == before + 1


def test_boxes_that_come_later_are_guarded_too(scrolling: Any, qtbot: QtBot) -> None:
    dialog = QDialog(scrolling)
    late = QSpinBox(dialog)
    late.setValue(7)
    dialog.show()
    qtbot.waitUntil(dialog.isVisible, timeout=5000)
    scrolling.setFocus()
    late.clearFocus()
    _notch(late)
    assert late.value() == 7
    dialog.close()
