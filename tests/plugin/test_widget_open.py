"""Studying an object alone, by the panel's own controls: the cut, and what is inside it."""

from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from widget_phantoms import at_rest, press, stage_with, states

from conftest import canvas
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.layers import compat
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from tin import tin


@pytest.fixture
def studied(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> Any:
    """Return (viewer, panel, session, labels layer) with the tin studied alone."""
    volume, labels = tin()
    viewer.add_image(volume, name="scan")
    mine = viewer.add_labels(labels, name="expert", visible=False)
    session = stage_with(panel, qtbot, mine)
    stage = panel.workbench.stage
    stage.seconds, stage.recolor_at_rest = 0.1, False
    assert stage.settle(60)
    panel.workbench.inspect(1)
    qtbot.waitUntil(lambda: panel.unpack.studied.isVisibleTo(panel), timeout=20000)
    return viewer, panel, session, mine


def test_the_cut_opens_the_studied_object_and_reset_closes_it(studied: Any, qtbot: QtBot) -> None:
    viewer, panel, session, _ = studied
    box, stage = panel.unpack.studied, panel.workbench.stage
    at_rest(stage, qtbot)
    whole = canvas(viewer)
    box.cut.setValue(60)
    qtbot.waitUntil(lambda: session.study(1).cut is not None, timeout=20000)
    point, normal = session.study(1).cut
    # Straight across the view, three fifths of the way through.
    np.testing.assert_allclose(normal, -stage.rotation_of(1)[0], atol=1e-6)
    corners = session.boxes.corners(1, np.asarray(session.spacing)) @ -np.asarray(normal)
    reach = corners.max() - 0.6 * np.ptp(corners)
    assert float(-np.asarray(normal) @ np.asarray(point)) == pytest.approx(reach, abs=1e-6)
    at_rest(stage, qtbot)
    cut = canvas(viewer)
    assert (np.abs(cut - whole).max(axis=-1) > 12).mean() > 0.02

    press(qtbot, box.plain)
    assert session.study(1).cut is None
    assert box.cut.value() == 0
    at_rest(stage, qtbot)
    assert (np.abs(canvas(viewer) - whole).max(axis=-1) > 12).mean() < 0.005


def test_an_opened_object_is_a_bag_of_its_own_and_slices_stay_the_outer_ones(
    studied: Any, qtbot: QtBot
) -> None:
    viewer, panel, outer, mine = studied
    view = {name: getattr(viewer.scene.camera, name) for name in ("center", "zoom", "angles")}
    bench = panel.workbench
    hue = mine.colormap.map(np.array([1, 2]))
    at_rest(bench.stage, qtbot)
    bench.stage.turn(1, rotation_about((0.2, 1.0, 0.5), 0.8))
    held = bench.stage.rotation_of(1).copy()
    press(qtbot, panel.unpack.studied.open)
    assert bench.is_inside
    inner = bench.session
    assert inner is not outer
    # It lies as it was held, its wall off what is in it.
    np.testing.assert_allclose(inner.camera.rotation, held, atol=1e-6)
    assert list(states(inner).values()) == ["UNPACKED", "PACKED", "PACKED"]
    assert len(inner.ids) == 3
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    inner.recolor()
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    assert bench.stage.in_slice((10, 10, 10)) == 0
    assert bench.stage.settle(60)

    qtbot.waitUntil(panel.unpack.next.isEnabled, timeout=10000)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: not bench.stage.flying, timeout=20000)
    assert list(states(inner).values()).count("UNPACKED") == 2
    assert set(states(outer).values()) == {"PACKED"}

    assert panel.unpack.outside.isVisibleTo(panel)
    # Escape ends first what was begun last.
    canvas_widget = compat.native_canvas(viewer).native
    bench.inspect(1)
    qtbot.keyClick(canvas_widget, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: states(inner)[1] == "UNPACKED", timeout=20000)
    assert bench.is_inside
    qtbot.keyClick(canvas_widget, Qt.Key.Key_Escape)
    assert bench.session is outer
    for name, value in view.items():
        np.testing.assert_allclose(getattr(viewer.scene.camera, name), value, atol=1e-4)
    assert not bench.is_inside
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    assert bench.stage.in_slice((10, 10, 10)) == 1


def test_what_was_taken_out_inside_is_still_out_when_the_object_is_opened_again(
    studied: Any, qtbot: QtBot
) -> None:
    _, panel, outer, _ = studied
    bench = panel.workbench
    press(qtbot, panel.unpack.studied.open)
    inner = bench.session
    bench.unpack(1)
    at_rest(bench.stage, qtbot)
    left = states(inner)
    assert list(left.values()).count("UNPACKED") == 2
    press(qtbot, panel.unpack.outside)
    assert bench.session is outer
    bench.open_object(1)
    assert bench.is_inside
    assert states(bench.session) == left
    bench.restore(1)
    at_rest(bench.stage, qtbot)
    assert list(states(bench.session).values()).count("UNPACKED") == 1


def test_an_object_that_was_repaired_is_opened_anew(studied: Any, qtbot: QtBot) -> None:
    _, panel, outer, _ = studied
    bench = panel.workbench
    bench.open_object(1)
    before = bench.session
    bench.leave_object()
    assert outer.merge([1, 2]) == 1
    bench.open_object(1)
    assert bench.session is not before
    assert bench.session.labels.shape[2] > before.labels.shape[2]
