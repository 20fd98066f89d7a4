"""Other languages: every text of the panel longer by 40 %, and nothing is cut off."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QObject, QRect, QSignalBlocker, Qt
from qtpy.QtGui import QHelpEvent
from qtpy.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QCheckBox,
    QComboBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QScrollBar,
    QStyle,
    QStyleOptionButton,
    QStyleOptionComboBox,
    QStyleOptionFrame,
    QStyleOptionSpinBox,
    QToolTip,
    QWidget,
)

from napari_unpack.widgets.object_columns import Column, Units
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.section import Collapsible, Section
from napari_unpack.widgets.slice_view import SliceView
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
                if widget.placeholderText():
                    widget.setPlaceholderText(longer(widget.placeholderText()))
                    count += 1
        elif isinstance(widget, QLineEdit) and widget.placeholderText():
            widget.setPlaceholderText(longer(widget.placeholderText()))
            # Which Qt does where a text changes, but not where a placeholder does.
            widget.updateGeometry()
            count += 1
        elif isinstance(widget, QAbstractSpinBox) and widget.specialValueText():
            widget.setSpecialValueText(longer(widget.specialValueText()))
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


TYPED = 2
"""Pixels that Qt leaves free at both ends of what is typed."""


def room_of(widget: QWidget) -> QRect | None:
    """Return where a control's text stands in it, None where it has no text."""
    style = widget.style()
    if isinstance(widget, QComboBox):
        combo = QStyleOptionComboBox()
        widget.initStyleOption(combo)
        field = QStyle.SubControl.SC_ComboBoxEditField
        return style.subControlRect(QStyle.ComplexControl.CC_ComboBox, combo, field, widget)
    if isinstance(widget, QAbstractSpinBox):
        spin = QStyleOptionSpinBox()
        widget.initStyleOption(spin)
        field = QStyle.SubControl.SC_SpinBoxEditField
        room = style.subControlRect(QStyle.ComplexControl.CC_SpinBox, spin, field, widget)
        return room.adjusted(TYPED, 0, -TYPED, 0)
    if isinstance(widget, QLineEdit):
        frame = QStyleOptionFrame()
        widget.initStyleOption(frame)
        room = style.subElementRect(QStyle.SubElement.SE_LineEditContents, frame, widget)
        return room.adjusted(TYPED, 0, -TYPED, 0)
    if isinstance(widget, QCheckBox | QPushButton):
        option = QStyleOptionButton()
        widget.initStyleOption(option)
        of_box = QStyle.SubElement.SE_CheckBoxContents
        of_button = QStyle.SubElement.SE_PushButtonContents
        element = of_box if isinstance(widget, QCheckBox) else of_button
        return style.subElementRect(element, option, widget)
    return widget.contentsRect() if isinstance(widget, QAbstractButton | QLabel) else None


def text_of(widget: QWidget) -> str:
    """Return what a control says; what is typed into a field is not its own."""
    if isinstance(widget, QComboBox):
        return str(widget.currentText() or widget.placeholderText())
    if isinstance(widget, QLineEdit):
        return "" if widget.text() else str(widget.placeholderText())
    return str(widget.text())


def tooltip_of(widget: QWidget) -> str:
    """Return what is shown where the mouse rests on a widget."""
    QToolTip.hideText()
    middle = widget.rect().center()
    at = widget.mapToGlobal(middle)
    QApplication.sendEvent(widget, QHelpEvent(QEvent.Type.ToolTip, middle, at))
    return str(QToolTip.text())


CONTROLS = (
    QAbstractButton, QAbstractItemView, QAbstractSlider, QAbstractSpinBox, QComboBox, QLabel,
    QLineEdit, SliceView,
)  # fmt: skip


def controls(around: QWidget) -> Iterator[QWidget]:
    """Yield what is to be seen and used, whole: of a number's box neither field nor arrows."""
    for widget in around.findChildren(QWidget):
        if not isinstance(widget, CONTROLS) or isinstance(widget, QScrollBar):
            continue
        outer = widget.parentWidget()
        while outer is not around and not isinstance(outer, CONTROLS):
            outer = outer.parentWidget()
        if outer is around and widget.isVisible():
            yield widget


def seen(around: QWidget) -> Iterator[tuple[QWidget, QRect]]:
    """Yield what has a text and is to be seen, with the room for that."""
    for widget in controls(around):
        room = room_of(widget)
        if room is not None and len(text_of(widget)) > 2:
            yield widget, room


def faults(around: QWidget) -> list[str]:
    """Name what is cut off, beyond the edge of what is around it, or over something else."""
    found, places = [], []
    for widget in controls(around):
        place = QRect(widget.mapTo(around, widget.rect().topLeft()), widget.size())
        places.append((place, name_of(widget)))
        if not around.rect().contains(place):
            found.append(f"{name_of(widget)!r} at {place} of {around.size()}")
    for widget, room in seen(around):
        text = text_of(widget)
        if isinstance(widget, QLabel) and widget.wordWrap():
            if widget.height() < widget.heightForWidth(widget.width()):
                found.append(f"{text!r}: {widget.height()} high")
            continue
        needs = widget.fontMetrics().horizontalAdvance(text)
        if room.width() < needs and text not in tooltip_of(widget):
            found.append(f"{text!r}: {room.width()} of {needs}")
    found += [
        f"{a!r} over {b!r}"
        for (one, a), (other, b) in combinations(places, 2)
        if one.intersects(other)
    ]
    return found + [fault for table in around.findChildren(ObjectTable) for fault in titles(table)]


def name_of(widget: QWidget) -> str:
    has_text = room_of(widget) is not None
    return (text_of(widget) if has_text else "") or str(widget.accessibleName() or widget)


def titles(table: ObjectTable) -> list[str]:
    """Name the columns in sight whose titles are cut off."""
    found, header = [], table.horizontalHeader()
    for column in Column:
        text = str(table.model().headerData(column, Qt.Orientation.Horizontal) or "")
        needs = header.fontMetrics().horizontalAdvance(text)
        if not table.isColumnHidden(column) and table.columnWidth(column) < needs:
            found.append(f"{text!r}: {table.columnWidth(column)} of {needs}")
    return found


def panel_faults(panel: UnpackingWidget) -> list[str]:
    """Name what is wrong in the panel, all of which scrolls, and never sideways."""
    (scroll,) = (s for s in panel.findChildren(QScrollArea) if s.widget() is not None)
    inside, wide = scroll.widget(), scroll.viewport().width()
    found = [] if inside.width() <= wide else [f"{inside.width()} wide in {wide}"]
    return found + faults(inside)


@pytest.fixture
def unfolded(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> UnpackingWidget:
    """Return a panel with a bag, in which every step and all that folds away is open."""
    add_bag(viewer)
    controller_with(panel, qtbot)
    # Nothing is unpackable: the offers that are made then are to be seen as well.
    panel.workspace.unpackable.disconnect()
    panel.unpack.show_unpackable(frozenset())
    unfold(panel)
    rest(panel, qtbot)
    qtbot.waitUntil(panel.unpack.use_best.isVisible, timeout=60000)
    return panel


def test_in_english_nothing_is_shortened_and_in_longer_texts_nothing_is_cut_off(
    unfolded: UnpackingWidget, qtbot: QtBot
) -> None:
    in_english_nothing_is_shortened(unfolded)
    width = unfolded.width()
    assert width <= WIDTH
    qtbot.waitUntil(lambda: panel_faults(unfolded) == [], timeout=10000)
    assert stretch(unfolded) > 120
    qtbot.wait(200)
    qtbot.waitUntil(lambda: panel_faults(unfolded) == [], timeout=10000)
    assert unfolded.width() == width


def in_english_nothing_is_shortened(unfolded: UnpackingWidget) -> None:
    narrow = [
        f"{text_of(widget)!r}: {room.width()}"
        for widget, room in seen(unfolded)
        if not (isinstance(widget, QLabel) and widget.wordWrap())
        and room.width() < widget.fontMetrics().horizontalAdvance(text_of(widget))
    ]
    assert narrow == []


def test_placeholders_are_told_whole_before_there_is_a_volume(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    unfold(panel)
    for text in ("No volume yet", longer("No volume yet")):
        qtbot.waitUntil(lambda text=text: text in {text_of(w) for w, _ in seen(panel)})
        qtbot.wait(200)
        qtbot.waitUntil(lambda: panel_faults(panel) == [], timeout=10000)
        stretch(panel)
    panel.segment.volume_input.setFixedWidth(60)
    assert longer(longer("No volume yet")) in tooltip_of(panel.segment.volume_input)


@pytest.fixture
def stretched_titles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the titles of columns longer, as if the program had been made so."""
    title = Units.title
    monkeypatch.setattr(
        Units,
        "title",
        lambda self, column: (longer(title(self, column)[0]), title(self, column)[1]),
    )


SIZES = ((330, 700), (560, 420), (1100, 260), (700, 700), (250, 900), (420, 300))
"""Pixels: docks at a side and below, one that floats, and as small as they become."""


@pytest.mark.usefixtures("stretched_titles", "piled")
def test_in_docks_nothing_is_cut_off_where_texts_are_longer_by_forty_percent(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    rest(panel, qtbot)
    for opener in (panel.slices, panel.objects.table_button):
        press(qtbot, opener.button)
        dock, frame = opener.dock, opener.dock.parentWidget()
        frame.setFloating(True)
        for text in (str, longer):
            if text is longer:
                assert stretch(dock) >= 5
            for width, height in SIZES:
                # A row of slices may be lower than the square that they were before.
                for _ in range(2):
                    frame.resize(width, height)
                    qtbot.wait(60)
                assert faults(dock) == [], (type(dock).__name__, text, width, height)
        press(qtbot, opener.button)


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
    unfold(panel)
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
    assert panel_faults(panel) == []
