"""The way through, by the panel's own buttons, in a real viewer that draws."""

from collections.abc import Callable
from time import monotonic
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt

from napari_unpack.layers import compat
from napari_unpack.session.framing import fitted
from napari_unpack.widgets.object_model import ID
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import SMALL, add_bag, controller_with, open_panel, press, rest, states

Viewers = Callable[..., Any]
Box = tuple[int, int, int, int]


def _pictures(viewer: Any, panel: UnpackingWidget) -> dict[str, NDArray[np.int16]]:
    """Take a picture of each of the three layers alone, (H, W, 3)."""
    controller = panel.workspace.controller
    layers = {
        "packed": controller.packed,
        "transition": controller.transition,
        "sprites": controller.sprites,
    }
    taken = {}
    for name, layer in layers.items():
        for other in layers.values():
            other.visible = other is layer
        shot = viewer.screenshot(canvas_only=True, flash=False)
        taken[name] = shot[..., :3].astype(np.int16)
    for layer in layers.values():
        layer.visible = True
    return taken


def _changed(before: NDArray[np.int16], after: NDArray[np.int16]) -> NDArray[np.bool_]:
    return np.abs(after - before).max(axis=-1) > 6


def _outside(mask: NDArray[np.bool_], box: Box, margin: int = 3) -> int:
    """Count the pixels of a mask that lie outside a box (top, bottom, left, right)."""
    top, bottom, left, right = box
    rest = mask.copy()
    rest[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin] = False
    return int(rest.sum())


def _box_on_screen(session: Any, object_id: int, size: tuple[int, int]) -> Box:
    """Project the box of a packed object with the session's camera."""
    spacing = np.asarray(session.spacing)
    pixels = session.camera.project(session.boxes.corners(object_id, spacing), size)
    (top, left), (bottom, right) = pixels.min(axis=0), pixels.max(axis=0)
    return int(top), int(np.ceil(bottom)), int(left), int(np.ceil(right))


def test_segment_unpack_three_restore_one(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    image, expert = add_bag(viewer)
    session = controller_with(panel, qtbot)
    controller = panel.workspace.controller
    controller.seconds = 0.2
    panel.color.at_rest.setChecked(False)
    assert controller.recolor_at_rest is False
    # Outlines of who is free are drawn on the transition layer; here it is to be empty at rest.
    panel.unpack.outlines.setChecked(False)

    # Six balls of six densities; every one is found, and the user's own layers step back.
    assert sorted(states(session).values()) == ["PACKED"] * 6
    assert [layer.visible for layer in (image, expert)] == [False, False]
    assert viewer.layers["bag objects"].data.max() == 6
    names = [layer.name for layer in viewer.layers]
    assert [layer.name for layer in controller.layers] == names[-3:]
    assert all(step.reason == "" for step in (panel.color, panel.unpack, panel.objects))
    assert panel.segment.status == "6 objects"

    # Room for all, so that pictures before and after can be compared.
    controller.look_from(session.overview())
    rest(panel, qtbot)
    start = _pictures(viewer, panel)
    size = start["packed"].shape[:2]
    background = start["transition"][0, 0]
    assert not _changed(np.broadcast_to(background, start["sprites"].shape), start["sprites"]).any()

    for _ in range(3):
        press(qtbot, panel.unpack.next)
        rest(panel, qtbot)
    out = [i for i, state in states(session).items() if state == "UNPACKED"]
    assert len(out) == 3
    assert panel.unpack.status == "3 in, 3 out"

    unpacked = _pictures(viewer, panel)
    gone = _changed(start["packed"], unpacked["packed"])
    boxes = [_box_on_screen(session, i, size) for i in out]
    assert all(gone[t:b, left:r].sum() > 100 for t, b, left, r in boxes)
    others = gone.copy()
    for top, bottom, left, right in boxes:
        others[max(top - 3, 0) : bottom + 3, max(left - 3, 0) : right + 3] = False
    assert others.sum() == 0
    assert not _changed(start["transition"], unpacked["transition"]).any()
    beside = _changed(start["sprites"], unpacked["sprites"])
    packed_area = _changed(np.broadcast_to(background, start["packed"].shape), start["packed"])
    assert beside.sum() > 3 * 300
    assert not (beside & packed_area).any()

    press(qtbot, panel.unpack.back)
    rest(panel, qtbot)
    (returned,) = [i for i in out if states(session)[i] == "PACKED"]
    restored = _pictures(viewer, panel)
    back = _changed(unpacked["packed"], restored["packed"])
    assert back.sum() > 100
    assert _outside(back, _box_on_screen(session, returned, size)) == 0
    left_over = _changed(start["sprites"], restored["sprites"])
    assert 0 < left_over.sum() < beside.sum()
    assert panel.unpack.status == "4 in, 2 out"

    press(qtbot, panel.unpack.all_back)
    rest(panel, qtbot)
    again = _pictures(viewer, panel)
    for name in ("packed", "transition", "sprites"):
        # Windows of the packed picture that are cast anew may round a pixel otherwise.
        assert np.abs(start[name] - again[name]).max() <= (name == "packed"), name

    panel.workspace.close()
    assert [layer.name for layer in viewer.layers] == ["expert", "bag", "bag objects"]
    assert image.visible
    assert not expert.visible


def test_labels_that_are_there_already_are_used_as_they_are(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    image, expert = add_bag(viewer)
    expert.visible = True
    before = expert.data.copy()
    session = controller_with(panel, qtbot, expert)
    assert sorted(states(session)) == [1, 2, 3, 4, 5, 6]
    assert not expert.visible
    assert session.spacing == pytest.approx((2.0, 1.0, 1.0))
    press(qtbot, panel.unpack.several)
    panel.end()
    np.testing.assert_array_equal(expert.data, before)
    assert expert.visible
    assert image.visible
    assert [layer.name for layer in viewer.layers] == ["expert", "bag"]


def test_the_table_and_the_session_select_hide_and_name_together(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    table = panel.objects.table
    piled.select([2, 5])
    qtbot.waitUntil(lambda: table.selected_ids() == [2, 5], timeout=20000)
    table.selectRow(2)
    assert piled.selected == frozenset({3})
    qtbot.waitUntil(panel.objects.isolate.isEnabled, timeout=20000)

    press(qtbot, panel.objects.isolate)
    assert [i for i, s in states(piled).items() if s == "HIDDEN"] == [1, 2, 4, 5, 6]
    qtbot.waitUntil(lambda: panel.objects.status == "6, 5 hidden", timeout=20000)
    table.eye_clicked.emit(1)
    assert states(piled)[1] == "PACKED"
    qtbot.waitUntil(panel.objects.show_all.isEnabled, timeout=20000)
    press(qtbot, panel.objects.show_all)
    assert set(states(piled).values()) == {"PACKED"}
    menu = panel.objects.pane.menu()
    texts = {action.text(): action.isEnabled() for action in menu.actions()}
    assert texts["Unpack"]
    assert texts["Inspect"]
    assert not texts["Restore"]
    menu.close()


def test_keys_act_while_there_is_a_controller_and_are_given_back(
    make_napari_viewer: Viewers, qtbot: QtBot
) -> None:
    from napari.utils.key_bindings import coerce_keybinding

    viewer = make_napari_viewer(show=True)
    viewer.window.resize(*SMALL)
    mine = []
    viewer.bind_key("N", lambda _: mine.append("N"), overwrite=True)
    panel = open_panel(viewer, qtbot)
    _, expert = add_bag(viewer)
    session = controller_with(panel, qtbot, expert)
    controller = panel.workspace.controller
    controller.seconds = 0.2

    def hit(owner: Any, key: str) -> None:
        owner.keymap[coerce_keybinding(key)](owner)

    hit(viewer, "N")
    hit(controller.packed, "N")
    qtbot.waitUntil(lambda: not controller.flying, timeout=20000)
    assert list(states(session).values()).count("UNPACKED") == 2
    hit(controller.sprites, "B")
    qtbot.waitUntil(lambda: not controller.flying, timeout=20000)
    assert list(states(session).values()).count("UNPACKED") == 1
    packed = [i for i, state in states(session).items() if state == "PACKED"]
    session.select(packed[:1])
    hit(viewer, "H")
    assert states(session)[packed[0]] == "HIDDEN"
    hit(viewer, "Control-Z")
    assert states(session)[packed[0]] == "PACKED"
    hit(viewer, "Control-Shift-Z")
    assert states(session)[packed[0]] == "HIDDEN"
    assert mine == []

    panel.end()
    hit(viewer, "N")
    assert mine == ["N"]
    assert coerce_keybinding("B") not in viewer.keymap


def test_objects_found_once_more_take_the_place_of_those_found_before(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    add_bag(viewer)
    controller_with(panel, qtbot)
    controller_with(panel, qtbot)
    own = ["expert", "bag", "bag objects", "bag objects [1]"]
    assert [layer.name for layer in viewer.layers if layer.visible and layer.name in own] == []
    panel.workspace.close()
    assert [viewer.layers[name].visible for name in own] == [False, True, True, True]


def test_the_bag_stays_in_the_window_until_the_user_takes_the_camera(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    rest(panel, qtbot)

    def resize(width: int) -> None:
        before = piled.canvas_size
        viewer.window.resize(width, SMALL[1])
        qtbot.waitUntil(lambda: piled.canvas_size != before, timeout=20000)
        rest(panel, qtbot)

    def fits() -> bool:
        return piled.camera.height == pytest.approx(fitted(piled).height, rel=0.01)

    resize(SMALL[0] - 180)
    assert fits()
    resize(SMALL[0])
    assert fits()
    viewer.scene.camera.zoom *= 1.5
    zoomed = viewer.scene.camera.zoom
    rest(panel, qtbot)
    resize(SMALL[0] - 180)
    assert viewer.scene.camera.zoom == pytest.approx(zoomed)
    assert not fits()


def test_settings_reach_the_controller(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> None:
    controller = panel.workspace.controller
    panel.unpack.speed.setValue(20)
    assert controller.seconds == 2.0
    panel.unpack.direction.setCurrentText("Up (−y)")
    assert tuple(piled.direction) == (0.0, -1.0, 0.0)
    panel.unpack.direction.setCurrentText("Towards you")
    assert piled.direction is None
    panel.color.mode.setCurrentText("Vivid")
    assert piled.tint_mode == "hsv"
    panel.color.preset.setCurrentText("Metal")
    panel.color.preset.activated.emit(panel.color.preset.currentIndex())
    assert piled.transfer_function.points[-1][0] == 12000
    panel.color.curve.toggle.setChecked(True)
    points = panel.color.editor.points
    assert points == list(piled.transfer_function.points)
    panel.color.editor.edited.emit([(0.0, 0.0), (1000.0, 0.5)])
    qtbot.waitUntil(lambda: len(piled.transfer_function.points) == 2, timeout=20000)
    assert panel.color.preset.currentText() == "My own curve"


def test_table_and_slices_select_the_same(
    viewer: Any, panel: UnpackingWidget, piled: Any, expert: Any, qtbot: QtBot
) -> None:
    rest(panel, qtbot)
    viewer.dims.ndisplay = 2
    expert.visible = True
    viewer.reset_view()
    # Slices are the user's for a moment after a scroll; here the last one was long ago.
    panel.workspace.controller.slice_steps.clock = lambda: monotonic() + 60.0
    table = panel.objects.table
    rows = [table.model().index(row, 1) for row in range(table.model().rowCount())]
    table.selectRow(next(row for row, at in enumerate(rows) if at.data(ID) == 3))
    # Ball 3 is about (34, 34, 14), less what ball 5 keeps of its box: nothing at its middle.
    assert piled.selected == frozenset({3})
    assert viewer.dims.current_step[0] == 34

    viewer.screenshot(canvas_only=True, flash=False)
    widget, camera = compat.native_canvas(viewer).native, viewer.scene.camera
    way = (np.array([34, 34]) - np.asarray(camera.center)[-2:]) * camera.zoom
    middle = QPoint(widget.width() // 2, widget.height() // 2)
    qtbot.mouseClick(
        widget, Qt.MouseButton.LeftButton, pos=middle + QPoint(round(way[1]), round(way[0]))
    )
    qtbot.waitUntil(lambda: table.selected_ids() == [4], timeout=20000)
    assert viewer.dims.current_step[0] == 34
