"""Mean-affinity linkage: fragments are merged while their mean affinity is high enough."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.joins import JoinLog
from napari_unpack.segmentation.common.merging import roots
from napari_unpack.segmentation.learned.fragments import REACH_WEIGHTS, FragmentAffinities

# How the excess of a mean affinity over its threshold becomes a probability; see `chance_of`.
CHANCE = (12.0, 1.0)
# Bounds of thresholds.
LOWEST, HIGHEST = 0.05, 0.6


@dataclass(frozen=True)
class LinkageThreshold:
    """The mean affinity from which two are merged: the larger they are, the higher.

    Parameters
    ----------
    usual : float
        Where the smaller has 1000 cells.
    slope : float
        More of it for every ten times as many; not negative.
    """

    usual: float = 0.25
    slope: float = 0.15

    def at(self, cells: float) -> float:
        """Return the threshold for a pair whose smaller has so many cells."""
        wanted = self.usual + self.slope * math.log10(max(cells, 1.0) / 1000)
        return min(max(wanted, LOWEST), HIGHEST)


def mean_affinity_linkage(
    affinities: FragmentAffinities,
    sizes: NDArray[np.integer],
    threshold: LinkageThreshold,
    log: JoinLog | None = None,
) -> NDArray[np.int64]:
    """Merge the pair that exceeds the threshold by most, again and again; return (count,) owners.

    Parameters
    ----------
    affinities : FragmentAffinities
    sizes : (count,) ndarray of int
        Cells of every fragment.
    threshold : LinkageThreshold
    log : JoinLog, optional
        Where merges are noted.

    Notes
    -----
    Average linkage on a signed graph (Bailoni et al., GASP, CVPR 2022): pairs that
    only long reaches connect enter the mean as soon as their objects touch, so that they hold apart
    what a leak would merge. O(E log E) for E pairs while objects have few neighbours.
    """
    count = len(sizes)
    cells = sizes.astype(np.float64).tolist()
    # Of each alone; that of a pair is its smaller's.
    bars = [threshold.at(size) for size in cells]
    owner = np.arange(count)
    near: list[dict[int, list[float]]] = [{} for _ in range(count)]
    heap: list[tuple[float, int, int, float, float]] = []

    def consider(a: int, b: int) -> None:
        total, number, faces = near[a][b]
        # Long reaches alone see through what lies between: only what touches is merged.
        if not faces:
            return
        excess = total / number - min(bars[a], bars[b])
        if excess >= 0:
            heapq.heappush(heap, (-excess, min(a, b), max(a, b), number, cells[a] + cells[b]))

    rows = zip(
        affinities.pairs.tolist(),
        (affinities.sums @ REACH_WEIGHTS).tolist(),
        (affinities.counts @ REACH_WEIGHTS).tolist(),
        affinities.touching.tolist(),
        strict=True,
    )
    for (a, b), total, number, faces in rows:
        near[a][b] = near[b][a] = [total, number, faces]
        consider(a, b)
    while heap:
        lacking, a, b, number, both = heapq.heappop(heap)
        entry = near[a].get(b)
        # Entries of the heap are not updated; one that a merge has changed is out of date.
        if entry is None or entry[1] != number or cells[a] + cells[b] != both:
            continue
        # The one with more neighbours stays: the work is that of the shorter list.
        if len(near[a]) < len(near[b]):
            a, b = b, a
        owner[b] = a
        if log is not None:
            log.joined.append((a, b, chance_of(-lacking)))
        cells[a] += cells[b]
        bars[a] = threshold.at(cells[a])
        _inherit(near, a, b)
        for c in near[a]:
            consider(a, c)
    return roots(owner)


def chance_of(excess: float) -> float:
    """Return the probability that two fragments of this excess of affinity are one object."""
    return 1 / (1 + math.exp(-CHANCE[0] * excess - CHANCE[1]))


def _inherit(near: list[dict[int, list[float]]], a: int, b: int) -> None:
    """Add the affinities of b to those of a."""
    del near[a][b], near[b][a]
    for c, theirs in near[b].items():
        del near[c][b]
        mine = near[a].get(c)
        if mine is None:
            mine = near[a][c] = near[c][a] = [0.0, 0.0, 0.0]
        for k in range(3):
            mine[k] += theirs[k]
    near[b] = {}
