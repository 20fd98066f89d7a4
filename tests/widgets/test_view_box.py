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
