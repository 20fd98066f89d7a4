"""Several objects selected in the picture: clicks with Ctrl and Shift, and a rubber band."""

from typing import Any

import numpy as np
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from mouse import LEFT, PLAIN, drag, move
from napari_unpack.layers import compat
from napari_unpack.session import ObjectState
from opened_panel import rest
from viewer_fixtures import canvas

CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
ALT = Qt.KeyboardModifier.AltModifier


def spots(controller: Any, session: Any) -> dict[int, QPoint]:
    """Return where every packed object is seen, and the middle of every sprite."""
    frame, found = controller.frame, {}
    for object_id, state in session.states.items():
        if state is ObjectState.PACKED:
            center = session.boxes.center(object_id, session.spacing)
            row, col = frame.camera.project(center, frame.size)
        else:
            row, col = frame.camera.pixels(session.poses[object_id].center, frame.size)
        found[object_id] = QPoint(round(col), round(row))
    return found


def test_clicks_and_a_rubber_band_select_several(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot, request: Any
) -> None:
    session, controller = piled, panel.workspace.controller
    controller.recolor_at_rest, controller.seconds = False, 0.05
    (out,) = controller.unpack(1)
    rest(panel, qtbot)
    widget, at = compat.native_canvas(viewer).native, spots(controller, session)
    # Clicks in a row are to be clicks.
    interval = QApplication.doubleClickInterval()
    request.addfinalizer(lambda: QApplication.setDoubleClickInterval(interval))
    QApplication.setDoubleClickInterval(1)
    seen = {i: controller.interaction.packed_at(np.array([p.y(), p.x()])) for i, p in at.items()}
    a, b, *_ = (i for i, there in seen.items() if i != out and there[:1] == [i])

    def click(spot: QPoint, held: Any, wanted: set[int]) -> None:
        QTest.mouseClick(widget, LEFT, held, pos=spot)
        qtbot.waitUntil(lambda: session.selected == wanted, timeout=5000)
        qtbot.wait(10)

    click(at[a], PLAIN, {a})
    click(at[b], CONTROL, {a, b})
    click(at[out], SHIFT, {a, b, out})
    # What is selected already stays so with Shift, and goes with Ctrl.
    click(at[b], SHIFT, {a, b, out})
    click(at[a], CONTROL, {b, out})
    # A miss with a key held keeps what was chosen with care.
    click(QPoint(3, 3), CONTROL, {b, out})
    table = panel.objects.table
    qtbot.waitUntil(lambda: set(table.selected_ids()) == {b, out}, timeout=5000)
    click(QPoint(3, 3), PLAIN, set())
    qtbot.waitUntil(lambda: table.selected_ids() == [], timeout=5000)

    # The band holds the whole window, and so everything that is seen.
    drawn = list(controller.overlays.drawings)
    angles = viewer.scene.camera.angles
    corner = QPoint(2, 2)
    everything = QPoint(widget.width() - 5, widget.height() - 5)
    drag(widget, corner, everything, qtbot, CONTROL)
    qtbot.waitUntil(lambda: {a, b, out} <= session.selected, timeout=5000)
    # The sprites at once, the packed objects from a worker.
    qtbot.waitUntil(lambda: len(session.selected) > 3, timeout=5000)
    assert controller.overlays.drawings == drawn
    qtbot.keyClick(widget, Qt.Key.Key_Escape)
    assert session.selected == frozenset()
    # Around the sprite alone, the bag is not touched.
    near = QPoint(70, 70)
    QTest.mousePress(widget, LEFT, CONTROL, pos=at[out] - near)
    qtbot.wait(20)
    before = canvas(viewer)
    for share in (0.5, 1.0):
        move(widget, at[out] + near * (2 * share - 1), LEFT, CONTROL)
        qtbot.wait(20)
    # While it is drawn it is seen.
    assert np.abs(canvas(viewer) - before).max(axis=-1).sum() > 1000
    QTest.mouseRelease(widget, LEFT, CONTROL, pos=at[out] + near)
    qtbot.waitUntil(lambda: session.selected == {out}, timeout=5000)
    assert controller.settle(30)
    assert session.selected == {out}
    assert viewer.scene.camera.angles == angles

    # Commands act on all that is selected, also where a search leaves it out of the table.
    session.select([a, b])
    panel.objects.pane.search.setText("no such name")
    assert table.selected_ids() == []
    qtbot.waitUntil(panel.objects.merge.isEnabled, timeout=5000)
    panel.objects.pane.search.setText("")
    assert set(table.selected_ids()) == {a, b}
    panel.objects.pane.search.setText("no such name")
    panel.objects.hide_chosen.click()
    assert {a, b} <= session.state.hidden
    qtbot.keyClick(widget, Qt.Key.Key_Z, CONTROL)
    qtbot.keyClick(widget, Qt.Key.Key_H)
    qtbot.waitUntil(lambda: {a, b} <= session.state.hidden, timeout=5000)
