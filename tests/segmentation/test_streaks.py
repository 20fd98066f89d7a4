"""What fades into air is a streak; what ends in a step is a thing, however the scan is blurred."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.segmentation.foreground.streaks import find_streaks
from napari_unpack.segmentation.foreground.thresholds import Levels

LEVELS = Levels(air=0.0, noise=5.0, low=65.0, high=100.0)


def scene() -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Return three boxes of 1000, and a glow of 600 that fades over twenty voxels."""
    labels = np.zeros((40, 40, 120), np.int32)
    density = np.zeros(labels.shape, np.float32)
    for name, start in enumerate((5, 35, 65), 1):
        labels[10:30, 10:30, start : start + 20] = name
    density[labels > 0] = 1000
    z, y, x = np.indices(labels.shape)
    glow = 600 * np.exp(-((z - 20) ** 2 + (y - 20) ** 2 + (x - 102) ** 2) / (2 * 7.0**2))
    labels[(glow >= LEVELS.low) & (labels == 0) & (x > 86)] = 4
    return labels, np.maximum(density, glow.astype(np.float32))


def test_a_glow_is_a_streak_and_boxes_are_none_sharp_or_blurred():
    labels, density = scene()
    for sigma in (0.0, 1.0):
        blurred = gaussian_filter(density, sigma)
        assert find_streaks(labels, blurred, LEVELS).tolist() == [False] * 4 + [True], sigma
    for sigma in (2.0, 3.0):
        assert not find_streaks(labels, gaussian_filter(density, sigma), LEVELS)[:4].any(), sigma


def test_where_everything_fades_nothing_is_a_streak():
    labels, density = scene()
    alone = np.where(labels == 4, 1, 0).astype(np.int32)
    assert not find_streaks(alone, density, LEVELS).any()
    assert not find_streaks(np.zeros_like(labels), density, LEVELS).any()


def test_what_lies_in_matter_is_not_judged():
    labels, density = scene()
    # Flesh around a bone: no label, but no air.
    density = np.maximum(density, 500)
    assert not find_streaks(labels, density, LEVELS).any()
    # Nor is what others are around.
    shell = labels.copy()
    shell[(labels == 0)] = 5
    assert not find_streaks(shell, density, LEVELS).any()
