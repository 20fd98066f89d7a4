"""The table of families that are left out: what is like one is not learned from."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.segmentation import left_out, part_merging_training, part_splitting_training
from benchmarks.segmentation.classifier_training import Scans, fitted
from benchmarks.segmentation.left_out import ALIKE, Pair, trained_without, without
from benchmarks.segmentation.training_scans import FAMILIES

from napari_unpack.segmentation.learned import part_merging, part_splitting
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier


def constant(features: tuple[str, ...], odds: float) -> PairClassifier:
    """Return a classifier that says one thing of all pairs."""
    width = len(features)
    weights, offsets = (np.zeros((width, 1)),), (np.array([odds]),)
    return PairClassifier(np.zeros(width), np.ones(width), weights, offsets, features)


@pytest.mark.parametrize("family", ALIKE)
def test_what_is_like_a_family_is_not_learned_from(family):
    assert set(ALIKE[family]) <= set(FAMILIES)
    for training in (part_merging_training, part_splitting_training):
        left = without(training.SCANS, family)
        learned = {some.family for some in left}
        assert not learned & set(ALIKE[family])
        assert learned | set(ALIKE[family]) >= {some.family for some in training.SCANS}
        assert len(learned) >= 3


def test_classifiers_that_are_given_decide_and_then_those_that_ship():
    parts, pieces = constant(part_merging.FEATURES, 1), constant(part_splitting.PIECE_FEATURES, 1)
    ships = part_merging.default_merging_classifier(), part_splitting.default_splitting_classifier()
    with Pair(parts, pieces).used():
        assert part_merging.default_merging_classifier() is parts
        assert part_splitting.default_splitting_classifier() is pieces
    with Pair().used():
        assert part_merging.default_merging_classifier() is ships[0]
        assert part_splitting.default_splitting_classifier() is ships[1]


def test_pieces_learn_behind_the_parts_of_their_own_and_files_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked = []

    def fitted(measure, scans, fit, shorten, workers, known=None):
        asked.append((measure, scans, shorten, known))
        merging = len(asked) == 1
        features = part_merging.FEATURES if merging else part_splitting.PIECE_FEATURES
        return constant(features, len(asked))

    monkeypatch.setattr(left_out, "fitted", fitted)
    parts_of = {}
    pair = trained_without("second", tmp_path, 7, 1, parts_of)
    (_, scans, shorten, known), (measure, others, _, none) = asked
    # The parts of a scan are the same for every family, its pieces are not.
    assert known is parts_of
    assert none is None
    assert scans == without(part_merging_training.SCANS, "second")
    assert others == without(part_splitting_training.SCANS, "second")
    assert shorten == 7
    # What measures pieces holds the classifier of parts that was just fitted.
    assert measure.args[0].offsets[0] == 1
    assert pair.pieces.offsets[0] == 2
    again = trained_without("second", tmp_path, 7, 1, parts_of)
    assert len(asked) == 2
    np.testing.assert_array_equal(again.pieces.offsets[0], pair.pieces.offsets[0])


def refuse(scanned):
    raise AssertionError("it was measured already")


def test_scans_that_were_measured_already_are_not_measured_again():
    scans = (Scans("bags", 3), Scans("small bags", 2, times=2))
    known = {"bags": [1, 2, 3], "small bags": [4, 5]}
    given = []

    def fit(states):
        given.extend(states)
        return constant(part_merging.FEATURES, 0)

    fitted(refuse, scans, fit, known=known)
    assert given == [1, 2, 3, 4, 5, 4, 5]
