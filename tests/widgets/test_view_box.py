"""Fit and the views from the sides, by button, menu and key."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unpack.layers import compat
from napari_unpack.session.framing import fitted
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import press, rest


def test_fit_and_the_sides_by_button_menu_and_key(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    rest(panel, qtbot)
    widget, box = compat.native_canvas(viewer).native, panel.unpack.view
    steps = piled.history.done

    def looks_along() -> np.ndarray:
        rest(panel, qtbot)
        return np.round(piled.camera.direction, 3) + 0.0

    texts = [action.text() for action in box.menu.actions()]
    assert [text.split("\t") for text in texts[:2]] == [["Front", "1"], ["Back", "2"]]
    assert len(texts) == 7
    QTest.keyClick(widget, Qt.Key.Key_3)
    assert looks_along() == pytest.approx([0, 0, 1])
    box.menu.actions()[0].trigger()
    assert looks_along() == pytest.approx([-1, 0, 0])
    for back in (lambda: press(qtbot, box.fit), lambda: QTest.keyClick(widget, Qt.Key.Key_F)):
        viewer.scene.camera.zoom *= 3
        rest(panel, qtbot)
        assert piled.camera.height == pytest.approx(fitted(piled).height / 3, rel=0.02)
        back()
        rest(panel, qtbot)
        assert piled.camera.height == pytest.approx(fitted(piled).height, rel=0.01)
    # To look is no step: there is nothing of it to undo.
    assert piled.history.done == steps


def test_keys_alone_turn_the_bag_and_what_is_inspected_and_tab_leaves_the_table(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    controller, shift = panel.workspace.controller, Qt.KeyboardModifier.ShiftModifier
    assert controller is not None
    controller.seconds = 0.05
    rest(panel, qtbot)
    canvas = compat.native_canvas(viewer).native

    def angle(before: np.ndarray, after: np.ndarray) -> float:
        return float(np.degrees(np.arccos((np.trace(before.T @ after) - 1) / 2)))

    was, height = piled.camera.rotation.copy(), piled.camera.height
    for key in (Qt.Key.Key_Right, Qt.Key.Key_Right):
        QTest.keyClick(canvas, key, shift)
    rest(panel, qtbot)
    assert angle(was, piled.camera.rotation) == pytest.approx(30, abs=1)
    assert piled.camera.height == pytest.approx(height, rel=1e-3)
    QTest.keyClick(canvas, Qt.Key.Key_N)
    rest(panel, qtbot)
    QTest.keyClick(canvas, Qt.Key.Key_I)
    rest(panel, qtbot)
    (one,) = piled.poses
    held, seen = controller.rotation_of(one).copy(), piled.camera.rotation.copy()
    QTest.keyClick(canvas, Qt.Key.Key_Up, shift)
    rest(panel, qtbot)
    assert angle(held, controller.rotation_of(one)) == pytest.approx(15, abs=1)
    np.testing.assert_allclose(piled.camera.rotation, seen, atol=1e-6)

    table = panel.objects.table
    panel.window().activateWindow()
    table.setFocus()
    for key in (Qt.Key.Key_Tab, Qt.Key.Key_Backtab):
        qtbot.waitUntil(table.hasFocus, timeout=5000)
        QTest.keyClick(table, Qt.Key.Key_Down)
        QTest.keyClick(table, key)
        assert not table.hasFocus()
        table.setFocus()
