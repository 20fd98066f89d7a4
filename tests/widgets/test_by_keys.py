"""The whole story without a mouse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtGui import QContextMenuEvent
from qtpy.QtWidgets import QApplication, QDialog

from keys import ALT, CONTROL, KEY, PLAIN, SHIFT, Keys, called
from napari_unpack.layers import compat
from napari_unpack.rendering.slice_image import ALONG_Z
from napari_unpack.widgets import notifications
from napari_unpack.widgets.object_columns import Column
from napari_unpack.widgets.section import Collapsible
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import Closed, add_bag, rest, states


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


@contextmanager
def watched_focus(heard: Callable[[Any], None]) -> Iterator[None]:
    """Tell whatever is given the keyboard meanwhile."""

    def follow(_before: Any, now: Any) -> None:
        heard(now)

    changes = QApplication.instance().focusChanged
    changes.connect(follow)
    yield
    changes.disconnect(follow)


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
    keys.to("Labels of the objects", back=True)
    keys.press(KEY.Key_Down)
    assert panel.segment.labels_input.currentText() == "expert"
    keys.to("Unpack these labels")
    passed: list[str] = []
    with watched_focus(lambda widget: passed.append(called(widget))):
        keys.press(KEY.Key_Space)
    # While it works; that may be over by now.
    assert "Cancel: Segment" in passed
    qtbot.waitUntil(lambda: panel.workspace.controller is not None, timeout=60000)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=20000)
    panel.workspace.controller.seconds = 0.15
    rest(panel, qtbot)
    yield keys, panel
    panel.unsaved.give_up()
    panel.end()


@pytest.fixture
def closed(story: Any, viewer: Any) -> Any:
    """Count how often the window is closed, and have it stay: napari would end the tests."""
    _, panel = story
    window, closed = compat.native_window(viewer), Closed()
    # Behind the panel, which asks first.
    window.installEventFilter(closed)
    window.installEventFilter(panel)
    yield closed
    window.removeEventFilter(closed)
    compat.call_off_exit(window)


def test_panes_are_gone_through_where_the_panel_floats(
    story: Any, viewer: Any, qtbot: QtBot
) -> None:
    keys, panel = story
    window, dock = panel.window(), panel.parentWidget()
    canvas = compat.native_canvas(viewer).native
    last = QApplication.focusWidget()
    dock.setFloating(True)
    try:
        qtbot.waitUntil(lambda: panel.window() is dock, timeout=5000)
        # What a click on it does, and after each key what a window manager does.
        last.setFocus()
        QApplication.setActiveWindow(dock)
        qtbot.waitUntil(last.hasFocus, timeout=5000)
        for _ in range(2):
            canvas.clearFocus()
            keys.press(KEY.Key_F6)
            assert window.focusWidget() is canvas
            QApplication.setActiveWindow(window)
            qtbot.waitUntil(canvas.hasFocus, timeout=5000)
            last.clearFocus()
            keys.press(KEY.Key_F6, SHIFT)
            assert dock.focusWidget() is last
            QApplication.setActiveWindow(dock)
            qtbot.waitUntil(last.hasFocus, timeout=5000)
    finally:
        dock.setFloating(False)


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
        keys.to("Table of objects", back=True)
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
    keys.to("Table of objects", back=True)

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
    keys.to("Table of objects")
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


def test_a_button_that_is_spent_hands_its_key_to_no_other(story: Any, qtbot: QtBot) -> None:
    keys, panel = story
    session = panel.workspace.session
    # One press for each object, and some more.
    for _ in range(len(session.ids) + 3):
        keys.press(KEY.Key_Space)
        rest(panel, qtbot)
        assert keys.focus == "Unpack next"
    assert out(session) == list(session.ids)
    assert not panel.unpack.next.isEnabled()
    # Tab goes on from there, and it is of use again where it is.
    keys.press(KEY.Key_Tab)
    assert keys.focus == "Restore last"
    keys.to("Restore all")
    keys.press(KEY.Key_Space)
    rest(panel, qtbot)
    keys.press(KEY.Key_Space)
    assert out(session) == []
    assert keys.focus == "Restore all"
    keys.press("n")
    rest(panel, qtbot)
    keys.press(KEY.Key_Space)
    rest(panel, qtbot)
    assert out(session) == []

    # So it is where the button is no more to be seen, with all around it.
    buried = next(i for i in session.ids if i not in session.unpackable())
    session.select([buried])
    keys.press("r")
    qtbot.waitUntil(panel.unpack.reveal_box.isVisible, timeout=20000)
    keys.to("Not now")
    keys.press(KEY.Key_Space)
    assert not panel.unpack.reveal_box.isVisible()
    more = panel.unpack.findChild(Collapsible)
    keys.press(KEY.Key_Space, times=2)
    assert not more.toggle.isChecked()
    keys.press(KEY.Key_Tab)
    assert keys.focus == more.toggle.text()

    keys.press("h")
    keys.to("Show all")
    keys.press(KEY.Key_Space)
    qtbot.waitUntil(lambda: not panel.objects.show_all.isEnabled(), timeout=5000)
    keys.press(KEY.Key_Space)
    assert not panel.objects.split.isChecked()
    assert panel.workspace.controller.interaction.tool is None


def test_a_direction_is_drawn_by_keys(story: Any, viewer: Any, qtbot: QtBot) -> None:
    keys, panel = story
    session, controller = panel.workspace.session, panel.workspace.controller
    camera, angles = session.camera, viewer.scene.camera.angles
    canvas, arrow = compat.native_canvas(viewer).native, controller.overlays.arrow
    step = viewer.dims.current_step

    def draw() -> None:
        keys.to("Draw…")
        keys.press(KEY.Key_Space)
        # The keys go to the picture at once, and the panel says which.
        assert QApplication.focusWidget() is canvas
        assert panel.ring.isVisible()
        assert "arrow keys" in panel.unpack.sentence.text()

    draw()
    assert len(arrow.quads_at(controller.frame)) == 0
    keys.press(KEY.Key_Return)
    assert panel.unpack.draw.isChecked(), "there is no arrow to take"
    keys.press(KEY.Key_Right)
    assert len(arrow.quads_at(controller.frame)) == 6
    keys.press(KEY.Key_Up, times=2)
    keys.press(KEY.Key_Down)
    keys.press(KEY.Key_Return)
    # 30 degrees up and 15 back.
    up = -np.cross(camera.right, camera.direction)
    up *= np.sign(up @ camera.up)
    wanted = np.cos(np.pi / 12) * camera.right + np.sin(np.pi / 12) * up
    np.testing.assert_allclose(session.unpack_direction, wanted, atol=1e-6)
    assert keys.focus == "Draw…"
    assert not panel.unpack.draw.isChecked()
    assert "arrow keys" not in panel.unpack.sentence.text()
    keys.press(KEY.Key_Z, CONTROL)
    assert session.direction is None

    # Left alone by Escape; the keys are napari's own again.
    draw()
    keys.press(KEY.Key_Left)
    keys.press(KEY.Key_Escape)
    assert session.direction is None
    assert len(arrow.quads_at(controller.frame)) == 0
    assert keys.focus == "Draw…"
    keys.press(KEY.Key_F6, SHIFT)
    assert QApplication.focusWidget() is canvas
    viewer.dims.ndisplay = 2
    keys.press(KEY.Key_Right)
    assert viewer.dims.current_step != step
    viewer.dims.ndisplay = 3
    rest(panel, qtbot)
    keys.press(KEY.Key_F6)

    # Out of the surface before the bag's middle, which faces the viewer.
    draw()
    keys.press(KEY.Key_Return, SHIFT)
    assert session.unpack_direction @ -session.camera.direction > 0.2
    assert viewer.scene.camera.angles == angles


def test_the_view_is_zoomed_and_moved_by_keys(story: Any, qtbot: QtBot) -> None:
    keys, panel = story
    keys.press(KEY.Key_F6, SHIFT)
    # Each ends with all in view, as it began.
    the_view_is_zoomed_by_keys(keys, panel, qtbot)
    the_view_is_moved_by_keys(keys, panel, qtbot)


def the_view_is_zoomed_by_keys(keys: Keys, panel: UnpackingWidget, qtbot: QtBot) -> None:
    session, framing = panel.workspace.session, panel.workspace.controller.framing
    height = session.camera.height
    plus, equal = KEY.Key_Plus, KEY.Key_Equal
    for k, (key, held) in enumerate([(plus, PLAIN), (plus, SHIFT), (equal, PLAIN)]):
        keys.press(key, held)
        rest(panel, qtbot)
        assert session.camera.height == pytest.approx(height / 1.25 ** (k + 1))
    keys.press(KEY.Key_Minus)
    rest(panel, qtbot)
    assert session.camera.height == pytest.approx(height / 1.25**2)
    # Like one of the wheel it is a person's zoom, until all is to be seen again.
    assert not framing.is_fit
    keys.press("f")
    rest(panel, qtbot)
    assert session.camera.height == pytest.approx(height)


def the_view_is_moved_by_keys(keys: Keys, panel: UnpackingWidget, qtbot: QtBot) -> None:
    session, framing = panel.workspace.session, panel.workspace.controller.framing
    before = session.camera
    for key, down, right in (
        (KEY.Key_Left, 0.0, -0.1),
        (KEY.Key_Down, 0.1, -0.1),
        (KEY.Key_Right, 0.1, 0.0),
        (KEY.Key_Up, 0.0, 0.0),
    ):
        keys.press(key, CONTROL)
        rest(panel, qtbot)
        # Where what was in the middle is in the image now: as far the other way.
        place = session.camera.rotation @ (before.center - session.camera.center)
        np.testing.assert_allclose(
            place, before.height * np.array([0.0, -down, -right]), atol=1e-6 * before.height
        )
        np.testing.assert_allclose(session.camera.rotation, before.rotation, atol=1e-9)
        assert session.camera.height == pytest.approx(before.height)
        # A person's view, until it is the one that fits again.
        assert framing.is_fit == (down == right == 0)
    keys.press(KEY.Key_Right, CONTROL)
    keys.press("f")
    rest(panel, qtbot)
    np.testing.assert_allclose(session.camera.center, before.center, atol=1e-6 * before.height)


def test_an_object_beside_the_bag_is_moved_by_keys(story: Any, viewer: Any, qtbot: QtBot) -> None:
    keys, panel = story
    session, controller = panel.workspace.session, panel.workspace.controller
    keys.press(KEY.Key_Space, times=2)
    rest(panel, qtbot)
    first, last = out(session)
    before = {i: session.poses[i].center.copy() for i in (first, last)}
    mm = session.camera.height / controller.frame.size[0] * compat.pixel_scale(viewer)

    # The last one unpacked, and then the selected one; one step of undo for as many presses.
    keys.press(KEY.Key_F6, SHIFT)
    keys.press(KEY.Key_Left, CONTROL | SHIFT)
    # A press is 24 pixels; later the view may glide to what is where now.
    way = session.poses[last].center - before[last]
    np.testing.assert_allclose(way, [0.0, 0.0, -24 * mm], atol=1e-6)
    keys.press(KEY.Key_Left, CONTROL | SHIFT)
    keys.press(KEY.Key_Down, CONTROL | SHIFT)
    down, right = (session.poses[last].center - before[last])[1:]
    assert 12 * mm < down < 36 * mm
    assert -60 * mm < right < -36 * mm
    np.testing.assert_allclose(session.poses[first].center, before[first], atol=mm)
    rest(panel, qtbot)
    keys.press(KEY.Key_Z, CONTROL)
    rest(panel, qtbot)
    np.testing.assert_allclose(session.poses[last].center, before[last], atol=1e-9)
    keys.press(KEY.Key_F6)
    keys.to("Objects")
    pick(keys, session, first)
    keys.press(KEY.Key_F6, SHIFT)
    keys.press(KEY.Key_Up, CONTROL | SHIFT)
    assert session.poses[first].center[1] < before[first][1]
    np.testing.assert_allclose(session.poses[last].center, before[last], atol=1e-9)

    # What lies in the bag stays there.
    packed = next(i for i in session.ids if i not in (first, last))
    poses = {i: session.poses[i].center.copy() for i in (first, last)}
    session.select([packed])
    keys.press(KEY.Key_Up, CONTROL | SHIFT)
    for i, center in poses.items():
        np.testing.assert_array_equal(session.poses[i].center, center)


def test_exit_is_asked_about_and_answered_by_keys(
    story: Any, viewer: Any, qtbot: QtBot, closed: Any
) -> None:
    keys, panel = story
    keys.press(KEY.Key_Space)
    rest(panel, qtbot)

    def ours(button: str) -> None:
        qtbot.waitUntil(lambda: panel.unsaved.question is not None, timeout=10000)
        box = panel.unsaved.question
        assert "Quitting napari ends it." in box.informativeText()
        keys.answer(button=button)()
        assert panel.unsaved.question is None

    # napari asks whether one is sure, and then we about the work: a person may turn back.
    over = keys.answer(button="Close")
    keys.press(KEY.Key_Q, CONTROL)
    over()
    ours("Cancel")
    assert closed.count == 0
    assert panel.workspace.controller.is_open
    keys.press("n")
    rest(panel, qtbot)
    assert len(out(panel.workspace.session)) == 2

    keys.press(KEY.Key_F, ALT)
    over = keys.answer(button="Close")
    keys.choose("Exit")
    over()
    ours("Discard")
    assert closed.count == 1


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


def test_a_notification_that_ends_leaves_the_keyboard_where_it_is(
    story: Any, viewer: Any, qtbot: QtBot
) -> None:
    _, panel = story
    canvas = compat.native_canvas(viewer).native
    field = panel.unpack.next
    field.setFocus()

    def shown() -> list[QDialog]:
        return [one for one in canvas.findChildren(QDialog) if one.isVisible()]

    notifications.inform("Split off Object 2.")
    assert shown()
    for one in shown():
        one.close()
        assert QApplication.focusWidget() is field
    # Whoever closes it by the button of its own goes on in the 3D view.
    notifications.inform("Split off Object 3.")
    (one,) = shown()
    one.close_button.setFocus()
    one.close()
    assert QApplication.focusWidget() is canvas
    # Nobody else is kept from giving it the keyboard, while one is shown or not.
    for _ in range(2):
        field.setFocus()
        canvas.setFocus()
        assert QApplication.focusWidget() is canvas
        notifications.inform("Split off Object 4.")
        assert shown()


@pytest.mark.parametrize("control", ["Cut", "Opacity curve of this object", "Reset"])
def test_a_control_that_goes_with_the_inspection_hands_its_key_to_no_other(
    story: Any, qtbot: QtBot, control: str
) -> None:
    keys, panel = story
    session = panel.workspace.session
    session.select([session.ids[0]])
    keys.press("i")
    rest(panel, qtbot)
    assert panel.unpack.inspection.isVisible()
    box = panel.unpack.inspection
    field = {"Cut": box.cut, "Reset": box.reset}.get(control, box.editor)
    field.setFocus()
    keys.press(KEY.Key_Escape)
    rest(panel, qtbot)
    assert not box.isVisible()
    more = panel.unpack.findChild(Collapsible)
    keys.press(KEY.Key_Space, times=2)
    assert not more.toggle.isChecked()
    keys.press(KEY.Key_Tab)
    assert keys.focus == more.toggle.text()


def test_escape_empties_the_search_and_then_selects_nothing(story: Any, qtbot: QtBot) -> None:
    keys, panel = story
    session, pane = panel.workspace.session, panel.objects.pane
    session.select([2])
    pane.search.setFocus()
    keys.press("2")
    assert pane.table.rows.rowCount() == 1
    keys.press(KEY.Key_Escape)
    assert not pane.search.text()
    assert QApplication.focusWidget() is pane.search
    assert session.selected == {2}
    keys.press(KEY.Key_Escape)
    assert not session.selected


def test_a_note_is_written_from_the_menu(story: Any, qtbot: QtBot) -> None:
    keys, panel = story
    session, pane = panel.workspace.session, panel.objects.pane
    pane.table.setFocus()
    session.select([2, 3])
    qtbot.waitUntil(lambda: pane.table.selected_ids() == [2, 3], timeout=5000)
    (entry,) = (action for action in pane.menu().actions() if action.text() == "Note…")
    assert not entry.isEnabled()
    pick(keys, session, 2)
    assert pane.table.isColumnHidden(Column.NOTE)
    pane.menu().popup(pane.table.mapToGlobal(pane.table.rect().center()))
    keys.choose("Note")
    assert not pane.table.isColumnHidden(Column.NOTE)
    keys.press("ask the owner")
    keys.press(KEY.Key_Return)
    assert session.annotations.notes == {2: "ask the owner"}
    assert session.selected == {2}
