import numpy as np
import pytest

from napari_unpack.segmentation import score


def line(*labels):
    return np.array(labels).reshape(1, 1, -1)


def test_a_perfect_segmentation_scores_perfectly_whatever_its_ids():
    result = score(line(0, 1, 1, 2, 2), line(0, 70, 70, 9, 9))
    for name in ("f1", "f1_75", "precision", "recall", "ap", "mean_iou", "panoptic_quality"):
        assert result[name] == 1.0, name
    for name in ("voi", "adapted_rand", "count_error", "false_foreground", "missed_foreground"):
        assert result[name] == pytest.approx(0.0), name


def test_a_merge_and_a_split_give_the_numbers_worked_out_by_hand():
    truth = line(1, 1, 1, 1, 2, 2, 2, 2)
    merged = score(truth, line(5, 5, 5, 5, 5, 5, 5, 5))
    # One segment of IoU 4/8 with each: 0.5 is not above 0.5.
    assert merged["f1"] == 0.0
    assert merged["voi_merge"] == pytest.approx(1.0)
    assert merged["voi_split"] == pytest.approx(0.0)
    assert merged["count_error"] == 0.5
    assert merged["undersegmentation"] == 2.0
    # Pairs: truth 2 * (1/2)^2 = 1/2, found 1: precision 1/2, recall 1.
    assert merged["adapted_rand"] == pytest.approx(1 - 2 * 0.5 / 1.5)
    halved = score(truth, line(1, 1, 3, 3, 2, 2, 2, 2))
    assert halved["voi_split"] == pytest.approx(0.5)
    assert halved["voi_merge"] == pytest.approx(0.0)
    assert halved["oversegmentation"] == 1.5
    # One of two objects matched, one of three segments right.
    assert halved["recall"] == 0.5
    assert halved["precision"] == pytest.approx(1 / 3)
    assert halved["f1"] == pytest.approx(2 / 5)


def test_iou_thresholds_tell_good_from_passable():
    # IoU 3/4 exactly: above 0.5 up to 0.7, not above 0.75.
    result = score(line(1, 1, 1, 1), line(1, 1, 1, 0))
    assert result["f1"] == 1.0
    assert result["f1_75"] == 0.0
    assert result["mean_iou"] == 0.75
    assert result["ap"] == pytest.approx(0.5)
    assert result["missed_foreground"] == 0.25


def test_false_foreground_is_told_apart_and_leaves_information_alone():
    truth, found = line(1, 1, 0, 0), line(1, 1, 2, 2)
    result = score(truth, found)
    assert result["false_foreground"] == 0.5
    assert result["voi"] == pytest.approx(0.0)
    assert result["precision"] == 0.5


def test_nothing_found_is_a_score_of_zero_and_no_error():
    result = score(line(1, 1, 2), line(0, 0, 0))
    assert result["f1"] == 0.0
    assert result["precision"] == 0.0
    assert result["missed_foreground"] == 1.0
    assert result["count_error"] == 1.0


def test_agreement_with_scikit_image_on_random_labels():
    from skimage.metrics import adapted_rand_error, variation_of_information

    rng = np.random.default_rng(3)
    truth, found = rng.integers(1, 6, (2, 6, 7, 8)).repeat(4, 1).repeat(4, 2).repeat(4, 3)
    result = score(truth, found)
    split, merge = variation_of_information(truth, found)
    assert result["voi_split"] == pytest.approx(split)
    assert result["voi_merge"] == pytest.approx(merge)
    error = adapted_rand_error(truth, found)[0]
    # scikit-image leaves out self-pairs, which vanish in large volumes.
    assert result["adapted_rand"] == pytest.approx(error, abs=0.001)


@pytest.mark.parametrize(
    ("truth", "found", "words"),
    [
        (np.ones((2, 2, 2), int), np.ones((2, 2, 3), int), "one shape"),
        (np.zeros((2, 2, 2), int), np.ones((2, 2, 2), int), "at least one object"),
        (np.ones((2, 2), int), np.ones((2, 2), int), "3 axes"),
        (np.full((2, 2, 2), -1), np.ones((2, 2, 2), int), "negative"),
    ],
)
def test_labels_that_cannot_be_compared_are_refused(truth, found, words):
    with pytest.raises(ValueError, match=words):
        score(truth, found)


def test_labels_of_floats_are_a_type_error():
    with pytest.raises(TypeError, match="integers"):
        score(np.ones((2, 2, 2)), np.ones((2, 2, 2), int))
