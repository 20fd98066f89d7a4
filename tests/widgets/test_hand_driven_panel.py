"""The story of the paper's Figures 1, 4 and 5, told by mouse and keys in a real viewer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from mouse import LEFT, drag
from napari_unpack.layers import compat
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import add_bag, at_rest, controller_with, states


class Hand:
    """A person at the mouse and the keys."""

    def __init__(self, viewer: Any, panel: Any, qtbot: QtBot) -> None:
        self.viewer, self.panel, self.qtbot = viewer, panel, qtbot
        self.controller, self.session = panel.workspace.controller, panel.workspace.session
        self.widget = compat.native_canvas(viewer).native

    def rest(self) -> None:
        at_rest(self.controller, self.qtbot)

    def key(self, key: Qt.Key, *modifiers: Qt.KeyboardModifier) -> None:
        held = Qt.KeyboardModifier.NoModifier
        for modifier in modifiers:
            held |= modifier
        QTest.keyClick(self.widget, key, held)

    def drag(self, start: QPoint, way: QPoint) -> None:
        drag(self.widget, start, way, self.qtbot)

    def wheel(self, at: QPoint, clicks: int) -> None:
        where = QPointF(at)
        event = QWheelEvent(
            where,
            QPointF(self.widget.mapToGlobal(at)),
            QPoint(0, 0),
            QPoint(0, 120 * clicks),
            Qt.MouseButton.NoButton,
            Qt.KeyboardModifier.NoModifier,
            Qt.ScrollPhase.NoScrollPhase,
            False,
        )
        QApplication.sendEvent(self.widget, event)

    def at_sprite(self, object_id: int) -> QPoint:
        frame = self.controller.frame
        row, col = frame.camera.pixels(self.session.poses[object_id].center, frame.size)
        return QPoint(round(col), round(row))

    def picture(self) -> NDArray[np.int16]:
        """Have the canvas drawn, which is also when napari's camera hears of the mouse."""
        shot = self.viewer.screenshot(canvas_only=True, flash=False)
        return np.asarray(shot)[..., :3].astype(np.int16)

    def around(self, picture: NDArray[np.int16], at: QPoint) -> NDArray[np.int16]:
        x, y = _xy(at)
        return picture[max(y - 25, 0) : y + 26, max(x - 25, 0) : x + 26]


def _xy(point: QPoint) -> tuple[int, int]:
    return point.x(), point.y()


def test_figures_1_4_and_5(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> None:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    hand = Hand(viewer, panel, qtbot)
    controller, session, camera = hand.controller, hand.session, viewer.scene.camera
    controller.seconds = 0.2
    panel.color.at_rest.setChecked(False)
    panel.unpack.outlines.setChecked(False)
    hand.rest()
    view = {name: getattr(camera, name) for name in ("center", "zoom", "angles", "perspective")}
    start = hand.picture()

    # Figure 1: objects leave and return by keys alone.
    for _ in range(3):
        hand.key(Qt.Key.Key_N)
        hand.rest()
    out = list(session.poses)
    assert len(out) == 3
    hand.key(Qt.Key.Key_B)
    hand.rest()
    assert len(session.poses) == 2
    hand.key(Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    hand.rest()
    assert list(session.poses) == out
    one = out[0]

    # Figure 4: the bag turns under its sprites, which stay; all scale with the wheel.
    before, at = hand.picture(), hand.at_sprite(one)
    middle = QPoint(before.shape[1] // 2, before.shape[0] // 2)
    angles = camera.angles
    hand.drag(middle, QPoint(35, 20))
    # napari's camera hears of the mouse when the canvas is next drawn.
    qtbot.waitUntil(lambda: camera.angles != angles, timeout=20000)
    hand.rest()
    turned = hand.picture()
    assert hand.at_sprite(one) == at
    np.testing.assert_array_equal(hand.around(turned, at), hand.around(before, at))
    box = slice(middle.y() - 60, middle.y() + 60), slice(middle.x() - 60, middle.x() + 60)
    assert (np.abs(turned[box] - before[box]) > 12).any()
    zoom, far = camera.zoom, np.subtract(_xy(at), _xy(middle))
    hand.wheel(middle, -1)
    qtbot.waitUntil(lambda: camera.zoom < zoom, timeout=20000)
    hand.rest()
    factor = camera.zoom / zoom
    nearer = np.subtract(_xy(hand.at_sprite(one)), _xy(middle))
    np.testing.assert_allclose(nearer, factor * far, atol=3)
    corner = session.boxes.corners(out[-1], session.spacing)
    assert session.camera.height == controller.frame.camera.height
    assert np.ptp(session.camera.project(corner, controller.frame.size), axis=0).max() > 0

    # A drag on a sprite turns that object and nothing else.
    held, angles = session.poses[one].rotation.copy(), camera.angles
    hand.drag(hand.at_sprite(one), QPoint(0, 40))
    hand.rest()
    assert not np.allclose(session.poses[one].rotation, held)
    hand.picture()
    assert camera.angles == angles

    # Figure 5: studied alone, turned, left; the sprite is the last picture.
    before, zoom = hand.picture(), camera.zoom
    at = hand.at_sprite(one)
    QTest.mouseDClick(hand.widget, LEFT, pos=at)
    qtbot.waitUntil(lambda: states(session)[one] == "INSPECTED", timeout=20000)
    qtbot.waitUntil(panel.unpack.inspection.isVisible, timeout=20000)
    assert camera.zoom == zoom
    qtbot.waitUntil(
        lambda: "along its own axes" in panel.unpack.inspection.facts.text(), timeout=60000
    )
    held, angles = controller.rotation_of(one).copy(), camera.angles
    hand.drag(middle, QPoint(60, 10))
    assert not np.allclose(controller.rotation_of(one), held)
    hand.picture()
    assert camera.angles == angles
    hand.wheel(middle, 2)
    qtbot.waitUntil(lambda: camera.zoom > zoom, timeout=20000)
    last = controller.rotation_of(one).copy()
    hand.key(Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: states(session)[one] == "UNPACKED", timeout=20000)
    hand.rest()
    assert abs(camera.zoom - zoom) < 1e-9
    np.testing.assert_allclose(session.poses[one].rotation, last)
    assert (np.abs(hand.around(hand.picture(), at) - hand.around(before, at)) > 12).sum() > 50

    # Back to the start along the steps, the view as it was: packed exactly as before.
    assert session.go_to(0) == 0
    hand.rest()
    camera.update(view)
    hand.rest()
    assert set(states(session).values()) == {"PACKED"}
    np.testing.assert_array_equal(hand.picture(), start)
