"""The whole story without a mouse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtGui import QContextMenuEvent
from qtpy.QtWidgets import QApplication

from keys import ALT, CONTROL, KEY, SHIFT, Keys
from napari_unpack.layers import compat
from napari_unpack.rendering.slice_image import ALONG_Z
from napari_unpack.widgets.object_columns import Column
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import add_bag, rest, states


def out(session: Any) -> list[int]:
    return [i for i, state in states(session).items() if state == "UNPACKED"]


def pick(keys: Keys, session: Any, object_id: int) -> None:
    """Select the row of an object in the table that has the keyboard."""
    for way in (KEY.Key_Down, KEY.Key_Up):
        for _ in session.ids:
            if session.selected == {object_id}:
                return
            keys.press(way)
    assert session.selected == {object_id}


def to_column(keys: Keys, table: Any, column: Column) -> None:
    """Go to a column of the table's current row."""
    for way in (KEY.Key_Right, KEY.Key_Left):
        for _ in Column:
            if table.currentIndex().column() == column:
                return
            keys.press(way)
    raise AssertionError(f"no key leads to {column!r}")


@pytest.fixture
def story(viewer: Any, qtbot: QtBot) -> Any:
    """Return (keys, panel): opened from the menu, with labels of the viewer, by keys."""
    add_bag(viewer)
    window = compat.native_window(viewer)
    keys = Keys(window, qtbot)
    keys.press(KEY.Key_P, ALT)
    keys.choose("Virtual Unpacking")
    qtbot.waitUntil(lambda: bool(window.findChildren(UnpackingWidget)), timeout=20000)
    (panel,) = window.findChildren(UnpackingWidget)
    qtbot.waitUntil(panel.isVisible, timeout=5000)
    # From the 3D view into the panel: napari's own Tab never leaves the sliders of its slices.
    keys.press(KEY.Key_F6)
    assert keys.focus == "Segment"
    keys.to("Objects", back=True)
    keys.press(KEY.Key_Down)
    assert panel.segment.labels_input.currentText() == "expert"
    keys.to("Unpack these labels")
    keys.press(KEY.Key_Space)
    assert keys.focus == "Cancel"
    qtbot.waitUntil(lambda: panel.workspace.controller is not None, timeout=60000)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=20000)
    panel.workspace.controller.seconds = 0.15
    rest(panel, qtbot)
    yield keys, panel
    panel.unsaved.give_up()
    panel.end()


def test_a_bag_is_unpacked_inspected_noted_and_repaired_by_keys(
    story: Any, viewer: Any, qtbot: QtBot
) -> None:
    keys, panel = story
    session, controller = panel.workspace.session, panel.workspace.controller
    # Nobody has to look for what comes next.
    assert keys.focus == "Unpack next"
    keys.press(KEY.Key_Space, times=2)
    rest(panel, qtbot)
    assert len(out(session)) == 2
    keys.press("b")
    rest(panel, qtbot)
    (one,) = out(session)
    assert keys.focus == "Unpack next"

    # Selected in the table, inspected, turned in the picture, and back.
    keys.to("Objects")
    pick(keys, session, one)
    keys.press("i")
    rest(panel, qtbot)
    assert states(session)[one] == "INSPECTED"
    before = controller.rotation_of(one).copy()
    keys.press(KEY.Key_F6)
    assert QApplication.focusWidget() is compat.native_canvas(viewer).native
    assert panel.ring.isVisible()
    keys.press(KEY.Key_Left, SHIFT)
    rest(panel, qtbot)
    assert not np.allclose(controller.rotation_of(one), before)
    keys.press(KEY.Key_Escape)
    rest(panel, qtbot)
    assert states(session)[one] == "UNPACKED"
    keys.press(KEY.Key_F6)
    assert keys.focus == "Objects"
    assert not panel.ring.isVisible()

    # A flag by Space, a name where it stands, and a note in the table with all its columns.
    table = panel.objects.table
    to_column(keys, table, Column.FLAG)
    keys.press(KEY.Key_Space)
    assert session.state.flags == {one: "suspicious"}
    to_column(keys, table, Column.NAME)
    keys.press(KEY.Key_F2)
    keys.press("Left ")
    # What it is doing meanwhile does not end up in what is being typed.
    panel.objects.model.refresh()
    keys.press("shoe")
    keys.press(KEY.Key_Return)
    assert session.objects["name"][one] == "Left shoe"
    assert keys.focus == "Objects"
    keys.to("Table in a dock")
    keys.press(KEY.Key_Space)
    wide = panel.objects.table_button.dock.pane.table
    assert QApplication.focusWidget() is wide
    pick(keys, session, one)
    if wide.isColumnHidden(Column.NOTE):
        keys.to("Columns…")
        keys.press(KEY.Key_Space)
        keys.choose("Note")
        keys.to("Objects", back=True)
    to_column(keys, wide, Column.NOTE)
    keys.press(KEY.Key_F2)
    keys.press("laces cut")
    keys.press(KEY.Key_Return)
    assert session.state.notes == {one: "laces cut"}
    keys.to("Columns…")
    for first in (600, 4500):
        keys.press(KEY.Key_Space)
        keys.choose("Sort by", "Mean density")
        assert float(wide.rows.index(0, Column.DENSITY).data()) == first
    keys.to("Objects", back=True)

    # What blocks a buried object is told, and let be.
    buried = next(i for i in session.ids if i not in session.unpackable() and i != one)
    pick(keys, session, buried)
    keys.press("r")
    qtbot.waitUntil(panel.unpack.reveal_box.isVisible, timeout=20000)
    keys.press(KEY.Key_Escape)
    qtbot.waitUntil(lambda: not panel.unpack.reveal_box.isVisible(), timeout=5000)

    # Deleted, and back; two made one, and two again.
    keys.press(KEY.Key_Delete)
    qtbot.waitUntil(lambda: buried not in session.ids, timeout=20000)
    keys.press(KEY.Key_Z, CONTROL)
    qtbot.waitUntil(lambda: buried in session.ids, timeout=20000)
    rest(panel, qtbot)
    keys.to("Objects")
    packed = [i for i in session.ids if i != one]
    pick(keys, session, packed[0])
    way = KEY.Key_Up if wide.currentIndex().row() == len(session.ids) - 1 else KEY.Key_Down
    keys.press(way, SHIFT)
    assert len(session.selected) == 2
    menu_from_keys(wide)
    keys.choose("Merge")
    qtbot.waitUntil(lambda: len(session.ids) == 5, timeout=20000)
    keys.press(KEY.Key_Z, CONTROL)
    qtbot.waitUntil(lambda: len(session.ids) == 6, timeout=20000)

    # Split between two voxels of a slice.
    assert wide.hasFocus()
    keys.press(KEY.Key_F6, SHIFT)
    keys.to("Slices")
    keys.press(KEY.Key_Space)
    slices = panel.slices.dock
    assert QApplication.focusWidget() is slices.views[ALONG_Z]
    keys.press(KEY.Key_F6, SHIFT)
    # The crosshair follows.
    pick(keys, session, packed[1])
    keys.press(KEY.Key_F6, SHIFT)
    keys.to("Split")
    keys.press(KEY.Key_Space)
    keys.press(KEY.Key_F6, times=2)
    assert QApplication.focusWidget() is slices.views[ALONG_Z]
    keys.press(KEY.Key_Left, times=4)
    keys.press(KEY.Key_Return)
    keys.press(KEY.Key_Right, times=8)
    keys.press(KEY.Key_Return)
    qtbot.waitUntil(lambda: len(session.ids) == 7, timeout=20000)


def menu_from_keys(widget: Any) -> None:
    """Ask for the menu as the window system does for the key of that name."""
    by_key, middle = QContextMenuEvent.Reason.Keyboard, widget.rect().center()
    QApplication.sendEvent(widget, QContextMenuEvent(by_key, middle, widget.mapToGlobal(middle)))


def test_work_is_saved_and_exported_by_keys(story: Any, qtbot: QtBot, tmp_path: Path) -> None:
    keys, panel = story
    keys.press(KEY.Key_Space)
    rest(panel, qtbot)

    def written(name: str) -> Path:
        path = tmp_path / name
        qtbot.waitUntil(lambda: panel.files.status == f"{name} written", timeout=60000)
        assert path.stat().st_size > 0
        return path

    keys.to("Save session…")
    over = keys.answer(str(tmp_path / "mine.unpack"))
    keys.press(KEY.Key_Space)
    over()
    written("mine.unpack")
    assert keys.focus == "Save session…"

    keys.to("Size of pictures and movies")
    keys.press(KEY.Key_Space)
    for name, value in (("Width", "160"), ("Height", "120"), ("Frames per second", "5")):
        keys.to(name)
        keys.press(KEY.Key_A, CONTROL)
        keys.press(value)
        keys.press(KEY.Key_Tab)
    keys.to("Export…", back=True)
    for entry, file in (("Movie of the unpacking", "film.mp4"), ("Web page", "page.html")):
        over = keys.answer(str(tmp_path / file))
        keys.press(KEY.Key_Space)
        keys.choose(entry)
        over()
        written(file)
        assert keys.focus == "Export…"
    import imageio.v3 as iio

    assert iio.improps(tmp_path / "film.mp4").shape[1:3] == (120, 160)

    # What was saved needs no question of ours; napari asks whether one is sure.
    over = keys.answer(button="Cancel")
    keys.press(KEY.Key_W, CONTROL)
    over()
    assert panel.unsaved.question is None
    assert not panel.workspace.scheduler.closed
