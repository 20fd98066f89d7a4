"""The paper's first method: the driver's own counters against the CPU ray caster's."""

import numpy as np
import pytest

from napari_unpack import occlusion_ratios
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.gl import backend as gl_backend
from napari_unpack.rendering.gl.occlusion_queries import picture_window


def scene(seed):
    rng = np.random.default_rng(seed)
    shape, spacing = (15, 18, 21), (1.3, 1.0, 0.8) if seed % 2 else (1.0, 1.0, 1.0)
    labels = np.zeros(shape, np.uint16)
    for name in rng.choice(400, 9, replace=False) + 1:
        low = rng.integers(0, np.array(shape) - 3)
        labels[tuple(slice(a, a + n) for a, n in zip(low, rng.integers(2, 9, 3), strict=True))] = (
            name
        )
    visible = np.bincount(labels.reshape(-1)) > 0
    visible[0] = False
    visible[np.flatnonzero(visible)[2]] = False
    camera = View(direction=tuple(rng.normal(size=3))).camera(shape, spacing)
    return labels, cast_rays(camera, (25, 31), voxel_from_world(spacing), 0.61), visible


@pytest.mark.parametrize("seed", range(8))
def test_queries_count_what_the_cpu_counts(gl, seed):
    labels, rays, visible = scene(seed)
    wanted = cpu.occlusion_counts(labels, rays, visible)
    found = gl_backend.first_hits(labels, rays, visible, label_boxes(labels))
    assert wanted.occluded_hits.sum() > 0
    # Objects that others cover whole in the volume have a box but no voxel, hence no query.
    assert set(wanted.ids.tolist()) <= set(found.ids.tolist())
    np.testing.assert_array_equal(found.hits, wanted.hits[found.ids])
    np.testing.assert_array_equal(found.occluded_hits, wanted.occluded_hits[found.ids])


def test_a_plate_before_half_a_plate_worked_out_by_hand(gl):
    # Looking along +z at 4 x 4 voxels, one ray each: 7 covers the left half of 9.
    labels = np.zeros((4, 4, 4), np.uint16)
    labels[0, :, :2], labels[2] = 7, 9
    camera = View(direction=(1, 0, 0), height=4.0).camera(labels.shape, (1, 1, 1))
    rays = cast_rays(camera, (4, 4), voxel_from_world((1, 1, 1)), 0.5)
    visible = np.zeros(10, bool)
    visible[[7, 9]] = True
    found = gl_backend.first_hits(labels, rays, visible, label_boxes(labels))
    assert found.ids.tolist() == [7, 9]
    assert found.hits.tolist() == [8, 16]
    assert found.occluded_hits.tolist() == [0, 8]
    assert found.ratios == {7: 0.0, 9: 0.5}
    visible[7] = False
    assert gl_backend.first_hits(labels, rays, visible, label_boxes(labels)).ratios == {9: 0.0}


def test_the_window_of_a_box_holds_its_projection_and_little_more():
    camera = View(direction=(1, 0, 0), height=10.0).camera((10, 10, 10), (1, 1, 1))
    rays = cast_rays(camera, (10, 10), voxel_from_world((1, 1, 1)), 1.0)
    column, row, width, height = picture_window(rays, np.array([2, 3, 5]), np.array([4, 5, 9]))
    columns, rows = set(range(column, column + width)), set(range(row, row + height))
    # At one pixel a voxel, row 0 lies at either end of y, column 0 at either end of x.
    assert {3, 4} <= rows or {5, 6} <= rows
    assert {5, 6, 7, 8} <= columns or {1, 2, 3, 4} <= columns
    assert width <= 6
    assert height <= 4


def test_what_queries_cannot_do_is_refused(gl):
    labels = np.arange(1, 301, dtype=np.uint16).reshape(300, 1, 1)
    rays = cast_rays(
        View().camera(labels.shape, (1, 1, 1)), (4, 4), voxel_from_world((1, 1, 1)), 1.0
    )
    visible = np.ones(301, bool)
    visible[0] = False
    with pytest.raises(ValueError, match="up to 256 objects, got 300"):
        gl_backend.first_hits(labels, rays, visible, label_boxes(labels))
    near = cast_rays(
        View(fov=40).camera((4, 4, 4), (1, 1, 1)), (4, 4), voxel_from_world((1, 1, 1)), 1.0
    )
    small = np.ones((4, 4, 4), np.uint16)
    with pytest.raises(ValueError, match="parallel rays"):
        gl_backend.first_hits(small, near, np.array([False, True]), label_boxes(small))


def test_the_api_measures_first_hit_ratios_by_queries(gl):
    labels = scene(3)[0]
    arguments = {"view": (0.2, 0.9, -0.4), "size": (40, 40), "spacing": (1.3, 1.0, 0.8)}
    wanted = occlusion_ratios(labels, **arguments, backend="cpu")
    assert occlusion_ratios(labels, **arguments, method="queries") == pytest.approx(wanted)
    with pytest.raises(ValueError, match="first_hit"):
        occlusion_ratios(labels, definition="exact", method="queries")
    for backend, why in (("cpu", "asks the graphics card"), ("cuda", "backend must be one of")):
        with pytest.raises(ValueError, match=why):
            occlusion_ratios(labels, method="queries", backend=backend)
    with pytest.raises(ValueError, match="method must be one of"):
        occlusion_ratios(labels, method="guess")
