"""Colours, notes and flags given by hand in the table, and the table in a dock of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtGui import QColor
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QDialogButtonBox, QDockWidget, QLineEdit

from mouse import LEFT
from napari_unpack.widgets.object_columns import Column, choice_of
from napari_unpack.widgets.object_model import ID
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import press, rest
from viewer_fixtures import canvas


def cell(table: ObjectTable, object_id: int, column: Column) -> QPoint:
    """Return where a cell is in the table's viewport, scrolled into sight."""
    rows = range(table.rows.rowCount())
    row = next(k for k in rows if table.rows.index(k, Column.NAME).data(ID) == object_id)
    index = table.rows.index(row, column)
    table.scrollTo(index)
    return table.visualRect(index).center()


def click(table: ObjectTable, object_id: int, column: Column) -> None:
    QTest.mouseClick(table.viewport(), LEFT, pos=cell(table, object_id, column))


def type_into(table: ObjectTable, object_id: int, column: Column, text: str) -> None:
    """Double-click a cell, type, and press Enter."""
    at = cell(table, object_id, column)
    QTest.mouseClick(table.viewport(), LEFT, pos=at)
    QTest.mouseDClick(table.viewport(), LEFT, pos=at)
    editor = table.viewport().findChild(QLineEdit)
    QTest.keyClicks(editor, text)
    QTest.keyClick(editor, Qt.Key.Key_Return)


def names(table: ObjectTable) -> list[str]:
    return [str(table.rows.index(k, Column.NAME).data()) for k in range(table.rows.rowCount())]


def show_only(table: ObjectTable, columns: set[Column]) -> None:
    """Choose columns in the menu of the titles."""
    for column in Column:
        if table.isColumnHidden(column) == (column in columns):
            actions = {action.text(): action for action in table.columns_menu().actions()}
            actions[choice_of(column)].trigger()


@pytest.fixture
def shown(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> Any:
    """Return the session of the pile; hues stay, and nothing is outlined."""
    panel.color.at_rest.setChecked(False)
    panel.unpack.outlines.setChecked(False)
    panel.workspace.controller.seconds = 0.1
    panel.objects.table.setFixedHeight(220)
    rest(panel, qtbot)
    return piled


def test_a_click_on_a_swatch_opens_a_chooser_and_the_colour_is_kept_in_every_view(
    viewer: Any, panel: UnpackingWidget, shown: Any, expert: Any, qtbot: QtBot
) -> None:
    table, chooser, session = panel.objects.table, panel.objects.chooser, shown
    slice_before = expert.colormap.map(np.array([5]))
    click(table, 5, Column.SWATCH)
    # Nothing is isolated by it.
    assert set(session.states.values()) == {session.states[5]}
    dialog = chooser.dialog
    assert dialog.isVisible()
    assert "Object 5" in dialog.windowTitle()
    before = canvas(viewer)
    lime = QColor.fromRgbF(0.5, 1.0, 0.0, 1.0)
    dialog.setCurrentColor(lime)
    # Seen while one chooses.
    qtbot.waitUntil(lambda: 5 in session.annotations.colors, timeout=5000)
    rest(panel, qtbot)
    after = canvas(viewer)
    changed = np.abs(after - before).max(axis=-1) > 30
    assert changed.mean() > 0.005
    assert (after[changed][:, 1] > after[changed][:, 2] + 40).mean() > 0.8
    QTest.mouseClick(dialog.findChild(QDialogButtonBox).buttons()[0], LEFT)
    assert chooser.dialog is None
    assert session.annotations.colors[5] == pytest.approx((0.5, 1.0, 0.0, 1.0), abs=0.01)
    np.testing.assert_allclose(
        expert.colormap.map(np.array([5]))[0], (0.5, 1.0, 0.0, 1.0), atol=0.01
    )
    # Its sprite is in the colour too.
    panel.commands.unpack([5])
    rest(panel, qtbot)
    sprite = panel.workspace.controller.sprites.sprites[5].patch.rgba
    seen = np.asarray(sprite, float).reshape(-1, 4)
    seen = seen[seen[:, 3] > 0.5 * seen[:, 3].max()]
    assert np.all(seen[:, 1] > seen[:, 2])
    panel.commands.undo()

    click(table, 5, Column.SWATCH)
    buttons = chooser.dialog.findChild(QDialogButtonBox).buttons()
    automatic = next(one for one in buttons if one.text() == "Automatic")
    QTest.mouseClick(automatic, LEFT)
    assert chooser.dialog is None
    assert session.annotations.colors == {}
    np.testing.assert_allclose(expert.colormap.map(np.array([5])), slice_before)
    panel.commands.undo()
    assert 5 in session.annotations.colors
    panel.commands.undo()
    assert session.annotations.colors == {}


def test_a_cancelled_choice_changes_nothing(
    panel: UnpackingWidget, shown: Any, qtbot: QtBot
) -> None:
    table, chooser, session = panel.objects.table, panel.objects.chooser, shown
    steps = len(session.history.done)
    session.select([2, 3])
    qtbot.waitUntil(lambda: table.selected_ids() == [2, 3], timeout=5000)
    click(table, 2, Column.SWATCH)
    for name in ("red", "blue"):
        chooser.dialog.setCurrentColor(QColor(name))
        qtbot.waitUntil(
            lambda name=name: (
                session.annotations.colors.get(3, ())[:3] == QColor(name).getRgbF()[:3]
            ),
            timeout=5000,
        )
    assert session.annotations.colors.keys() == {2, 3}
    QTest.keyClick(chooser.dialog, Qt.Key.Key_Escape)
    assert session.annotations.colors == {}
    assert len(session.history.done) == steps


@pytest.mark.parametrize("renamed", [False, True])
def test_cancel_after_there_and_back_leaves_what_was_done_before(
    panel: UnpackingWidget, shown: Any, qtbot: QtBot, renamed: bool
) -> None:
    chooser, session = panel.objects.chooser, shown
    session.annotations.set_color([2], QColor("blue").getRgbF())
    session.history.clear()
    if renamed:
        session.rename(3, "a knife")
    before = session.history.done
    chooser.choose([2])
    for name in ("red", "blue"):
        chooser.dialog.setCurrentColor(QColor(name))
        wanted = QColor(name).getRgbF()
        qtbot.waitUntil(lambda rgba=wanted: session.annotations.colors[2] == rgba, timeout=5000)
    QTest.keyClick(chooser.dialog, Qt.Key.Key_Escape)
    assert session.history.done == before
    assert session.annotations.colors[2] == QColor("blue").getRgbF()
    assert (session.objects["name"][3] == "a knife") == renamed


def test_what_is_undone_beside_an_open_chooser_is_no_other_choice(
    panel: UnpackingWidget, shown: Any, qtbot: QtBot
) -> None:
    chooser, session = panel.objects.chooser, shown
    panel.commands.annotate.color([2], (0.0, 0.0, 1.0, 1.0))

    def choose(name: str) -> None:
        chooser.dialog.setCurrentColor(QColor(name))
        qtbot.waitUntil(lambda: 1 in session.annotations.colors, timeout=5000)

    def kept() -> set[int]:
        return set(session.annotations.colors)

    chooser.choose([1])
    choose("lime")
    panel.commands.undo()
    choose("red")
    chooser.dialog.accept()
    assert kept() == {1, 2}
    panel.commands.undo()
    assert kept() == {2}
    for left in ({2}, set()):
        chooser.choose([1])
        choose("lime")
        panel.commands.undo()
        assert kept() == left
        chooser.dialog.reject()
        assert kept() == left
        panel.commands.undo()


def test_notes_and_flags_are_written_searched_and_undone_in_the_table(
    panel: UnpackingWidget, shown: Any, qtbot: QtBot
) -> None:
    session = shown
    press(qtbot, panel.objects.table_button.button)
    dock = panel.objects.table_button.dock
    qtbot.waitUntil(dock.isVisible, timeout=5000)
    table = dock.pane.table
    show_only(table, {Column.FLAG, Column.NAME, Column.NOTE})
    click(table, 3, Column.FLAG)
    assert session.annotations.flags == {3: "suspicious"}
    click(table, 3, Column.FLAG)
    click(table, 4, Column.FLAG)
    assert session.annotations.flags == {3: "cleared", 4: "suspicious"}
    type_into(table, 2, Column.NOTE, "ask the owner")
    qtbot.waitUntil(lambda: session.annotations.notes == {2: "ask the owner"}, timeout=5000)

    QTest.keyClicks(dock.pane.search, "owner")
    assert names(table) == ["Object 2"]
    dock.pane.search.clear()
    QTest.keyClicks(dock.pane.search, "suspi")
    assert names(table) == ["Object 4"]
    # The search of one table is not the other's.
    assert len(names(panel.objects.table)) == 6
    dock.pane.search.clear()
    table.sortByColumn(Column.FLAG, Qt.SortOrder.AscendingOrder)
    assert names(table)[0] == "Object 4"

    # By the menu, of all that are selected.
    session.select([1, 2])
    qtbot.waitUntil(lambda: len(table.selected_ids()) == 2, timeout=5000)
    menu = dock.pane.menu()
    flags = next(action for action in menu.actions() if action.text() == "Flag").menu()
    next(action for action in flags.actions() if action.text() == "Cleared").trigger()
    assert session.annotations.flags == {**dict.fromkeys((1, 2, 3), "cleared"), 4: "suspicious"}
    menu.close()
    for _ in range(5):
        panel.commands.undo()
    assert not session.annotations.flags
    assert not session.annotations.notes


def test_the_docked_table_shares_model_and_selection_and_remembers_its_columns(
    viewer: Any, panel: UnpackingWidget, shown: Any, qtbot: QtBot
) -> None:
    button, session = panel.objects.table_button, shown
    press(qtbot, button.button)
    qtbot.waitUntil(button.dock.isVisible, timeout=5000)
    table = button.dock.pane.table
    click(table, 2, Column.NAME)
    assert session.selected == {2}
    qtbot.waitUntil(lambda: panel.objects.table.selected_ids() == [2], timeout=5000)
    click(panel.objects.table, 4, Column.NAME)
    qtbot.waitUntil(lambda: table.selected_ids() == [4], timeout=5000)

    actions = {action.text(): action for action in table.columns_menu().actions()}
    wanted = {"Order out", "Blocked by", "Note", "Size", "Confidence", "Mean density"}
    assert wanted <= actions.keys()
    assert not actions["Name"].isEnabled()
    for title, column in (("Blocked by", Column.BLOCKERS), ("Size", Column.SIZE)):
        if not actions[title].isChecked():
            actions[title].trigger()
        assert not table.isColumnHidden(column)
        actions = {action.text(): action for action in table.columns_menu().actions()}
    assert actions["Volume"].isChecked()
    actions["Volume"].trigger()
    assert table.isColumnHidden(Column.VOLUME)
    assert not ObjectTable(panel.objects.model, "dock").isColumnHidden(Column.SIZE)
    assert ObjectTable(panel.objects.model, "dock").isColumnHidden(Column.VOLUME)

    def said(object_id: int, column: Column) -> str:
        return str(panel.objects.model.index(object_id - 1, column).data())

    # Closed, it leaves its room to the picture and not to the panel.
    dock = panel.parentWidget()
    assert isinstance(dock, QDockWidget)
    width = dock.width()
    press(qtbot, button.button)
    qtbot.wait(100)
    assert dock.width() == width
    press(qtbot, button.button)
    qtbot.waitUntil(button.dock.isVisible, timeout=5000)

    # Measured along their own axes, in a worker.
    qtbot.waitUntil(lambda: "×" in said(1, Column.SIZE), timeout=20000)
    rest(panel, qtbot)
    session.direction = "-y"
    rest(panel, qtbot)
    qtbot.waitUntil(
        lambda: "Object" in said(5, Column.BLOCKERS) or "Object" in said(1, Column.BLOCKERS),
        timeout=20000,
    )
    panel.commands.unpack(1)
    rest(panel, qtbot)
    left = next(iter(session.poses))
    assert said(left, Column.ORDER) == "1"

    press(qtbot, button.button)
    qtbot.waitUntil(lambda: not button.dock.isVisible(), timeout=5000)
    press(qtbot, button.button)
    qtbot.waitUntil(button.dock.isVisible, timeout=5000)
    # Closed by its own cross, the button opens it again.
    button.dock.parentWidget().close()
    qtbot.waitUntil(lambda: not button.button.isChecked(), timeout=5000)
    press(qtbot, button.button)
    qtbot.waitUntil(button.dock.isVisible, timeout=5000)
