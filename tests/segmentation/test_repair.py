import numpy as np
import pytest

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.repair import (
    delete_objects,
    difference,
    merge_objects,
    split_between,
)


def row(*labels):
    return np.array(labels, np.uint16).reshape(1, 1, -1)


def test_merge_delete_and_their_reverse_by_hand():
    labels = row(1, 1, 0, 2, 3, 3, 3)
    boxes = label_boxes(labels)
    merged = merge_objects(labels, boxes, [1, 3])
    assert merged.touched == {1, 3}
    assert merged.apply(labels).tolist() == [[[3, 3, 0, 2, 3, 3, 3]]]
    assert merged.reverse().apply(merged.apply(labels)).tolist() == labels.tolist()
    assert delete_objects(labels, boxes, [2]).apply(labels).tolist() == [[[1, 1, 0, 0, 3, 3, 3]]]
    # Of two equally large ones the smaller ID stays.
    assert merge_objects(row(5, 2), label_boxes(row(5, 2)), [5, 2]).apply(row(5, 2)).max() == 2


def test_a_split_leaves_the_id_with_the_larger_part():
    labels = np.zeros((7, 7, 30), np.uint16)
    labels[1:6, 1:6, 1:8] = 4
    labels[3, 3, 8:14] = 4
    labels[1:6, 1:6, 14:28] = 4
    edit = split_between(labels, label_boxes(labels), labels, (1, 1, 1), (3, 3, 20), (3, 3, 3), 9)
    after = edit.apply(labels)
    assert (after[1:6, 1:6, 1:8] == 9).all()
    assert (after[1:6, 1:6, 14:28] == 4).all()
    assert np.array_equal(after > 0, labels > 0)


@pytest.mark.parametrize("offset", [0, -1000, 32768])
def test_a_split_is_at_the_step_of_density_wherever_values_begin(offset):
    labels = np.zeros((12, 12, 40), np.uint16)
    labels[2:10, 2:10, 2:38] = 1
    density = np.random.default_rng(0).normal(10, 8, labels.shape) + 800 * labels + offset
    density[2:10, 2:10, 14:38] += 200
    edit = split_between(labels, label_boxes(labels), density, (1, 1, 1), (6, 6, 4), (6, 6, 36), 2)
    assert (edit.apply(labels)[2:10, 2:10, 2:38] == np.where(np.arange(2, 38) < 14, 2, 1)).all()


def test_the_difference_is_found_and_only_that():
    rng = np.random.default_rng(0)
    one = rng.integers(0, 5, (6, 7, 8)).astype(np.uint16)
    two = one.copy()
    two[2:4, 1, 3:5] += 1
    edit = difference(one, two)
    assert edit.box == (slice(2, 4), slice(1, 2), slice(3, 5))
    assert len(edit.where) == 4
    assert np.array_equal(edit.apply(one), two)
    assert difference(one, one.copy()) is None
