"""Studying an object alone, by the panel's own controls: the cut, and what is inside it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QFileDialog

import napari_unpack as nu
from mouse import move
from napari_unpack.appearance import Decorations
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.layers import compat
from napari_unpack.viewer.label_sync import QUIET_MS
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import at_rest, controller_with, press, states
from tin import tin
from viewer_fixtures import canvas


@pytest.fixture
def studied(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> Any:
    """Return (viewer, panel, session, labels layer, view before) with the tin studied alone."""
    volume, labels = tin()
    viewer.add_image(volume, name="scan")
    mine = viewer.add_labels(labels, name="expert", visible=False)
    session = controller_with(panel, qtbot, mine)
    controller = panel.workspace.controller
    controller.seconds, controller.recolor_at_rest = 0.1, False
    assert controller.settle(60)
    view = {name: getattr(viewer.scene.camera, name) for name in ("center", "zoom", "angles")}
    panel.commands.inspect(1)
    qtbot.waitUntil(lambda: panel.unpack.inspection.isVisibleTo(panel), timeout=20000)
    return viewer, panel, session, mine, view


def test_the_cut_opens_the_studied_object_and_reset_closes_it(studied: Any, qtbot: QtBot) -> None:
    viewer, panel, session, *_ = studied
    box, controller = panel.unpack.inspection, panel.workspace.controller
    at_rest(controller, qtbot)
    whole = canvas(viewer)
    box.cut.setValue(60)
    qtbot.waitUntil(lambda: session.style(1).cut is not None, timeout=20000)
    point, normal = session.style(1).cut
    # Straight across the view, three fifths of the way through.
    np.testing.assert_allclose(normal, -controller.rotation_of(1)[0], atol=1e-6)
    corners = session.boxes.corners(1, np.asarray(session.spacing)) @ -np.asarray(normal)
    reach = corners.max() - 0.6 * np.ptp(corners)
    assert float(-np.asarray(normal) @ np.asarray(point)) == pytest.approx(reach, abs=1e-6)
    at_rest(controller, qtbot)
    cut = canvas(viewer)
    assert (np.abs(cut - whole).max(axis=-1) > 12).mean() > 0.02

    press(qtbot, box.reset)
    assert session.style(1).cut is None
    assert box.cut.value() == 0
    at_rest(controller, qtbot)
    assert (np.abs(canvas(viewer) - whole).max(axis=-1) > 12).mean() < 0.005

    # It ends with the inspection, so that sprites, pictures and films are all without it.
    box.cut.setValue(60)
    qtbot.waitUntil(lambda: session.style(1).cut is not None, timeout=20000)
    steps = len(session.history.done)
    qtbot.keyClick(compat.native_canvas(viewer).native, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: states(session)[1] == "PACKED", timeout=20000)
    assert session.style(1).cut is None
    assert len(session.history.done) == steps


def test_an_opened_object_is_a_bag_of_its_own_and_slices_stay_the_outer_ones(
    studied: Any, qtbot: QtBot
) -> None:
    viewer, panel, outer, mine, view = studied
    workspace, commands = panel.workspace, panel.commands
    hue = mine.colormap.map(np.array([1, 2]))
    at_rest(workspace.controller, qtbot)
    workspace.controller.renderer.held.turn(1, rotation_about((0.2, 1.0, 0.5), 0.8))
    held = workspace.controller.rotation_of(1).copy()
    press(qtbot, panel.unpack.inspection.open)
    assert workspace.is_inside
    # What was chosen for the bag holds for its contents.
    assert not workspace.controller.recolor_at_rest
    inner = workspace.session
    assert inner is not outer
    # It lies as it was held, its wall off what is in it.
    np.testing.assert_allclose(inner.camera.rotation, held, atol=1e-6)
    assert list(states(inner).values()) == ["UNPACKED", "PACKED", "PACKED"]
    assert len(inner.ids) == 3
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    inner.recolor()
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    assert workspace.controller.interaction.in_slice((10, 10, 10)) == 0
    assert workspace.controller.settle(60)

    qtbot.waitUntil(panel.unpack.next.isEnabled, timeout=10000)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: not workspace.controller.flying, timeout=20000)
    assert list(states(inner).values()).count("UNPACKED") == 2
    assert set(states(outer).values()) == {"PACKED"}

    assert panel.unpack.back_to_bag.isVisibleTo(panel)
    # Escape ends first what was begun last.
    canvas_widget = compat.native_canvas(viewer).native
    commands.inspect(1)
    qtbot.keyClick(canvas_widget, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: states(inner)[1] == "UNPACKED", timeout=20000)
    assert workspace.is_inside
    qtbot.keyClick(canvas_widget, Qt.Key.Key_Escape)
    assert workspace.session is outer
    for name, value in view.items():
        np.testing.assert_allclose(getattr(viewer.scene.camera, name), value, atol=1e-4)
    assert not workspace.is_inside
    np.testing.assert_array_equal(mine.colormap.map(np.array([1, 2])), hue)
    assert workspace.controller.interaction.in_slice((10, 10, 10)) == 1


def test_an_opened_object_is_saved_with_its_bag_and_exported_by_its_own_name(
    studied: Any, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, panel, outer, *_ = studied
    workspace, files, proposed = panel.workspace, panel.files, []

    def asked(_parent: Any, _title: str, path: str, _kinds: str) -> tuple[str, str]:
        proposed.append(Path(path).name)
        return str(tmp_path / "scan.unpack"), ""

    monkeypatch.setattr(QFileDialog, "getSaveFileName", asked)
    monkeypatch.setattr(files, "export_to", lambda *_: None)
    outer.rename(1, "Tin: open?")
    workspace.open_container(1)
    workspace.session.rename(2, "Battery")
    assert panel.unsaved.changed
    press(qtbot, files.save)
    qtbot.waitUntil(lambda: not files.progress.running, timeout=60000)
    saved = nu.open_session(tmp_path / "scan.unpack")
    np.testing.assert_array_equal(saved.labels, outer.labels)
    assert saved.objects["name"][1] == "Tin: open?"
    assert saved.opened_bags.open(saved, 1).objects["name"][2] == "Battery"
    assert not panel.unsaved.changed
    files.menu.actions()[1].trigger()
    assert proposed == ["scan.unpack", "scan Tin open unpacking.mp4"]


def test_background_box_and_scale_bar_are_those_of_the_bag(studied: Any) -> None:
    _, panel, outer, *_ = studied
    outer.decorations = Decorations.of("light", ("box", "scale"))
    panel.unsaved.mark()()
    panel.workspace.open_container(1)
    inner = panel.workspace.session
    assert inner is not outer
    shown = inner.decorations
    assert (shown.background.name, shown.box, shown.scale) == ("light", True, True)
    assert not panel.unsaved.changed


def test_slices_show_what_is_inside_the_opened_object(studied: Any, qtbot: QtBot) -> None:
    viewer, panel, outer = studied[:3]
    press(qtbot, panel.slices.button)
    dock = panel.slices.dock
    assert dock.linked.shape == outer.labels.shape
    press(qtbot, panel.unpack.inspection.open)
    inner, linked = panel.workspace.session, dock.linked
    assert linked.shape == inner.labels.shape
    center = inner.boxes.center(inner.ids[1], inner.spacing)
    controller = panel.workspace.controller
    assert controller.settle(60)
    frame, widget = controller.frame, compat.native_canvas(viewer).native
    row, col = frame.camera.project(center, frame.size)
    for aside in (1, 0):
        move(widget, QPoint(round(col) + aside, round(row)))
        # napari hears of at most one movement in 5 ms.
        qtbot.wait(20)
    assert inner.labels[linked.crosshair] == controller.interaction.pointed != 0
    qtbot.waitUntil(lambda: dock.settled, timeout=20000)
    for plane, view in dock.views.items():
        shape = inner.labels.shape
        assert view.image.shape[:2] == (shape[plane.rows], shape[plane.cols])
    press(qtbot, panel.unpack.back_to_bag)
    assert dock.linked.shape == outer.labels.shape


def test_what_was_taken_out_inside_is_still_out_when_the_object_is_opened_again(
    studied: Any, qtbot: QtBot
) -> None:
    _, panel, outer, *_ = studied
    workspace, commands = panel.workspace, panel.commands
    press(qtbot, panel.unpack.inspection.open)
    inner = workspace.session
    commands.unpack(1)
    at_rest(workspace.controller, qtbot)
    left = states(inner)
    assert list(left.values()).count("UNPACKED") == 2
    press(qtbot, panel.unpack.back_to_bag)
    assert workspace.session is outer
    workspace.open_container(1)
    assert workspace.is_inside
    assert states(workspace.session) == left
    commands.restore(1)
    at_rest(workspace.controller, qtbot)
    assert list(states(workspace.session).values()).count("UNPACKED") == 1


def test_a_stroke_inside_is_taken_back_and_one_in_the_bag_counts(
    studied: Any, qtbot: QtBot
) -> None:
    _, panel, outer, layer, _ = studied
    before = layer.data.copy()
    panel.workspace.open_container(1)
    at_rest(panel.workspace.controller, qtbot)
    layer.n_edit_dimensions = 3
    layer.paint((1, 1, 1), 1)
    assert not np.array_equal(layer.data, before)
    qtbot.waitUntil(lambda: np.array_equal(layer.data, before), timeout=20000)
    assert "go back to the bag first" in notification_manager.records[-1].message
    assert not panel.unsaved.changed
    # Another slice is no stroke, though napari tells it alike.
    told, compared = len(notification_manager.records), []
    layer.refresh()
    scheduler = panel.workspace.scheduler
    scheduler.later(2 * QUIET_MS, lambda: compared.append(True))
    qtbot.waitUntil(lambda: bool(compared), timeout=20000)
    assert len(notification_manager.records) == told
    panel.workspace.leave_container()
    layer.paint((1, 1, 1), 1)
    qtbot.waitUntil(lambda: outer.labels[1, 1, 1] == 1, timeout=20000)
    assert panel.unsaved.changed


def test_the_automatic_curve_is_called_so_inside_and_names_given_there_stay(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    labels = np.zeros((20, 30, 40), np.uint16)
    labels[4:16, 5:25, 5:25] = 1
    labels[5:15, 6:24, 6:24] = 0
    labels[7:13, 8:14, 8:14], labels[4:16, 5:25, 29:37] = 2, 3
    viewer.add_image((labels == 1) * 1000 + (labels == 2) * 2500 + (labels == 3) * 4000.0)
    outer = controller_with(panel, qtbot, viewer.add_labels(labels, name="expert"))
    workspace, preset = panel.workspace, panel.color.preset
    at_rest(workspace.controller, qtbot)
    assert preset.currentText() == "Automatic"
    shown = outer.transfer_function
    panel.commands.open_container(1)
    at_rest(workspace.controller, qtbot)
    inner = workspace.session
    assert inner is not outer
    # The named curves are made in a worker.
    qtbot.waitUntil(lambda: not workspace.scheduler.has("named curves"), timeout=20000)
    assert preset.currentText() == "Automatic"
    preset.setCurrentText("Metal")
    preset.activated.emit(preset.currentIndex())
    assert inner.transfer_function != shown
    preset.setCurrentText("Automatic")
    preset.activated.emit(preset.currentIndex())
    assert inner.transfer_function == shown
    panel.commands.rename(2, "pearl")
    press(qtbot, panel.unpack.back_to_bag)
    assert workspace.session is outer
    assert outer.objects["name"][2] == "pearl"
    panel.commands.undo()
    assert outer.objects["name"][2] == "Object 2"


def test_an_object_that_was_repaired_is_opened_anew(studied: Any, qtbot: QtBot) -> None:
    _, panel, outer, *_ = studied
    workspace = panel.workspace
    workspace.open_container(1)
    before = workspace.session
    workspace.leave_container()
    assert outer.merge([1, 2]) == 1
    workspace.open_container(1)
    assert workspace.session is not before
    assert workspace.session.labels.shape[2] > before.labels.shape[2]
