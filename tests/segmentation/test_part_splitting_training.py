from types import SimpleNamespace

import numpy as np
from benchmarks.boundaries.solids import coat, lay_flat
from benchmarks.segmentation.part_splitting_training import owned
from phantoms import ball

SHAPE = (64, 64, 64)


def test_coats_are_thin_things_of_their_own_beside_what_they_cover():
    labels = np.zeros(SHAPE, np.uint16)
    labels[ball(SHAPE, (20, 32, 32), 12)] = 1
    labels[ball(SHAPE, (46, 32, 32), 12)] = 2
    density = np.where(labels > 0, 1000, 0).astype(np.uint16)
    bare, before = labels.copy(), density.copy()
    coat(5, density, labels, share=1.0)
    assert labels.max() > 2
    np.testing.assert_array_equal(labels[bare > 0], bare[bare > 0])
    np.testing.assert_array_equal(density[labels < 3], before[labels < 3])
    for name in range(3, int(labels.max()) + 1):
        own = np.argwhere(labels == name)
        assert len(own) >= 300
        depths = np.abs(
            np.linalg.norm(own[:, None] - np.array([[20, 32, 32], [46, 32, 32]]), axis=2) - 12
        )
        assert (depths.min(axis=1) <= 5.5).all()
        assert len(np.unique(density[labels == name])) == 1


def test_what_is_laid_on_a_box_lies_flat_on_one_of_its_sides():
    bare = np.zeros(SHAPE, np.uint16)
    bare[14:38, 20:46, 20:46] = 1
    for seed in range(6):
        labels, density = bare.copy(), np.where(bare > 0, 1000, 0).astype(np.uint16)
        lay_flat(seed, density, labels, share=1.0)
        np.testing.assert_array_equal(labels[bare > 0], 1)
        np.testing.assert_array_equal(density[bare > 0], 1000)
        np.testing.assert_array_equal(density > 0, labels > 0)
        for name in range(2, int(labels.max()) + 1):
            assert np.count_nonzero(labels == name) >= 150
            assert len(np.unique(density[labels == name])) == 1
        if labels.max() == 1:
            continue
        # The first lies on one side: beyond it, or where it hangs over level with its last voxels.
        own = np.argwhere(labels == 2)
        low, high = np.array([14, 20, 20]), np.array([37, 45, 45])
        gaps = np.concatenate([own.min(axis=0) - high, low - own.max(axis=0)])
        assert gaps.max() in (0, 1), seed


def test_rims_that_are_no_objects_go_to_what_their_host_mostly_is():
    pieces = SimpleNamespace(
        host=np.array([0, 1, 1, 1, 2]), sums=np.array([[0.0], [90], [40], [30], [20]])
    )
    shared = np.array([[0.0, 0, 0], [0, 80, 10], [35, 0, 5], [20, 0, 10], [20, 0, 0]])
    found = owned(pieces, shared)
    # The first is an object's, the second no one's, a third of the third is the other's.
    assert found[1].argmax() == 1
    assert found[2].tolist() == [0, 40, 0]
    assert found[3].argmax() == 2
    # A host that is nothing at all gives nothing.
    assert found[4].tolist() == [20, 0, 0]
