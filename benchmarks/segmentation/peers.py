"""Plain ways to find objects in the same foreground, each over a grid of its settings."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import cc3d
import edt
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.geometry.axes import voxel_size
from napari_unpack.segmentation.foreground.denoising import is_noisy, without_noise_and_haze
from napari_unpack.segmentation.foreground.thresholds import above_levels, find_levels, peel

Labels = NDArray[np.integer[Any]]
Found = Iterator[tuple[str, Labels]]
MIN_OBJECT_MM3 = 500
MOST_WALKED = 100_000
"""Voxels of matter at half resolution beyond which a random walker does not fit."""


def foreground_of(volume: NDArray[Any], spacing: Any) -> NDArray[np.bool_]:
    """Return the foreground that every method is given; of a grainy volume, what is left of it."""
    if is_noisy(volume):
        volume = without_noise_and_haze(volume, voxel_size(spacing))
    levels = find_levels(volume)
    return np.asarray(peel(above_levels(volume, levels), volume, levels.air))


def components(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield the connected components."""
    parts = cc3d.connected_components(foreground_of(volume, spacing), connectivity=6)
    yield "components", cc3d.dust(parts, threshold=MIN_OBJECT_MM3)


def watersheds(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield distance transform + peaks + watershed over a grid of settings."""
    from skimage.segmentation import watershed

    foreground = foreground_of(volume, spacing)
    depth = edt.edt(foreground, anisotropy=spacing, black_border=True)
    for sigma, distance in itertools.product((1.0, 2.0), (6, 10, 15)):
        smooth = gaussian_filter(depth, sigma)
        seeds = _peaks(smooth, foreground, distance)
        yield f"watershed s{sigma:g} d{distance}", watershed(-smooth, seeds, mask=foreground)


def random_walks(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield random walks from the peaks of depth, at half resolution, where they fit."""
    from skimage.segmentation import random_walker

    half = tuple(slice(None, None, 2) for _ in range(3))
    foreground = foreground_of(volume, spacing)[half]
    if np.count_nonzero(foreground) > MOST_WALKED:
        return
    values = gaussian_filter(volume.astype(np.float32), 1.0)[half]
    values = np.log(np.maximum(values, 0) + 100)
    depth = gaussian_filter(edt.edt(foreground, anisotropy=spacing, black_border=True), 1.0)
    for distance in (7,):
        seeds = _peaks(depth, foreground, distance)
        # What no seed reaches would have no answer.
        pieces = cc3d.connected_components(foreground, connectivity=6)
        reached = np.isin(pieces, np.unique(pieces[seeds > 0]))
        marked = np.where(reached & foreground, seeds, -1)
        walked = random_walker(values, marked, beta=130, mode="cg_j", tol=1e-3, copy=True)
        labels = np.maximum(np.asarray(walked), 0).astype(np.int32)
        whole = labels.repeat(2, 0).repeat(2, 1).repeat(2, 2)
        yield f"random walker d{distance}", whole[tuple(slice(n) for n in volume.shape)]


def _peaks(depth: NDArray[Any], foreground: NDArray[np.bool_], distance: int) -> NDArray[np.int32]:
    from skimage.feature import peak_local_max

    peaks = peak_local_max(depth, min_distance=distance, labels=foreground.astype(np.int32))
    seeds = np.zeros(depth.shape, np.int32)
    seeds[tuple(peaks.T)] = np.arange(1, len(peaks) + 1)
    return seeds


PEERS: tuple[tuple[str, Callable[[NDArray[Any], Any], Found]], ...] = (
    ("components", components),
    ("watershed", watersheds),
    ("random walker", random_walks),
)
"""Families of settings; the best of each by mean F1 stands in the table."""
