"""Means of values by label."""

import numpy as np

from napari_unpack.segmentation.common.density_regions import label_means


def test_means_are_of_each_labels_own_voxels_and_0_where_there_are_none() -> None:
    labels = np.array([[[0, 1, 1, 3, 3, 3]]], np.int32)
    values = np.array([[[np.inf, 2, 4, 1, 1, 4]]], np.float32)
    assert label_means(labels, values).tolist() == [0, 3, 0, 2]
    assert label_means(np.zeros((1, 2, 3), np.int32), values.reshape(1, 2, 3)).tolist() == [0]
