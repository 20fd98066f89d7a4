from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.relabeling import compact_labels, numbered


@pytest.mark.parametrize("dtype", [np.int64, np.uint64, np.int32, np.uint32])
def test_objects_are_numbered_in_the_order_of_their_ids(dtype):
    rng = np.random.default_rng(0)
    ids = np.unique(rng.integers(1, min(np.iinfo(dtype).max, 2**62), 300)).astype(dtype)
    labels = np.concatenate([[0], ids]).astype(dtype)[rng.integers(0, len(ids) + 1, (7, 11, 13))]
    compact, given = compact_labels(labels)
    assert compact.dtype == np.uint16
    assert compact.flags.c_contiguous
    np.testing.assert_array_equal(given[compact], labels.astype(np.int64))
    assert given[0] == 0
    assert (np.diff(given) > 0).all()
    assert set(compact.ravel()) | {0} == set(range(len(given)))


def test_labels_without_background_and_views_are_taken():
    labels = np.arange(5, 5 + 4 * 6 * 8, dtype=np.int64).reshape(4, 6, 8)[::-1, ::2, 1::3] * 10**12
    compact, given = compact_labels(labels)
    np.testing.assert_array_equal(given[compact], labels)
    assert compact.min() == 1


def test_65535_objects_are_kept_and_one_more_is_refused():
    labels = (np.arange(65536, dtype=np.int64) * 7919).reshape(16, 64, 64)
    compact, given = compact_labels(labels)
    assert len(given) == 65536
    np.testing.assert_array_equal(compact.ravel(), np.arange(65536))
    with pytest.raises(ValueError, match="at most 65,535 objects"):
        compact_labels(labels + 1)


@pytest.mark.parametrize("dtype", [">i4", ">u4", ">i8", "<i4"])
def test_labels_of_either_byte_order_are_taken(dtype):
    compact, given = compact_labels(np.array([[[0, 70_000, 300, 70_000]]], dtype))
    assert compact.tolist() == [[[0, 2, 1, 2]]]
    assert given.tolist() == [0, 300, 70_000]


def test_what_is_kept_is_numbered_without_gaps_and_all_else_is_0():
    found = numbered(np.array([False, True, False, True, True]))
    assert found.dtype == np.int32
    assert found.tolist() == [0, 1, 0, 2, 3]
