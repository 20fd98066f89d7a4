"""The mouse in the 3D view, with real events on the canvas."""

from __future__ import annotations

from dataclasses import replace
from threading import Event
from time import monotonic

import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt, QTimer
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from mouse import LEFT, drag, move
from napari_unpack.geometry.view import View
from napari_unpack.layers import compat
from napari_unpack.session import ObjectState
from napari_unpack.tasks import Task
from napari_unpack.viewer.controller import SessionController
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.viewer.split_tool import surface_voxel
from opened_panel import at_rest
from viewer_fixtures import canvas

CONTROL = Qt.KeyboardModifier.ControlModifier


def native(viewer):
    return compat.native_canvas(viewer).native


def logical(controller, pivot_point) -> QPoint:
    """Return where a point of pivot space is on the canvas widget (device pixels are one)."""
    row, col = controller.frame.camera.pixels(
        np.asarray(pivot_point, dtype=float), controller.frame.size
    )
    return QPoint(round(col), round(row))


def packed_point(controller, session, object_id) -> QPoint:
    center = session.boxes.center(object_id, session.spacing)
    row, col = controller.frame.camera.project(center, controller.frame.size)
    return QPoint(round(col), round(row))


def test_the_pointer_names_selects_turns_and_inspects(staged, session, qtbot) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    session.rename(3, "Red ball")
    (out,) = controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    widget = native(viewer)
    front = next(i for i in session.unpackable() if i != out)
    at_front = packed_point(controller, session, front)

    move(widget, at_front + QPoint(1, 1))
    move(widget, at_front)
    name = str(session.objects["name"][front])
    qtbot.waitUntil(lambda: controller.packed.words.startswith(name), timeout=20000)

    QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=at_front)
    qtbot.waitUntil(lambda: session.selected == frozenset({front}), timeout=20000)

    at_sprite = logical(controller, session.poses[out].center)
    angles, held = viewer.scene.camera.angles, session.poses[out].rotation.copy()
    drag(widget, at_sprite, QPoint(0, 40), qtbot)
    qtbot.waitUntil(lambda: not np.allclose(session.poses[out].rotation, held), timeout=20000)
    canvas(viewer)
    assert viewer.scene.camera.angles == angles
    assert viewer.scene.camera.mouse_pan

    # Turned, it waits in its slot as before: there it keeps clear of all others.
    assert session.state.placements[out].placed is None

    drag(widget, at_front, QPoint(40, 25), qtbot)
    qtbot.waitUntil(lambda: viewer.scene.camera.angles != angles, timeout=20000)

    zoom = viewer.scene.camera.zoom
    QTest.mouseDClick(widget, Qt.MouseButton.LeftButton, pos=at_sprite)
    qtbot.waitUntil(lambda: session.states[out] is ObjectState.INSPECTED, timeout=20000)
    assert viewer.scene.camera.zoom == zoom
    at_rest(controller, qtbot)
    QTest.mouseDClick(widget, Qt.MouseButton.LeftButton, pos=QPoint(5, 5))
    qtbot.waitUntil(lambda: session.states[out] is ObjectState.UNPACKED, timeout=20000)
    assert viewer.scene.camera.zoom == zoom


def test_a_sprite_is_never_carried_out_of_the_window(staged, session, qtbot) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    (out,) = controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    widget, shift = native(viewer), Qt.KeyboardModifier.ShiftModifier
    at_sprite = logical(controller, session.poses[out].center)
    drag(widget, at_sprite, QPoint(-2000, 60), qtbot, shift)
    qtbot.waitUntil(
        lambda: logical(controller, session.poses[out].center) != at_sprite, timeout=20000
    )
    there = logical(controller, session.poses[out].center)
    assert (there.x(), there.y()) == (pytest.approx(0, abs=1), at_sprite.y() + 60)
    assert controller.settle(30)
    # It can be taken hold of again, and carried back.
    drag(widget, QPoint(6, there.y()), QPoint(200, 0), qtbot, shift)
    qtbot.waitUntil(lambda: logical(controller, session.poses[out].center).x() > 190, timeout=20000)


def test_a_sprite_that_a_script_has_brought_nearer_is_carried_at_its_depth(staged, session) -> None:
    _, controller = staged
    (out,) = controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    pose = session.poses[out]
    session.place(out, replace(pose, center=pose.center + np.array([15.0, 0.0, 0.0])))
    before = session.poses[out].center
    controller.interaction.move(out, np.array([4.0, 0.0]))
    controller.renderer.held.moved(out)
    after = session.poses[out].center
    camera, (rows, _) = controller.frame.camera, controller.frame.size
    # Without perspective a pixel is as large at every depth.
    np.testing.assert_allclose(after - before, [0, 4 * camera.height / rows, 0], atol=1e-9)
    assert after[0] == pytest.approx(15.0)


def test_alt_clicks_at_one_place_step_through_all_objects_there(
    staged, session, qtbot, request
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    # Through the bag from the side: several objects in a row, all of them translucent.
    function = session.transfer_function
    session.transfer_function = type(function)([(d, 0.01 * (a > 0)) for d, a in function.points])
    camera = View((0.1, 0.1, 1.0)).camera(session.labels.shape, session.spacing)
    controller.look_from(camera)
    assert controller.settle(30)
    widget = native(viewer)
    rows = [packed_point(controller, session, i) for i in session.ids]
    there = {(p.x(), p.y()): controller.renderer.picker.packed_at(p.y(), p.x()) for p in rows}
    (x, y), wanted = max(there.items(), key=lambda item: len(item[1]))
    assert len(wanted) >= 3
    # Clicks in a row are to be clicks.
    interval = QApplication.doubleClickInterval()
    request.addfinalizer(lambda: QApplication.setDoubleClickInterval(interval))
    QApplication.setDoubleClickInterval(1)

    def clicked(modifier) -> int:
        session.select([])
        QTest.mouseClick(widget, Qt.MouseButton.LeftButton, modifier, pos=QPoint(x, y))
        qtbot.waitUntil(lambda: bool(session.selected), timeout=20000)
        qtbot.wait(10)
        return next(iter(session.selected))

    alt, plain = Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.NoModifier
    assert clicked(plain) == wanted[0]
    assert [clicked(alt) for _ in wanted] == [*wanted[1:], wanted[0]]
    assert clicked(plain) == wanted[0]


def on_slices(viewer, bag, session, z):
    """Return (viewer, stage, labels) looking at a slice, the user's labels shown, 2 chosen."""
    viewer.window.resize(760, 560)
    labels = viewer.add_labels(bag[1], scale=session.spacing)
    labels.selected_label = 2
    controller = SessionController(viewer, session, [labels])
    controller.recolor_at_rest = False
    controller.open()
    viewer.dims.ndisplay = 2
    labels.visible = True
    viewer.dims.set_point(0, z * 1.5)
    viewer.reset_view()
    return viewer, controller, labels


def test_slices_name_and_select_what_is_under_the_mouse(
    make_napari_viewer_proxy, bag, session, qtbot
) -> None:
    viewer, controller, labels = on_slices(make_napari_viewer_proxy(show=True), bag, session, 10)
    canvas(viewer)
    widget = native(viewer)
    camera, middle = viewer.scene.camera, QPoint(widget.width() // 2, widget.height() // 2)
    # Object 5 is a ball about voxel (10, 36, 36); the camera looks at the slice's middle.
    way, way_1 = (
        (np.array([at, at]) * 1.5 - np.asarray(camera.center)[-2:]) * camera.zoom for at in (36, 12)
    )
    there = middle + QPoint(round(way[1]), round(way[0]))
    move(widget, there + QPoint(2, 2))
    move(widget, there)
    name = str(session.objects["name"][5])
    qtbot.waitUntil(lambda: controller.packed.words.startswith(name), timeout=20000)
    assert viewer.status is not None
    QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=there)
    qtbot.waitUntil(lambda: session.selected == frozenset({5}), timeout=20000)
    assert labels.selected_label == 5
    # Several with Ctrl and Shift, as in the 3D view.
    at_1 = middle + QPoint(round(way_1[1]), round(way_1[0]))
    keys = Qt.KeyboardModifier
    for spot, key, wanted in (
        (at_1, keys.ControlModifier, {1, 5}), (there, keys.ShiftModifier, {1, 5}),
        (there, keys.ControlModifier, {1}), (there, keys.ShiftModifier, {1, 5}),
    ):  # fmt: skip
        QTest.mouseClick(widget, Qt.MouseButton.LeftButton, key, pos=spot)
        assert session.selected == wanted
    QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=QPoint(4, 4))
    qtbot.waitUntil(lambda: session.selected == frozenset(), timeout=20000)
    controller.close()
    assert labels.selected_label == 2


@pytest.fixture
def sliced(make_napari_viewer_proxy, bag, session):
    """Return (viewer, stage, time) looking at slices long after the last scroll; time is [s]."""
    viewer, controller, _ = on_slices(make_napari_viewer_proxy(show=True), bag, session, 30)
    time = [monotonic() + 1.0]
    controller.slice_steps.clock = lambda: time[0]
    yield viewer, controller, time
    controller.close()


def test_slices_go_to_what_is_selected(sliced, session, qtbot) -> None:
    viewer, _, time = sliced
    session.select([5])
    # Object 5 is a ball about voxel (10, 36, 36).
    assert tuple(viewer.dims.current_step) == (10, 36, 36)
    viewer.dims.set_current_step(0, 12)
    time[0] += 0.5
    session.select([5])
    assert viewer.dims.current_step[0] == 12
    session.select([6])
    assert tuple(viewer.dims.current_step) == (28, 14, 17)
    session.select([])
    session.select([2, 3])
    assert tuple(viewer.dims.current_step) == (28, 14, 17)

    # Whoever scrolls is left alone, and in 3D nothing is sliced before it is seen.
    viewer.dims.set_current_step(0, 30)
    session.select([5])
    assert viewer.dims.current_step[0] == 30
    viewer.dims.ndisplay = 3
    session.select([2])
    assert viewer.dims.current_step[0] == 30
    viewer.dims.ndisplay = 2
    assert tuple(viewer.dims.current_step) == (10, 13, 30)

    # Where nothing was selected in 3D they are where they were, or where a script has put them.
    viewer.dims.current_step = (7, 11, 30)
    viewer.dims.ndisplay = 3
    viewer.dims.ndisplay = 2
    assert tuple(viewer.dims.current_step) == (7, 11, 30)
    viewer.dims.ndisplay = 3
    viewer.dims.set_current_step(0, 9)
    viewer.dims.ndisplay = 2
    assert tuple(viewer.dims.current_step) == (9, 11, 30)


def test_a_click_in_a_slice_selects_there_and_leaves_the_slice(sliced, session, qtbot) -> None:
    viewer, controller, _ = sliced
    canvas(viewer)
    widget, camera = native(viewer), viewer.scene.camera
    middle = QPoint(widget.width() // 2, widget.height() // 2)
    # Object 6 is a box about (28, 14, 17); slice 30 cuts it off its middle.
    way = (np.array([14, 17]) * 1.5 - np.asarray(camera.center)[-2:]) * camera.zoom
    there = middle + QPoint(round(way[1]), round(way[0]))
    QTest.mouseClick(widget, Qt.MouseButton.LeftButton, pos=there)
    qtbot.waitUntil(lambda: session.selected == frozenset({6}), timeout=20000)
    assert viewer.dims.current_step[0] == 30
    controller.close()
    session.select([5])
    assert viewer.dims.current_step[0] == 30


def test_dabs_of_a_brush_in_a_slice_leave_its_label_and_what_is_selected(
    make_napari_viewer_proxy, bag, session, qtbot
) -> None:
    viewer, controller, labels = on_slices(make_napari_viewer_proxy(show=True), bag, session, 10)
    canvas(viewer)
    widget, camera = native(viewer), viewer.scene.camera
    middle = QPoint(widget.width() // 2, widget.height() // 2)
    viewer.layers.selection.active = labels
    labels.mode, labels.brush_size = "paint", 1
    # As the panel does, or the session's labels would be painted too.
    session.own_labels([labels.data])
    session.select([1])
    labels.selected_label = 2
    # Both in object 5.
    for row in (34, 38):
        way = (np.array([row, 36]) * 1.5 - np.asarray(camera.center)[-2:]) * camera.zoom
        QTest.mouseClick(widget, LEFT, pos=middle + QPoint(round(way[1]), round(way[0])))
        qtbot.wait(20)
    assert (labels.data[10, 34, 36], labels.data[10, 38, 36]) == (2, 2)
    assert labels.selected_label == 2
    assert session.selected == {1}
    controller.close()


def test_a_rubber_band_selects_what_it_encloses_in_a_slice(sliced, session, qtbot) -> None:
    viewer, _, _ = sliced
    session.select([])
    viewer.dims.set_current_step(0, 10)
    widget, camera = native(viewer), viewer.scene.camera
    middle = QPoint(widget.width() // 2, widget.height() // 2)

    def at(row: float, col: float) -> QPoint:
        way = (np.array([row, col]) * 1.5 - np.asarray(camera.center)[-2:]) * camera.zoom
        return middle + QPoint(round(way[1]), round(way[0]))

    view = tuple(camera.center), camera.zoom
    # Slice 10 has balls and boxes 1 to 5; the band holds 1 and 4, and half of 2.
    start, end = at(1, 1), at(46, 30)
    QTest.mousePress(widget, LEFT, CONTROL, pos=start)
    qtbot.wait(20)
    before = canvas(viewer)
    for share in (0.5, 1.0):
        move(widget, start + (end - start) * share, LEFT, CONTROL)
        qtbot.wait(20)
    assert np.abs(canvas(viewer) - before).max(axis=-1).sum() > 1000
    QTest.mouseRelease(widget, LEFT, CONTROL, pos=end)
    qtbot.waitUntil(lambda: session.selected == {1, 4}, timeout=5000)
    # The slice stays, and nothing was panned.
    assert viewer.dims.current_step[0] == 10
    assert (tuple(camera.center), camera.zoom) == view
    # Another adds; turned round, the slice is read as it is shown.
    drag(widget, at(1, 39), at(46, 59) - at(1, 39), qtbot, CONTROL)
    qtbot.waitUntil(lambda: session.selected == {1, 3, 4}, timeout=5000)
    session.select([])
    viewer.dims.order = (0, 2, 1)
    drag(widget, at(1, 1), at(30, 46) - at(1, 1), qtbot, CONTROL)
    qtbot.waitUntil(lambda: session.selected == {1, 4}, timeout=5000)
    # A brush keeps its own Ctrl+drag.
    session.select([])
    labels = viewer.add_labels(np.zeros_like(session.labels), scale=(1.5,) * 3)
    labels.mode = "paint"
    drag(widget, at(1, 1), at(30, 46) - at(1, 1), qtbot, CONTROL)
    assert session.selected == frozenset()


def test_a_click_made_while_a_rubber_band_is_worked_out_counts(staged, session, qtbot) -> None:
    viewer, controller = staged
    widget, busy = native(viewer), Event()
    controller.scheduler.submit(Task("busy", lambda _: busy.wait(20)), Worker.BACKGROUND, print)
    # It holds the whole window, and so all that is seen.
    everything = QPoint(widget.width() - 5, widget.height() - 5)
    drag(widget, QPoint(2, 2), everything, qtbot, CONTROL)
    controller.interaction.select(3)
    busy.set()
    assert controller.settle(30)
    assert session.selected == {3}


def test_in_napari_s_grid_the_mouse_is_on_what_is_seen_there(staged, session) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    (out,) = controller.unpack(1)
    controller.finish()
    # Its lines lie in a view of their own, beside what they are of.
    controller.transition.visible = False
    viewer.canvas.grid.enabled = True
    assert controller.settle(30)
    picture = canvas(viewer)
    places = [(r, c) for r in range(4, len(picture), 8) for c in range(4, picture.shape[1], 8)]
    bright = {p for p in places if picture[p].max() > 70}
    named = {p: controller.interaction.under(np.array(p, float)) for p in places}
    assert [p for p in bright if not named[p]] == []
    # Around the picture are a few dark pixels of objects, and each sprite has a margin.
    assert sum(bool(named[p]) for p in places if p not in bright) < len(bright) / 4
    assert set(named.values()) >= {0, out}


def test_an_object_that_is_renamed_under_the_mouse_is_named_so_at_its_next_movement(
    staged, session
) -> None:
    viewer, controller = staged
    controller.interaction.point_at(2)
    session.rename(2, "Kettle")
    assert controller.interaction.pointed == 2
    controller.interaction.point_at(2)
    assert viewer.status.startswith("Kettle")


def test_nothing_is_pointed_at_that_has_gone_from_under_the_mouse(staged, session, qtbot) -> None:
    viewer, controller = staged
    interaction, ghost = controller.interaction, controller.overlays.ghost
    interaction.point_at(1)
    controller.unpack([1])
    assert interaction.pointed == 0
    assert viewer.status == "Ready"
    controller.finish()
    # Beside the bag its ghost is shown, until something else is inspected.
    interaction.point_at(1)
    at_rest(controller, qtbot)
    assert ghost.quads_at(controller.frame)
    session.rename(3, "Ball")
    assert interaction.pointed == 1
    controller.inspect(3)
    assert interaction.pointed == 0
    at_rest(controller, qtbot)
    assert not ghost.quads_at(controller.frame)
    # Slices show it where it was.
    controller.leave()
    interaction.point_at(2, in_slice=True)
    controller.unpack([2])
    assert interaction.pointed == 2
    assert controller.packed.words


def test_the_status_bar_names_what_is_under_the_mouse_now(
    staged, session, qtbot, monkeypatch
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False

    def answer_late(*_):
        # As napari's thread does, which its test fixture leaves out: asked as the mouse moves.
        words = controller.packed.get_status()["layer_base"]
        QTimer.singleShot(30, lambda: setattr(viewer, "status", words))

    thread = compat.native_window(viewer).status_thread
    monkeypatch.setattr(thread, "trigger_status_update", answer_late)
    viewer.cursor.events.position.connect(answer_late)
    widget = native(viewer)
    at = {i: packed_point(controller, session, i) for i in session.ids}
    under = {
        i: p for i, p in at.items() if controller.renderer.picker.packed_at(p.y(), p.x())[:1] == [i]
    }
    assert len(under) >= 3
    for object_id, point in under.items():
        move(widget, point)
        qtbot.wait(80)
        assert viewer.status.startswith(str(session.objects["name"][object_id]))
    viewer.cursor.events.position.disconnect(answer_late)


def test_clicks_that_split_a_bag_that_is_cut_open_are_on_what_is_left(staged, session) -> None:
    viewer, controller = staged
    controller.cut_handle.cut_along(session.camera.direction)
    assert controller.settle(60)
    point, normal = session.cutting.plane
    rows, cols = viewer.canvas.size
    clicked = []
    for pixel in np.mgrid[10:rows:24, 10:cols:24].reshape(2, -1).T.astype(float):
        there = controller.interaction.packed_at(pixel)
        if there:
            clicked.append(surface_voxel(controller, pixel, there[0]))
    assert len(clicked) > 20
    # But for half the diagonal of a voxel.
    assert ((np.array(clicked) * session.spacing - point) @ normal).min() > -1.3


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_with_shift_objects_leave_straight_out_of_the_surface_pressed(
    staged, session, backend
) -> None:
    _, controller = staged
    controller.backend = backend
    assert controller.settle(60)
    camera, frame, pencil = session.camera, controller.frame, controller.interaction.pencil
    # Of a ball of 9 voxels: straight out of it is away from its middle.
    middle, found = 1.5 * np.array([10, 12, 12]), 0
    for turn in np.arange(0, 2 * np.pi, np.pi / 6):
        aside = np.cos(turn) * camera.right + np.sin(turn) * camera.up
        out = np.sin(0.7) * aside - np.cos(0.7) * camera.direction
        pixel = camera.project(middle + 1.5 * 9 * out, frame.size)
        if controller.interaction.packed_at(pixel)[:1] == [1]:
            pencil.begin()
            pencil.take(pixel, pixel, True)
            assert np.degrees(np.arccos(session.unpack_direction @ out)) < 8
            found += 1
    assert found > 3


def test_double_clicks_of_other_plugins_are_heard_while_a_session_is_open_and_after(
    make_napari_viewer_proxy, session, qtbot
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    heard: list[str] = []
    callbacks = compat.unwrap(viewer).mouse_double_click_callbacks
    callbacks.insert(0, lambda *_: heard.append("before"))
    before = list(callbacks)
    controller = SessionController(viewer, session)
    controller.open()
    callbacks.append(lambda *_: heard.append("meanwhile"))
    controller.settle(60)
    zoom = viewer.scene.camera.zoom
    QTest.mouseDClick(native(viewer), LEFT, pos=QPoint(4, 4))
    assert heard == ["before", "meanwhile"]
    assert viewer.scene.camera.zoom == zoom
    controller.close()
    assert callbacks[:-1] == before
    QTest.mouseDClick(native(viewer), LEFT, pos=QPoint(4, 4))
    assert heard == ["before", "meanwhile"] * 2
    assert viewer.scene.camera.zoom != zoom
