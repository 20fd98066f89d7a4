"""While the bag is turned the canvas is drawn once a picture, and for all else at once."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest
from qtpy.QtWidgets import QApplication

from napari_unpack.layers.compat import native_canvas
from napari_unpack.layers.view_camera import same_camera
from napari_unpack.viewer import packed_renderer, redraw_throttle


@pytest.fixture
def casting(staged, monkeypatch):
    """Return (viewer, stage, allowed, drawn): casts of a moving camera wait for `allowed`."""
    viewer, controller = staged
    controller.recolor_at_rest = False
    assert controller.settle(30)
    allowed, cast, drawn = Event(), packed_renderer.cast_packed, []

    def wait(*arguments):
        assert allowed.wait(30)
        return cast(*arguments)

    monkeypatch.setattr(packed_renderer, "cast_packed", wait)
    monkeypatch.setattr(redraw_throttle, "LONGEST_MS", 20_000)
    native_canvas(viewer).events.draw.connect(lambda _: drawn.append(controller.packed.image))
    yield viewer, controller, allowed, drawn
    allowed.set()


def turn(viewer, degrees: float) -> None:
    a, b, c = viewer.scene.camera.angles
    viewer.scene.camera.angles = a, b + degrees, c
    for _ in range(4):
        QApplication.processEvents()


def test_turned_on_it_waits_for_the_picture_which_is_of_the_newest_camera(casting) -> None:
    viewer, controller, allowed, drawn = casting
    turn(viewer, 5)
    assert len(drawn) == 1
    for _ in range(6):
        turn(viewer, 5)
    assert len(drawn) == 1
    before = controller.packed.image
    allowed.set()
    assert controller.settle(30)
    assert drawn[-1] is controller.packed.image is not before
    assert same_camera(controller.packed.image.camera, controller.packed.frame_now().camera)


def test_the_picture_after_next_is_begun_without_a_redraw(casting, qtbot, monkeypatch) -> None:
    viewer, controller, allowed, _ = casting
    turn(viewer, 5)
    turn(viewer, 5)
    newest = controller.packed.frame_now().camera
    assert not same_camera(newest, controller.frame.camera)
    cameras = []
    show = controller.packed.show

    def shown(shot, *rest, **kwargs):
        # Closing takes the image away.
        if shot is not None:
            cameras.append(shot.camera)
        show(shot, *rest, **kwargs)

    monkeypatch.setattr(controller.packed, "show", shown)
    allowed.set()
    qtbot.waitUntil(lambda: len(cameras) > 1, timeout=30_000)
    assert any(same_camera(camera, newest) for camera in cameras)


def test_a_pan_a_zoom_and_a_selection_are_drawn_at_once(casting, session) -> None:
    viewer, controller, _, drawn = casting
    turn(viewer, 5)
    camera = viewer.scene.camera
    for change in (
        lambda: setattr(camera, "zoom", camera.zoom * 1.1),
        lambda: setattr(camera, "center", tuple(np.array(camera.center) + 2.0)),
        lambda: controller.sprites.dim(0.5),
    ):
        before = len(drawn)
        change()
        for _ in range(4):
            QApplication.processEvents()
        assert len(drawn) > before


def test_it_waits_no_longer_than_it_may_and_closed_it_leaves_the_canvas_alone(
    casting, qtbot, monkeypatch
) -> None:
    viewer, controller, allowed, drawn = casting
    turn(viewer, 5)
    monkeypatch.setattr(redraw_throttle, "LONGEST_MS", 300)
    turn(viewer, 5)
    qtbot.waitUntil(lambda: len(drawn) > 1, timeout=10_000)
    assert "update" in vars(native_canvas(viewer))
    allowed.set()
    controller.close()
    assert "update" not in vars(native_canvas(viewer))
