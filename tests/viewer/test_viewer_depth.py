"""The packed picture among other layers, by depth; and under the hand, where it is coarser."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from skimage.registration import phase_cross_correlation

from napari_unpack.viewer import packed_renderer
from napari_unpack.viewer.scheduler import IdlePhase
from viewer_fixtures import canvas


def greenness(viewer, controller, world) -> float:
    """Return how green the canvas is around a point, 0 to 1."""
    picture = canvas(viewer)
    row, col = controller.frame.camera.project(
        np.asarray(world, dtype=float)[None], controller.frame.size
    )[0]
    scale = np.array(picture.shape[:2]) / controller.frame.size
    r, c = (round(float(v)) for v in (row * scale[0], col * scale[1]))
    patch = picture[r - 2 : r + 3, c - 2 : c + 3].reshape(-1, 3)
    return float((patch[:, 1] - patch[:, [0, 2]].max(axis=1)).clip(0).mean() / 255)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_a_point_is_hidden_behind_an_object_and_seen_before_it(staged, session, backend) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    controller.backend = backend
    function = session.transfer_function
    session.transfer_function = type(function)([(0, 0.0), (300, 0.0), (500, 1.0), (4000, 1.0)])
    session.apply_hues(dict.fromkeys(session.ids, 0.0), undoable=False)
    center = session.boxes.center(1, session.spacing)
    for fov, above, behind in product((0, 35), (True, False), (-40, 10)):
        viewer.scene.camera.perspective = fov
        assert controller.settle(60)
        world = center + behind * controller.frame.camera.direction
        points = viewer.add_points(
            [world], size=8, face_color=[0, 1, 0, 1], border_width=0, name="probe"
        )
        if not above:
            viewer.layers.move(len(viewer.layers) - 1, 0)
        viewer.layers.selection.active = controller.packed
        assert controller.settle(60)
        green = greenness(viewer, controller, world)
        assert (green > 0.6) if behind < 0 else (green < 0.25), (fov, above, behind, green)
        viewer.layers.remove(points.name)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_the_picture_under_the_hand_differs_little_from_the_one_at_rest(
    staged, qtbot, monkeypatch, backend
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    controller.backend = backend
    # A machine that casts such a small bag in no time would give the hand all rays.
    monkeypatch.setattr(packed_renderer, "FRAME_SECONDS", 0.0)
    monkeypatch.setattr(packed_renderer, "GL_FRAME_SECONDS", 0.0)
    viewer.window.resize(1000, 900)
    assert controller.settle(60)
    # Begin anew with the fewest rays.
    controller.renderer.packed_renderer.backend_changed()
    assert controller.settle(60)
    held = [True]
    controller.scheduler.hold_idle("test", lambda: held[0], IdlePhase.IMAGE)
    viewer.scene.camera.angles = (12, -35, 70)
    qtbot.waitUntil(
        lambda: (
            controller.packed.image is not None
            and controller.packed.image.camera is controller.frame.camera
            and controller.packed.image.size != controller.frame.size
        ),
        timeout=20000,
    )
    assert min(controller.packed.image.size) >= 384
    coarse = canvas(viewer)
    assert controller.casts_with == backend
    monkeypatch.undo()
    held[0] = False
    assert controller.settle(60)
    assert controller.packed.image.size == controller.frame.size
    fine = canvas(viewer)
    assert fine.std() > 10
    difference = np.abs(coarse - fine)
    assert difference.mean() < 4
    # Neither brighter nor moved: where the bag is seen the means agree, and no shift of one image
    # brings it nearer to the other.
    seen = fine.max(axis=2) > 60
    assert abs(coarse[seen].mean() - fine[seen].mean()) < 4
    shift, _, _ = phase_cross_correlation(
        fine.mean(axis=2), coarse.mean(axis=2), upsample_factor=10
    )
    assert np.abs(shift).max() < 0.5
