import time

import numpy as np
import pytest
from phantoms import ball, box, two_balls

from napari_unpack.segmentation.isoperimetric.distance_tree import isoperimetric_ratio
from napari_unpack.segmentation.isoperimetric.lattice import Lattice
from napari_unpack.segmentation.isoperimetric.two_point_cut import cut_between

UNIT = (1.0, 1.0, 1.0)


def dice(one, two):
    return 2 * (one & two).sum() / (one.sum() + two.sum())


def test_the_potential_of_a_row_and_the_cuts_of_its_sweep_are_those_worked_out_by_hand():
    lattice = Lattice.of(np.ones((1, 1, 5), bool), (2.0, 2.0, 1.0))
    potential = lattice.potential(np.array([0, 4]), np.array([0.0, 1.0]), 0.0, 1e-10)
    np.testing.assert_allclose(potential, [0, 0.25, 0.5, 0.75, 1], atol=1e-8)
    order, cut = lattice.sweep(potential, weighted=False)
    assert order.tolist() == [0, 1, 2, 3, 4]
    # Faces across x are 2 x 2 mm, a voxel is 4 mm^3.
    np.testing.assert_allclose(cut, [4, 4, 4, 4, 0])
    np.testing.assert_allclose(isoperimetric_ratio(cut, 4.0)[:4], [1, 1 / 2, 1 / 2, 1])


def test_the_lattice_solve_agrees_with_a_dense_one():
    rng = np.random.default_rng(0)
    mask = np.ones((3, 4, 5), bool)
    mask[1, 1, 1:4] = False
    lattice = Lattice.of(mask, (2.0, 1.0, 1.5), rng.normal(100, 10, mask.shape))
    count = len(lattice.where)
    laplacian = np.zeros((count, count))
    for node in range(count):
        for axis in range(3):
            other = lattice.after[node, axis]
            if other >= 0:
                w = lattice.conductance[node, axis]
                laplacian[[node, other], [node, other]] += w
                laplacian[node, other] -= w
                laplacian[other, node] -= w
    expected = np.zeros(count)
    expected[1:] = np.linalg.solve(laplacian[1:, 1:], np.ones(count - 1))
    found = lattice.potential(np.array([0]), np.array([0.0]), 1.0, 1e-10)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("spacing", [UNIT, (2.0, 1.0, 1.0)])
def test_two_touching_balls_come_apart(spacing):
    truth = two_balls()[:: int(spacing[0])]
    z = truth.shape[0] // 2
    part = cut_between(truth > 0, None, spacing, (z, 24, 20), (z, 26, 60))
    assert dice(part, truth == 2) > 0.97


def test_two_boxes_in_full_face_contact_come_apart_half_way_or_at_their_step():
    shape = (30, 30, 60)
    both = box(shape, (5, 5, 5), (25, 25, 55))
    half = box(shape, (5, 5, 30), (25, 25, 55))
    assert dice(cut_between(both, None, UNIT, (12, 14, 10), (16, 12, 50)), half) > 0.93
    third = box(shape, (5, 5, 22), (25, 25, 55))
    noise = np.random.default_rng(0).normal(0, 25, shape)
    density = np.where(third, 1150.0, 1000.0) + noise
    assert dice(cut_between(both, density, UNIT, (12, 14, 10), (16, 12, 50)), third) > 0.97


def test_two_boxes_in_partial_face_contact_come_apart():
    shape = (40, 40, 60)
    one, two = box(shape, (5, 5, 5), (25, 25, 30)), box(shape, (13, 13, 30), (35, 35, 55))
    part = cut_between(one | two, None, UNIT, (10, 10, 10), (30, 30, 50))
    assert dice(part, two) > 0.97


def test_a_large_shape_is_cut_to_the_voxel_in_seconds():
    shape = (80, 80, 130)
    truth = two_balls(shape, radius=36, distance=56)
    cut_between(truth[::8, ::8, ::8] > 0, None, UNIT, (5, 5, 3), (5, 5, 12))
    start = time.perf_counter()
    part = cut_between(truth > 0, None, UNIT, (40, 40, 30), (40, 44, 100))
    assert time.perf_counter() - start < 5
    assert dice(part, truth == 2) > 0.97


def test_each_part_holds_its_voxel_and_hangs_together():
    import cc3d

    rng = np.random.default_rng(3)
    shape = (30, 30, 40)
    mask = ball(shape, (15, 15, 12), 10) | box(shape, (13, 13, 12), (17, 17, 38))
    voxels = np.argwhere(mask)
    for a, b in rng.choice(voxels, (6, 2)):
        part = cut_between(mask, rng.normal(size=shape), UNIT, a, b)
        assert part[tuple(b)]
        assert not part[tuple(a)]
        assert not (part & ~mask).any()
        assert cc3d.connected_components(part, connectivity=6).max() == 1
        assert cc3d.connected_components(mask & ~part, connectivity=6).max() == 1


def test_neighbouring_voxels_and_separate_pieces_can_be_cut():
    mask = np.zeros((3, 3, 8), bool)
    mask[1, 1, :3] = mask[1, 1, 5:] = True
    assert cut_between(mask, None, UNIT, (1, 1, 0), (1, 1, 6)).sum() == 3
    pair = cut_between(mask[:, :, :2], None, UNIT, (1, 1, 0), (1, 1, 1))
    assert pair.sum() == 1
    assert pair[1, 1, 1]


def test_voxels_outside_the_object_are_refused():
    mask = box((5, 5, 5), (1, 1, 1), (4, 4, 4))
    for a, b in (((0, 0, 0), (2, 2, 2)), ((2, 2, 2), (2, 2, 9)), ((2, 2, 2), (2, 2, 2))):
        with pytest.raises(ValueError, match="voxel"):
            cut_between(mask, None, UNIT, a, b)
    with pytest.raises(ValueError, match="shape"):
        cut_between(mask, np.ones((2, 2, 2)), UNIT, (1, 1, 1), (2, 2, 2))
