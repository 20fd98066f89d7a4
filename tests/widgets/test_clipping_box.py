"""The bag cut open: a plane pushed and turned by hand, a box by numbers, both beside napari's."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt

import napari_unpack as nu
from mouse import drag
from napari_unpack.geometry.view import View
from napari_unpack.layers import compat
from opened_panel import rest
from viewer_fixtures import canvas

CONTROL = Qt.KeyboardModifier.ControlModifier


def test_a_plane_and_a_box_cut_the_bag_open(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    session, controller, box = piled, panel.workspace.controller, panel.clipping
    controller.recolor_at_rest = False
    session.direction = (-1.0, 0.0, 0.0)
    widget, free = compat.native_canvas(viewer).native, session.unpackable()
    box.toggle.click()
    before = canvas(viewer)
    box.plane.click()
    rest(panel, qtbot)
    # Half of the bag goes, the one that faces the viewer.
    assert np.abs(canvas(viewer) - before).max(axis=-1).sum() > 1e4
    _, normal = session.cutting.plane
    assert normal @ controller.frame.camera.direction == pytest.approx(1.0)
    assert box.depth.value() == 50
    assert len(compat.unwrap(controller.packed).experimental_clipping_planes) == 1

    # Seen aslant, a push goes along the arrow's picture as far as the mouse does.
    controller.look_from(View((0.5, 0.3, 1.0)).camera(session.labels.shape, session.spacing))
    rest(panel, qtbot)
    angles = viewer.scene.camera.angles

    def handle() -> Any:
        return controller.cut_handle.lines(controller.frame)

    start, tip = handle().arrow
    way = 40 * (start - tip) / np.linalg.norm(start - tip)
    point = session.cutting.plane[0]
    there = QPoint(*(round(v) for v in ((start + tip) / 2)[::-1]))
    drag(widget, there, QPoint(*(round(v) for v in way[::-1])), qtbot)
    rest(panel, qtbot)
    pushed = session.cutting.plane
    seen = np.subtract(*controller.frame.camera.project([pushed[0], point], controller.frame.size))
    assert pushed[1] == pytest.approx(normal)
    assert seen == pytest.approx(way, abs=2)
    assert box.depth.value() > 55
    # The rim turns it.
    window = np.array(before.shape[:2])
    spot = next(p for p in handle().rim[::4] if min(p) > 20 and (p < window - 20).all())
    drag(widget, QPoint(round(spot[1]), round(spot[0])), QPoint(30, -24), qtbot)
    rest(panel, qtbot)
    turned = session.cutting.plane[1]
    assert 0.5 < turned @ normal < 0.99
    assert np.linalg.norm(turned) == pytest.approx(1.0)
    assert box.across.currentText() == "Another direction"
    assert viewer.scene.camera.angles == angles

    # One step of undo takes one drag back, then the plane; the panel and the picture follow.
    redo = CONTROL | Qt.KeyboardModifier.ShiftModifier
    cut = canvas(viewer)
    for key, normal_now in ((CONTROL, normal), (redo, turned), (CONTROL, normal)):
        qtbot.keyClick(widget, Qt.Key.Key_Z, key)
        rest(panel, qtbot)
        assert session.cutting.plane[1] == pytest.approx(normal_now)
    assert session.cutting.plane == pytest.approx(pushed)
    assert np.abs(canvas(viewer) - cut).max(axis=-1).sum() > 1e4
    qtbot.keyClick(widget, Qt.Key.Key_Z, CONTROL)
    assert session.cutting.plane[0] == pytest.approx(point)
    qtbot.keyClick(widget, Qt.Key.Key_Z, CONTROL)
    rest(panel, qtbot)
    assert session.cutting.plane is None
    assert not box.plane.isChecked()
    assert len(compat.unwrap(controller.packed).experimental_clipping_planes) == 0
    for _ in range(3):
        qtbot.keyClick(widget, Qt.Key.Key_Z, redo)
    rest(panel, qtbot)
    assert session.cutting.plane[1] == pytest.approx(turned)
    assert box.plane.isChecked()

    # Without the mouse: an axis, a depth, the other side.
    for key in (Qt.Key.Key_Home, Qt.Key.Key_Down, Qt.Key.Key_Down):
        qtbot.keyClick(box.across, key)
    box.across.activated.emit(box.across.currentIndex())
    assert session.cutting.plane[1] == pytest.approx((0, 1, 0))
    qtbot.keyClick(box.depth, Qt.Key.Key_Home)
    qtbot.waitUntil(lambda: controller.cut_handle.share == pytest.approx(0.0), timeout=5000)
    box.flip.click()
    assert session.cutting.plane[1] == pytest.approx((0, -1, 0))
    assert controller.cut_handle.share == pytest.approx(1.0)
    box.handle.click()
    assert handle() is None
    # What is cut away still blocks.
    assert session.unpackable() == free
    box.plane.click()
    assert session.cutting.plane is None

    # A box of numbers, beside a plane of napari's own.
    layer = compat.unwrap(controller.packed)
    theirs = {"position": (2, 2, 2), "normal": (0, 0, 1), "enabled": True}
    layer.experimental_clipping_planes = [theirs]
    assert len(session.clipping) == 1
    box.box.click()
    middle = session.bag.center
    spin_box = box.sides[1][0]
    spin_box.lineEdit().selectAll()
    qtbot.keyClicks(spin_box.lineEdit(), f"{middle[0]:.1f}")
    qtbot.keyClick(spin_box.lineEdit(), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: session.cutting.box[1, 0] == pytest.approx(middle[0], abs=0.1))
    rest(panel, qtbot)
    # Undo takes back the number, then the box, and leaves napari's own plane alone.
    numbers = session.cutting.box
    session.undo()
    assert session.cutting.box[1] == pytest.approx(session.bag.upper)
    session.undo()
    assert session.cutting.box is None
    assert len(session.clipping) == 1
    session.redo()
    session.redo()
    np.testing.assert_array_equal(session.cutting.box, numbers)
    controller.look_from(View((1.0, 0.01, 0.01)).camera(session.labels.shape, session.spacing))
    rest(panel, qtbot)
    behind = [i for i in session.ids if session.boxes.center(i, session.spacing)[0] > middle[0]]
    for object_id in session.ids:
        pixel = controller.frame.camera.project(
            session.boxes.center(object_id, session.spacing), controller.frame.size
        )
        assert not set(controller.interaction.packed_at(pixel)) & set(behind)
    nu.save_session(session, tmp_path / "cut.unpack")
    again = nu.open_session(tmp_path / "cut.unpack")
    assert again.cutting.box == pytest.approx(session.cutting.box)
    again.cutting.box = None
    assert len(again.clipping) == 1
    box.box.click()
    assert len(session.clipping) == 1
    layer.experimental_clipping_planes = []
    assert len(session.clipping) == 0


def test_a_plane_that_napari_takes_away_is_no_cutting_plane_any_more(piled: Any) -> None:
    session = piled
    session.cutting.plane = [(5.0, 5.0, 5.0), (0.0, 0.0, 2.0)]
    assert session.cutting.plane[1] == pytest.approx((0, 0, 1))
    session.clipping = None
    assert session.cutting.plane is None
    for wrong in ([(0, 0, 0), (0, 0, 0)], [(0, 0, np.nan), (0, 0, 1)], [(0, 0, 0)]):
        with pytest.raises(ValueError, match=r"plane|normal"):
            session.cutting.plane = wrong
    with pytest.raises(ValueError, match="lower corner below"):
        session.cutting.box = [(0, 0, 0), (1, 1, 0)]
    assert len(session.clipping) == 0
