"""Lengths and angles measured by clicks on the canvas, drawn, listed, undone and saved."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

import napari_unpack as nu
from mouse import LEFT, PLAIN
from napari_unpack.layers import compat
from napari_unpack.session.measurements import Measurement, SurfacePoint
from opened_panel import rest
from viewer_fixtures import canvas

CONTROL = Qt.KeyboardModifier.ControlModifier


@pytest.fixture(autouse=True)
def single_clicks() -> Iterator[None]:
    """Let clicks in a row be clicks."""
    interval = QApplication.doubleClickInterval()
    QApplication.setDoubleClickInterval(1)
    yield
    QApplication.setDoubleClickInterval(interval)


def test_rulers_and_angles_between_points_of_surfaces(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    session, controller, box = piled, panel.workspace.controller, panel.measure
    controller.recolor_at_rest, controller.seconds = False, 0.05
    widget = compat.native_canvas(viewer).native

    def pixel(object_id: int) -> np.ndarray:
        frame = controller.frame
        if object_id in session.poses:
            return frame.camera.pixels(session.poses[object_id].center, frame.size)
        return frame.camera.project(session.boxes.center(object_id, session.spacing), frame.size)

    def click(spot: np.ndarray) -> None:
        QTest.mouseClick(widget, LEFT, PLAIN, pos=QPoint(round(spot[1]), round(spot[0])))
        qtbot.wait(15)

    seen = {i: controller.interaction.packed_at(pixel(i))[:1] for i in session.ids}
    a, b, c = [i for i in session.ids if seen[i] == [i]][:3]
    qtbot.keyClick(widget, Qt.Key.Key_M)
    assert box.ruler.isChecked()
    assert "from" in box.next_click.text()
    click(pixel(a))
    assert "to" in box.next_click.text()
    click(pixel(b))
    qtbot.waitUntil(lambda: box.list.count() == 1, timeout=5000)
    (made,) = session.measurements
    # Clicks of a tool select nothing.
    assert not session.selected
    assert not box.ruler.isChecked()
    for point, object_id in zip(made.points, (a, b), strict=True):
        assert point.object_id == object_id
        at = np.array(point.at)
        voxel = tuple(np.rint(at / session.spacing).astype(int))
        assert session.labels[voxel] == object_id
        # A voxel nearer to the viewer there is nothing of it.
        nearer = at - controller.frame.camera.direction * 1.01 * session.spacing.max()
        assert session.labels[tuple(np.rint(nearer / session.spacing).astype(int))] != object_id
    length = np.linalg.norm(np.subtract(made.points[0].at, made.points[1].at))
    assert made.lengths == pytest.approx((length,))
    assert box.list.item(0).text().startswith(made.words)
    # The line is drawn between both places.
    middle = np.round((pixel(a) + pixel(b)) / 2).astype(int)
    near = np.s_[middle[0] - 6 : middle[0] + 7, middle[1] - 6 : middle[1] + 7]

    # It is exported, and drawn only while it is to be.
    panel.files.menu.aboutToShow.emit()
    (export,) = [one for one in panel.files.menu.actions() if one.text() == "Measurements…"]
    assert export.isEnabled()
    box.show_all.click()
    rest(panel, qtbot)
    plain = canvas(viewer)
    box.show_all.click()
    rest(panel, qtbot)
    assert np.abs(canvas(viewer) - plain)[near].max() > 60

    qtbot.keyClick(widget, Qt.Key.Key_A)
    for object_id in (a, b, c):
        click(pixel(object_id))
    qtbot.waitUntil(lambda: box.list.count() == 2, timeout=5000)
    assert "°" in box.list.item(1).text()
    qtbot.keyClick(widget, Qt.Key.Key_Z, CONTROL)
    qtbot.waitUntil(lambda: box.list.count() == 1, timeout=5000)
    nu.save_session(session, tmp_path / "measured.unpack")
    assert tuple(nu.open_session(tmp_path / "measured.unpack").measurements) == (made,)

    # Escape calls a tool off; a point of a sprite goes along with it.
    qtbot.keyClick(widget, Qt.Key.Key_M)
    qtbot.keyClick(widget, Qt.Key.Key_Escape)
    assert controller.interaction.tool is None
    (out, *_) = controller.unpack(1)
    rest(panel, qtbot)
    qtbot.keyClick(widget, Qt.Key.Key_M)
    click(pixel(out) - 8)
    click(pixel(out) + 8)
    qtbot.waitUntil(lambda: len(session.measurements) == 2, timeout=5000)
    on_sprite = list(session.measurements)[1]
    assert on_sprite.objects == {out}
    scale = session.poses[out].scale * controller.frame.size[0] / controller.frame.camera.height
    # Across a ball seen nearly face on: hardly longer than the way of the mouse.
    assert on_sprite.lengths[0] * scale == pytest.approx(16 * 2**0.5, rel=0.25)

    # On an inspected object a ruler is drawn upon it, and those of other objects are not.
    controller.inspect(out)
    rest(panel, qtbot)
    middle = 0.5 * np.array(controller.frame.size)
    before = canvas(viewer)
    box.ruler.click()
    # Across the one that was made on its sprite.
    click(middle + np.array([-18, 18]))
    click(middle + np.array([18, -18]))
    qtbot.waitUntil(lambda: len(session.measurements) == 3, timeout=5000)
    row, col = np.round(middle).astype(int)
    drawn = np.abs(canvas(viewer) - before).max(axis=-1) > 60
    near = drawn[row - 15 : row + 16, col - 15 : col + 16]
    assert np.diag(near[:, ::-1]).mean() > 0.8
    qtbot.keyClick(widget, Qt.Key.Key_Z, CONTROL)
    qtbot.waitUntil(lambda: box.list.count() == 2, timeout=5000)
    rest(panel, qtbot)

    # In slices a click is exact, and what lies in the slice is drawn.
    viewer.dims.ndisplay = 2
    viewer.dims.set_point(0, session.boxes.center(a, session.spacing)[0])
    canvas(viewer)
    # The sliders of slices take their room from the canvas.
    qtbot.wait(100)
    viewer.reset_view()
    before = canvas(viewer)
    size = np.array([widget.height(), widget.width()])
    box.ruler.click()
    click(0.5 * size + (-30, -40))
    click(0.5 * size + (-30, 40))
    qtbot.waitUntil(lambda: len(session.measurements) == 3, timeout=5000)
    flat = list(session.measurements)[2]
    assert flat.lengths[0] == pytest.approx(80 / viewer.scene.camera.zoom, rel=1e-3)
    row, col = np.round(0.5 * size + (-30, 0)).astype(int)
    drawn = np.abs(canvas(viewer) - before).max(axis=-1) > 60
    assert drawn[row - 3 : row + 4, col - 35 : col + 35].any(axis=0).mean() > 0.9

    box.list.setCurrentRow(2)
    box.remove.click()
    qtbot.waitUntil(lambda: box.list.count() == 2, timeout=5000)


def test_in_perspective_clicks_on_a_sprite_are_on_what_the_sprite_shows_there(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot
) -> None:
    session, controller, box = piled, panel.workspace.controller, panel.measure
    controller.recolor_at_rest, controller.seconds = False, 0.05
    viewer.scene.camera.perspective = 60.0
    widget = compat.native_canvas(viewer).native
    (out,) = controller.unpack(1)
    rest(panel, qtbot)
    frame, pose = controller.frame, session.poses[out]
    middle = frame.camera.pixels(pose.center, frame.size)
    clicked = [np.round(middle) + aside for aside in ((-9, -6), (9, 6))]
    before = canvas(viewer)
    box.ruler.click()
    for row, col in clicked:
        QTest.mouseClick(widget, LEFT, PLAIN, pos=QPoint(int(col), int(row)))
        qtbot.wait(15)
    qtbot.waitUntil(lambda: len(session.measurements) == 1, timeout=5000)
    (made,) = session.measurements
    # A sprite is orthographic: what is beside its middle does not depend on depth.
    pixels_a_mm = frame.size[0] / frame.camera.height
    for point, pixel in zip(made.points, clicked, strict=True):
        away = np.array(point.at) - session.boxes.center(out, session.spacing)
        beside = pixels_a_mm * pose.scale * (pose.rotation @ away)[1:]
        np.testing.assert_allclose(middle + beside, pixel, atol=0.6)
    # The line is drawn between the clicks.
    rest(panel, qtbot)
    drawn = np.abs(canvas(viewer) - before).max(axis=-1) > 60
    between = np.round(np.linspace(*clicked, 15)).astype(int)
    assert drawn[tuple(between.T)].mean() > 0.9


def test_an_angle_is_exact_and_nothing_is_not_measured() -> None:
    corner, along, up = (SurfacePoint(1, p) for p in ((0, 0, 0.0), (0, 0, 3.0), (0, 4.0, 0)))
    assert Measurement((along, corner, up)).words == "90.0° (3.00 mm, 4.00 mm)"
    assert Measurement((corner, up)).angle is None
    with pytest.raises(ValueError, match="apart"):
        Measurement((corner, corner))
    with pytest.raises(ValueError, match="two points"):
        Measurement((corner,))
