import itertools

import numpy as np
import pytest
from phantoms import ball, box, two_balls

from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.distance_tree import significant_minima, tree_sweep
from napari_unpack.segmentation.isoperimetric.shape_cuts import shape_cuts

UNIT = (1.0, 1.0, 1.0)


def test_a_row_of_five_voxels_is_swept_from_its_middle_with_the_cuts_worked_out_by_hand():
    mask = np.ones((1, 1, 5), bool)
    sweep = tree_sweep(mask, np.array([[[1.0, 2, 3, 2, 1]]]), UNIT)
    # Ground in the middle; two arms of subtrees 2, 1: potentials 0, 2, 2, 3, 3.
    assert sweep.order[0] == 2
    assert set(sweep.order[1:3].tolist()) == {1, 3}
    assert set(sweep.order[3:].tolist()) == {0, 4}
    # {2}: two faces; {2, one arm}: two; both arms: two; one end too: one; all: none.
    np.testing.assert_array_equal(sweep.cut, [2, 2, 2, 1, 0])
    np.testing.assert_allclose(sweep.ratio[:4], [2 / 1, 2 / 2, 2 / 2, 1 / 1])
    assert np.isinf(sweep.ratio[4])


def test_the_cut_is_an_area_in_square_millimetres():
    mask = np.ones((2, 1, 1), bool)
    sweep = tree_sweep(mask, np.array([[[2.0]], [[1.0]]]), (5.0, 2.0, 3.0))
    assert sweep.cut[0] == pytest.approx(6.0)
    assert sweep.ratio[0] == pytest.approx(6.0 / 30.0)


def test_the_tree_follows_the_deepest_way_round():
    # Voxels 0 1 2 over 3 4 5. The tree is 0-3-4-5-2 with 1 hanging from 0; subtrees hold
    # 4, 3, 2, 1 and 1 voxels, so the potentials are 3: 4, 4: 7, 5: 9, 2: 10 and 1: 1.
    distance = np.array([[[9.0, 1.0, 1.0], [8.0, 7.0, 6.0]]])
    sweep = tree_sweep(np.ones((1, 2, 3), bool), distance, UNIT)
    assert sweep.order.tolist() == [0, 1, 3, 4, 5, 2]
    np.testing.assert_array_equal(sweep.cut, [2, 3, 3, 2, 2, 0])


def test_voxels_the_ground_cannot_reach_are_left_out():
    mask = np.array([[[True, True, False, True]]])
    assert len(tree_sweep(mask, np.ones(mask.shape), UNIT).order) == 2


@pytest.mark.parametrize("conductance", ["unit", "distance"])
def test_the_sweep_agrees_with_a_brute_force_twin(conductance):
    # Prim by looking at every edge, subtrees by walking up, cuts by counting faces.
    rng = np.random.default_rng(5)
    mask = np.ones((3, 4, 4), bool)
    mask[1, 1, 1] = mask[0, 3, 3] = False
    distance = rng.choice(20_000, mask.shape, replace=False).astype(np.float64)
    voxels = [tuple(v) for v in np.argwhere(mask)]
    root = max(voxels, key=lambda v: distance[v])
    beside = [(a, b) for a in voxels for b in voxels if np.abs(np.subtract(a, b)).sum() == 1]
    # All weights differ, so that there is one maximum spanning tree.
    assert len({distance[a] + distance[b] for a, b in beside}) == len(beside) / 2
    parent, inside = {root: None}, {root}
    while len(inside) < len(voxels):
        a, b = max(
            ((a, b) for a, b in beside if a in inside and b not in inside),
            key=lambda edge: distance[edge[0]] + distance[edge[1]],
        )
        parent[b] = a
        inside.add(b)

    def up(v):
        return [] if parent[v] is None else [v, *up(parent[v])]

    size = {v: sum(v in up(w) for w in voxels) for v in voxels}

    def potential(v):
        steps = (
            size[w] / (4 * (distance[w] + distance[parent[w]]) if conductance == "distance" else 1)
            for w in up(v)
        )
        return sum(steps)

    sweep = tree_sweep(mask, distance, UNIT, conductance)
    found = [tuple(int(i) for i in np.unravel_index(k, mask.shape)) for k in sweep.order]
    values = [potential(v) for v in found]
    assert all(b >= a - 1e-9 for a, b in itertools.pairwise(values))
    for k in range(len(found)):
        first = set(found[: k + 1])
        assert sweep.cut[k] == sum(a in first and b not in first for a, b in beside)


def test_only_minima_that_stand_out_are_significant():
    curve = np.array([9.0, 5.0, 2.0, 6.0, 5.9, 6.0, 3.0, 8.0])
    assert significant_minima(curve, 0, 8, 1.15, 5) == [2, 6]
    assert significant_minima(curve, 0, 8, 1.15, 1) == [2]
    assert significant_minima(curve, 5, 5, 1.15, 5) == []


@pytest.mark.parametrize("spacing", [UNIT, (2.5, 1.0, 1.0)])
def test_two_overlapping_balls_come_apart_with_dice_of_98_percent(spacing):
    truth = two_balls()[:: int(spacing[0])]
    region = Region(truth > 0, np.ones(truth.shape), (0, 0, 0), spacing)
    cut = next(iter(shape_cuts(region, smallest=500)))
    assert cut.parts.max() == 2
    for name in (1, 2):
        side = truth == name
        dice = max(
            2 * (side & (cut.parts == k)).sum() / (side.sum() + (cut.parts == k).sum())
            for k in (1, 2)
        )
        assert dice >= 0.98
    assert cut.neck < 0.6


def test_a_large_region_is_cut_at_its_neck_to_the_voxel():
    shape = (80, 80, 130)
    truth = two_balls(shape, radius=36, distance=56)
    region = Region(truth > 0, np.ones(shape), (0, 0, 0), UNIT)
    assert region.voxels > 120_000
    cut = next(iter(shape_cuts(region, smallest=500)))
    left = cut.parts == cut.parts[40, 40, 30]
    assert (left != (truth == 1))[truth > 0].mean() < 0.01


def test_a_ball_alone_has_no_neck():
    mask = ball((40, 40, 40), (20, 20, 20), 15)
    region = Region(mask, np.ones(mask.shape), (0, 0, 0), UNIT)
    assert all(cut.neck > 0.65 for cut in shape_cuts(region, smallest=500))


def test_the_ring_part_of_a_cut_is_relabelled_by_component():
    # A rod with a ball at each end: the middle is the ground's or an end's, never two things.
    shape = (24, 24, 90)
    mask = ball(shape, (12, 12, 14), 10) | ball(shape, (12, 12, 75), 10)
    mask |= ball(shape, (12, 12, 45), 10) | box(shape, (9, 9, 14), (15, 15, 75))
    region = Region(mask, np.ones(shape), (0, 0, 0), UNIT)
    import cc3d

    for cut in shape_cuts(region, smallest=200):
        for k in range(1, cut.parts.max() + 1):
            assert cc3d.connected_components(cut.parts == k, connectivity=6).max() == 1
        assert (cut.parts > 0).sum() == mask.sum()
