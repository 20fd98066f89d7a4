"""Components of masks are those of scipy, whatever the shape."""

import numpy as np
import pytest
from scipy import ndimage

from napari_unpack.segmentation.common.mask_components import mask_components


@pytest.mark.parametrize("dimensions", [2, 3])
def test_components_are_those_of_scipy(dimensions: int) -> None:
    rng = np.random.default_rng(0)
    for _ in range(400):
        # Of bool, cc3d 4.1 stumbles over odd rows and over volumes of one row.
        shape = rng.integers(1, 30 if dimensions == 2 else 7, dimensions)
        mask = rng.random(shape) < rng.choice([0.02, 0.1, 0.3, 0.7])
        found, count = mask_components(mask)
        wanted, number = ndimage.label(mask, np.ones((3,) * dimensions))
        assert count == number
        # Each has one name in either.
        pairs = np.unique(np.stack([found[mask], wanted[mask]]), axis=1)
        assert pairs.shape[1] == number
        assert not found[~mask].any()
