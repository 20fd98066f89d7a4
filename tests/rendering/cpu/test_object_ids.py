"""Object-ID layers and occlusion counts against brute force and by hand."""

from __future__ import annotations

import brute_force
import numpy as np
import pytest
from compared_counts import assert_as_expected, assert_same
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_scenes import VIEWS, along, patches, visible_but

from napari_unpack.geometry.rays import Rays, cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering.cpu import Bricks, id_layers, occlusion_counts


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
@pytest.mark.parametrize("hidden", [(), (2,)])
def test_id_layers_match_brute_force(direction, spacing, fov, hidden) -> None:
    labels = patches(np.random.default_rng(1))
    rays = along(direction, labels.shape, spacing, fov=fov)
    visible = visible_but(hidden, 6)
    expected = brute_force.id_layers(labels, rays, visible, 3)
    assert expected[2].any()
    np.testing.assert_array_equal(id_layers(labels, rays, visible, 3), expected)


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
def test_occlusion_counts_match_brute_force(direction, spacing, fov) -> None:
    labels = patches(np.random.default_rng(2))
    rays = along(direction, labels.shape, spacing, fov=fov)
    visible = visible_but([3], 6)
    expected = brute_force.occlusion(labels, rays, visible)
    assert_as_expected(occlusion_counts(labels, rays, visible), expected)


def test_equation_2_and_its_kin_worked_by_hand() -> None:
    # 8 x 8 x 8, looking along +x (D = -x: objects leave towards smaller x), rays one per voxel
    # column (z, y), samples at voxel centres.
    #   A = 1: z 0-7, y 0-3, x 0-1, a wall in front of half of the image: 8 * 4 * 2 = 64.
    #   B = 2: z 0-7, y 2-5, x 4-6: 8 * 4 * 3 = 96 samples on 32 rays. Columns y 2, 3 are behind
    #     A: 16 rays, 48 samples. eq. 2 = 48 / 96 = 1/2, first_hit = 16 / 32 = 1/2.
    #   C = 3: a clamp around B's back and front on z = 0, y = 5: voxels x = 3 and x = 7; 2
    #     samples on 1 ray where it is first. eq. 2: 0, first_hit: 0. Its second sample lies
    #     behind B: exact = 1/2.
    #   B, then: column (0, 5) is behind C, one more ray and 3 more samples:
    #     eq. 2 = (48 + 3) / 96, first_hit = 17 / 32, exact = 51 / 96.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[:, 0:4, 0:2] = 1
    labels[:, 2:6, 4:7] = 2
    labels[0, 5, 3] = labels[0, 5, 7] = 3
    camera = View(direction=(0, 0, 1), height=8.0).camera(labels.shape, (1, 1, 1))
    rays = cast_rays(camera, (8, 8), voxel_from_world((1, 1, 1)), 1.0)
    counts = occlusion_counts(labels, rays, visible_but([], 4))
    assert counts.ids.tolist() == [1, 2, 3]
    assert counts.samples[1:].tolist() == [64, 96, 2]
    assert counts.hits[1:].tolist() == [32, 32, 1]
    assert counts.occluded_hits[1:].tolist() == [0, 17, 0]
    assert counts.occluded_samples[1:].tolist() == [0, 51, 0]
    assert counts.exact_samples[1:].tolist() == [0, 51, 1]
    # A blocks B; B blocks C's rear; C's front blocks B.
    assert counts.blocks.astype(int).tolist() == [[0, 1, 0], [0, 0, 1], [0, 1, 0]]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.tuples(*[st.floats(-1, 1).filter(lambda v: abs(v) > 0.05)] * 3))
def test_the_papers_free_sets_agree_and_hold_the_exact_one(seed, direction) -> None:
    rng = np.random.default_rng(seed)
    labels = patches(rng, (9, 8, 10), objects=4)
    rays = along(direction, labels.shape, size=(10, 10))
    visible = visible_but([], 5)
    counts = occlusion_counts(labels, rays, visible)
    first_hit = {int(i) for i in counts.ids if counts.occluded_hits[i] == 0}
    eq2 = {int(i) for i in counts.ids if counts.occluded_samples[i] == 0}
    passes = brute_force.listing(labels, rays, visible)
    listed = {int(i) for i in counts.ids if passes[int(i)] == 0}
    exact = {int(i) for i in counts.ids if counts.exact_samples[i] == 0}
    assert first_hit == eq2 == listed
    assert exact <= eq2
    assert {int(i): int(counts.listing_samples[i]) for i in counts.ids} == {
        int(i): passes[int(i)] for i in counts.ids
    }
    blocked = {int(counts.ids[j]) for j in np.flatnonzero(counts.blocks.any(axis=0))}
    assert blocked == {int(i) for i in counts.ids} - exact


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
def test_bricks_and_threads_change_nothing(direction, spacing, fov) -> None:
    labels = np.zeros((40, 37, 61), np.uint16)
    labels[14:31, 9:21, 20:42] = patches(np.random.default_rng(3), (17, 12, 22))
    rays = along(direction, labels.shape, spacing, (110, 111), fov)
    visible = visible_but([1], 6)
    bricks = Bricks.of(labels)
    plain = occlusion_counts(labels, rays, visible, threads=1)
    assert plain.samples.sum() > 500
    for counts in (
        occlusion_counts(labels, rays, visible, bricks, threads=1),
        occlusion_counts(labels, rays, visible, bricks, threads=3),
        occlusion_counts(labels, rays, visible, threads=2),
    ):
        assert_same(counts, plain)
    layers = id_layers(labels, rays, visible, 4, threads=1)
    np.testing.assert_array_equal(id_layers(labels, rays, visible, 4, bricks, threads=2), layers)


def test_a_window_of_the_picture_is_that_part_of_it() -> None:
    labels = patches(np.random.default_rng(4))
    rays = along((0.3, 0.5, 0.8), labels.shape, size=(20, 24))
    visible = visible_but([], 6)
    whole = id_layers(labels, rays, visible, 2)
    part = id_layers(labels, rays.window(5, 7, (9, 11)), visible, 2)
    np.testing.assert_array_equal(part, whole[:, 5:14, 7:18])


def test_a_crop_of_the_volume_counts_the_same_samples_of_its_object() -> None:
    # docs/paper.md, R11: boxes must not move the lattice.
    labels = np.zeros((20, 20, 20), np.uint16)
    labels[6:11, 5:13, 7:12] = 1
    rays = along((0.31, -0.52, 0.87), labels.shape, size=(50, 50))
    whole = occlusion_counts(labels, rays, np.array([False, True]))
    shifted = rays.table.copy()
    shifted[0] -= (5, 4, 6)
    crop = np.ascontiguousarray(labels[5:12, 4:14, 6:13])
    part = occlusion_counts(crop, Rays(shifted, rays.size, rays.step), np.array([False, True]))
    assert whole.samples[1] > 200
    assert part.samples[1] == whole.samples[1]
    assert part.hits[1] == whole.hits[1]


def test_as_many_objects_as_uint16_holds() -> None:
    labels = np.zeros((41, 40, 41), np.uint16)
    labels.reshape(-1)[:65535] = np.arange(1, 65536)
    rays = along((0.001, 0.0013, 1), labels.shape, size=(110, 110), step=0.5)
    visible = visible_but([], 65536)
    counts = occlusion_counts(labels, rays, visible)
    assert counts.blocks is None
    assert len(counts.ids) > 60_000
    assert counts.ids[-1] > 65_000
    ids = id_layers(labels, rays, visible, 1)
    assert len(np.unique(ids)) > 1000


def test_no_object_at_all() -> None:
    labels = np.zeros((4, 5, 6), np.uint16)
    rays = along((0, 0, 1), labels.shape)
    counts = occlusion_counts(labels, rays, np.zeros(1, bool))
    assert counts.ids.tolist() == []
    assert counts.blocks.shape == (0, 0)
    assert not id_layers(labels, rays, np.zeros(1, bool), 2).any()


def test_a_clipping_plane_cuts_ids_away() -> None:
    # Looking along +x; the plane at x = 3.6 keeps larger x: the first object is cut off.
    labels = np.zeros((6, 6, 8), np.uint16)
    labels[:, :, 1:3] = 1
    labels[:, :, 5:7] = 2
    rays = along((0, 0, 1), labels.shape, size=(9, 9))
    clipping = [[[0, 0, 3.6], [0, 0, 1]]]
    ids = id_layers(labels, rays, visible_but([], 3), 2, clipping=clipping)
    assert set(np.unique(ids[0])) == {0, 2}
    assert not ids[1].any()
    with pytest.raises(ValueError, match="clipping"):
        id_layers(labels, rays, visible_but([], 3), clipping=[[0, 0, 1]])
