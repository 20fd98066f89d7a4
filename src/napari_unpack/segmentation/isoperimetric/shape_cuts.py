"""Candidate cuts of a region at the necks of its shape."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.distance_tree import (
    TreeSweep,
    significant_minima,
    tree_sweep,
)

COARSE_VOXELS = 60_000
DROP = 1.15
THICK = 2.5


@dataclass(frozen=True, eq=False)
class Cut:
    """One way to take a region apart.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ... in the region's box, 0 outside; each part is 6-connected.
    ratio : float
        Isoperimetric ratio: area of the cut over the volume of the smaller side, 1/mm.
    neck : float
        Area of the cut over the largest cross-section of the slimmer side, in (0, 1]:
        small at a neck, 1 along a rod.
    source : str
        Which generator proposed it.
    """

    parts: NDArray[np.int32]
    ratio: float
    neck: float
    source: str


def shape_cuts(region: Region, smallest: float, keep: int = 3) -> Iterator[Cut]:
    """Propose cuts by isoperimetric distance trees, most promising first.

    Parameters
    ----------
    region : Region
        6-connected.
    smallest : float
        No side is smaller than this, mm^3.
    keep : int
        Most cuts proposed.

    Yields
    ------
    Cut

    Notes
    -----
    Regions above 60,000 voxels are halved in resolution until they are below it, and the cut is
    carried back by flooding the full-resolution depth: the tree of a large region costs a few
    tens of milliseconds, and the neck is placed to the voxel.
    """
    depth = edt.edt(region.mask, anisotropy=region.spacing, black_border=True)
    if float(depth.max()) < THICK * max(region.spacing):
        return
    factor = 1
    while region.voxels / factor**3 > COARSE_VOXELS:
        factor *= 2
    mask, distance = _coarsen(region.mask, depth, factor)
    spacing = region.spacing
    coarse = (spacing[0] * factor, spacing[1] * factor, spacing[2] * factor)
    sweep = tree_sweep(mask, distance, coarse)
    first = max(1, int(np.ceil(smallest / sweep.voxel)))
    last = len(sweep.order) - first
    for k in significant_minima(sweep.ratio, first, last, DROP, keep):
        parts = _carry_back(sweep, k, mask, region, depth, factor)
        parts = connected_parts(parts, int(smallest / region.voxel_volume))
        if parts.max() >= 2 and _all_thick(parts, depth, THICK * max(region.spacing)):
            neck = sweep.cut[k] / min(sweep.cut[: k + 1].max(), sweep.cut[k:].max())
            yield Cut(parts, float(sweep.ratio[k]), float(neck), "distance tree")


def _all_thick(parts: NDArray[np.int32], depth: NDArray[np.float32], least: float) -> bool:
    return all(float(depth[parts == k].max()) >= least for k in range(1, int(parts.max()) + 1))


def connected_parts(parts: NDArray[np.int32], smallest: int) -> NDArray[np.int32]:
    """Relabel parts by 6-connected component; small fragments go to a neighbour.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        Not changed.
    smallest : int
        Components of fewer voxels are flooded by the others.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        1, 2, ... by first voxel; 0 stays 0.
    """
    import cc3d

    components, count = cc3d.connected_components(parts, connectivity=6, return_N=True)
    sizes = np.bincount(components.reshape(-1), minlength=count + 1)
    large = sizes >= min(smallest, sizes[1:].max(initial=0))
    large[0] = False
    seeds = np.where(large, np.cumsum(large), 0).astype(np.int32)[components]
    return seeds if large[1:].all() else flood(seeds, parts > 0)


def _coarsen(
    mask: NDArray[np.bool_], depth: NDArray[np.float32], factor: int
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Shrink by the deepest voxel of each block, and keep one 6-connected component."""
    import cc3d

    if factor > 1:
        pad = [(0, -n % factor) for n in mask.shape]
        blocks = np.pad(depth, pad)
        a, b, c = (n // factor for n in blocks.shape)
        blocks = blocks.reshape(a, factor, b, factor, c, factor)
        depth = np.ascontiguousarray(blocks.max(axis=(1, 3, 5)))
        mask = depth > 0
        mask = cc3d.largest_k(mask, k=1, connectivity=6) > 0
    return mask, depth


def _carry_back(
    sweep: TreeSweep,
    k: int,
    mask: NDArray[np.bool_],
    region: Region,
    depth: NDArray[np.float32],
    factor: int,
) -> NDArray[np.int32]:
    flat = np.zeros(mask.size, np.int32)
    flat[sweep.order[: k + 1]] = 1
    flat[sweep.order[k + 1 :]] = 2
    sides: NDArray[np.int32] = flat.reshape(mask.shape)
    if factor == 1:
        return sides
    for axis in range(3):
        sides = sides.repeat(factor, axis=axis)
    a, b, c = region.mask.shape
    sides = np.where(region.mask, sides[:a, :b, :c], 0)
    blurred = _boundary(sides, factor)
    sides[blurred] = 0
    cost = np.clip(255 - depth * (255 / max(float(depth.max()), 1e-6)), 0, 255)
    return flood(sides, region.mask, cost.astype(np.uint8))


def _boundary(sides: NDArray[np.int32], width: int) -> NDArray[np.bool_]:
    from scipy.ndimage import binary_dilation

    near = np.zeros(sides.shape, np.bool_)
    for axis in range(3):
        low = np.moveaxis(sides, axis, 0)
        differ = (low[1:] != low[:-1]) & (low[1:] > 0) & (low[:-1] > 0)
        moved = np.moveaxis(near, axis, 0)
        moved[1:] |= differ
        moved[:-1] |= differ
    return np.asarray(binary_dilation(near, iterations=width))
