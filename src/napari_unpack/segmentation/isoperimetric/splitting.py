"""Recursive splitting at necks, without an oracle; with one see `recursion`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from napari_unpack.segmentation.common.convex_hull import solidity
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.shape_cuts import Cut, shape_cuts
from napari_unpack.tasks import Progress

Oracle = Callable[[Region], float]


@dataclass(frozen=True)
class SplitRule:
    """When a cut is taken.

    Parameters
    ----------
    smallest : float
        No part is smaller, mm^3.
    neck : float
        A cut is taken when its neck is at most this.
    compactness : float
        And when its area over volume^(2/3) of the smaller side is at most this.
    convexity : float
        And when the parts' volume-weighted mean solidity exceeds the whole's by this.
    """

    smallest: float = 1000.0
    neck: float = 0.65
    compactness: float = 1.2
    convexity: float = 0.05


def split(
    regions: list[Region],
    rule: SplitRule,
    progress: Progress | None = None,
) -> list[Region]:
    """Split regions until no cut is worth taking.

    Parameters
    ----------
    regions : list of Region
        6-connected regions.
    rule : SplitRule
        When to cut.
    progress : callable, optional
        Called before every region with the fraction of voxels settled; raising in it cancels.

    Returns
    -------
    list of Region
        In a fixed order: depth first, parts by their first voxel.
    """
    stack = list(reversed(regions))
    total = max(sum(region.voxels for region in regions), 1)
    settled = 0
    done: list[Region] = []
    while stack:
        region = stack.pop()
        if progress is not None:
            progress(settled / total, f"Splitting: {len(done)} pieces")
        cut = best_cut(region, rule)
        if cut is None:
            done.append(region)
            settled += region.voxels
        else:
            stack.extend(reversed(parts_of(region, cut)))
    return done


def best_cut(region: Region, rule: SplitRule) -> Cut | None:
    """Return the cut to take, or None where the region should stay whole."""
    if region.volume < 2 * rule.smallest:
        return None
    cuts = shape_cuts(region, rule.smallest)
    return next((cut for cut in cuts if _is_neck(region, cut, rule)), None)


def parts_of(region: Region, cut: Cut) -> list[Region]:
    """Return the regions a cut makes."""
    return [region.part(cut.parts == k) for k in range(1, int(cut.parts.max()) + 1)]


def _is_neck(region: Region, cut: Cut, rule: SplitRule) -> bool:
    counts = np.bincount(cut.parts.reshape(-1))[1:]
    smaller = min(float(counts[0]), float(counts.sum() - counts[0])) * region.voxel_volume
    compactness = cut.ratio * smaller ** (1 / 3)
    if cut.neck > rule.neck or compactness > rule.compactness:
        return False
    whole = solidity(region.mask, region.spacing)
    if whole > 1 - rule.convexity:
        return False
    parts = [solidity(part.mask, part.spacing) for part in parts_of(region, cut)]
    return float(np.average(parts, weights=counts)) - whole >= rule.convexity
