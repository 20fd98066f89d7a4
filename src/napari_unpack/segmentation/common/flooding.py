"""Seeded flooding: every voxel of a mask goes to the seed it can be reached from most cheaply."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import face_steps
from napari_unpack.tasks import SILENT, VOXELS_PER_CHECK, Share


def flood(
    seeds: NDArray[np.int32],
    mask: NDArray[np.bool_],
    cost: NDArray[np.uint8] | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Grow seeds over a mask in order of cost (Meyer's watershed in buckets); 0 where none reaches.

    Parameters
    ----------
    seeds : (Z, Y, X) ndarray of int32
        Labels to grow, 0 where there is none. Not changed. Labels outside the mask are dropped.
    mask : (Z, Y, X) ndarray of bool
        Where labels may grow to, through faces.
    cost : (Z, Y, X) ndarray of uint8, optional
        Height of the landscape, flooded from low to high; None floods by steps from the seeds.
    share : Share
    """
    # Linear in the voxels. Equal costs are flooded first come, first served, so that plateaus are
    # shared half-way between their seeds.
    # A frame of -1: no voxel has to be asked whether it lies at the border.
    shape = [n + 2 for n in mask.shape]
    labels = np.full(shape, -1, np.int32)
    inner = labels[1:-1, 1:-1, 1:-1]
    inner[mask] = seeds[mask]
    heights = np.zeros(shape, np.uint8)
    if cost is not None:
        heights[1:-1, 1:-1, 1:-1] = cost
    share(0.1)
    flat = labels.reshape(-1), heights.reshape(-1), face_steps(labels.shape)
    # First-in, first-out lists of the seeds to flood from, one for each height: the first of each,
    # the last, and what comes after each voxel. int32: 2^31 voxels are more than is ever flooded at
    # once, and this is the largest array here.
    head, tail = np.full(256, -1, np.int64), np.full(256, -1, np.int64)
    lists = head, tail, np.full(labels.size, -1, np.int32)
    _queue(*flat, *lists)
    share(0.2)
    level, flooded = 0, 0
    while level < 256:
        level = _flood(level, VOXELS_PER_CHECK, *flat, *lists)
        flooded += VOXELS_PER_CHECK
        share(0.2 + 0.7 * min(flooded / mask.size, 1.0))
    return np.where(mask, inner, 0).astype(np.int32, copy=False)


@njit(cache=True, nogil=True)
def _queue(labels, heights, steps, head, tail, after):  # type: ignore[no-untyped-def]
    """Put the seeds with something to flood around them into the lists of their heights."""
    for voxel in range(len(labels)):
        if labels[voxel] <= 0:
            continue
        for step in steps:
            # Seeds with nothing left to flood around them need no place in the lists.
            if labels[voxel + step] == 0:
                level = np.int64(heights[voxel])
                if tail[level] < 0:
                    head[level] = voxel
                else:
                    after[tail[level]] = voxel
                tail[level] = voxel
                break


@njit(cache=True, nogil=True)
def _flood(level, most, labels, heights, steps, head, tail, after):  # type: ignore[no-untyped-def]
    """Flood from so many voxels of padded labels: -1 is outside, 0 is to be flooded.

    Return the level to go on from, 256 where all is flooded.
    """
    while level < 256 and most > 0:
        voxel = head[level]
        if voxel < 0:
            level += 1
            continue
        most -= 1
        head[level] = after[voxel]
        if head[level] < 0:
            tail[level] = -1
        for step in steps:
            other = voxel + step
            if labels[other] != 0:
                continue
            labels[other] = labels[voxel]
            # Water never falls below where it came over a ridge.
            height = max(np.int64(heights[other]), level)
            if tail[height] < 0:
                head[height] = other
            else:
                after[tail[height]] = other
            tail[height] = other
    return level
