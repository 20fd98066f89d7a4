"""Other languages: all texts of the panel longer by 40 %, and nothing is cut off."""

from typing import Any

from qtpy.QtWidgets import QAbstractButton, QApplication, QLabel, QScrollArea, QWidget

from napari_unpack.widgets.section import Collapsible, Section
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import add_bag, controller_with, rest


def longer(text: str) -> str:
    """Return a text with four tenths more letters, broken as its own words are."""
    more = -(-len(text) * 2 // 5)
    return text + "".join("n" if k % 8 else " " for k in range(1, more + 1)) if text else text


def stretch(panel: QWidget) -> int:
    """Lengthen what buttons and labels say; return how many."""
    count = 0
    for widget in panel.findChildren(QWidget):
        if isinstance(widget, QAbstractButton | QLabel) and len(widget.text()) > 2:
            if widget.text().lstrip().startswith("<"):
                continue
            widget.setText(longer(widget.text()))
            count += 1
    return count


def cut_off(panel: QWidget) -> list[str]:
    """Name what is narrower than its text, or lies beyond the panel's edge."""
    (scroll,) = (s for s in panel.findChildren(QScrollArea) if s.widget() is not None)
    wide, found = scroll.viewport().width(), []
    for widget in panel.findChildren(QWidget):
        if not isinstance(widget, QAbstractButton | QLabel) or not widget.isVisibleTo(panel):
            continue
        if len(widget.text()) < 3:
            continue
        needs = widget.minimumSizeHint().width()
        wraps = isinstance(widget, QLabel) and widget.wordWrap()
        right = widget.mapTo(scroll.widget(), widget.rect().topRight()).x()
        if right > wide or (not wraps and widget.width() < needs):
            found.append(
                f"{widget.text()!r}: {widget.width()} of {needs}, ends at {right} of {wide}"
            )
        if wraps and widget.height() < widget.heightForWidth(widget.width()):
            found.append(f"{widget.text()!r}: too low")
    return found


def test_nothing_is_cut_off_where_texts_are_longer_by_forty_percent(
    viewer: Any, panel: UnpackingWidget, qtbot: Any
) -> None:
    add_bag(viewer)
    controller_with(panel, qtbot)
    rest(panel, qtbot)
    for section in panel.findChildren(Section):
        section.fold.setChecked(False)
    for more in panel.findChildren(Collapsible):
        more.toggle.setChecked(True)
    rest(panel, qtbot)
    qtbot.waitUntil(lambda: cut_off(panel) == [], timeout=10000)
    assert stretch(panel) > 60
    for _ in range(50):
        QApplication.processEvents()
    assert cut_off(panel) == []
