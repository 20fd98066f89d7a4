"""What fades into air is a streak; what ends in a step is a thing, however the scan is blurred."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.foreground.streaks import find_streaks, without_streaks
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


def test_a_streak_goes_and_the_metal_in_it_stays_under_a_label_of_its_own():
    labels, density = scene()
    knife, speck = np.zeros_like(labels, bool), np.zeros_like(labels, bool)
    knife[19:21, 16:24, 98:106] = True
    speck[20, 28, 102] = True
    density[knife | speck] = 9000
    kept = labels.copy()
    streaks = np.array([False, False, False, False, True])
    # Solid is what is 54 times as dense as the knee: 2700.
    found, count = without_streaks(labels, streaks, density, DensityScale(0.0, 50.0), 27.0)
    assert (labels == kept).all()
    assert count == 1
    assert (found == np.where(knife, 5, np.where(labels < 4, labels, 0))).all()


def test_a_streak_without_metal_goes_whole_and_metal_elsewhere_is_left_alone():
    labels, density = scene()
    density[labels == 2] = 9000
    streaks = np.array([False, False, False, False, True])
    found, count = without_streaks(labels, streaks, density, DensityScale(0.0, 50.0), 27.0)
    assert count == 0
    assert (found == np.where(labels < 4, labels, 0)).all()
