"""Boxes, voxel counts and front areas of objects."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.boxes import label_boxes


@pytest.fixture
def labels() -> np.ndarray:
    out = np.zeros((6, 7, 8), np.uint16)
    out[1:3, 2:5, 3:7] = 4
    out[2, 3, 5] = 9
    out[5, 6, 7] = 65535
    out[0, 0, 0] = 65535
    return out


def test_boxes_and_counts_by_hand(labels) -> None:
    boxes = label_boxes(labels)
    assert boxes.ids.tolist() == [4, 9, 65535]
    assert boxes.lower.tolist() == [[1, 2, 3], [2, 3, 5], [0, 0, 0]]
    assert boxes.upper.tolist() == [[3, 5, 7], [3, 4, 6], [6, 7, 8]]
    assert boxes.counts.tolist() == [23, 1, 2]


def test_an_empty_volume_has_no_boxes() -> None:
    assert len(label_boxes(np.zeros((3, 3, 3), np.uint16)).ids) == 0


def test_centre_and_corners_are_in_mm(labels) -> None:
    boxes = label_boxes(labels)
    # Voxels 1..2, 2..4, 3..6 of (2, 1, 0.5) mm.
    np.testing.assert_allclose(boxes.center(4, np.array([2, 1, 0.5])), (3.0, 3.0, 2.25))
    corners = boxes.corners(4, np.array([2, 1, 0.5]))
    np.testing.assert_allclose(corners.min(0), (1.0, 1.5, 1.25))
    np.testing.assert_allclose(corners.max(0), (5.0, 4.5, 3.25))
    assert len(np.unique(corners, axis=0)) == 8


def test_slices_stay_in_the_volume_below(labels) -> None:
    boxes = label_boxes(labels)
    assert boxes.slices(4, margin=2) == (slice(0, 5), slice(0, 7), slice(1, 9))
    with pytest.raises(KeyError, match="no object 5"):
        boxes.slices(5)


def test_front_areas_by_hand(labels) -> None:
    # Object 4 is 2 x 3 x 4 voxels; of (2, 1, 1) mm: 4 x 3 x 4 mm. Along x one sees 4 x 3;
    # along (0.6, 0, 0.8), 0.6 of 3 x 4 and 0.8 of 4 x 3.
    boxes = label_boxes(labels)
    spacing = np.array([2.0, 1.0, 1.0])
    assert boxes.front_areas(spacing, np.array([0, 0, 1.0]))[0] == pytest.approx(12.0)
    assert boxes.front_areas(spacing, np.array([0.6, 0, 0.8]))[0] == pytest.approx(16.8)
