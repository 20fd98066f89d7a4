"""Labels grown into their fringe for display."""

from __future__ import annotations

import numpy as np

from napari_unpack.geometry.grow_labels import grow_labels


def test_one_round_claims_the_six_neighbours() -> None:
    labels = np.zeros((5, 5, 5), np.uint16)
    labels[2, 2, 2] = 3
    grown = grow_labels(labels, 1)
    assert np.count_nonzero(grown) == 7
    assert labels.sum() == 3
    assert grown[2, 2, 1] == grown[1, 2, 2] == grown[2, 3, 2] == 3


def test_labelled_voxels_keep_theirs_and_the_smaller_id_wins_between_two() -> None:
    labels = np.zeros((1, 1, 5), np.uint16)
    labels[0, 0] = [7, 0, 2, 0, 0]
    assert grow_labels(labels, 1)[0, 0].tolist() == [7, 2, 2, 2, 0]


def test_no_round_is_a_copy() -> None:
    labels = np.ones((2, 2, 2), np.uint16)
    grown = grow_labels(labels, 0)
    grown[:] = 0
    assert labels.all()
