"""Labels of half the size: the most frequent label of each block."""

import numpy as np
import pytest

from napari_unpack.geometry.coarser_labels import halved


def most_frequent(block: np.ndarray) -> int:
    """Return the label that most voxels have, the largest of several."""
    ids, counts = np.unique(block, return_counts=True)
    return int(ids[counts == counts.max()].max())


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.int64, ">u2"])
@pytest.mark.parametrize("shape", [(4, 6, 8), (5, 7, 1)])
def test_a_voxel_has_the_most_frequent_label_of_its_block(
    shape: tuple[int, int, int], dtype: str
) -> None:
    fine = np.random.default_rng(0).integers(0, 4, shape).astype(dtype)
    coarse = halved(fine)
    assert coarse.shape == tuple(-(-n // 2) for n in shape)
    for z, y, x in np.ndindex(coarse.shape):
        block = fine[2 * z : 2 * z + 2, 2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
        assert coarse[z, y, x] == most_frequent(block)


def test_objects_stay_where_they_are() -> None:
    fine, low = np.zeros((4, 4, 1024), np.uint16), 3
    rng, middles = np.random.default_rng(0), []
    while low < 1000:
        size = int(rng.integers(20, 30))
        middles.append(low + (size - 1) / 2)
        fine[..., low : low + size] = len(middles)
        low += size + int(rng.integers(9, 14))
    half = halved(fine)
    for coarse, factor in ((half, 2), (halved(half), 4)):
        found = [np.argwhere(coarse == i + 1)[:, 2].mean() for i in range(len(middles))]
        moved = factor * np.array(found) + (factor - 1) / 2 - middles
        # The first voxel of each block would move them by (factor - 1) / 2.
        assert abs(moved.mean()) < factor / 8
