"""Runs kept from one look: their counts against a cast of every step, brute force and by hand."""

from __future__ import annotations

import brute_force
import numpy as np
import pytest
from compared_counts import assert_as_expected, assert_same
from ray_scenes import VIEWS, along, patches, visible_but

from napari_unpack.rendering.cpu import Bricks, Runs, occlusion_counts, occlusion_runs
from napari_unpack.rendering.cpu.label_runs import LONGEST, longest_ray


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
def test_every_step_of_an_unpacking_is_as_if_cast_anew(direction, spacing, fov) -> None:
    labels = np.zeros((33, 26, 29), np.uint16)
    labels[9:20, 4:22, 7:20] = patches(np.random.default_rng(5))
    rays = along(direction, labels.shape, spacing, (45, 47), fov)
    bricks = Bricks.of(labels)
    runs = occlusion_runs(labels, rays, visible_but([], 6), bricks)
    met, hidden = set(), set()
    for gone in ([], [4], [4, 1], [4, 1, 5], [4, 1, 5, 2]):
        visible = visible_but(gone, 6)
        counts = runs.counts(visible)
        assert_same(counts, occlusion_counts(labels, rays, visible, bricks))
        hidden.add(int(counts.exact_samples.sum()))
        met.add(int(counts.samples.sum()))
    assert len(met) == 5
    assert len(hidden) > 3


def test_a_step_agrees_with_brute_force() -> None:
    labels = patches(np.random.default_rng(2))
    rays = along(VIEWS[0][0], labels.shape)
    counts = occlusion_runs(labels, rays, visible_but([], 6)).counts(visible_but([3], 6))
    assert_as_expected(counts, brute_force.occlusion(labels, rays, visible_but([3], 6)))


def test_runs_counted_by_hand() -> None:
    # First ray: 2 for 3 samples, 1 for 5, 2 again for 4. Second: 1 for 7, split in two.
    # Third, in a part of its own: 3 for 2, then 1 for 1.
    first = [2 << 16 | 3, 1 << 16 | 5, 2 << 16 | 4, 0, 1 << 16 | 6, 1 << 16 | 1, 0]
    parts = np.array(first, np.uint32), np.array([3 << 16 | 2, 1 << 16 | 1, 0], np.uint32)
    rays = along((0, 0, 1), (4, 4, 4))
    runs = Runs(parts, rays, visible_but([], 4))
    counts = runs.counts(visible_but([], 4))
    assert counts.samples.tolist() == [0, 13, 7, 2]
    assert counts.hits.tolist() == [0, 3, 1, 1]
    assert counts.occluded_hits.tolist() == [0, 2, 0, 0]
    assert counts.occluded_samples.tolist() == [0, 6, 0, 0]
    assert counts.exact_samples.tolist() == [0, 6, 4, 0]
    assert counts.blocks.astype(int).tolist() == [[0, 1, 0], [1, 0, 0], [1, 0, 0]]
    without = runs.counts(visible_but([2], 4))
    assert without.occluded_hits.tolist() == [0, 1, 0, 0]
    assert without.exact_samples.tolist() == [0, 1, 0, 0]
    assert without.ids.tolist() == [1, 3]


def test_who_was_hidden_needs_rays_of_their_own() -> None:
    rays = along((0, 0, 1), (4, 4, 4))
    runs = Runs((np.zeros(0, np.uint32),), rays, visible_but([2], 4))
    assert runs.serves(rays, visible_but([2, 3], 4))
    assert not runs.serves(rays, visible_but([3], 4))
    assert not runs.serves(along((0, 1, 0), (4, 4, 4)), visible_but([2], 4))
    with pytest.raises(ValueError, match="cast them anew"):
        runs.counts(visible_but([], 4))


def test_a_run_longer_than_a_number_holds_is_counted_whole() -> None:
    labels = np.ones((1, 1, 7), np.uint16)
    rays = along((0, 0, 1), labels.shape, size=(1, 1), step=7 / 150_000)
    counts = occlusion_counts(labels, rays, np.array([False, True]))
    assert counts.samples[1] == pytest.approx(150_000, abs=1)
    assert counts.samples[1] > 2 * LONGEST
    assert counts.hits[1] == 1


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
def test_no_ray_is_longer_than_the_longest(direction, spacing, fov) -> None:
    labels = np.ones((11, 18, 13), np.uint16)
    rays = along(direction, labels.shape, spacing, (40, 41), fov)
    most = max(len(ids) for _, _, ids in brute_force.runs(labels, rays, np.array([False, True])))
    assert 0 < most <= longest_ray(rays, labels.shape) < 2 * (most + 8)
