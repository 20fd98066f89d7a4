"""Whatever commands follow each other, the canvas shows what a fresh image of the session shows."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.rendering.compose import scene_image
from napari_unpack.session import ObjectState
from opened_panel import at_rest
from viewer_fixtures import canvas

BURSTS = 6


def shown_times(controller: Any) -> dict[int, int]:
    """Count in how many of the three layers every object that is not hidden shows."""
    states = controller.session.states
    return {
        i: (i in controller.transition.images)
        + (i in controller.sprites.sprites)
        + (state is ObjectState.PACKED)
        for i, state in states.items()
        if state is not ObjectState.HIDDEN
    }


def differs(viewer: Any, controller: Any) -> int:
    """Return the pixels of the largest place where the canvas is not as a fresh image is."""
    frame, shot = controller.frame, canvas(viewer)
    fresh = scene_image(controller.session.scene(), frame.camera, frame.size, backend="cpu")
    ground = shot[2, 2]
    apart = np.abs(shot - 255.0 * fresh[..., :3] - (1.0 - fresh[..., 3:]) * ground).max(axis=-1)
    # Thin lines are the silhouettes of sprites.
    places, count = ndimage.label(ndimage.binary_erosion(apart > 45, iterations=3))
    return int(max(np.bincount(places.ravel())[1:], default=0)) if count else 0


def test_what_goes_back_before_its_sprite_is_there_is_shown_once(staged: Any, qtbot: Any) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    before = canvas(viewer)
    controller.unpack(2)
    # At once: no sprite was cast yet.
    controller.go_to(0)
    at_rest(controller, qtbot)
    assert set(shown_times(controller).values()) == {1}
    assert controller.transition.images == {}
    assert np.abs(canvas(viewer) - before).max() < 12


def test_the_canvas_shows_a_fresh_image_after_any_commands(
    staged: Any, session: Any, qtbot: Any
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    controller.seconds, rng = 0.1, np.random.default_rng(3)

    def some() -> int:
        return int(rng.choice(session.ids))

    def delete() -> None:
        if len(session.ids) > 4:
            session.delete(some())

    commands = [
        *[lambda: controller.unpack(int(rng.integers(1, 3)))] * 4,
        *[lambda: controller.restore(int(rng.integers(1, 3)))] * 2,
        *[controller.undo] * 4,
        *[controller.redo] * 2,
        *[delete] * 2,
        lambda: controller.go_to(int(rng.integers(0, 4))),
        lambda: session.hide(some()),
        lambda: session.show(),
        lambda: controller.inspect(next(i for i, n in shown_times(controller).items() if n)),
        controller.leave,
    ]
    given: list[int] = []
    for _ in range(BURSTS):
        for k in rng.integers(0, len(commands), 3):
            given.append(int(k))
            commands[k]()
            if rng.random() < 0.5:
                controller.settle(0.03)
        controller.renderer.end_inspection()
        at_rest(controller, qtbot)
        assert set(shown_times(controller).values()) <= {1}, given
        assert differs(viewer, controller) < 20, given


def test_an_inspected_object_that_is_deleted_is_inspected_no_longer(
    staged: Any, session: Any, qtbot: Any
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    controller.inspect(7)
    controller.settle(0.6)
    session.delete(7)
    # Every redraw asks where it is.
    viewer.scene.camera.angles = (10.0, 20.0, 30.0)
    at_rest(controller, qtbot)
    assert controller.inspected == 0
    assert differs(viewer, controller) < 20


def test_a_sprite_turned_and_turned_back_at_once_is_as_before(
    staged: Any, session: Any, qtbot: Any
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    (one,) = controller.unpack(1)
    controller.finish()
    at_rest(controller, qtbot)
    before = canvas(viewer)
    controller.renderer.held.turn(one, rotation_about((0.3, 1.0, 0.5), 0.9))
    controller.renderer.held.turned(one)
    controller.undo()
    at_rest(controller, qtbot)
    assert np.abs(canvas(viewer) - before).max() < 12


TWICE = """
import napari
from test_shown_picture import differs, shown_times
from viewer_fixtures import phantom
from napari_unpack.layers import compat
from napari_unpack.session import Session
from napari_unpack.viewer.controller import SessionController

viewer = napari.Viewer()
viewer.window.resize(420, 300)
controller = SessionController(viewer, Session(*phantom(), spacing=(1.5, 1.5, 1.5)))
controller.seconds = 0.1
controller.open()
controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
assert controller.settle(60)
for steps in (1, 0):
    # Back at once, before the sprites are there.
    controller.unpack(3)
    controller.go_to(steps)
    controller.finish()
    assert controller.settle(30)
    assert set(shown_times(controller).values()) == {1}, steps
    assert differs(viewer, controller) < 20, steps
print("pixels a point:", compat.pixel_scale(viewer))
viewer.close()
"""


def test_nothing_is_drawn_twice_on_a_screen_of_twice_the_pixels() -> None:
    tests = Path(__file__).parents[1]
    path = os.pathsep.join(map(str, (tests, tests / "viewer")))
    child = subprocess.run(
        [sys.executable, "-c", TWICE],
        env={**os.environ, "QT_SCALE_FACTOR": "2", "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert "pixels a point: 2.0" in child.stdout, child.stderr


def _shown(picture: np.ndarray) -> np.ndarray:
    """Return (H, W) of bool: where a picture is not of the background, which is in its corner."""
    colors = np.asarray(picture)[..., :3].astype(int)
    return np.abs(colors - colors[2, 2]).max(axis=2) > 25


def test_a_screenshot_of_twice_the_size_shows_what_the_window_does_further_off(
    staged: Any, qtbot: Any
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    viewer.scene.camera.zoom *= 1.8
    at_rest(controller, qtbot)
    before = canvas(viewer)
    picture = viewer.screenshot(scale=2, flash=False)
    at_rest(controller, qtbot)
    assert (np.abs(canvas(viewer) - before).max(axis=2) > 3).mean() < 0.001
    viewer.scene.camera.zoom /= 2
    at_rest(controller, qtbot)
    wanted, found = _shown(canvas(viewer)), _shown(picture)[::2, ::2]
    assert found.shape == wanted.shape
    assert (found & wanted).sum() / (found | wanted).sum() > 0.97


def test_a_figure_of_all_holds_the_bag_and_what_is_out_and_moves_nothing(
    staged: Any, qtbot: Any
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = controller.overlays.outlines_unpackable = False
    controller.unpack(3)
    controller.finish()
    at_rest(controller, qtbot)
    assert controller.framing.is_fit
    parts = ndimage.label(_shown(canvas(viewer)))[1]
    assert parts >= 4
    zoom = viewer.scene.camera.zoom
    for closer in (1.0, 2.5):
        viewer.scene.camera.zoom = zoom * closer
        at_rest(controller, qtbot)
        before, fit = canvas(viewer), controller.framing.is_fit
        shown = _shown(viewer.export_figure(scale_factor=9, flash=False))
        assert ndimage.label(shown)[1] == parts
        assert not shown[[0, -1]].any()
        assert not shown[:, [0, -1]].any()
        # Nothing glides back either.
        assert controller.renderer.glides.settled
        at_rest(controller, qtbot)
        assert controller.framing.is_fit == fit == (closer == 1.0)
        assert (np.abs(canvas(viewer) - before).max(axis=2) > 3).mean() < 0.001
