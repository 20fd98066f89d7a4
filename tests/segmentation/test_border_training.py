from itertools import pairwise

import numpy as np
from benchmarks.segmentation import part_merging_training, part_splitting_training
from benchmarks.segmentation.border_training import border_examples, measured, owners
from benchmarks.segmentation.training_scans import Scan
from phantoms import box, scanned

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.learned.border_classifier import BORDER_FEATURES, BorderEvidence
from napari_unpack.simulation import simulate_bag

SHAPE = (16, 16, 36)


def blocks(*ends):
    labels = np.zeros(SHAPE, np.int32)
    for name, (first, last) in enumerate(pairwise(ends), 1):
        labels[box(SHAPE, (3, 3, first), (13, 13, last))] = name
    return labels


def examples(labels, truth):
    known = {name: 500.0 * name for name in range(1, int(truth.max()) + 1)}
    density = scanned(truth, known)
    unsure = np.full((3, *SHAPE), 128, np.uint8)
    evidence = BorderEvidence.of(labels, density, DensityScale(0.0, 200.0), unsure, 20.0)
    return border_examples(labels, evidence, np.ones(SHAPE, bool), truth)


def test_a_label_belongs_to_the_object_that_has_most_of_it():
    truth = blocks(3, 13, 23, 33)
    found = np.where(truth > 0, 4 * truth, 0)
    found[(truth == 2) & (np.arange(36) < 16)] = 4
    found[(truth == 3) | ((truth == 2) & (np.arange(36) > 18))] = 12
    owner = owners(found.astype(np.int32), (7 * truth).astype(np.uint16))
    assert owner[[0, 4, 8, 12]].tolist() == [0, 7, 14, 21]
    # Half of one object and half of another: nobody's.
    found[truth > 1] = 12
    assert owners(found.astype(np.int32), truth)[12] == 0


def test_examples_are_of_voxels_between_known_objects_and_say_whose_each_is():
    truth, found = blocks(3, 13, 33), blocks(3, 15, 33)
    rows, right = examples(found, truth)
    holds = rows[:, BORDER_FEATURES.index("holds")]
    # Planes of 100 voxels on both sides, and two labels for each; nothing else is at a border.
    assert len(rows) == 2 * 2 * 100
    assert right.sum() == 200
    # The label that holds 100 of them lost them in truth.
    assert (right == (holds == 1)).sum() == 200
    assert right[holds == 1].sum() == 100


def test_voxels_of_labels_that_are_nobodys_are_left_out():
    truth = blocks(3, 13, 23, 33)
    both = np.where(truth > 1, 2, truth)
    rows, right = examples(both.astype(np.int32), truth)
    assert len(rows) == len(right) == 0


def test_each_training_measures_what_a_scan_has_to_learn_from():
    bag = simulate_bag(seed=2, shape=(40, 48, 56), count=4)
    scan = Scan(bag.volume, bag.labels, bag.spacing)
    rows, right = measured(scan)
    assert rows.shape == (len(right), len(BORDER_FEATURES))
    # Where two labels meet, about every second is not the true object's.
    assert len(right) > 100
    assert 0.2 < right.mean() < 0.8
    inside = np.count_nonzero(bag.labels)
    for training in (part_merging_training, part_splitting_training):
        _, shared = training.measured(scan)
        # Of all that is in the bag, most is in some part.
        assert 0.7 * inside < shared.sum() <= 1.5 * inside
