"""Work on a smaller copy of a region, and carry its cut back to the voxel."""

from __future__ import annotations

from dataclasses import dataclass

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.morphology import dilate
from napari_unpack.segmentation.common.validation import Spacing


@dataclass(frozen=True, eq=False)
class ReducedRegion:
    """A region in blocks of `factor` voxels along each axis.

    Parameters
    ----------
    factor : int
        1 where nothing was reduced.
    mask : (Z', Y', X') ndarray of bool
        Blocks at least half full, and of the others what keeps it connected.
    spacing : (float, float, float)
        Size of a block z y x, mm.
    depth : (Z', Y', X') ndarray of float32
        Largest depth in each block, mm.
    density : (Z', Y', X') ndarray of float32
        Mean density of the region's voxels in each block.
    """

    factor: int
    mask: NDArray[np.bool_]
    spacing: Spacing
    depth: NDArray[np.float32]
    density: NDArray[np.float32]


def coarsened(
    mask: NDArray[np.bool_],
    depth: NDArray[np.float32],
    density: NDArray[np.generic],
    spacing: Spacing,
    most: int,
) -> ReducedRegion:
    """Halve the resolution of a region until it has at most so many blocks in one component.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        6-connected.
    depth : (Z, Y, X) ndarray of float32
        Distance to the outside, mm.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    most : int
        Blocks.
    """
    voxels = int(np.count_nonzero(mask))
    factor = 1
    while voxels / factor**3 > most:
        factor *= 2
    # Densities of others in the same block must not enter its mean.
    values = np.where(mask, np.nan_to_num(density.astype(np.float32)), np.float32(0))
    if factor == 1:
        return ReducedRegion(1, mask, spacing, depth, values)
    count = _blocks(mask.astype(np.float32), factor).sum(axis=(1, 3, 5))
    total = _blocks(values, factor).sum(axis=(1, 3, 5))
    deepest = np.ascontiguousarray(_blocks(depth, factor).max(axis=(1, 3, 5)))
    # Every block that holds any of it, or thin bridges would break; specks at corners go.
    small = cc3d.largest_k(count > 0, k=1, connectivity=6) > 0
    mean = (total / np.maximum(count, 1)).astype(np.float32)
    a, b, c = spacing
    return ReducedRegion(factor, small, (a * factor, b * factor, c * factor), deepest, mean)


def carried_back(
    sides: NDArray[np.int32],
    factor: int,
    mask: NDArray[np.bool_],
    depth: NDArray[np.float32],
) -> NDArray[np.int32]:
    """Bring parts from blocks to all voxels of a mask that they reach through faces.

    Parameters
    ----------
    sides : (Z', Y', X') ndarray of int32
        Parts 1, 2, ... of the blocks, 0 outside.
    factor : int
        Voxels a block along each axis.
    mask : (Z, Y, X) ndarray of bool
        The region.
    depth : (Z, Y, X) ndarray of float32
        Distance to the outside, mm: borders settle where it is small.
    """
    # A band of one block on both sides of every border is forgotten and flooded again at full
    # resolution.
    a, b, c = mask.shape
    full = sides.repeat(factor, axis=0).repeat(factor, axis=1).repeat(factor, axis=2)
    full = np.where(mask, full[:a, :b, :c], 0).astype(np.int32, copy=False)
    if factor > 1:
        forgotten = np.where(_border(full, factor), 0, full).astype(np.int32, copy=False)
        # A part thinner than the band would be lost with it.
        present = np.bincount(forgotten.reshape(-1), minlength=int(full.max()) + 1) > 0
        full = np.where(present[full], forgotten, full)
    height = 1 - depth / max(float(depth.max()), 1e-6)
    return flood(full, mask, np.clip(255 * height, 0, 255).astype(np.uint8))


def _blocks(values: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    padded = np.pad(values, [(0, -n % factor) for n in values.shape])
    a, b, c = (n // factor for n in padded.shape)
    return padded.reshape(a, factor, b, factor, c, factor)


def _border(parts: NDArray[np.int32], width: int) -> NDArray[np.bool_]:
    near = np.zeros(parts.shape, np.bool_)
    for axis in range(3):
        low = np.moveaxis(parts, axis, 0)
        differ = (low[1:] != low[:-1]) & (low[1:] > 0) & (low[:-1] > 0)
        moved = np.moveaxis(near, axis, 0)
        moved[1:] |= differ
        moved[:-1] |= differ
    return dilate(near, iterations=width)
