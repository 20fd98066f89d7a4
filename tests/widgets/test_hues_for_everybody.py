"""Hues that people tell apart who confuse red and green, from the first bag on."""

from pathlib import Path
from typing import Any

from pytestqt.qtbot import QtBot
from qtpy.QtTest import QTest

from napari_unpack.io import save_session
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import add_bag, controller_with, open_panel, rest


def _choose_safe(panel: UnpackingWidget) -> None:
    QTest.keyClicks(panel.color.mode, "Colour-b")


def test_on_first_use_hues_for_the_colour_blind_are_one_of_the_choices_and_change_the_picture(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    rest(panel, qtbot)
    modes = panel.color.mode
    assert modes.isVisible()
    assert modes.isEnabled()
    assert [modes.itemText(k) for k in range(modes.count())] == [
        "Even",
        "Colour-blind safe",
        "Vivid",
    ]
    assert "red or green" in modes.toolTip()
    before = panel.objects.table.grab().toImage()
    _choose_safe(panel)
    rest(panel, qtbot)
    assert modes.currentText() == "Colour-blind safe"
    assert piled.tint_mode == "safe"
    assert panel.objects.table.grab().toImage() != before


def test_who_chose_them_once_has_them_in_the_next_panel(
    make_napari_viewer_proxy: Any, qtbot: QtBot
) -> None:
    viewer = make_napari_viewer_proxy()
    first = open_panel(viewer, qtbot)
    controller_with(first, qtbot, add_bag(viewer)[1])
    assert first.color.mode.currentText() == "Even"
    _choose_safe(first)
    rest(first, qtbot)
    first.end()
    viewer = make_napari_viewer_proxy()
    second = open_panel(viewer, qtbot)
    assert second.color.mode.currentText() == "Colour-blind safe"
    assert controller_with(second, qtbot, add_bag(viewer)[1]).tint_mode == "safe"


def test_a_saved_session_keeps_its_hues_and_everything_else_in_a_panel_with_others(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    session = piled
    rest(panel, qtbot)
    session.tint_mode, session.show_unlabelled = "safe", True
    save_session(session, tmp_path / "safe.unpack")
    session.tint_mode, session.show_unlabelled = "perceptual", False
    panel.unsaved.settled.emit()
    panel.files.open_from(tmp_path / "safe.unpack")
    qtbot.waitUntil(lambda: panel.workspace.session is not session, timeout=30000)
    rest(panel, qtbot)
    assert panel.workspace.session.tint_mode == "safe"
    assert panel.color.mode.currentText() == "Colour-blind safe"
    assert panel.workspace.session.show_unlabelled
    assert panel.color.unlabelled.isChecked()
    assert not panel.unsaved.changed


def test_what_the_panel_itself_sets_in_an_opened_session_is_no_work(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    save_session(piled, tmp_path / "even.unpack")
    _choose_safe(panel)
    panel.color.unlabelled.setChecked(True)
    panel.unsaved.give_up()
    panel.files.open_from(tmp_path / "even.unpack")
    qtbot.waitUntil(lambda: panel.workspace.session is not piled, timeout=30000)
    rest(panel, qtbot)
    assert panel.workspace.session.tint_mode == "safe"
    assert panel.workspace.session.show_unlabelled
    assert not panel.unsaved.changed
