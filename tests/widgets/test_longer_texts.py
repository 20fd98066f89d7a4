"""Other languages: every text of the panel longer by 40 %, and nothing is cut off."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QObject, QRect, QSignalBlocker
from qtpy.QtGui import QHelpEvent
from qtpy.QtWidgets import (
    QAbstractButton,
    QApplication,
    QCheckBox,
    QComboBox,
    QFileDialog,
    QLabel,
    QPushButton,
    QScrollArea,
    QStyle,
    QStyleOptionButton,
    QStyleOptionComboBox,
    QToolTip,
    QWidget,
)

from napari_unpack.widgets.section import Collapsible, Section
from napari_unpack.widgets.unpacking_widget import WIDTH, UnpackingWidget
from opened_panel import add_bag, controller_with, press, rest


def longer(text: str) -> str:
    """Return a text with four tenths more letters, in words like those of other languages."""
    more = -(-len(text) * 2 // 5)
    # Of a single word, a longer word.
    gaps = 9 if " " in text else more + 1
    return text + "".join("n" if k % gaps else " " for k in range(1, more + 1))


def stretch(panel: QWidget) -> int:
    """Lengthen what labels, buttons and choices say; return how many texts."""
    count = 0
    for widget in panel.findChildren(QWidget):
        if isinstance(widget, QComboBox):
            # The choices themselves stay: only what they are called is longer.
            with QSignalBlocker(widget):
                for place in range(widget.count()):
                    widget.setItemText(place, longer(widget.itemText(place)))
                    count += 1
        elif isinstance(widget, QAbstractButton | QLabel) and len(widget.text()) > 2:
            widget.setText(longer(widget.text()))
            count += 1
    return count


def unfold(panel: QWidget) -> None:
    """Open every step and everything that folds away."""
    for section in panel.findChildren(Section):
        section.fold.setChecked(False)
    for more in panel.findChildren(Collapsible):
        more.toggle.setChecked(True)


def room_of(widget: QWidget) -> QRect | None:
    """Return where a control's text stands in it, None where it has no text."""
    style = widget.style()
    if isinstance(widget, QComboBox):
        combo = QStyleOptionComboBox()
        widget.initStyleOption(combo)
        field = QStyle.SubControl.SC_ComboBoxEditField
        return style.subControlRect(QStyle.ComplexControl.CC_ComboBox, combo, field, widget)
    if isinstance(widget, QCheckBox | QPushButton):
        option = QStyleOptionButton()
        widget.initStyleOption(option)
        of_box = QStyle.SubElement.SE_CheckBoxContents
        of_button = QStyle.SubElement.SE_PushButtonContents
        element = of_box if isinstance(widget, QCheckBox) else of_button
        return style.subElementRect(element, option, widget)
    return widget.contentsRect() if isinstance(widget, QAbstractButton | QLabel) else None


def text_of(widget: QWidget) -> str:
    return str(widget.currentText() if isinstance(widget, QComboBox) else widget.text())


def tooltip_of(widget: QWidget) -> str:
    """Return what is shown where the mouse rests on a widget."""
    QToolTip.hideText()
    middle = widget.rect().center()
    at = widget.mapToGlobal(middle)
    QApplication.sendEvent(widget, QHelpEvent(QEvent.Type.ToolTip, middle, at))
    return str(QToolTip.text())


def seen(panel: QWidget) -> Iterator[tuple[QWidget, QRect]]:
    """Yield what has a text and is to be seen, with the room for that."""
    for widget in panel.findChildren(QWidget):
        room = room_of(widget) if widget.isVisible() else None
        if room is not None and len(text_of(widget)) > 2:
            yield widget, room


def faults(panel: UnpackingWidget) -> list[str]:
    """Name what is cut off, beyond the panel's edge, or over something else."""
    (scroll,) = (s for s in panel.findChildren(QScrollArea) if s.widget() is not None)
    inside, found = scroll.widget(), []
    if inside.width() > scroll.viewport().width():
        found.append(f"{inside.width()} wide in {scroll.viewport().width()}")
    places = []
    for widget, room in seen(panel):
        text = text_of(widget)
        place = QRect(widget.mapTo(inside, widget.rect().topLeft()), widget.size())
        places.append((place, text))
        if not inside.rect().contains(place):
            found.append(f"{text!r} ends at {place.right()} of {inside.width()}")
        metrics = widget.fontMetrics()
        if isinstance(widget, QLabel) and widget.wordWrap():
            if widget.height() < widget.heightForWidth(widget.width()):
                found.append(f"{text!r}: {widget.height()} high")
            continue
        needs = metrics.horizontalAdvance(text)
        if room.width() < needs and text not in tooltip_of(widget):
            found.append(f"{text!r}: {room.width()} of {needs}")
    found += [
        f"{a!r} over {b!r}"
        for (one, a), (other, b) in combinations(places, 2)
        if one.intersects(other)
    ]
    return found


@pytest.fixture
def unfolded(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> UnpackingWidget:
    """Return a panel with a bag, in which every step and all that folds away is open."""
    add_bag(viewer)
    controller_with(panel, qtbot)
    # Nothing is unpackable: the offers that are made then are to be seen as well.
    panel.workspace.unpackable.disconnect()
    panel.unpack.show_unpackable(frozenset())
    for section in panel.findChildren(Section):
        section.fold.setChecked(False)
    for more in panel.findChildren(Collapsible):
        more.toggle.setChecked(True)
    rest(panel, qtbot)
    qtbot.waitUntil(panel.unpack.use_best.isVisible, timeout=60000)
    return panel


def test_where_texts_are_longer_by_forty_percent_nothing_is_cut_off(
    unfolded: UnpackingWidget, qtbot: QtBot
) -> None:
    width = unfolded.width()
    assert width <= WIDTH
    qtbot.waitUntil(lambda: faults(unfolded) == [], timeout=10000)
    assert stretch(unfolded) > 120
    qtbot.wait(200)
    assert faults(unfolded) == []
    assert unfolded.width() == width


def test_in_english_nothing_is_shortened(unfolded: UnpackingWidget) -> None:
    narrow = [
        f"{text_of(widget)!r}: {room.width()}"
        for widget, room in seen(unfolded)
        if not (isinstance(widget, QLabel) and widget.wordWrap())
        and room.width() < widget.fontMetrics().horizontalAdvance(text_of(widget))
    ]
    assert narrow == []


class _Widths(QObject):
    """Notes every width that a widget has."""

    def __init__(self, widget: QWidget) -> None:
        super().__init__(widget)
        self.seen = {widget.width()}
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self.seen.add(watched.width())
        return False


def test_the_panel_is_as_wide_through_segmentation_unpacking_and_a_movie(
    viewer: Any,
    panel: UnpackingWidget,
    qtbot: QtBot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # In a narrower one napari's own controls take from the panel as they come.
    panel.window().resize(1300, 800)
    add_bag(viewer)
    qtbot.wait(200)
    widths = _Widths(panel)
    controller_with(panel, qtbot)
    for section in panel.findChildren(Section):
        section.fold.setChecked(False)
    for more in panel.findChildren(Collapsible):
        more.toggle.setChecked(True)
    rest(panel, qtbot)
    press(qtbot, panel.unpack.next)
    press(qtbot, panel.unpack.several)
    rest(panel, qtbot)
    # Where the words beside a title are longer than there is room for.
    name = "a bag of which somebody wrote down where and when it was scanned.gif"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(tmp_path / name), ""))
    panel.files.width_px.setValue(96)
    panel.files.height_px.setValue(64)
    panel.files.fps.setValue(2)
    titled = {action.text(): action for action in panel.files.menu.actions()}
    titled["Movie of the steps so far…"].trigger()
    qtbot.waitUntil(lambda: name in panel.files.status, timeout=60000)
    qtbot.wait(200)
    assert widths.seen == {WIDTH}
    assert faults(panel) == []
