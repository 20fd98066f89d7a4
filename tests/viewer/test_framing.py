"""What the camera does by itself, and what it leaves to a person: real mouse, wheel and keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from mouse import LEFT, drag
from napari_unpack.appearance import Decorations
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.standard_views import Side, upright
from napari_unpack.layers import compat
from napari_unpack.layers.view_camera import same_camera
from napari_unpack.session import ObjectState, Session
from napari_unpack.viewer.controller import SessionController
from opened_panel import at_rest
from viewer_fixtures import canvas


class Window:
    """A person before the window."""

    def __init__(self, viewer: Any, controller: Any, qtbot: Any) -> None:
        self.viewer, self.controller, self.qtbot = viewer, controller, qtbot
        self.session = controller.session
        self.widget = compat.native_canvas(viewer).native
        controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
        self.rest()

    def rest(self) -> None:
        at_rest(self.controller, self.qtbot)

    def unpack(self, count: int = 1) -> None:
        self.controller.unpack(count)
        self.controller.finish()
        self.rest()

    def view(self) -> tuple[float, ...]:
        camera = self.viewer.scene.camera
        return (camera.zoom, *camera.center, *camera.angles)

    def at_object(self, object_id: int) -> QPoint:
        center = self.session.boxes.center(object_id, self.session.spacing)
        frame = self.controller.frame
        row, col = frame.camera.project(center, frame.size)
        return QPoint(round(col), round(row))

    def double_click(self, at: QPoint) -> None:
        QTest.mouseDClick(self.widget, LEFT, pos=at)
        QApplication.processEvents()

    def wheel(self, clicks: int) -> None:
        at = QPoint(self.widget.width() // 2, self.widget.height() // 2)
        where, there = QPointF(at), QPointF(self.widget.mapToGlobal(at))
        plain = Qt.KeyboardModifier.NoModifier
        none, still = Qt.MouseButton.NoButton, Qt.ScrollPhase.NoScrollPhase
        way = QPoint(0, 120 * clicks)
        event = QWheelEvent(where, there, QPoint(0, 0), way, none, plain, still, False)
        QApplication.sendEvent(self.widget, event)
        self.rest()

    def outside(self) -> list[int]:
        """Return the sprites that reach out of the window."""
        frame = self.controller.frame
        per_mm = frame.size[0] / frame.camera.height
        low, high = -0.5, np.array(frame.size) - 0.5
        ends = {
            i: (
                frame.camera.pixels(pose.center, frame.size),
                pose.scale * max(self.session.state.placements[i].image_mm) * per_mm / 2,
            )
            for i, pose in self.session.poses.items()
        }
        return [
            i
            for i, (at, half) in ends.items()
            if (at - half < low).any() or (at + half > high).any()
        ]

    def share(self) -> float:
        """Return the longer side of the bag's picture, of the window's shorter side."""
        picture = canvas(self.viewer)
        apart = np.abs(picture - picture[2, 2]).max(axis=-1) > 25
        rows, cols = apart.any(axis=1).nonzero()[0], apart.any(axis=0).nonzero()[0]
        return float(max(np.ptp(rows), np.ptp(cols)) / min(apart.shape))


@pytest.fixture
def window(staged: Any, qtbot: Any) -> Window:
    return Window(*staged, qtbot)


def test_a_double_click_inspects_a_packed_object_where_it_lies(window: Window) -> None:
    controller, session = window.controller, window.session
    window.unpack(2)
    before, picture = window.view(), canvas(window.viewer)
    packed = [i for i, state in session.states.items() if state is ObjectState.PACKED]
    at = {i: window.at_object(i) for i in packed}
    front = next(
        i for i, p in at.items() if controller.renderer.picker.packed_at(p.y(), p.x())[:1] == [i]
    )
    window.double_click(at[front])
    assert session.states[front] is ObjectState.INSPECTED
    window.rest()
    # Not the last frame drawn: of cameras a thousandth of a pixel apart the first is kept.
    camera = controller.packed.frame_now().camera
    center = session.boxes.center(front, session.spacing)
    # The camera came to it; it has stayed where it lies among the others, which are dimmed.
    np.testing.assert_allclose(camera.center, center, atol=1e-6)
    image = controller.transition.images[front]
    middle = np.array(image.patch.size) / 2 + (image.patch.row, image.patch.col)
    np.testing.assert_allclose(middle, np.array(controller.frame.size) / 2, atol=12)
    assert max(image.patch.size) > 0.35 * min(controller.frame.size)
    assert controller.packed.dimming < 0.5
    # A drag goes round it, and the object stays with the rest.
    drag(window.widget, QPoint(120, 120), QPoint(60, 20), window.qtbot)
    window.rest()
    assert window.view()[4:] != pytest.approx(before[4:], abs=1.0)
    np.testing.assert_allclose(controller.rotation_of(front), controller.frame.camera.rotation)
    controller.leave()
    window.qtbot.waitUntil(lambda: session.states[front] is ObjectState.PACKED, timeout=20000)
    window.rest()
    assert window.view() == pytest.approx(before)
    assert np.abs(canvas(window.viewer) - picture).max() < 12
    # Beside everything a double click does nothing, and never zooms.
    window.double_click(QPoint(4, 4))
    window.rest()
    assert window.view() == pytest.approx(before)


def test_fit_and_home_are_the_way_back_from_every_zoom_and_pan(window: Window) -> None:
    window.unpack(3)
    fitted = window.view()
    assert window.outside() == []
    for key, modifier in ((None, None), (Qt.Key.Key_R, Qt.KeyboardModifier.ControlModifier)):
        window.wheel(9)
        drag(
            window.widget,
            QPoint(40, 40),
            QPoint(0, 90),
            window.qtbot,
            Qt.KeyboardModifier.ShiftModifier,
        )
        window.rest()
        assert len(window.outside()) == 3
        if key is None:
            window.controller.framing.fit()
        else:
            QTest.keyClick(window.widget, key, modifier)
        window.rest()
        assert window.view() == pytest.approx(fitted, rel=1e-3, abs=0.05)
        assert window.outside() == []


def test_the_bag_fills_the_window_and_makes_room_in_steps(window: Window) -> None:
    assert window.share() > 0.7
    zooms = [window.viewer.scene.camera.zoom]
    for _ in window.session.ids[:-1]:
        window.unpack()
        zooms.append(window.viewer.scene.camera.zoom)
        assert window.outside() == []
    steps = set(np.round(zooms, 3))
    assert zooms == sorted(zooms, reverse=True)
    assert 2 <= len(steps) <= 5, zooms
    window.controller.restore(len(zooms))
    window.controller.finish()
    window.rest()
    assert window.viewer.scene.camera.zoom == pytest.approx(zooms[0])


def test_fit_brings_the_box_and_the_handle_of_the_cut_into_view(window: Window) -> None:
    session, controller = window.session, window.controller
    session.decorations = Decorations.of(decorations=["box"])
    window.rest()
    controller.cut_handle.cut_along(np.array([1.0, 1.0, 0.0]))

    def outside() -> int:
        frame = controller.frame
        lines = controller.cut_handle.lines(frame)
        corners = box_corners(session.bag.lower, session.bag.upper)
        box = transform_points(frame.camera.pivot_from_world(), corners)
        drawn = np.concatenate([lines.rim, lines.arrow, frame.camera.pixels(box, frame.size)])
        return int(((drawn < 0) | (drawn > np.array(frame.size) - 1)).any(axis=1).sum())

    window.wheel(3)
    assert outside() > 0
    QTest.keyClick(window.widget, Qt.Key.Key_R, Qt.KeyboardModifier.ControlModifier)
    window.rest()
    assert outside() == 0
    assert window.share() > 0.4


def test_a_persons_own_zoom_is_never_changed(window: Window) -> None:
    window.wheel(-1)
    zoom = window.viewer.scene.camera.zoom
    window.unpack(4)
    assert window.viewer.scene.camera.zoom == pytest.approx(zoom)
    window.controller.look_from_side(Side.LEFT)
    window.rest()
    assert window.viewer.scene.camera.zoom == pytest.approx(zoom)
    window.controller.framing.fit()
    window.rest()
    assert window.viewer.scene.camera.zoom != pytest.approx(zoom)
    assert window.outside() == []


def test_a_persons_own_perspective_is_never_changed(window: Window) -> None:
    camera, controller = window.viewer.scene.camera, window.controller
    packed = window.session.ids[-1]

    def inspect_and_leave() -> None:
        controller.inspect(packed)
        window.rest()
        # Also where it is changed in an inspection.
        camera.perspective = 25.0
        window.rest()
        controller.leave()

    for wanted, command in (
        (40.0, controller.unpack),
        (40.0, controller.undo),
        (25.0, inspect_and_leave),
    ):
        camera.perspective = wanted
        window.rest()
        command()
        controller.finish()
        window.rest()
        assert camera.perspective == pytest.approx(wanted)
        assert window.outside() == []


@pytest.mark.parametrize("glides", [True, False])
def test_a_side_chosen_in_slices_is_seen_when_the_bag_comes_back(
    window: Window, glides: bool
) -> None:
    dims, camera = window.viewer.dims, window.viewer.scene.camera
    window.controller.fade.allowed = glides
    window.controller.look_from_side(Side.TOP)
    window.rest()
    wanted = window.view()
    window.controller.look_from_side(Side.FRONT)
    window.rest()
    assert window.view() != pytest.approx(wanted, abs=1.0)
    dims.ndisplay = 2
    window.rest()
    slices = camera.zoom, camera.center
    window.controller.look_from_side(Side.LEFT)
    window.controller.look_from_side(Side.TOP)
    window.rest()
    # Slices stay where they are, and 3D where it was.
    assert (camera.zoom, camera.center) == slices
    dims.set_current_step(0, 3)
    dims.ndisplay = 3
    window.rest()
    assert window.view() == pytest.approx(wanted, rel=1e-3, abs=0.05)
    window.unpack(4)
    assert window.outside() == []


def test_commands_leave_slices_in_place_and_what_they_ask_for_is_seen_after(
    window: Window,
) -> None:
    dims, camera, controller = window.viewer.dims, window.viewer.scene.camera, window.controller
    packed = window.session.ids[-1]
    window.unpack(2)
    before = window.view()
    controller.inspect(packed)
    window.rest()
    assert window.view() != pytest.approx(before)
    dims.ndisplay = 2
    camera.zoom, camera.center = 20, (0, 20, 30)
    slices = window.view()

    def do(command: Any, *given: Any) -> None:
        command(*given)
        controller.finish()
        window.rest()
        assert window.view() == slices

    # Left in slices, the way back from the object is gone in 3D.
    do(controller.leave)
    dims.ndisplay = 3
    window.rest()
    assert window.view() == pytest.approx(before)
    dims.ndisplay = 2
    camera.zoom, camera.center = 20, (0, 20, 30)
    slices = window.view()
    do(controller.unpack, 2)
    do(controller.undo)
    do(controller.redo)
    do(controller.inspect, packed)
    do(controller.leave)
    do(controller.framing.fit)
    dims.ndisplay = 3
    window.rest()
    assert controller.framing.is_fit
    assert window.outside() == []


def test_what_is_done_to_slices_leaves_the_view_of_the_bag_as_it_was(window: Window) -> None:
    viewer, framing = window.viewer, window.controller.framing
    dims, camera = viewer.dims, viewer.scene.camera

    def look_at_slices() -> None:
        before = window.view()
        dims.ndisplay = 2
        window.rest()
        window.wheel(3)
        camera.center = (0, 5, 9)
        dims.order = (1, 0, 2)
        dims.order = (0, 1, 2)
        viewer.fit_to_view()
        window.wheel(4)
        dims.ndisplay = 3
        window.rest()
        assert window.view() == pytest.approx(before)

    window.unpack(2)
    look_at_slices()
    assert framing.is_fit
    window.unpack(3)
    assert window.outside() == []
    # As near as a person has zoomed it stays as well.
    window.wheel(2)
    look_at_slices()
    assert not framing.is_fit


@pytest.fixture
def measured(make_napari_viewer_proxy: Any, bag: Any, qtbot: Any) -> Any:
    """Return a window with the phantom on a layer in millimetres."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(760, 560)
    session = Session(*bag, spacing=(1.5, 1.5, 1.5))
    image = viewer.add_image(bag[0], scale=(1.5,) * 3, units=("mm",) * 3)
    controller = SessionController(viewer, session, [image])
    controller.seconds = 0.1
    controller.open()
    yield Window(viewer, controller, qtbot)
    controller.close()


def small_layer(viewer: Any) -> Any:
    """Add a layer in micrometres, in which napari draws everything from then on."""
    cells = np.zeros((8, 8, 8), np.uint8)
    return viewer.add_image(cells, scale=(1, 0.5, 0.5), units=("um",) * 3, visible=False)


def test_the_bag_stays_in_place_when_finer_units_come_and_go(measured: Window) -> None:
    viewer, controller, session = measured.viewer, measured.controller, measured.session
    measured.unpack(2)
    measured.wheel(-1)
    seen = controller.frame
    picture = canvas(viewer)

    def nothing_has_moved() -> None:
        measured.rest()
        assert same_camera(controller.packed.frame_now().camera, seen.camera)
        assert np.abs(canvas(viewer) - picture).max() < 12

    for _ in range(2):
        small = small_layer(viewer)
        nothing_has_moved()
        viewer.layers.remove(small)
        nothing_has_moved()
    # In slices it comes and goes as well.
    viewer.dims.ndisplay = 2
    small = small_layer(viewer)
    viewer.dims.ndisplay = 3
    nothing_has_moved()
    viewer.dims.ndisplay = 2
    viewer.layers.remove(small)
    viewer.dims.ndisplay = 3
    nothing_has_moved()
    # Fitted, it still makes room.
    controller.framing.fit()
    measured.rest()
    small_layer(viewer)
    measured.unpack(3)
    assert measured.outside() == []
    assert len(session.poses) == 5


def test_the_way_back_from_an_inspection_holds_in_finer_units(measured: Window) -> None:
    viewer, controller = measured.viewer, measured.controller
    measured.unpack(1)
    before = controller.frame
    packed = next(i for i, state in measured.session.states.items() if state is ObjectState.PACKED)
    controller.inspect(packed)
    measured.rest()
    near = controller.frame
    small = small_layer(viewer)
    measured.rest()
    assert same_camera(controller.packed.frame_now().camera, near.camera)
    assert measured.session.states[packed] is ObjectState.INSPECTED
    controller.leave()
    measured.qtbot.waitUntil(
        lambda: measured.session.states[packed] is ObjectState.PACKED, timeout=20000
    )
    measured.rest()
    assert same_camera(controller.packed.frame_now().camera, before.camera)
    viewer.layers.remove(small)
    measured.rest()
    assert same_camera(controller.packed.frame_now().camera, before.camera)
    assert controller.framing.is_fit


def test_a_window_of_another_shape_is_laid_out_anew(window: Window) -> None:
    window.unpack(4)
    for width, height in ((620, 640), (900, 480), (560, 420)):
        size = window.session.canvas_size
        window.viewer.window.resize(width, height)
        window.qtbot.waitUntil(
            lambda before=size: window.session.canvas_size != before, timeout=20000
        )
        window.rest()
        assert window.outside() == [], (width, height)


def test_views_from_the_sides_of_a_mirrored_and_turned_layer(
    make_napari_viewer_proxy: Any, bag: Any, qtbot: Any
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(560, 480)
    place = {"scale": (1.5, 1.5, -1.5), "rotate": (20.0, 30.0, 10.0)}
    session = Session(*bag, spacing=(1.5, 1.5, 1.5))
    controller = SessionController(viewer, session, [viewer.add_image(bag[0], **place)])
    controller.open()
    window = Window(viewer, controller, qtbot)
    up = upright(session.queries.bag_up(), session.away_from_table)
    seen = {}
    for side in (Side.FRONT, Side.LEFT, Side.TOP, None):
        controller.look_from_side(side)
        window.rest()
        camera = controller.frame.camera
        seen[side] = camera.linear
        toward, down, _ = camera.linear @ up / np.linalg.norm(camera.linear @ up)
        # Up in the picture, or towards the viewer.
        assert (toward if side in (Side.TOP, None) else -down) == pytest.approx(1.0, abs=1e-3)
        assert window.share() > 0.7, side
    # What is at the left in the view from the front looks at the viewer from the left.
    np.testing.assert_allclose(seen[Side.LEFT][0], -seen[Side.FRONT][2], atol=1e-3)
    # Objects leave towards the viewer: the view against that is the one there is.
    np.testing.assert_allclose(seen[None], seen[Side.TOP], atol=1e-3)
    session.direction = "-x"
    controller.look_from_side(None)
    window.rest()
    leaving = controller.frame.camera.linear @ session.unpack_direction
    assert leaving / np.linalg.norm(leaving) == pytest.approx([1, 0, 0], abs=1e-3)
    controller.close()
