import numpy as np
import pytest

from napari_unpack import raycasting
from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering import gl_backend
from napari_unpack.rendering.occlusion_pass import counts_of_runs

COUNTERS = ("samples", "hits", "occluded_hits", "occluded_samples", "exact_samples")


def test_runs_worked_out_by_hand():
    # Three rays of runs (object: samples), nearest first:
    #   1:2, 2:3, 1:4      2:5      3:1, 2:2
    ids = np.array([[1, 2, 3], [2, 0, 2], [1, 0, 0]], dtype=np.int32)
    samples = np.array([[2, 5, 1], [3, 0, 2], [4, 0, 0]], dtype=np.int32)
    counts = counts_of_runs(ids, samples, np.array([False, True, True, True, True]))
    assert counts.ids.tolist() == [1, 2, 3]
    assert counts.samples.tolist() == [0, 6, 10, 1, 0]
    assert counts.hits.tolist() == [0, 1, 3, 1, 0]
    assert counts.occluded_hits.tolist() == [0, 0, 2, 0, 0]
    # Eq. 2 forgives object 1 its re-entry behind 2; "exact" does not.
    assert counts.occluded_samples.tolist() == [0, 0, 5, 0, 0]
    assert counts.exact_samples.tolist() == [0, 4, 5, 0, 0]
    # 1 blocks 2, 2 blocks 1 (its second run), 3 blocks 2.
    assert counts.blocks.tolist() == [
        [False, True, False],
        [True, False, False],
        [False, True, False],
    ]


def test_no_run_at_all_counts_nothing():
    nothing = np.zeros((6, 0), np.int32)
    counts = counts_of_runs(nothing, nothing, np.array([False, True]))
    assert counts.ids.size == 0
    assert counts.samples.tolist() == [0, 0]


@pytest.mark.parametrize("seed", range(6))
def test_counts_match_the_cpu_where_rays_are_clear_of_voxel_faces(gl, seed):
    rng = np.random.default_rng(seed)
    shape, spacing = (14, 17, 20), (1.3, 1.0, 0.8) if seed % 2 else (1.0, 1.0, 1.0)
    # Blocks of 2 voxels in 8 kinds: rays meet far more than the six runs of one pass.
    labels = rng.integers(0, 8, (7, 9, 10)).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    labels = np.ascontiguousarray(labels[:14, :17, :20]).astype(np.uint16) * 30
    visible = np.zeros(211, bool)
    visible[[30, 60, 90, 150, 210]] = True
    camera = View(direction=tuple(rng.normal(size=3))).camera(shape, spacing)
    rays = cast_rays(camera, (24, 26), voxel_from_world(spacing), 0.61)
    wanted = raycasting.occlusion_counts(labels, rays, visible)
    bricks = raycasting.Bricks.of(labels) if seed % 3 else None
    found = gl_backend.occlusion_counts(labels, rays, visible, bricks)
    np.testing.assert_array_equal(found.ids, wanted.ids)
    np.testing.assert_array_equal(found.blocks, wanted.blocks)
    # None of these views has a sample within float32's reach of a voxel face (test_parity.py).
    for name in COUNTERS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)
