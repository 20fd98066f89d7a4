"""What is opened or begun in the panel comes into sight, whatever the window's height."""

from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QScrollArea, QWidget

from napari_unpack.widgets.files_section import EXPORTS
from napari_unpack.widgets.section import Collapsible
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import press, rest


@pytest.fixture
def low(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> UnpackingWidget:
    """Return the panel with a session, in a window that is lower than it."""
    rest(panel, qtbot)
    scroll = panel.findChild(QScrollArea)
    assert scroll.verticalScrollBar().maximum() > scroll.viewport().height() / 2
    return panel


def in_sight(panel: UnpackingWidget, widget: QWidget) -> bool:
    """Return whether all of a widget is in sight, or as much as there is room for."""
    view = panel.findChild(QScrollArea).viewport()
    top = widget.mapTo(view, widget.rect().topLeft()).y()
    lowest = max(view.height() - widget.height(), GAP)
    return widget.isVisible() and 0 <= top <= lowest


def test_what_is_unfolded_is_scrolled_into_sight(low: UnpackingWidget, qtbot: QtBot) -> None:
    scroll = low.findChild(QScrollArea)
    for folded in (one for one in low.findChildren(Collapsible) if one.isVisible()):
        title = folded.toggle
        # At the lower edge, as one who looked for it has scrolled to it.
        end = title.mapTo(scroll.widget(), title.rect().bottomLeft()).y()
        scroll.verticalScrollBar().setValue(end - scroll.viewport().height() + GAP)
        press(qtbot, title)
        # Until all is laid out.
        qtbot.wait(400)
        qtbot.waitUntil(lambda folded=folded: in_sight(low, folded), timeout=5000)
        press(qtbot, title)


def test_the_buttons_of_a_review_are_in_sight_and_stay_where_they_are(
    low: UnpackingWidget, qtbot: QtBot
) -> None:
    review = low.objects.review
    press(qtbot, review.toggle)
    qtbot.waitUntil(lambda: in_sight(low, review.save), timeout=5000)
    top = review.picture.y()
    review.sentence.setText("<b>1 of 28</b> Object 2<br>Is the orange one a thing, or so?")
    qtbot.wait(100)
    assert review.picture.y() == top


def test_an_export_is_begun_in_sight_of_its_cancel_and_grey_buttons_say_why(
    low: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    files = low.files
    movie = next(kind for kind in EXPORTS if kind.title == "Movie of the unpacking")
    low.findChild(QScrollArea).ensureWidgetVisible(files.export, 0, 0)
    use = files.save.toolTip()
    files.export_to(movie, tmp_path / "unpacking.gif")
    assert not in_sight(low, files.progress)
    qtbot.waitUntil(lambda: in_sight(low, files.progress), timeout=5000)
    for grey in (files.open, files.save, files.label_names, files.export):
        assert not grey.isEnabled()
        assert grey.toolTip() == "Wait for the file that is being read or written, or cancel it."
    files.progress.cancel.click()
    qtbot.waitUntil(lambda: not files.progress.running, timeout=50000)
    assert files.save.isEnabled()
    assert files.save.toolTip() == use


def test_without_a_session_save_says_when_it_works(panel: UnpackingWidget) -> None:
    assert not panel.files.save.isEnabled()
    assert panel.files.save.toolTip() == "Available after step 1."
    assert panel.files.open.toolTip() == "Continue a saved session."


def test_the_longest_sentence_has_the_room_that_a_short_one_has(
    low: UnpackingWidget, qtbot: QtBot
) -> None:
    """So that none is cut off until all below it has moved."""
    unpack = low.unpack
    unpack.sentence.setText("2 of 6 are unpackable now.")
    qtbot.wait(100)
    before = unpack.sentence.height()
    unpack.sentence.setText("Nothing is unpackable.<br>Next: Object 13.<br>To the right: 3.")
    assert unpack.sentence.heightForWidth(unpack.sentence.width()) <= before
