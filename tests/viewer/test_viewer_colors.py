"""New colours come in a short transition; background, box and scale belong to the picture."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.decorations import scale_mark
from napari_unpack.geometry.length_unit import MICRO, LengthUnit
from napari_unpack.viewer import animation, canvas_backend
from viewer_fixtures import canvas


@pytest.fixture
def slow(staged, monkeypatch):
    """Return (viewer, stage) and the time of its transitions, a list of one number, s."""
    viewer, controller = staged
    controller.recolor_at_rest = False
    assert controller.settle(30)
    time = [100.0]
    monkeypatch.setattr(controller.fade.animation, "now", lambda: time[0])
    controller.fade.allowed = True
    yield viewer, controller, time
    monkeypatch.undo()


def move_on(controller, time: list[float], part: float) -> None:
    """Let a part of a transition's time go by."""
    time[0] += animation.FADE_SECONDS * part
    controller.fade.animation.tick(time[0])


def finished(controller, time: list[float]) -> None:
    move_on(controller, time, 1.1)
    assert not controller.fade.running
    assert controller.settle(30)


def test_half_way_the_canvas_is_half_of_both_and_goes_on_from_what_is_seen(
    slow, session, qtbot
) -> None:
    viewer, controller, time = slow
    passes, before = controller.renderer.packed_renderer.passes, canvas(viewer)
    session.apply_hues({i: (h + 0.4) % 1 for i, h in session.hues.items()}, undoable=False)
    qtbot.waitUntil(lambda: controller.fade.running, timeout=10000)
    move_on(controller, time, 0.5)
    half = canvas(viewer)
    finished(controller, time)
    after = canvas(viewer)
    assert controller.renderer.packed_renderer.passes == passes + 1
    assert np.abs(after - before).max() > 80
    assert np.abs(half - (before + after) / 2).max() <= 3
    a_second_change_sets_out_from_what_is_seen(slow, session, qtbot)
    who_asks_for_reduced_motion_gets_new_colours_at_once(slow, session)


def a_second_change_sets_out_from_what_is_seen(slow, session, qtbot) -> None:
    viewer, controller, time = slow
    hues = session.hues
    session.apply_hues({i: (h + 0.4) % 1 for i, h in hues.items()}, undoable=False)
    qtbot.waitUntil(lambda: controller.fade.running, timeout=10000)
    move_on(controller, time, 0.5)
    half, passes = canvas(viewer), controller.renderer.packed_renderer.passes
    session.apply_hues({i: (h + 0.2) % 1 for i, h in hues.items()}, undoable=False)
    qtbot.waitUntil(lambda: controller.renderer.packed_renderer.is_full, timeout=10000)
    assert np.abs(canvas(viewer) - half).max() <= 3
    finished(controller, time)
    assert controller.renderer.packed_renderer.passes == passes + 1
    # The picture under the hand, coarser, comes as soon as this is told.
    shown = canvas(viewer)
    controller.renderer.packed_renderer.recast()
    assert controller.settle(30)
    assert np.abs(canvas(viewer) - shown).mean() < 0.3


def who_asks_for_reduced_motion_gets_new_colours_at_once(slow, session) -> None:
    viewer, controller, _ = slow
    controller.fade.allowed = False
    before = canvas(viewer)
    session.apply_hues({i: (h + 0.4) % 1 for i, h in session.hues.items()}, undoable=False)
    assert controller.settle(30)
    assert not controller.fade.running
    assert np.abs(canvas(viewer) - before).max() > 80


def test_the_graphics_card_casts_hues_on_their_way(slow, session, qtbot, monkeypatch) -> None:
    _, controller, time = slow
    monkeypatch.setattr("napari_unpack.viewer.packed_renderer.FADING_SECONDS", 60.0)
    controller.backend = "gl"
    assert controller.settle(60)
    uploads = controller.renderer.canvas_backend.uploads
    seen = []
    tints = canvas_backend.CanvasBackend.packed_tints

    def watched(self):
        seen.append(tints(self)[7, :3].copy())
        return tints(self)

    monkeypatch.setattr(canvas_backend.CanvasBackend, "packed_tints", watched)
    session.apply_hues({7: (session.hues[7] + 0.3) % 1}, undoable=False)
    qtbot.waitUntil(lambda: controller.fade.running, timeout=10000)
    move_on(controller, time, 0.5)
    qtbot.waitUntil(lambda: len(seen) > 1, timeout=10000)
    finished(controller, time)
    np.testing.assert_allclose(seen[-1], session.packed_tints()[7, :3])
    assert any(np.abs(tint - seen[-1]).max() > 0.05 for tint in seen)
    assert controller.renderer.canvas_backend.uploads == uploads
    assert not controller.renderer.canvas_backend.hues_on_the_way


def test_backgrounds_are_behind_the_bag_and_cost_no_pass(staged, session, qtbot) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    assert controller.settle(30)
    passes, plain = controller.renderer.packed_renderer.passes, canvas(viewer)
    bag = np.abs(plain - plain[0, 0]).max(axis=2) > 60
    session.decorations = Decorations.of("#ffffff,#000000")
    gradient = canvas(viewer)
    assert gradient[2, 5].min() > 240
    assert gradient[-3, 5].max() < 15
    assert np.abs(gradient - plain)[bag].mean() < 12
    picture = np.zeros((10, 20, 3), np.uint8)
    picture[...] = (10, 200, 30)
    session.decorations = Decorations.of(picture)
    np.testing.assert_allclose(canvas(viewer)[3, 3], (10, 200, 30), atol=2)
    session.decorations = Decorations.of("light", ["box", "scale"])
    light = canvas(viewer)
    np.testing.assert_allclose(light[3, 3], (242, 243, 245), atol=1)
    assert controller.settle(30)
    assert controller.renderer.packed_renderer.passes == passes


def test_the_box_is_hidden_by_the_bag_in_front_of_it(staged, session) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    viewer.scene.camera.angles = (15, 35, 10)
    # The bag fills the window, and corners of its box would lie outside.
    viewer.scene.camera.zoom *= 0.6
    controller.settle(30)
    bare = canvas(viewer)
    session.decorations = Decorations.of("dark", ["box"])
    boxed = canvas(viewer)
    low = (session.boxes.lower.min(0) - 0.5) * session.spacing
    high = (session.boxes.upper.max(0) - 0.5) * session.spacing
    from napari_unpack.geometry.boxes import box_corners

    corners = box_corners(low, high)
    depth = -(corners - controller.frame.camera.center) @ controller.frame.camera.rotation[0]
    near, far = corners[depth.argmin()], corners[depth.argmax()]

    def changed(corner) -> float:
        neighbours = [c for c in corners if np.sum(~np.isclose(c, corner)) == 1]
        total = 0.0
        for other in neighbours:
            points = corner + np.linspace(0.02, 0.98, 40)[:, None] * (other - corner)
            rows, cols = (
                np.rint(controller.frame.camera.project(points, controller.frame.size))
                .astype(int)
                .T
            )
            total += float((np.abs(boxed - bare).max(axis=2)[rows, cols] > 15).mean())
        return total / len(neighbours)

    assert changed(near) > 0.9
    assert changed(far) < 0.7


def test_the_scale_bar_is_that_of_pictures_in_the_unit_of_the_session(staged, session) -> None:
    viewer, controller = staged
    bar = viewer.canvas.overlays.scale_bar
    bar.visible = True
    session.decorations = Decorations.of("light")
    assert controller.settle(60)
    bare = canvas(viewer)
    seen = []
    for unit in ("mm", "voxels", LengthUnit(MICRO, 1000.0)):
        session.length_unit = unit
        session.decorations = Decorations.of("light", ["scale"])
        assert controller.settle(60)
        # One bar is enough.
        assert not bar.visible
        shown = canvas(viewer)
        frame, unit = controller.frame, session.length_unit
        wanted = np.zeros(frame.size, bool)
        mark, row, col = scale_mark(frame.camera, frame.size, session.decorations.ink, unit)
        wanted[row:, col:] = mark[..., 3] > 0.5
        away = np.abs(shown - bare).max(axis=2) > 60
        assert (away == wanted).mean() > 0.999
        assert away[wanted].mean() > 0.9
        seen.append(shown)
    # 1.5 mm are a voxel: another round number, another length.
    assert np.abs(seen[0] - seen[1]).max() > 60
    controller.close()
    assert viewer.canvas.background_color_override is None
