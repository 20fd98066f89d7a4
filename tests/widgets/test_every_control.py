"""Every control of the panel: its name, its help, its place in the order of Tab, its ring."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtGui import QColor, QPalette
from qtpy.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QScrollArea,
    QScrollBar,
    QTableView,
    QWidget,
)

from keys import KEY, MOST, SHIFT, Keys, called
from napari_unpack.layers import compat
from napari_unpack.widgets.color_ramp_editor import ColorRampEditor
from napari_unpack.widgets.opacity_editor import OpacityEditor
from napari_unpack.widgets.section import Collapsible, Section
from napari_unpack.widgets.slice_view import SliceView
from napari_unpack.widgets.theme import palette_of
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import press, rest

KINDS = (
    QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit, QTableView,
    OpacityEditor, ColorRampEditor,
)  # fmt: skip


def is_part_of_another(widget: QWidget) -> bool:
    """Return whether a widget is a part that Qt made: a field's editor, a bar, a corner."""
    above = widget.parentWidget()
    return (
        isinstance(widget, QScrollBar)
        or isinstance(above, QAbstractSpinBox | QComboBox | QLineEdit | QTableView)
        or widget.objectName().startswith("qt_")
    )


def controls(panel: QWidget) -> Iterator[Any]:
    for widget in panel.findChildren(QWidget):
        if isinstance(widget, KINDS) and not is_part_of_another(widget):
            yield widget


def name_of(widget: Any, panel: QWidget) -> str:
    buddies = [label.text() for label in panel.findChildren(QLabel) if label.buddy() is widget]
    own = widget.text() if isinstance(widget, QAbstractButton) else ""
    return widget.accessibleName() or own or "".join(buddies)


def everything_open(panel: UnpackingWidget) -> None:
    for section in panel.findChildren(Section):
        section.fold.setChecked(False)
    for more in panel.findChildren(Collapsible):
        more.toggle.setChecked(True)


@pytest.mark.usefixtures("piled")
def test_every_control_is_named_explained_and_reached_by_the_keyboard(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    # Looked at alone, in one panel: opening it takes most of the time.
    everything_open(panel)
    QApplication.processEvents()
    tab_goes_through_the_panel_from_top_to_bottom(panel)
    press(qtbot, panel.objects.table_button.button)
    every_control_has_a_name_a_sentence_of_help_and_the_keyboard(panel)
    press(qtbot, panel.slices.button)
    no_two_controls_have_one_name(panel)


def every_control_has_a_name_a_sentence_of_help_and_the_keyboard(panel: UnpackingWidget) -> None:
    lacking = []
    found = [*controls(panel), *controls(panel.objects.table_button.dock)]
    assert len(found) > 60
    for widget in found:
        name = name_of(widget, panel)
        told = f"{type(widget).__name__} {name!r}"
        if not name:
            lacking.append(f"{told}: no name")
        # A table's cells have help of their own.
        if not widget.toolTip() and not isinstance(widget, QTableView):
            lacking.append(f"{told}: no help")
        if not widget.focusPolicy() & Qt.FocusPolicy.TabFocus:
            lacking.append(f"{told}: Tab passes it by")
    assert not lacking, "\n".join(lacking)


def no_two_controls_have_one_name(panel: UnpackingWidget) -> None:
    # Windows of their own or not, one Tab goes through all of them.
    whole = (panel, panel.objects.table_button.dock, panel.slices.dock)
    names: dict[str, list[str]] = {}
    for part in whole:
        for widget in {*controls(part), *part.findChildren(SliceView)}:
            told = f"{type(widget).__name__} in {type(part).__name__}"
            names.setdefault(name_of(widget, panel).rstrip("…"), []).append(told)
    assert sum(map(len, names.values())) > 80
    assert {name: told for name, told in names.items() if len(told) > 1} == {}


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_texts_stand_out_from_what_is_behind_them(theme: str) -> None:
    p = palette_of(theme)
    texts = {
        "text": (p.text, p.background, p.raised, p.chosen),
        "text of less weight": (p.faint, p.background, p.raised),
        "text on the primary button": (p.on_accent, p.accent, p.accent_hover),
        "warning": (p.warning, p.background),
    }
    # As the guidelines for accessible content (WCAG 2.1, AA) ask of text, and of what shows focus.
    for what, (ink, *behind) in texts.items():
        for ground in behind:
            assert contrast(ink, ground) >= 4.5, f"{what}, {ink} on {ground}"
    for ground in (p.background, p.raised):
        assert contrast(p.focus, ground) >= 3.0


def test_what_an_empty_field_says_stands_out(viewer: Any, panel: UnpackingWidget) -> None:
    for theme in ("dark", "light"):
        viewer.theme = theme
        QApplication.processEvents()
        said = [field for field in panel.findChildren(QLineEdit) if field.placeholderText()]
        assert {"Search objects", "automatic"} <= {field.placeholderText() for field in said}
        for field in said:
            ink = field.palette().color(QPalette.ColorRole.PlaceholderText)
            pixels = picture(field).reshape(-1, 3)
            shades, counts = np.unique(pixels, axis=0, return_counts=True)
            # Of the field, most of which is empty; blue comes first.
            ground = QColor(*(int(shade) for shade in shades[counts.argmax()][::-1]))
            assert ink.alpha() == 255
            assert contrast(ink.name(), ground.name()) >= 4.5, (theme, field.placeholderText())


def contrast(ink: str, ground: str) -> float:
    """Return the contrast of two colours as WCAG 2.1 defines it."""
    shares = np.array([QColor(color).getRgbF()[:3] for color in (ink, ground)])
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    lights = linear @ (0.2126, 0.7152, 0.0722) + 0.05
    return float(lights.max() / lights.min())


def tab_goes_through_the_panel_from_top_to_bottom(panel: UnpackingWidget) -> None:
    inside = panel.segment.parentWidget()
    order, widget = [], inside
    while (widget := widget.nextInFocusChain()) is not inside:
        ours = isinstance(widget, KINDS) and inside.isAncestorOf(widget)
        if ours and widget.isVisibleTo(panel) and not is_part_of_another(widget):
            order.append(widget)
    assert set(order) == {w for w in controls(inside) if w.isVisibleTo(panel)}
    tops = [widget.mapTo(inside, widget.rect().center()).y() for widget in order]
    backwards = [
        f"{name_of(above, panel)} before {name_of(below, panel)}"
        for (above, y), (below, z) in zip(
            zip(order, tops, strict=True), list(zip(order, tops, strict=True))[1:], strict=False
        )
        # Controls of one line differ by some pixels.
        if z < y - 16
    ]
    assert backwards == []


def test_the_control_with_the_keyboard_has_a_ring_in_both_themes(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    everything_open(panel)
    panel.window().activateWindow()
    for theme in ("light", "dark"):
        viewer.theme = theme
        QApplication.processEvents()
        unseen, seen, ringed = [], set(), 0
        for widget in controls(panel):
            # One of each kind, and of each role in the style sheet.
            kind = type(widget).__name__, widget.property("role")
            if kind in seen or not widget.isEnabled() or not widget.isVisibleTo(panel):
                continue
            seen.add(kind)
            before = picture(widget)
            # As the window system would, whose focus another test may have.
            widget.setFocus(Qt.FocusReason.TabFocusReason)
            if not widget.hasFocus():
                continue
            if np.abs(picture(widget) - before).max() < 60:
                unseen.append((theme, *kind))
            ringed += 1
            widget.clearFocus()
        assert unseen == []
        assert ringed > 8


def test_what_has_the_keyboard_is_in_sight(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    everything_open(panel)
    rest(panel, qtbot)
    keys, scroll = Keys(compat.native_window(viewer), qtbot), panel.findChild(QScrollArea)
    # The panel is much taller than its window.
    assert scroll.verticalScrollBar().maximum() > 2 * scroll.viewport().height()
    keys.press(KEY.Key_F6)
    unseen, passed = [], set()

    def look(how: str) -> None:
        QApplication.processEvents()
        widget = QApplication.focusWidget()
        if widget is None or not scroll.isAncestorOf(widget):
            return
        passed.add(widget)
        seen, whole = scroll.viewport().rect(), widget.rect()
        top = widget.mapTo(scroll.viewport(), whole.topLeft()).y()
        if top < 0 or top + whole.height() > seen.height():
            unseen.append(f"{how} {called(widget)}: {top} to {top + whole.height()} of {seen}")

    for _ in range(MOST):
        keys.press(KEY.Key_Tab)
        look("Tab")
    for _ in range(MOST):
        keys.press(KEY.Key_Backtab, SHIFT)
        look("Shift+Tab")
    assert len(passed) > 60
    # Back from the 3D view, though the panel was scrolled meanwhile.
    for end in (0, scroll.verticalScrollBar().maximum()):
        keys.press(KEY.Key_F6, SHIFT)
        scroll.verticalScrollBar().setValue(end)
        keys.press(KEY.Key_F6)
        look("F6")
    assert unseen == []


def picture(widget: QWidget) -> Any:
    QApplication.sendPostedEvents()
    image = widget.grab().toImage().convertToFormat(widget.grab().toImage().Format.Format_RGB32)
    pixels = np.frombuffer(image.constBits().asarray(image.sizeInBytes()), np.uint8)
    return pixels.reshape(image.height(), image.width(), 4).astype(int)[..., :3]
