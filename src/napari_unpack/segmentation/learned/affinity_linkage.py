"""Joining fragments by how strongly they belong together on average."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.learned.fragments import Ties


@dataclass(frozen=True)
class Bar:
    """How surely two must belong together to be joined: the larger they are, the more so.

    Parameters
    ----------
    usual : float
        Mean probability where the smaller has 1000 cells.
    slope : float
        More of it for every ten times as many.
    lowest, highest : float
        Bounds.
    """

    usual: float = 0.25
    slope: float = 0.15
    lowest: float = 0.05
    highest: float = 0.6

    def height(self, cells: float) -> float:
        """Return the bar for a pair whose smaller has so many cells."""
        wanted = self.usual + self.slope * math.log10(max(cells, 1.0) / 1000)
        return min(max(wanted, self.lowest), self.highest)


def link(
    ties: Ties, sizes: NDArray[np.integer], bar: Bar, weights: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Join the pair that passes the bar by most, again and again.

    Parameters
    ----------
    ties : Ties
        Pairs of fragments.
    sizes : (count,) ndarray of int
        Cells of every fragment.
    bar : Bar
        What a pair must pass.
    weights : (K,) ndarray of float64
        Of the reaches in the mean.

    Returns
    -------
    (count,) ndarray of int64
        For every fragment the one that stands for its object.

    Notes
    -----
    Average linkage on a signed graph (Bailoni et al., GASP, CVPR 2022): pairs that long reaches
    alone tie take part in the mean as soon as their objects touch, so that they hold apart what
    a leak would join. O(E log E) for E pairs while objects have few neighbours.
    """
    count = len(sizes)
    cells = sizes.astype(np.float64).tolist()
    owner = np.arange(count)
    near: list[dict[int, list[float]]] = [{} for _ in range(count)]
    heap: list[tuple[float, int, int, float, float]] = []

    def consider(a: int, b: int) -> None:
        total, number, faces = near[a][b]
        if not faces:
            return
        excess = total / number - bar.height(min(cells[a], cells[b]))
        if excess >= 0:
            heapq.heappush(heap, (-excess, min(a, b), max(a, b), number, cells[a] + cells[b]))

    rows = zip(
        ties.pairs.tolist(),
        (ties.sums @ weights).tolist(),
        (ties.counts @ weights).tolist(),
        ties.touching.tolist(),
        strict=True,
    )
    for (a, b), total, number, faces in rows:
        near[a][b] = near[b][a] = [total, number, faces]
        consider(a, b)
    while heap:
        _, a, b, number, both = heapq.heappop(heap)
        tied = near[a].get(b)
        if tied is None or tied[1] != number or cells[a] + cells[b] != both:
            continue
        if len(near[a]) < len(near[b]):
            a, b = b, a
        owner[b] = a
        cells[a] += cells[b]
        _inherit(near, a, b)
        for c in near[a]:
            consider(a, c)
    for k in range(count):
        root = k
        while owner[root] != root:
            root = int(owner[root])
        owner[k] = root
    return owner


def _inherit(near: list[dict[int, list[float]]], a: int, b: int) -> None:
    """Add the ties of b to those of a."""
    del near[a][b], near[b][a]
    for c, theirs in near[b].items():
        del near[c][b]
        mine = near[a].get(c)
        if mine is None:
            mine = near[a][c] = near[c][a] = [0.0, 0.0, 0.0]
        for k in range(3):
            mine[k] += theirs[k]
    near[b] = {}
