import numpy as np
import pytest
from crowded_bags import assert_counted_as_by_the_cpu

from napari_unpack.rendering.gl.occlusion_runs import counts_of_runs


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
    assert_counted_as_by_the_cpu(seed)
