import re
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from napari_unpack.segmentation import score, score_by, score_objects
from napari_unpack.segmentation.evaluation import Overlaps


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


def test_each_true_object_has_its_match_worked_out_by_hand():
    #            1  1  1  1  5  5  5  5  5  5  7
    truth = line(1, 1, 1, 1, 5, 5, 5, 5, 5, 5, 7)
    found = line(2, 2, 2, 9, 9, 9, 9, 9, 9, 0, 0)
    table = score_objects(truth, found)
    assert table.index.tolist() == [1, 5, 7]
    assert table.voxels.tolist() == [4, 6, 1]
    assert table.match.tolist() == [2, 9, 0]
    # Object 5: 5 voxels in common with segment 9 of 6, union 7.
    assert table.iou.tolist() == pytest.approx([3 / 4, 5 / 7, 0])
    assert table.precision.tolist() == pytest.approx([1, 5 / 6, 0])
    assert table.recall.tolist() == pytest.approx([3 / 4, 5 / 6, 0])
    assert table.pieces.tolist() == [2, 1, 0]
    # Segment 9 covers a quarter of object 1 as well; segment 2 covers object 1 alone.
    assert table.shares_match.tolist() == [False, True, False]
    assert table.detected.tolist() == [True, True, False]


def test_sheets_are_detected_at_a_fifth_and_bulk_at_a_half():
    truth = line(*[1] * 10, *[0] * 10)
    found = line(*[0] * 6, *[3] * 14)
    # Recall 4/10, precision 4/14.
    assert not score_objects(truth, found).detected[1]
    assert score_objects(truth, found, sheets=[1]).detected[1]
    assert not score_objects(truth, line(*[0] * 9, 3, *[0] * 10), sheets=[1]).detected[1]


def test_boundary_distances_in_millimetres():
    truth, found = np.zeros((2, 5, 5, 9), np.uint8)
    truth[1:4, 1:4, 1:4] = 1
    found[1:4, 1:4, 3:6] = 1
    table = score_objects(truth, found, (1.0, 1.0, 2.0), boundary=True)
    # 26 boundary voxels each way: the 9 left ones lie 2 voxels of 2 mm from the other's left
    # side, 8 of the middle plane 1 voxel, the 9 of the right plane 0; and the mirror image.
    assert table.surface_mm[1] == pytest.approx((9 * 4 + 8 * 2) / 26)
    assert table.hausdorff95_mm[1] == pytest.approx(4.0)
    nothing = score_objects(truth, 0 * found, boundary=True)
    assert np.isnan(nothing.surface_mm[1])


def test_a_table_by_class_and_over_all():
    truth, found = line(1, 1, 2, 2, 3, 3, 4), line(1, 1, 2, 2, 2, 2, 0)
    each = score_objects(truth, found)
    table = score_by(each, {1: "metal", 2: "bulk", 3: "bulk"})
    assert table.index.tolist() == ["bulk", "metal", "unknown", "all"]
    assert table.objects.tolist() == [2, 1, 1, 4]
    assert table.found.tolist() == [0.0, 1.0, 0.0, 0.25]
    assert table.detected.tolist() == [1.0, 1.0, 0.0, 0.75]
    assert table.merged.tolist() == [1.0, 0.0, 0.0, 0.5]
    assert table.mean_iou["bulk"] == pytest.approx(0.5)
    # Two bags at once, told row by row.
    both = pd.concat([each, each])
    rows = pd.Series(["a"] * 4 + ["b"] * 4)
    assert score_by(both, rows).loc["a"].tolist() == table.loc["all"].tolist()


def test_a_series_of_the_tables_own_ids_goes_by_them_however_it_is_sorted():
    each = score_objects(line(1, 1, 2, 2, 3, 3, 4), line(1, 1, 2, 2, 2, 2, 0))
    kinds = pd.Series({4: "lost", 2: "bulk", 1: "metal", 3: "bulk"})
    pd.testing.assert_frame_equal(score_by(each, kinds), score_by(each, kinds.to_dict()))
    # Rows counted from 0 are no IDs.
    rows = kinds.sort_index().reset_index(drop=True)
    pd.testing.assert_frame_equal(score_by(each, rows), score_by(each, kinds))


def test_objects_without_a_group_are_counted_and_a_whole_table_is_refused():
    each = score_objects(line(1, 1, 2, 2, 3, 3, 4), line(1, 1, 2, 2, 2, 2, 0))
    kinds = pd.Series({1: "metal", 2: np.nan, 3: "bulk", 4: None})
    for groups in (kinds, kinds.iloc[:3], kinds.to_dict(), pd.Series([7.0, np.nan, 8.0, np.nan])):
        table = score_by(each, groups)
        assert table.objects.tolist()[-2:] == [2, 4]
        assert table.index.tolist()[-2:] == ["unknown", "all"]
    with pytest.raises(TypeError, match="such as one column of a table, got DataFrame"):
        score_by(each, kinds.to_frame("kind"))


def test_fragmentation_and_merge_rates_by_hand():
    result = score(line(1, 1, 2, 2, 3, 3, 4, 4), line(1, 5, 2, 2, 2, 2, 4, 4))
    assert result["fragmentation_rate"] == 0.25
    assert result["merge_rate"] == 0.5


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="one shape"):
        score_objects(line(1, 1), line(1))
    with pytest.raises(ValueError, match="at least one object"):
        score_objects(line(0, 0), line(1, 1))


def test_sixty_thousand_objects_of_any_id_need_no_table_of_all_pairs():
    # A dense table of their pairs would take 26.8 GiB.
    found = np.repeat(np.arange(60_000), 4).reshape(60, 100, 40)
    truth = np.where(found > 0, found + 2**40, 0)
    result = score(truth, np.roll(found, 1))
    assert result["true_objects"] == result["found_objects"] == 59_999
    # Three of four voxels stay, of five in all: the first object has lost nothing to air's side.
    assert result["mean_iou"] == pytest.approx(0.6, abs=1e-3)
    assert len(score_objects(truth, found)) == 59_999


@pytest.mark.parametrize("factor", [1, 10**12])
def test_planes_counted_one_by_one_give_what_all_at_once_do(monkeypatch, factor):
    rng = np.random.default_rng(0)
    truth, found = rng.integers(0, 6, (2, 7, 8, 9)) * factor
    # Some labels are in some planes alone, and background is not in all.
    truth[3], found[:5][found[:5] == 2 * factor] = 5 * factor, factor
    whole, scores = Overlaps.of(truth, found), score(truth, found)
    monkeypatch.setattr("napari_unpack.segmentation.evaluation.AT_ONCE", 2 * 8 * 9)
    parts = Overlaps.of(truth, found)
    for name in ("true_ids", "found_ids", "rows", "columns", "voxels"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert score(truth, found) == scores


def test_a_score_takes_little_memory_beside_the_labels():
    labels = np.repeat(np.arange(128, dtype=np.uint16), 128 * 128).reshape(128, 128, 128)
    tracemalloc.start()
    score(labels, labels)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 16 * labels.size


def test_large_ids_without_a_sign_are_told_apart():
    labels = np.zeros((8, 8, 8), np.uint64)
    labels[:3], labels[5:] = 2**60, 2**60 + 1
    assert score(labels, labels)["true_objects"] == 2
    with pytest.raises(ValueError, match=r"found must be below 2\*\*63"):
        score_objects(labels, np.where(labels, np.uint64(2**63), labels))


def test_every_number_of_a_score_is_explained():
    told = set(re.findall(r"\w+", score.__doc__))
    assert set(score(np.ones((2, 3, 4), int), np.ones((2, 3, 4), int))) <= told
