import itertools

import numpy as np
import pytest

from napari_unpack.segmentation.isoperimetric.distance_tree import (
    isoperimetric_ratio,
    significant_minima,
    tree_sweep,
)

UNIT = (1.0, 1.0, 1.0)


def test_a_row_of_five_voxels_is_swept_from_its_middle_with_the_cuts_worked_out_by_hand():
    mask = np.ones((1, 1, 5), bool)
    order, cut = tree_sweep(mask, np.array([[[1.0, 2, 3, 2, 1]]]), UNIT)
    # Ground in the middle; two arms of subtrees 2, 1: potentials 0, 2, 2, 3, 3.
    assert order[0] == 2
    assert set(order[1:3].tolist()) == {1, 3}
    assert set(order[3:].tolist()) == {0, 4}
    # {2}: two faces; {2, one arm}: two; both arms: two; one end too: one; all: none.
    np.testing.assert_array_equal(cut, [2, 2, 2, 1, 0])
    ratio = isoperimetric_ratio(cut, 1.0)
    np.testing.assert_allclose(ratio[:4], [2 / 1, 2 / 2, 2 / 2, 1 / 1])
    assert np.isinf(ratio[4])


def test_the_cut_is_an_area_in_square_millimetres():
    mask = np.ones((2, 1, 1), bool)
    _, cut = tree_sweep(mask, np.array([[[2.0]], [[1.0]]]), (5.0, 2.0, 3.0))
    assert cut[0] == pytest.approx(6.0)
    assert isoperimetric_ratio(cut, 30.0)[0] == pytest.approx(6.0 / 30.0)


def test_the_tree_follows_the_deepest_way_round():
    # Voxels 0 1 2 over 3 4 5. The tree is 0-3-4-5-2 with 1 hanging from 0; subtrees hold
    # 4, 3, 2, 1 and 1 voxels, so the potentials are 3: 4, 4: 7, 5: 9, 2: 10 and 1: 1.
    distance = np.array([[[9.0, 1.0, 1.0], [8.0, 7.0, 6.0]]])
    order, cut = tree_sweep(np.ones((1, 2, 3), bool), distance, UNIT)
    assert order.tolist() == [0, 1, 3, 4, 5, 2]
    np.testing.assert_array_equal(cut, [2, 3, 3, 2, 2, 0])


def test_voxels_the_ground_cannot_reach_are_left_out():
    mask = np.array([[[True, True, False, True]]])
    assert len(tree_sweep(mask, np.ones(mask.shape), UNIT)[0]) == 2


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

    order, cut = tree_sweep(mask, distance, UNIT, conductance)
    found = [tuple(int(i) for i in np.unravel_index(k, mask.shape)) for k in order]
    values = [potential(v) for v in found]
    assert all(b >= a - 1e-9 for a, b in itertools.pairwise(values))
    for k in range(len(found)):
        first = set(found[: k + 1])
        assert cut[k] == sum(a in first and b not in first for a, b in beside)


def test_only_minima_that_stand_out_are_significant():
    curve = np.array([9.0, 5.0, 2.0, 6.0, 5.9, 6.0, 3.0, 8.0])
    assert significant_minima(curve, 0, 8, 1.15, 5) == [2, 6]
    assert significant_minima(curve, 0, 8, 1.15, 1) == [2]
    assert significant_minima(curve, 5, 5, 1.15, 5) == []
