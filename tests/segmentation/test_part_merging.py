import numpy as np
import pytest
from phantoms import box

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.learned import part_merging
from napari_unpack.segmentation.learned.fragments import FragmentAffinities
from napari_unpack.segmentation.learned.pair_classifier import (
    PairClassifier,
    agglomerate,
    discrimination,
    measure_parts,
)
from napari_unpack.segmentation.learned.part_merging import (
    FEATURES,
    default_merging_classifier,
    measure_predicted_parts,
    merge_parts,
)

SHAPE = (20, 20, 52)


def three_boxes():
    """Return three boxes in a row, named 2, 5 and 6, of which 1, 3 and 4 are fragments too."""
    labels = np.zeros(SHAPE, np.int32)
    for name, x in ((2, 5), (5, 19), (6, 33)):
        labels[box(SHAPE, (4, 4, x), (16, 16, x + 14))] = name
    return labels


def of_reaches(rows):
    return np.insert(np.array(rows), [1, 1], 0, axis=1)


def measured(spacing=(1.0, 1.0, 1.0)):
    # 1 is of 2, 3 and 4 are of 5; nothing is known by the reaches between the first and the last.
    owner = np.array([0, 2, 2, 5, 5, 5, 6])
    ties = FragmentAffinities(
        np.array([[1, 2], [2, 3], [1, 4], [4, 5], [5, 6], [2, 6]]),
        of_reaches([[9.0, 8.0], [1, 2], [3, 0], [7, 7], [9, 9], [0, 4]]),
        of_reaches([[10.0, 10.0], [10, 4], [10, 0], [10, 10], [10, 10], [0, 8]]),
    )
    labels = three_boxes()
    density = np.where(labels > 0, 1000.0, 0.0)
    scale = DensityScale(0.0, 250.0)
    return measure_predicted_parts(labels, density, spacing, scale, ties, owner)


def test_what_fragments_say_is_added_up_between_and_within_parts():
    labels, parts = measured()
    assert np.unique(labels).tolist() == [0, 1, 2, 3]
    for one, two in ((1, 2), (2, 1)):
        assert parts.between.between(one, two).tolist() == [4, 0, 0, 2, 20, 0, 0, 4]
    assert parts.within[1].tolist() == [9, 0, 0, 8]
    row = dict(zip(FEATURES, parts.features(1, 2, np.zeros(20)), strict=True))
    assert row["belonging"] == pytest.approx((4 + 2 * 2) / (20 + 2 * 4))
    assert row["belonging_next"] == pytest.approx(0.2)


def test_joining_two_parts_loses_no_pair_of_cells():
    _, parts = measured()
    parts.join(1, 2)
    assert parts.within[1].tolist() == [9 + 7 + 4, 0, 0, 8 + 7 + 2]
    for one, two in ((1, 3), (3, 1)):
        assert parts.between.between(one, two).tolist() == [9, 0, 0, 13, 10, 0, 0, 18]
    assert not parts.between.of(2)
    assert list(parts.between.of(1)) == [3]


def test_only_the_proportions_of_voxels_count():
    for one, two in ((1, 2), (2, 3)):
        fine, coarse = (measured((s, s, s))[1] for s in (0.1, 1.0))
        np.testing.assert_allclose(
            fine.features(one, two, np.zeros(20)), coarse.features(one, two, np.zeros(20))
        )
        np.testing.assert_allclose(fine.sums[:, 3], coarse.sums[:, 3])


def judge_of_belonging(bias):
    width = len(FEATURES)
    weight = np.zeros((width, 1))
    weight[FEATURES.index("belonging")] = 20.0
    return PairClassifier(
        np.full(width, 0.5), np.ones(width), (weight,), (np.array([bias]),), FEATURES
    )


def test_the_classifier_decides_who_is_joined(monkeypatch):
    monkeypatch.setattr(part_merging, "AFFINITY_ALONE", 1.0)
    labels, parts = measured()
    joined = merge_parts(labels, parts, judge_of_belonging(0.0))
    # 2 and 3 belong together by 0.9, 1 and 2 by 0.29; 1 and both by less than a half.
    assert joined[10, 10, 25] == joined[10, 10, 40] != joined[10, 10, 8]


@pytest.mark.parametrize(("sure", "together"), [(0.5, True), (0.8, False)])
def test_where_the_network_is_sure_the_classifier_is_not_asked(monkeypatch, sure, together):
    monkeypatch.setattr(part_merging, "AFFINITY_ALONE", sure)
    labels, parts = measured()
    joined = merge_parts(labels, parts, judge_of_belonging(-1000.0))
    # 0.9 lies by more than 0.5 and less than 0.8 above the bar for so few cells, about 0.2.
    assert (joined[10, 10, 25] == joined[10, 10, 40]) == together
    assert joined[10, 10, 8] not in (joined[10, 10, 25], joined[10, 10, 40])


@pytest.mark.parametrize(("side", "asked"), [(1, False), (2, True)])
def test_parts_that_touch_over_little_are_asked_about_and_a_corner_is_not(side, asked):
    # Of 864 faces of a cube of 12 three thousandths are 2.6: one face is less, four are more.
    labels = np.zeros((16, 16, 40), np.int32)
    labels[box(labels.shape, (2, 2, 2), (14, 14, 14))] = 1
    labels[box(labels.shape, (2, 2, 15), (14, 14, 27))] = 2
    labels[2 : 2 + side, 2 : 2 + side, 14] = 2
    pairs = []

    def answer(one, two, features):
        pairs.append((one, two))
        return 1.0

    lifted = (labels > 0).astype(np.float32)
    owners = agglomerate(measure_parts(labels, lifted, (1.0, 1.0, 1.0)), answer)
    assert pairs == [(1, 2)] * asked
    assert (owners[1] == owners[2]) == asked


def test_discrimination_is_what_truth_would_tell_of_calibrated_probabilities():
    rng = np.random.default_rng(0)
    for chances in (rng.beta(0.3, 0.9, 40_000), rng.beta(3, 9, 40_000)):
        one = rng.random(len(chances)) < chances
        wanted = chances[one].mean() - chances[~one].mean()
        assert discrimination(chances) == pytest.approx(wanted, abs=0.02)
    assert discrimination(np.repeat([0.0, 1.0], 20)) == 1.0
    assert discrimination(np.full(40, 0.4)) == 0.0
    # All surely apart: nothing says that it is wrong, nor does anything hang on it.
    assert discrimination(np.zeros(40)) == 0.0
    # Of too few nothing can be said.
    assert discrimination(np.full(5, 0.4)) == 1.0


@pytest.mark.parametrize(("least", "objects"), [(0.0, 1), (0.3, 64)])
def test_nothing_is_merged_where_the_classifier_tells_no_pair_from_another(least, objects):
    labels = np.arange(1, 65, dtype=np.int32).reshape(4, 4, 4).repeat(4, 0).repeat(4, 1)
    labels = labels.repeat(4, 2)
    measurements = measure_parts(labels, np.ones(labels.shape, np.float32), (1.0, 1.0, 1.0))
    owners = agglomerate(measurements, lambda *_: 0.6, least_discrimination=least)
    assert len(np.unique(owners[1:])) == objects


def test_the_classifier_that_ships_knows_these_features():
    assert default_merging_classifier().features == FEATURES
    assert default_merging_classifier().weights[0].shape[0] == len(FEATURES)
