import numpy as np
import pandas as pd
import pytest

from napari_unpack.segmentation import score, score_by, score_objects


def line(*labels):
    return np.array(labels).reshape(1, 1, -1)


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


def test_fragmentation_and_merge_rates_by_hand():
    result = score(line(1, 1, 2, 2, 3, 3, 4, 4), line(1, 5, 2, 2, 2, 2, 4, 4))
    assert result["fragmentation_rate"] == 0.25
    assert result["merge_rate"] == 0.5


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="one shape"):
        score_objects(line(1, 1), line(1))
    with pytest.raises(ValueError, match="at least one object"):
        score_objects(line(0, 0), line(1, 1))
