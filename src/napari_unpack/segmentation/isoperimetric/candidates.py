"""The pool of candidate cuts of a region, from every source, for an oracle to choose from.

No single splitter wins: trees find necks and miss face contacts, the
lattice finds least areas and bends around sheets, steps of density need a difference. So all
propose, and the confidence of the parts decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.relabeling import numbered
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.measures import chamfer_depth
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.candidate_sources import (
    PreparedRegion,
    Proposals,
    density_candidates,
    lattice_candidates,
    sheet_candidates,
    tree_candidates,
)
from napari_unpack.segmentation.isoperimetric.multiresolution import carried_back, coarsened
from napari_unpack.tasks import SILENT, Share

SOURCES: tuple[Callable[[PreparedRegion], Proposals], ...] = (
    tree_candidates,
    sheet_candidates,
    density_candidates,
    lattice_candidates,
)
# Share of the smaller part in which two candidates agree that are one.
SAME = 0.97
# Larger regions are cut on a reduced copy: the candidates of so many take some seconds.
MOST_VOXELS = 1_000_000
# Cuts into more are not proposed.
MOST_PARTS = 5


@dataclass(frozen=True, eq=False)
class Candidate:
    """One way to take a region apart.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ... in the region's box, 0 outside; each part is 6-connected.
    ratio : float
        Isoperimetric ratio: area between parts over the volume of all but the largest, 1/mm.
    source : str
        Which source proposed it: "tree", "lattice", "sheet", "materials" ...
    """

    parts: NDArray[np.int32]
    ratio: float
    source: str


def candidate_cuts(region: Region, smallest: float, share: Share = SILENT) -> list[Candidate]:
    """Propose cuts of a region from every source.

    Parameters
    ----------
    region : Region
        6-connected.
    smallest : float
        No part is smaller than this, mm^3.
    share : Share

    Returns
    -------
    list of Candidate
        By ascending ratio; of two that are the same but for 3 % of the voxels, the one of lesser
        ratio. Empty where the region cannot hold two parts.
    """
    # Every source works on at most 30,000 blocks; borders are settled at full resolution. Linear
    # in the voxels of the box, and bounded beyond that.
    if region.volume < 2 * smallest or region.voxels < 16:
        return []
    if region.voxels > MOST_VOXELS:
        return _reduced_candidates(region, smallest, share)
    piece = PreparedRegion.of(region, smallest)
    fewest = max(int(smallest / region.voxel_volume), 1)
    areas = region.voxel_volume / np.array(region.spacing)
    found: list[Candidate] = []
    blocks: list[NDArray[np.int32]] = []
    for source in share.over(SOURCES):
        for name, sides in source(piece):
            # Some twelve are proposed.
            share(min(len(blocks) / 12, 1.0))
            if any(_alike(sides, other) for other in blocks):
                continue
            blocks.append(sides)
            parts = carried_back(sides, piece.coarse.factor, region.mask, piece.depth)
            parts = _connected_parts(parts, fewest)
            if 2 <= parts.max() <= MOST_PARTS:
                found.append(Candidate(parts, _ratio(parts, areas, region.voxel_volume), name))
    kept: list[Candidate] = []
    for candidate in sorted(found, key=lambda c: c.ratio):
        if not any(_alike(candidate.parts, other.parts) for other in kept):
            kept.append(candidate)
    return kept


def _connected_parts(parts: NDArray[np.int32], smallest: int) -> NDArray[np.int32]:
    """Name parts by 6-connected component; those of fewer voxels are flooded by others."""
    components, count = cc3d.connected_components(parts, connectivity=6, return_N=True)
    sizes = np.bincount(components.reshape(-1), minlength=count + 1)
    large = sizes >= min(smallest, sizes[1:].max(initial=0))
    large[0] = False
    seeds = numbered(large)[components]
    return seeds if large[1:].all() else flood(seeds, parts > 0)


def _reduced_candidates(region: Region, smallest: float, share: Share) -> list[Candidate]:
    """Search on a copy of at most a million voxels, and carry its candidates back."""
    depth = chamfer_depth(region.mask, region.spacing)
    small = coarsened(region.mask, depth, region.density, region.spacing, MOST_VOXELS)
    copy = Region(small.mask, small.density, (0, 0, 0), small.spacing)
    fewest = max(int(smallest / region.voxel_volume), 1)
    found = []
    candidates = candidate_cuts(copy, smallest, share.part(0.0, 0.6))
    for candidate in share.part(0.6, 1.0).over(candidates):
        parts = carried_back(candidate.parts, small.factor, region.mask, depth)
        parts = _connected_parts(parts, fewest)
        if parts.max() >= 2:
            found.append(Candidate(parts, candidate.ratio, candidate.source))
    return found


def _ratio(parts: NDArray[np.int32], areas: NDArray[np.float64], voxel: float) -> float:
    """Return the isoperimetric ratio of parts: the area between them over all but the largest."""
    counts = np.bincount(parts.reshape(-1))[1:]
    return float(_between(parts, areas) / ((counts.sum() - counts.max()) * voxel))


def _alike(one: NDArray[np.int32], two: NDArray[np.int32]) -> bool:
    """Return whether two partitions of one region agree but for few voxels, whatever the names."""
    inside = (one > 0) & (two > 0)
    width = int(two.max()) + 1
    table = np.bincount(one[inside] * width + two[inside], minlength=(int(one.max()) + 1) * width)
    grid = table.reshape(-1, width)[1:, 1:]
    if np.count_nonzero(grid.sum(axis=1)) != np.count_nonzero(grid.sum(axis=0)):
        return False
    smaller = max(int(grid.sum() - grid.sum(axis=0).max()), 1)
    return bool(grid.sum() - grid.max(axis=1).sum() <= (1 - SAME) * smaller)


@njit(cache=True, nogil=True)
def _between(parts, areas):  # type: ignore[no-untyped-def]
    """Return the area between parts."""
    nz, ny, nx = parts.shape
    total = 0.0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                here = parts[z, y, x]
                if here == 0:
                    continue
                if z + 1 < nz and parts[z + 1, y, x] != here and parts[z + 1, y, x] > 0:
                    total += areas[0]
                if y + 1 < ny and parts[z, y + 1, x] != here and parts[z, y + 1, x] > 0:
                    total += areas[1]
                if x + 1 < nx and parts[z, y, x + 1] != here and parts[z, y, x + 1] > 0:
                    total += areas[2]
    return total
