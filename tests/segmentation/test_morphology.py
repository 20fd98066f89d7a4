"""Dilation and erosion are those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from napari_unpack.segmentation.common.morphology import dilate, erode


@pytest.mark.parametrize("connectivity", [1, 2, 3])
@pytest.mark.parametrize("shape", [(9, 8, 7), (1, 6, 5), (4, 1, 1), (0, 3, 3)])
def test_masks_are_dilated_and_eroded_as_scipy_does(connectivity, shape):
    rng = np.random.default_rng(connectivity)
    structure = ndimage.generate_binary_structure(3, connectivity)
    for share in (0.03, 0.5, 0.97):
        mask = rng.random(shape) < share
        before = mask.copy()
        for times in (1, 2):
            expected = ndimage.binary_dilation(mask, structure, times)
            np.testing.assert_array_equal(dilate(mask, connectivity, times), expected)
        expected = ndimage.binary_erosion(mask, structure, border_value=1)
        np.testing.assert_array_equal(erode(mask, connectivity), expected)
        np.testing.assert_array_equal(mask, before)
