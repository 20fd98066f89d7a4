"""Repair by hand in a real viewer: clicks that split, buttons, brushes, undo."""

import threading
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.layers import Labels
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

import napari_unpack as nu
from bells import BELL, CUBE, SLAB, bells
from mouse import move
from napari_unpack.layers import compat
from napari_unpack.segmentation.repair import LabelEdit
from napari_unpack.tasks import Task, no_progress
from napari_unpack.viewer.label_sync import QUIET_MS
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.files_section import EXPORTS
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import at_rest, controller_with, press, rest, states
from tin import tin
from viewer_fixtures import canvas


@pytest.fixture
def session(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> Any:
    volume, labels = bells()
    layer = viewer.add_labels(labels, name="found", visible=False)
    viewer.add_image(volume, name="bag")
    made = controller_with(panel, qtbot, layer)
    panel.workspace.controller.recolor_at_rest = False
    # The first to cast compiles the kernels.
    assert panel.workspace.controller.settle(200)
    return made


def with_brush(viewer: Any) -> Labels:
    """Return the user's labels, seen and with napari's brush in hand, which paints the cube's."""
    layer = viewer.layers["found"]
    layer.visible, viewer.layers.selection.active = True, layer
    layer.mode, layer.brush_size, layer.selected_label = "paint", 3, CUBE
    return layer


def click(panel: UnpackingWidget, voxel: tuple[int, int, int], qtbot: QtBot) -> None:
    """Click where a voxel is seen in the picture."""
    controller = panel.workspace.controller
    world = np.array(voxel) * controller.session.spacing
    row, col = controller.frame.camera.project(world, controller.frame.size)
    widget = compat.native_canvas(controller.viewer).native
    move(widget, QPoint(round(col) + 1, round(row)))
    QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=QPoint(round(col), round(row)))
    qtbot.wait(60)


def test_two_clicks_split_and_undo_joins(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    objects, first = panel.objects, session.labels.copy()
    layer = viewer.layers["found"]
    press(qtbot, objects.split)
    asked = objects.next_click
    assert asked.text().startswith("Click the object to split, on one of its parts.")
    assert asked.text().endswith("The larger part keeps its number.")
    # The table above fills the panel: what to do next is scrolled into sight.
    qtbot.waitUntil(lambda: asked.visibleRegion().boundingRect() == asked.rect(), timeout=5000)
    click(panel, (12, 20, 16), qtbot)
    assert "Now click the other part of Object 1" in objects.next_click.text()
    click(panel, (12, 20, 44), qtbot)
    qtbot.waitUntil(lambda: len(session.ids) == 4, timeout=10000)
    assert not objects.split.isChecked()
    assert objects.next_click.isHidden()
    left, right = int(session.labels[12, 20, 16]), int(session.labels[12, 20, 44])
    assert {left, right} == {1, 4}
    assert np.count_nonzero(session.labels == 1) >= np.count_nonzero(session.labels == 4)
    assert notification_manager.records[-1].message == "Split off Object 1: Object 1, part."
    qtbot.waitUntil(lambda: objects.model.rowCount() == 4, timeout=20000)
    assert np.array_equal(layer.data, session.labels)
    assert panel.workspace.controller.settle(30)

    panel.commands.undo()
    assert np.array_equal(session.labels, first)
    assert np.array_equal(layer.data, first)
    qtbot.waitUntil(lambda: objects.model.rowCount() == 3, timeout=20000)
    assert panel.workspace.controller.settle(30)


def test_a_split_inside_an_opened_object_is_a_split_there(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume, labels = tin()
    viewer.add_image(volume, name="scan")
    bag = controller_with(panel, qtbot, viewer.add_labels(labels, name="expert", visible=False))
    panel.workspace.open_container(1)
    inside, whole = panel.workspace.session, bag.labels.copy()
    before = set(inside.ids)
    # Two clicks on one thing in there.
    voxels = [tuple(map(int, v)) for v in np.argwhere(inside.labels == 2)[[0, -1]]]

    def clicked(_controller: Any, _told: Any, found: Any) -> None:
        found((2, *voxels))

    monkeypatch.setattr("napari_unpack.viewer.split_tool.SplitTool", clicked)
    press(qtbot, panel.objects.split)
    qtbot.waitUntil(lambda: set(inside.ids) > before, timeout=20000)
    assert np.array_equal(bag.labels, whole)
    assert bag.ids == (1, 2)


def test_undo_calls_off_a_repair_that_is_still_worked_out(
    panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    panel.commands.rename(1, "Bells")
    released, done = threading.Event(), []
    busy = Task("busy", lambda _: released.wait(10))
    panel.workspace.scheduler.submit(busy, Worker.LONG, done.append)
    panel.objects.repair.delete([2])
    widget = compat.native_canvas(panel.workspace.controller.viewer).native
    QTest.keyClick(widget, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    released.set()
    qtbot.waitUntil(lambda: bool(done) and not panel.objects.repair.running, timeout=10000)
    assert 2 in session.ids
    assert session.objects["name"][1] == "Bells"
    QTest.keyClick(widget, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: session.objects["name"][1] != "Bells", timeout=5000)


def test_a_click_on_another_object_starts_over_and_split_again_or_escape_cancels(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    objects = panel.objects
    press(qtbot, objects.split)
    click(panel, (10, 20, 64), qtbot)
    click(panel, (12, 20, 16), qtbot)
    assert "That is another object" in objects.next_click.text()
    press(qtbot, objects.split)
    assert objects.next_click.text() == ""
    click(panel, (12, 20, 44), qtbot)
    assert len(session.ids) == 3
    assert session.selected == {BELL}
    # Escape calls off a split that has begun.
    press(qtbot, objects.split)
    click(panel, (12, 20, 16), qtbot)
    assert objects.split.isChecked()
    QTest.keyClick(compat.native_canvas(viewer).native, Qt.Key.Key_Escape)
    assert not objects.split.isChecked()
    assert not objects.next_click.isVisible()
    click(panel, (12, 20, 44), qtbot)
    assert not objects.repair.running
    assert session.ids == (BELL, CUBE, SLAB)


def test_clicks_in_a_slice_split_too(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    viewer.dims.ndisplay = 2
    viewer.dims.set_point(0, 12)
    canvas(viewer)
    press(qtbot, panel.objects.split)
    widget = compat.native_canvas(panel.workspace.controller.viewer).native
    camera = viewer.scene.camera
    height, width = viewer.canvas.size
    for x in (12, 48):
        at = (np.array([20, x]) - np.asarray(camera.center)[-2:]) * camera.zoom
        spot = QPoint(round(width / 2 + at[1]), round(height / 2 + at[0]))
        move(widget, spot + QPoint(1, 0))
        QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=spot)
    qtbot.waitUntil(lambda: len(session.ids) == 4, timeout=10000)
    assert session.labels[12, 20, 12] != session.labels[12, 20, 48]


@pytest.mark.parametrize("ndisplay", [2, 3])
def test_clicks_that_a_tool_takes_do_not_paint(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot, ndisplay: int
) -> None:
    viewer.dims.ndisplay = ndisplay
    viewer.dims.set_point(0, 12)
    layer = with_brush(viewer)
    before = layer.data.copy()
    canvas(viewer)
    rest(panel, qtbot)
    # That the layer is seen is compared as a stroke would be.
    qtbot.waitUntil(panel.objects.split.isEnabled, timeout=20000)
    press(qtbot, panel.objects.split)
    assert layer.mode == "pan_zoom"
    for x in (16, 44):
        if ndisplay == 2:
            camera, (height, width) = viewer.scene.camera, viewer.canvas.size
            at = (np.array([20, x]) - np.asarray(camera.center)[-2:]) * camera.zoom
            spot = QPoint(round(width / 2 + at[1]), round(height / 2 + at[0]))
            widget = compat.native_canvas(viewer).native
            QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=spot)
        else:
            click(panel, (12, 20, x), qtbot)
    qtbot.waitUntil(lambda: len(session.ids) == 4, timeout=10000)
    assert [step.verb for step in session.history.done] == ["split"]
    split = before == BELL
    assert np.array_equal(layer.data[~split], before[~split])
    # The brush is taken up again.
    assert layer.mode == "paint"


def test_a_brush_taken_up_while_a_tool_waits_paints_and_the_tool_goes_on_waiting(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    press(qtbot, panel.measure.ruler)
    layer = with_brush(viewer)
    at_rest(panel.workspace.controller, qtbot)
    click(panel, (12, 20, 16), qtbot)
    assert (layer.data == CUBE).sum() > 12**3
    assert panel.workspace.controller.interaction.tool is not None
    assert "from" in panel.measure.next_click.text()
    panel.measure.cancel()
    assert layer.mode == "paint"
    press(qtbot, panel.unpack.draw)
    assert layer.mode == "pan_zoom"
    press(qtbot, panel.unpack.draw)
    assert layer.mode == "paint"


def test_dabs_of_a_brush_in_3d_leave_its_label_and_what_is_selected(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    session.select([CUBE])
    layer = with_brush(viewer)
    at_rest(panel.workspace.controller, qtbot)
    for x in (16, 44):
        click(panel, (12, 20, x), qtbot)
        assert layer.selected_label == CUBE
        assert session.selected == {CUBE}
    assert (layer.data == BELL).sum() < (bells()[1] == BELL).sum()
    widget = compat.native_canvas(viewer).native
    QTest.mouseDClick(widget, Qt.MouseButton.LeftButton, pos=widget.rect().center())
    assert "INSPECTED" not in states(session).values()


def test_merge_and_delete_the_selected_and_refuse_what_is_outside(
    panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    objects = panel.objects
    objects.table.show_selection(frozenset({BELL, CUBE}))
    panel.commands.select([BELL, CUBE])
    qtbot.waitUntil(objects.merge.isEnabled, timeout=20000)
    press(qtbot, objects.merge)
    qtbot.waitUntil(lambda: session.ids == (BELL, SLAB), timeout=10000)
    qtbot.waitUntil(lambda: objects.model.rowCount() == 2, timeout=20000)
    assert panel.workspace.controller.settle(30)
    panel.commands.undo()
    assert session.ids == (1, 2, 3)

    session.take_least_occluded = True
    panel.commands.unpack([CUBE])
    panel.workspace.controller.finish()
    before = session.labels
    objects.repair.delete([CUBE])
    qtbot.wait(50)
    assert session.labels is before
    objects.repair.delete([BELL])
    qtbot.waitUntil(lambda: session.ids == (2, 3), timeout=10000)
    assert panel.workspace.controller.settle(30)
    panel.commands.undo()
    assert session.ids == (1, 2, 3)
    assert session.states[CUBE].name == "UNPACKED"


def test_the_delete_key_over_picture_and_table_deletes_what_is_selected(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    places = compat.native_canvas(viewer).native, panel.objects.table
    for place, key in product(places, (Qt.Key.Key_Delete, Qt.Key.Key_Backspace)):
        session.select([])
        click(panel, (10, 20, 64), qtbot)
        assert session.selected == {CUBE}
        qtbot.waitUntil(lambda: panel.workspace.settled, timeout=20000)
        qtbot.keyClick(place, key)
        qtbot.waitUntil(lambda: session.ids == (BELL, SLAB), timeout=10000)
        assert panel.workspace.controller.settle(30)
        panel.commands.undo()
        assert session.ids == (1, 2, 3)
        assert panel.workspace.controller.settle(30)


def _offered(panel: UnpackingWidget, qtbot: QtBot) -> bool:
    """Return whether the button deletes, having seen that the menu says the same."""
    qtbot.waitUntil(lambda: panel.workspace.settled, timeout=20000)
    menu = panel.objects.pane.menu()
    (entry,) = [action for action in menu.actions() if action.text() == "Delete"]
    assert entry.isEnabled() == panel.objects.delete.isEnabled()
    menu.close()
    return panel.objects.delete.isEnabled()


def test_button_menu_and_key_delete_by_one_rule(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    panel.commands.select([CUBE, BELL])
    assert _offered(panel, qtbot)
    # A bag needs an object.
    panel.commands.select([CUBE, BELL, SLAB])
    assert not _offered(panel, qtbot)
    qtbot.keyClick(compat.native_canvas(viewer).native, Qt.Key.Key_Delete)
    assert "One object must stay" in notification_manager.records[-1].message
    session.take_least_occluded = True
    panel.commands.unpack([CUBE])
    panel.workspace.controller.finish()
    panel.commands.select([CUBE])
    assert not _offered(panel, qtbot)
    before = session.labels, len(notification_manager.records)
    qtbot.keyClick(compat.native_canvas(viewer).native, Qt.Key.Key_Delete)
    assert "restore" in notification_manager.records[-1].message.lower()
    assert (session.labels, len(notification_manager.records)) == (before[0], before[1] + 1)


def test_a_brush_on_the_users_layer_reaches_the_session(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    layer, first = viewer.layers["found"], session.labels.copy()
    session.hide([CUBE])
    layer.visible = True
    viewer.dims.ndisplay = 2
    viewer.dims.set_point(0, 30)
    layer.brush_size = 9
    layer.selected_label = 9
    layer.paint((30, 20, 20), 9)
    layer.paint((30, 20, 24), 9)
    assert np.array_equal(session.labels, first)
    qtbot.waitUntil(lambda: 9 in session.ids, timeout=10000)
    assert np.array_equal(session.labels, layer.data)
    assert session.states[CUBE].name == "HIDDEN"
    qtbot.waitUntil(lambda: panel.objects.model.rowCount() == 4, timeout=20000)
    panel.commands.undo()
    assert np.array_equal(session.labels, first)
    assert np.array_equal(layer.data, first)
    assert session.states[CUBE].name == "HIDDEN"
    qtbot.wait(500)
    assert np.array_equal(session.labels, first)


def test_a_stroke_whose_hand_rests_is_one_step_of_undo(
    viewer: Any, session: Any, qtbot: QtBot
) -> None:
    viewer.dims.ndisplay = 2
    viewer.dims.set_point(0, 30)
    layer, first = with_brush(viewer), session.labels.copy()
    widget, steps = compat.native_canvas(viewer).native, len(session.history.done)
    at, way = widget.rect().center() - QPoint(40, 0), QPoint(30, 0)
    left = Qt.MouseButton.LeftButton
    QTest.mousePress(widget, left, pos=at)
    for part in (1, 2):
        move(widget, at + part * way, left)
        qtbot.wait(2 * QUIET_MS)
        assert (layer.data != first).any()
        assert np.array_equal(session.labels, first)
    QTest.mouseRelease(widget, left, pos=at + 2 * way)
    qtbot.waitUntil(lambda: np.array_equal(session.labels, layer.data), timeout=10000)
    assert len(session.history.done) == steps + 1
    session.undo()
    assert np.array_equal(layer.data, first)


def test_ids_beyond_the_type_of_the_users_labels_get_a_wider_one(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    volume, labels = bells()
    layer = viewer.add_labels((85 * labels).astype(np.uint8), name="found", visible=False)
    viewer.add_image(volume, name="bag")
    session = controller_with(panel, qtbot, layer)
    assert session.split(85, (12, 20, 16), (12, 20, 44)) == 256
    assert np.array_equal(layer.data, session.labels)
    viewer.dims.ndisplay = 2
    layer.paint((38, 38, 66), 255)
    qtbot.waitUntil(lambda: session.labels[38, 38, 66] == 255, timeout=10000)
    assert session.ids == (85, 170, 255, 256)
    # With data of another shape it is the session's no more.
    layer.data = np.ones((5, 6, 7), np.uint8)
    session.delete(256)
    session.undo()
    assert (layer.data == 1).all()


def test_strokes_on_objects_outside_are_taken_back_and_all_others_count(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    layer, first = viewer.layers["found"], session.labels.copy()
    session.take_least_occluded = True
    panel.commands.unpack([CUBE])
    panel.workspace.controller.finish()
    viewer.dims.ndisplay = 2
    layer.paint((8, 20, 64), SLAB)
    qtbot.waitUntil(lambda: bool(np.array_equal(layer.data, first)), timeout=10000)
    assert np.array_equal(session.labels, first)
    said = notification_manager.records[-1].message
    assert said.startswith("Objects must be in the bag to be painted on: restore them first.")
    layer.paint((8, 20, 64), SLAB)
    layer.paint((36, 2, 2), CUBE)
    layer.paint((38, 36, 60), SLAB)
    qtbot.waitUntil(lambda: session.labels[38, 36, 60] == SLAB, timeout=10000)
    first[layer.data != first] = SLAB
    assert np.array_equal(layer.data, session.labels)
    assert session.labels[8, 20, 64] == CUBE
    assert session.labels[36, 2, 2] == 0
    assert session.states[CUBE].name == "UNPACKED"


@pytest.mark.parametrize("chosen_in", [2, 3])
def test_back_in_3d_the_undo_key_takes_a_stroke_out_of_labels_and_objects_alike(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot, chosen_in: int
) -> None:
    layer, first = viewer.layers["found"], session.labels.copy()
    packed = panel.workspace.controller.packed
    viewer.dims.ndisplay = chosen_in
    layer.visible = True
    viewer.layers.selection.active = layer
    viewer.dims.ndisplay = 2
    assert layer.visible
    viewer.dims.set_point(0, 30)
    layer.brush_size, layer.selected_label = 9, 9
    layer.paint((30, 20, 20), 9)
    qtbot.waitUntil(lambda: 9 in session.ids, timeout=10000)
    viewer.dims.ndisplay = 3
    assert viewer.layers.selection.active == packed
    at_rest(panel.workspace.controller, qtbot)
    canvas = compat.native_canvas(viewer).native
    QTest.keyClick(canvas, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: 9 not in session.ids, timeout=10000)
    assert np.array_equal(session.labels, first)
    assert np.array_equal(layer.data, first)


def test_undo_while_a_stroke_is_compared_takes_back_the_last_step_and_keeps_the_stroke(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    repair, layer = panel.objects.repair, viewer.layers["found"]
    repair.delete([SLAB])
    qtbot.waitUntil(lambda: session.ids == (BELL, CUBE) and not repair.running, timeout=10000)
    widget, undone = compat.native_canvas(viewer).native, []

    def undo(busy: bool) -> None:
        if busy and not undone:
            undone.append(True)
            QTest.keyClick(widget, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)

    repair.busy.connect(undo)
    layer.paint((36, 2, 2), CUBE)
    qtbot.waitUntil(lambda: session.labels[36, 2, 2] == CUBE and not repair.running, timeout=20000)
    assert undone
    assert session.ids == (BELL, CUBE, SLAB)
    wanted = bells()[1]
    wanted[layer.data != wanted] = CUBE
    assert layer.data[36, 2, 2] == CUBE
    assert np.array_equal(session.labels, wanted)


def test_a_repair_asked_for_while_a_stroke_is_compared_follows_it(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    repair, layer, asked = panel.objects.repair, viewer.layers["found"], []

    def delete(busy: bool) -> None:
        if busy and not asked:
            asked.append(True)
            repair.delete([SLAB])

    repair.busy.connect(delete)
    layer.paint((36, 2, 2), CUBE)
    qtbot.waitUntil(lambda: SLAB not in session.ids and not repair.running, timeout=20000)
    assert session.labels[36, 2, 2] == CUBE
    wanted = np.where(bells()[1] == SLAB, 0, bells()[1])
    assert np.array_equal(layer.data, np.where(layer.data != wanted, CUBE, wanted))
    assert [step.verb for step in session.history.done] == ["paint", "delete"]


def test_what_is_written_right_after_a_stroke_or_a_repair_holds_it(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    repair, painted, merged = panel.objects.repair, tmp_path / "1.unpack", tmp_path / "2.unpack"
    assert not panel.unsaved.changed
    viewer.layers["found"].paint((36, 2, 2), CUBE)
    # It would end with the window as well.
    assert panel.unsaved.changed
    panel.files.save_to(painted)
    qtbot.waitUntil(lambda: painted.exists() and not panel.files.progress.running, timeout=20000)
    assert nu.open_session(painted).labels[36, 2, 2] == CUBE
    assert not panel.unsaved.changed
    repair.merge([CUBE, SLAB])
    assert repair.running
    panel.files.save_to(merged)
    qtbot.waitUntil(lambda: merged.exists() and not panel.files.progress.running, timeout=20000)
    assert nu.open_session(merged).ids == session.ids
    assert len(session.ids) == 2
    repair.delete([BELL])
    table = tmp_path / "table.csv"
    panel.files.export_to(next(kind for kind in EXPORTS if kind.title == "Table"), table)
    qtbot.waitUntil(lambda: table.exists() and not panel.files.progress.running, timeout=20000)
    assert len(table.read_text().splitlines()) == 2


def test_a_repair_asked_for_after_another_was_called_off_is_done(
    panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    repair, released = panel.objects.repair, threading.Event()
    # It looks no more whether it is wanted, so that it is delivered as ever.
    edit = session.label_editor.delete_task([CUBE])
    slow = Task(edit.key, lambda progress: (released.wait(10), edit.run(no_progress))[1])
    panel.workspace.scheduler.submit(slow, Worker.LONG, lambda _: None)
    repair.delete([CUBE])
    assert repair.call_off()
    repair.delete([SLAB])
    released.set()
    qtbot.waitUntil(lambda: SLAB not in session.ids and not repair.running, timeout=20000)
    assert session.ids == (BELL, CUBE)


def test_an_arrow_and_a_tool_call_each_other_off(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    interaction, layer = panel.workspace.controller.interaction, with_brush(viewer)
    rest(panel, qtbot)
    # That the layer is seen is compared as a stroke would be.
    qtbot.waitUntil(panel.objects.split.isEnabled, timeout=20000)
    press(qtbot, panel.objects.split)
    press(qtbot, panel.unpack.draw)
    assert (interaction.tool, interaction.pencil.drawing, layer.mode) == (None, True, "pan_zoom")
    press(qtbot, panel.measure.ruler)
    assert (interaction.pencil.drawing, layer.mode) == (False, "pan_zoom")
    assert interaction.tool is not None
    panel.measure.cancel()
    assert layer.mode == "paint"


def test_undo_of_earlier_repairs_copies_volumes_in_a_worker(
    viewer: Any, panel: UnpackingWidget, session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, commands = panel.workspace, panel.commands
    given = session.labels.copy()
    session.merge([BELL, CUBE])
    session.delete([SLAB])
    threads, apply = [], LabelEdit.apply

    def told(edit: LabelEdit, labels: np.ndarray) -> np.ndarray:
        threads.append(threading.current_thread())
        return apply(edit, labels)

    monkeypatch.setattr(LabelEdit, "apply", told)
    commands.undo()
    assert threads == []
    commands.undo()
    assert len(threads) == 1
    assert threads[0] is not threading.main_thread()
    assert np.array_equal(session.labels, given)
    assert workspace.controller.settle(60)
    commands.redo()
    commands.redo()
    assert session.ids == (BELL,)
    assert len(threads) == 2
    assert threading.main_thread() not in threads
    assert np.array_equal(viewer.layers["found"].data, session.labels)
