"""The dock of three linked slices, with the mouse and the keys of a person."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import dask.array as da
import numpy as np
import pytest
from napari.layers import Image
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QImage, QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication, QToolTip

from mouse import LEFT, NONE, PLAIN, move
from napari_unpack.appearance import tints_of
from napari_unpack.layers import compat
from napari_unpack.rendering.slice_image import ALONG_X, ALONG_Y, ALONG_Z, PLANES
from napari_unpack.viewer.linked_slices import OUTSIDE, limits_chosen
from napari_unpack.viewer.ruler_drawing import FAINT
from napari_unpack.widgets.remembered import remembered
from napari_unpack.widgets.slices_button import OPEN, SlicesButton
from opened_panel import CENTERS, at_rest, controller_with, pile_of_balls, press, rest

CONTROL = Qt.KeyboardModifier.ControlModifier
SHIFT = Qt.KeyboardModifier.ShiftModifier
RIGHT = Qt.MouseButton.RightButton


def spot(view: Any, voxel: tuple[int, int, int]) -> QPoint:
    """Return the pixel of a slice nearest to a voxel's middle."""
    return view.place_of(voxel).toPoint()


def wheel(view: Any, notches: int, modifiers: Any = PLAIN, at: QPoint | None = None) -> None:
    """Turn the mouse's wheel, away from the person where positive."""
    place = QPointF(view.rect().center() if at is None else at)
    there = QPointF(view.mapToGlobal(place.toPoint()))
    turn, still = QPoint(0, 120 * notches), QPoint()
    phase = Qt.ScrollPhase.NoScrollPhase
    event = QWheelEvent(place, there, still, turn, NONE, modifiers, phase, False)
    QApplication.sendEvent(view, event)


def drawn(dock: Any, qtbot: QtBot) -> None:
    """Wait until all slices show what they are to show."""
    qtbot.waitUntil(lambda: dock.settled, timeout=20000)


@pytest.fixture
def slices(panel: Any, piled: Any, qtbot: QtBot) -> Any:
    """Return the dock over the pile of balls, opened by its button, and its parts by name."""
    press(qtbot, panel.slices.button)
    dock = panel.slices.dock
    drawn(dock, qtbot)
    along = {"z": dock.views[ALONG_Z], "x": dock.views[ALONG_X], "y": dock.views[ALONG_Y]}
    rest(panel, qtbot)
    return SimpleNamespace(
        dock=dock, linked=dock.linked, panel=panel, session=piled,
        controller=panel.workspace.controller, **along,
    )  # fmt: skip


def test_what_is_said_of_the_voxel_is_true_after_a_repair_and_a_new_name(
    slices: Any, qtbot: QtBot
) -> None:
    session, said = slices.session, slices.dock.where.text
    z, y, x = CENTERS[0]
    slices.linked.point_at((z, y, x))
    assert said().startswith("Object 1, ")
    before = said()
    session.split(1, (z, y - 3, x), (z, y + 3, x))
    qtbot.waitUntil(lambda: said() != before, timeout=5000)
    name = session.objects["name"][int(session.labels[z, y, x])]
    assert said().startswith(f"{name}, ")
    assert said().split("\n")[1] == before.split("\n")[1]
    session.rename(int(session.labels[z, y, x]), "Half a ball")
    qtbot.waitUntil(lambda: said().startswith("Half a ball, "), timeout=5000)


def test_the_crosshair_follows_the_mouse_over_a_slice_into_the_others_and_the_3d_view(
    slices: Any, qtbot: QtBot
) -> None:
    linked, session, views = slices.linked, slices.session, (slices.z, slices.x, slices.y)
    for view in views:
        assert view.image.shape == (48, 48, 4)
        # Voxels are twice as deep as wide.
        spread = view.place_of((1, 1, 1)) - view.place_of((0, 0, 0))
        along_z = {ALONG_Z: None, ALONG_X: spread.x(), ALONG_Y: spread.y()}[view.plane]
        across = spread.y() if view.plane is ALONG_X else spread.x()
        assert along_z is None or along_z == pytest.approx(2 * across, rel=1e-6)

    at_z = linked.crosshair[0]
    before = {view: view.image.copy() for view in views}
    wanted = (at_z, CENTERS[4][1], 12)
    move(slices.z, spot(slices.z, wanted))
    assert linked.crosshair == wanted
    drawn(slices.dock, qtbot)
    np.testing.assert_array_equal(slices.z.image, before[slices.z])
    for view, axis in ((slices.x, 2), (slices.y, 1)):
        assert not np.array_equal(view.image, before[view])
        ids = view.plane.cut(session.labels, wanted[axis])
        # What belongs to no object is grey, all else has a tint.
        tinted = np.ptp(view.image[..., :3].astype(int), axis=-1) > 3
        assert (tinted == (ids > 0)).mean() > 0.99

    inside = CENTERS[2]
    assert inside[0] == CENTERS[3][0]
    move(slices.y, spot(slices.y, (inside[0], wanted[1], inside[2])))
    move(slices.x, spot(slices.x, (inside[0], inside[1], inside[2])))
    assert linked.crosshair == inside
    name = str(session.objects["name"][3])
    assert slices.x.name.startswith(name)
    assert QToolTip.text().startswith(name)
    assert slices.controller.interaction.pointed == 3
    assert name in slices.dock.where.text()

    frame = slices.controller.frame
    point, camera = linked.marker.point_in(frame)
    there = frame.camera.project(np.array(inside) * session.spacing, frame.size)
    np.testing.assert_allclose(camera.pixels(point, frame.size), there, atol=1e-6)
    assert linked.marker in slices.controller.overlays.drawings
    assert linked.marker.quads_at(frame)
    move(slices.x, QPoint(1, 1))
    assert (linked.crosshair, slices.x.name, slices.controller.interaction.pointed) == (
        inside, "", 0,
    )  # fmt: skip


def test_the_slices_follow_the_mouse_over_objects_and_sprites_in_the_3d_view(
    slices: Any, qtbot: QtBot
) -> None:
    controller, session, linked = slices.controller, slices.session, slices.linked
    controller.recolor_at_rest = False
    widget = compat.native_canvas(controller.viewer).native
    (out,) = controller.unpack(1)
    at_rest(controller, qtbot)
    frame, front = controller.frame, session.unpackable()[0]
    center = session.boxes.center(front, session.spacing)
    pixels = {
        front: frame.camera.project(center, frame.size),
        out: frame.camera.pixels(session.poses[out].center, frame.size),
    }
    for object_id, (row, col) in pixels.items():
        for aside in (1, 0):
            move(widget, QPoint(round(col) + aside, round(row)))
            # napari hears of at most one movement in 5 ms.
            qtbot.wait(20)
        assert session.labels[linked.crosshair] == object_id
        # Where the mouse is there is no second mark.
        assert linked.marker.point_in(frame) is None
        # Shown from the slices, the same point is under the mouse: on the sprite too.
        linked.point_at(linked.crosshair)
        point, camera = linked.marker.point_in(frame)
        assert np.abs(camera.pixels(point, frame.size) - (row, col)).max() < 4
    drawn(slices.dock, qtbot)
    assert slices.z.plane.cut(session.labels, linked.crosshair[0]).any()


def test_clicks_select_the_wheel_and_the_keys_go_through_the_slices(
    slices: Any, qtbot: QtBot
) -> None:
    linked, session, dock = slices.linked, slices.session, slices.dock
    view, panel = slices.z, slices.panel
    linked.point_at(CENTERS[0])
    for center, modifiers, wanted in (
        (CENTERS[0], PLAIN, {1}), (CENTERS[1], CONTROL, {1, 2}), (CENTERS[0], CONTROL, {2}),
    ):  # fmt: skip
        QTest.mouseClick(view, LEFT, modifiers, spot(view, center))
        assert session.selected == wanted
    drawn(dock, qtbot)
    white = (view.image[..., :3] == 255).all(axis=-1)
    assert white.any()
    assert (session.labels[14][white] == 2).all()
    qtbot.waitUntil(lambda: panel.workspace.settled, timeout=20000)
    assert panel.objects.table.selected_ids() == [2]
    QTest.mouseClick(view, LEFT, PLAIN, spot(view, (14, 1, 1)))
    assert session.selected == frozenset()

    move(view, spot(view, (14, 20, 20)))
    wheel(view, -3)
    assert linked.crosshair == (17, 20, 20)
    wheel(view, 50)
    assert linked.crosshair == (0, 20, 20)
    keys = {
        Qt.Key.Key_PageDown: (1, 20, 20), Qt.Key.Key_PageUp: (0, 20, 20),
        Qt.Key.Key_Right: (0, 20, 21), Qt.Key.Key_Left: (0, 20, 20),
        Qt.Key.Key_Down: (0, 21, 20), Qt.Key.Key_Up: (0, 20, 20),
    }  # fmt: skip
    for key, wanted in keys.items():
        qtbot.keyClick(view, key)
        assert linked.crosshair == wanted
    qtbot.keyClick(slices.x, Qt.Key.Key_Right, SHIFT)
    assert linked.crosshair == (10, 20, 20)

    held = spot(view, (10, 12, 30))
    wheel(view, 4, CONTROL, held)
    assert view.zoom > 2
    # What the mouse was on stays under it.
    assert view.voxel_at(QPointF(held)) == (10, 12, 30)
    qtbot.mouseDClick(view, LEFT, pos=held)
    assert view.voxel_at(QPointF(view.rect().center())) == (10, 12, 30)
    zoom = view.zoom
    qtbot.keyClick(view, Qt.Key.Key_Minus)
    assert view.zoom < zoom
    qtbot.keyClick(view, Qt.Key.Key_Plus)
    assert view.zoom == pytest.approx(zoom)
    qtbot.keyClick(view, Qt.Key.Key_Home)
    assert view.zoom == 1

    # What is selected elsewhere is gone to, and so it is by Centre.
    session.select([6])
    assert session.labels[linked.crosshair] == 6
    move(view, spot(view, (linked.crosshair[0], 2, 2)))
    press(qtbot, dock.center)
    assert session.labels[linked.crosshair] == 6
    session.select([])
    qtbot.keyClick(view, Qt.Key.Key_Return)
    assert session.selected == frozenset({6})


def test_tools_take_their_points_from_slices_too(slices: Any, qtbot: QtBot) -> None:
    linked, session, panel, view = slices.linked, slices.session, slices.panel, slices.z
    linked.point_at(CENTERS[0])
    drawn(slices.dock, qtbot)

    def click(voxel: tuple[int, int, int]) -> None:
        move(view, spot(view, voxel))
        QTest.mouseClick(view, LEFT, PLAIN, spot(view, voxel))

    def yellow() -> np.ndarray:
        image = view.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
        rows = np.frombuffer(image.constBits().asarray(image.sizeInBytes()), np.uint8)
        rgb = rows.reshape(image.height(), image.bytesPerLine())[:, : 3 * image.width()]
        r, g, b = np.moveaxis(rgb.reshape(image.height(), image.width(), 3).astype(int), -1, 0)
        return (r > 200) & (g > 180) & (b < 140)

    panel.measure.ruler.click()
    assert "3D view or in slices" in panel.measure.ruler.toolTip()
    click((14, 34, 14))
    assert "measure to" in panel.measure.next_click.text()
    assert not session.selected
    # The second by the keyboard alone: the crosshair's voxel.
    move(view, spot(view, (14, 34, 34)))
    before = yellow()
    qtbot.keyClick(view, Qt.Key.Key_Return)
    (made,) = session.measurements
    assert [point.object_id for point in made.points] == [1, 2]
    # A click is exact to the pixel, the key to the voxel.
    np.testing.assert_allclose(made.points[1].at, np.array((14, 34, 34)) * session.spacing)
    assert made.lengths[0] == pytest.approx(20, abs=0.5)
    qtbot.wait(5)
    move(view, spot(view, (14, 10, 10)))
    middle = view.place_of((14, 34, 24))
    line = np.s_[int(middle.y()) - 2 : int(middle.y()) + 3, int(middle.x()) - 9 : int(middle.x())]
    assert not before[line].any()
    assert yellow()[line].any(axis=0).all()
    # Through another slice it is faint, and beside one it is not drawn at all.
    assert [one.strength for one in linked.rulers_in(ALONG_X)] == []
    linked.point_at((14, 34, 34))
    assert [one.strength for one in linked.rulers_in(ALONG_X)] == [FAINT]
    session.undo()
    assert linked.rulers_in(ALONG_Z) == []

    # One tool at a time: Split calls the angle off, and Escape calls Split off.
    panel.measure.angle.click()
    press(qtbot, panel.objects.split)
    assert not panel.measure.angle.isChecked()
    click((14, 34, 14))
    assert "other part" in panel.objects.next_click.text()
    qtbot.keyClick(view, Qt.Key.Key_Escape)
    assert not panel.objects.split.isChecked()
    press(qtbot, panel.objects.split)
    click((14, 34, 10))
    click((14, 34, 18))
    qtbot.waitUntil(lambda: len(session.ids) == 7, timeout=10000)
    assert session.labels[14, 34, 10] != session.labels[14, 34, 18]


def test_greys_and_tints_follow_the_hand_and_the_session(slices: Any, qtbot: QtBot) -> None:
    linked, session, dock, view = slices.linked, slices.session, slices.dock, slices.z
    slices.controller.recolor_at_rest = False
    image = slices.controller.sources[0]
    # Half of the balls' voxels are of 1350 or less, and white is at three times that above air; the
    # densest would leave the others dark.
    automatic = (20, 20 + 3 * (1350 - 20))
    assert linked.window == automatic
    assert image.contrast_limits == [20, 4500]
    linked.point_at(CENTERS[0])
    drawn(dock, qtbot)
    at = (CENTERS[0][1], CENTERS[0][2])
    # They follow the image's contrast, until a hand has changed them here.
    before = tuple(image.contrast_limits)
    image.contrast_limits = (100, 2500)
    assert linked.window == (100, 2500)
    assert (dock.black.value(), dock.white.value()) == (100, 2500)
    dock.white.setValue(2000)
    image.contrast_limits = before
    assert linked.window == (100, 2000)
    press(qtbot, dock.automatic)
    assert linked.window == automatic
    # Set now, the whole range is a choice as well.
    image.contrast_limits = (100, 2500)
    image.contrast_limits = before
    assert linked.window == before == (20, 4500)
    press(qtbot, dock.automatic)
    assert linked.window == automatic

    def color() -> np.ndarray:
        drawn(dock, qtbot)
        return view.image[at][:3].astype(int)

    def expected(share: float) -> np.ndarray:
        low, high = linked.window
        grey = np.clip((session.volume[CENTERS[0]] - low) / (high - low), 0, 1)
        tint = tints_of(session.hues, 6, mode=session.tint_mode)[1, :3]
        return 255 * ((1 - share) * grey + share * tint)

    np.testing.assert_allclose(color(), expected(0.5), atol=2)
    dock.overlay.setValue(80)
    np.testing.assert_allclose(color(), expected(0.8), atol=2)
    session.apply_hues({1: 0.61})
    np.testing.assert_allclose(color(), expected(0.8), atol=2)
    session.tint_mode = "safe"
    np.testing.assert_allclose(color(), expected(0.8), atol=2)

    # A colour of its own is the object's here too, with the opacity that was chosen.
    session.annotations.set_color([1], (0.0, 1.0, 0.0, 0.5))
    drawn(dock, qtbot)
    np.testing.assert_allclose(linked.tints()[1], (0, 1, 0, 0.4), atol=1e-6)
    assert color()[1] > color()[0]
    session.annotations.set_color([1], None)

    low, high = linked.window
    QTest.mousePress(view, RIGHT, PLAIN, pos=QPoint(40, 40))
    move(view, QPoint(70, 40), RIGHT)
    QTest.mouseRelease(view, RIGHT, PLAIN, pos=QPoint(70, 40))
    assert linked.window[1] - linked.window[0] > 1.1 * (high - low)
    assert sum(linked.window) == pytest.approx(low + high)
    assert dock.white.value() == pytest.approx(linked.window[1], abs=0.1)
    np.testing.assert_allclose(color(), expected(0.8), atol=2)
    dock.white.setValue(1234)
    assert linked.window[1] == 1234
    press(qtbot, dock.automatic)
    assert linked.window == (low, high)

    session.hide([1])
    np.testing.assert_allclose(color(), expected(0.0), atol=2)
    session.show([1])
    slices.controller.unpack([1])
    at_rest(slices.controller, qtbot)
    np.testing.assert_allclose(color(), expected(0.8 * OUTSIDE), atol=2)
    slices.controller.restore()
    at_rest(slices.controller, qtbot)
    session.delete([1])
    np.testing.assert_allclose(color(), expected(0.0), atol=2)
    assert linked.name_at(CENTERS[0]) == ""


def test_black_and_white_are_chosen_as_finely_in_a_volume_from_0_to_1(
    viewer: Any, panel: Any, qtbot: QtBot
) -> None:
    volume, labels = pile_of_balls()
    viewer.add_image((volume / 4500).astype(np.float32), name="bag")
    controller_with(panel, qtbot, viewer.add_labels(labels, name="expert"))
    press(qtbot, panel.slices.button)
    dock = panel.slices.dock
    drawn(dock, qtbot)
    low, high = dock.linked.window
    # 20 and 4010 of 4500.
    assert (low, high) == pytest.approx((0.0044, 0.8911), abs=1e-3)
    assert (dock.black.value(), dock.white.value()) == pytest.approx((low, high), abs=0.01)
    dock.black.stepUp()
    assert dock.linked.window[0] == pytest.approx(low + (high - low) / 50, abs=0.005)
    dock.white.selectAll()
    qtbot.keyClicks(dock.white, "0.25")
    qtbot.keyClick(dock.white, Qt.Key.Key_Return)
    assert dock.linked.window[1] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("given", "window"),
    [
        (None, (20, 4010)),
        ((100, 3000), (100, 3000)),
        ((20, 4500), (20, 4500)),
        ((0, 9e3), (0, 9e3)),
    ],
)
def test_contrast_limits_that_a_script_gave_are_those_of_the_slices(
    viewer: Any, panel: Any, qtbot: QtBot, given: Any, window: tuple[float, float]
) -> None:
    """Also those that are the whole range of the data, in which napari itself begins."""
    volume, labels = pile_of_balls()
    image = viewer.add_image(volume, name="bag", contrast_limits=given)
    # Which makes them the range of napari's slider, too.
    assert image.contrast_limits_range == list(given or (20, 4500))
    controller_with(panel, qtbot, viewer.add_labels(labels, name="expert"))
    press(qtbot, panel.slices.button)
    drawn(panel.slices.dock, qtbot)
    assert panel.slices.dock.linked.window == window
    # Also after another choice that was made while nobody saw the slices.
    press(qtbot, panel.slices.button)
    image.contrast_limits = (200, 2000)
    press(qtbot, panel.slices.button)
    drawn(panel.slices.dock, qtbot)
    assert panel.slices.dock.linked.window == (200, 2000)
    press(qtbot, panel.slices.dock.automatic)
    assert panel.slices.dock.linked.window == (20, 4010)


@pytest.mark.parametrize(
    ("dtype", "given", "chosen"),
    [
        (np.uint16, None, False),
        (np.float32, None, False),
        (np.uint8, None, False),
        (np.uint16, (3, 90), True),
        (np.uint16, (0, 100), True),
        (np.float32, (np.float32(0), np.float32(100)), True),
        (np.uint8, (0, 100), True),
        # Just what napari takes: nothing is left that would tell.
        (np.float32, (0.0, 100.0), False),
        (np.uint8, (0, 255), False),
    ],
)
@pytest.mark.parametrize("many", [np.asarray, partial(da.from_array, chunks=2), "multiscale"])
def test_contrast_limits_that_were_given_are_told_from_those_that_napari_takes(
    dtype: Any, given: Any, chosen: bool, many: Any
) -> None:
    volume = np.zeros((4, 5, 6), dtype)
    # The whole range is in the first plane, which is all that napari sees of what is in chunks.
    volume[0, 2, 3] = 100
    made = [volume, volume[::2]] if isinstance(many, str) else many(volume)
    image = Image(made, contrast_limits=given)
    assert limits_chosen(image) is chosen
    volume[2] = 50
    assert limits_chosen(image) is chosen


def test_docks_below_leave_the_window_no_taller_than_a_laptops_screen(
    viewer: Any, panel: Any, piled: Any, qtbot: QtBot
) -> None:
    window = compat.native_window(viewer)
    window.resize(1000, 768)
    below = Qt.DockWidgetArea.BottomDockWidgetArea
    for opener in (panel.objects.table_button, panel.slices):
        press(qtbot, opener.button)
        qtbot.waitUntil(opener.dock.isVisible, timeout=5000)
        frame = opener.dock.parentWidget()
        assert window.dockWidgetArea(frame) == below
        # Once the window has laid it out, which makes the window taller where it has to.
        qtbot.waitUntil(
            lambda frame=frame: (
                frame.y() > window.centralWidget().geometry().bottom()
                and frame.height() >= frame.minimumSizeHint().height()
            ),
            timeout=5000,
        )
        assert window.height() == 768
        if opener is panel.slices:
            # They would like 538, which would leave hardly anything to the picture.
            qtbot.waitUntil(lambda frame=frame: frame.height() == 768 // 2, timeout=5000)
        press(qtbot, opener.button)


@pytest.mark.parametrize("slices_first", [True, False])
def test_docks_that_have_no_room_beside_each_other_stand_in_one_place(
    viewer: Any, panel: Any, piled: Any, qtbot: QtBot, slices_first: bool
) -> None:
    window = compat.native_window(viewer)
    window.resize(1024, 768)
    openers = [panel.objects.table_button, panel.slices]
    first, second = openers[::-1] if slices_first else openers

    def is_seen(opener: Any, other: Any) -> None:
        qtbot.waitUntil(lambda: not opener.dock.visibleRegion().isEmpty(), timeout=5000)
        qtbot.wait(200)
        assert other.dock.visibleRegion().isEmpty()
        assert [one.button.isChecked() for one in (opener, other)] == [True, False]
        assert window.width() == 1024

    # By itself each has its place below the picture.
    press(qtbot, first.button)
    qtbot.waitUntil(first.dock.isVisible, timeout=5000)
    press(qtbot, second.button)
    is_seen(second, first)
    press(qtbot, first.button)
    is_seen(first, second)
    # The other takes its place again.
    press(qtbot, first.button)
    is_seen(second, first)
    press(qtbot, second.button)
    qtbot.waitUntil(lambda: not any(one.dock.isVisible() for one in openers), timeout=5000)
    press(qtbot, first.button)
    is_seen(first, second)


@pytest.mark.parametrize("slices_first", [True, False])
def test_the_window_has_its_corners_back_when_the_panel_is_closed(
    viewer: Any, panel: Any, piled: Any, qtbot: QtBot, slices_first: bool
) -> None:
    window = compat.native_window(viewer)
    window.resize(1000, 768)
    before = [window.corner(corner) for corner in Qt.Corner]
    openers = (panel.objects.table_button, panel.slices)
    for opener in openers[::-1] if slices_first else openers:
        press(qtbot, opener.button)
        qtbot.waitUntil(opener.dock.isVisible, timeout=5000)
    assert [window.corner(corner) for corner in Qt.Corner] != before
    panel.end()
    assert [window.corner(corner) for corner in Qt.Corner] == before


def test_a_closed_dock_does_nothing_and_comes_back_as_it_was(
    slices: Any, viewer: Any, qtbot: QtBot
) -> None:
    linked, dock, panel = slices.linked, slices.dock, slices.panel
    callbacks = viewer.mouse_move_callbacks
    count = len(callbacks)
    move(slices.z, spot(slices.z, CENTERS[1]))
    drawn(dock, qtbot)
    voxel, image = linked.crosshair, slices.z.image
    dock.parentWidget().close()
    assert not panel.slices.button.isChecked()
    assert len(callbacks) == count - 1
    assert linked.marker not in slices.controller.overlays.drawings
    slices.session.apply_hues({1: 0.11})
    qtbot.wait(20)
    assert dock.settled
    assert slices.z.image is image

    press(qtbot, panel.slices.button)
    drawn(dock, qtbot)
    assert dock.linked is linked
    assert linked.crosshair == voxel
    assert slices.z.image is not image

    # Its cross takes it out of the window for good; the button brings it back.
    compat.unwrap(viewer).window.remove_dock_widget(dock.parentWidget())
    assert not panel.slices.button.isChecked()
    press(qtbot, panel.slices.button)
    drawn(dock, qtbot)
    assert dock.isVisible()
    assert len(callbacks) == count

    # What was open opens by itself with the first session of the next start.
    assert remembered().value(OPEN, type=bool)
    panel.slices.end()
    again = SlicesButton(panel.workspace)
    panel.workspace.switched.emit()
    assert again.button.isChecked()
    assert again.dock.isVisible()
    again.end()
    panel.slices = SlicesButton(panel.workspace)
    press(qtbot, panel.slices.button)
    dock = panel.slices.dock
    drawn(dock, qtbot)
    linked = dock.linked

    # Another session is shown in the same dock, and none is while there is none.
    panel.workspace.close()
    assert dock.linked is None
    assert dock.views[ALONG_Z].image is None
    press(qtbot, panel.segment.start)
    qtbot.waitUntil(lambda: panel.workspace.controller is not None, timeout=90000)
    drawn(dock, qtbot)
    assert dock.linked is not linked
    assert all(dock.views[plane].image is not None for plane in PLANES)
