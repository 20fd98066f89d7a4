"""napari's clipping planes of the packed layer cut the picture, the picking, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from viewer_fixtures import canvas

MIDDLE = {"position": (20.0, 24.0, 30.0), "normal": (0.0, 0.0, 1.0), "enabled": True}


def extent(picture: np.ndarray) -> tuple[int, int]:
    """Return first and last column that shows something."""
    cols = np.flatnonzero(((picture - picture[0, 0]).max(axis=2) > 40).any(axis=0))
    return int(cols[0]), int(cols[-1])


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_a_plane_cuts_what_lies_behind_it_and_taking_it_away_brings_it_back(
    staged, session, backend
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    controller.backend = backend
    viewer.scene.camera.angles = (0, 0, 90)
    assert controller.settle(60)
    whole = canvas(viewer)
    controller.packed.experimental_clipping_planes = [MIDDLE]
    assert controller.settle(60)
    cut = canvas(viewer)
    np.testing.assert_allclose(session.clipping, [[[20, 24, 30], [0, 0, 1]]])
    # The bag's middle in x is the middle of its two ends.
    centre = controller.frame.camera.project(
        np.array([[20.0, 24.0, 30.0]]) * session.spacing, controller.frame.size
    )[0, 1]
    scale = whole.shape[1] / controller.frame.size[1]
    seen = extent(cut)
    kept = [abs(end - centre * scale) < 6 for end in seen]
    assert sum(kept) == 1
    assert seen[kept.index(False)] == pytest.approx(extent(whole)[kept.index(False)], abs=2)
    controller.packed.experimental_clipping_planes[0].enabled = False
    assert controller.settle(60)
    assert len(session.clipping) == 0
    np.testing.assert_allclose(canvas(viewer), whole, atol=1)


def test_an_object_that_leaves_a_cut_bag_leaves_it_cut(staged, session) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    session.clipping = [[[20, 24, 30], [0.3, 0, 1]]]
    assert len(controller.packed.experimental_clipping_planes) == 1
    controller.unpack(1)
    controller.finish()
    assert controller.settle(60)
    viewer.layers["Sprites"].visible = False
    windowed = canvas(viewer)
    session.clipping = None
    assert controller.settle(60)
    session.clipping = [[[20, 24, 30], [0.3, 0, 1]]]
    assert controller.settle(60)
    np.testing.assert_allclose(canvas(viewer), windowed, atol=1)


def test_what_is_cut_away_cannot_be_picked(staged, session) -> None:
    controller = staged[1]
    camera, size = controller.frame.camera, controller.frame.size
    row, col = camera.project(session.boxes.center(1, session.spacing)[None], size)[0]
    before = controller.renderer.picker.packed_at(row, col)
    assert 1 in before
    # Ball 1 lies at x < 22, and all of that goes.
    session.clipping = [[[0, 0, 23], [0, 0, 1]]]
    assert 1 not in controller.renderer.picker.packed_at(row, col)


def test_the_users_own_planes_are_taken_over(make_napari_viewer_proxy, bag, session) -> None:
    from napari_unpack.viewer.controller import SessionController

    viewer = make_napari_viewer_proxy(show=True)
    image = viewer.add_image(bag[0], scale=session.spacing)
    image.experimental_clipping_planes = [MIDDLE, {**MIDDLE, "enabled": False}]
    controller = SessionController(viewer, session, (image,))
    controller.open()
    try:
        np.testing.assert_allclose(session.clipping, [[[20, 24, 30], [0, 0, 1]]])
        assert len(controller.packed.experimental_clipping_planes) == 1
    finally:
        controller.close()
    assert len(image.experimental_clipping_planes) == 2
