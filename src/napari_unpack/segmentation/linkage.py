"""Joining fragments by how strongly they belong together on average."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.fragments import Ties


def link(ties: Ties, count: int, least: float) -> NDArray[np.int64]:
    """Join the pair that belongs together most, again and again.

    Parameters
    ----------
    ties : Ties
        Pairs of fragments.
    count : int
        Fragments 0 ... count - 1.
    least : float
        Mean probability below which nothing is joined.

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
    owner = np.arange(count)
    near: list[dict[int, list[float]]] = [{} for _ in range(count)]
    heap: list[tuple[float, int, int, float]] = []
    rows = zip(
        ties.pairs.tolist(),
        ties.sums.tolist(),
        ties.counts.tolist(),
        ties.touching.tolist(),
        strict=True,
    )
    for (a, b), total, number, faces in rows:
        near[a][b] = near[b][a] = [total, number, faces]
        if faces and total >= least * number:
            heap.append((-total / number, a, b, number))
    heapq.heapify(heap)
    while heap:
        _, a, b, number = heapq.heappop(heap)
        tied = near[a].get(b)
        if tied is None or tied[1] != number:
            continue
        if len(near[a]) < len(near[b]) or (len(near[a]) == len(near[b]) and b < a):
            a, b = b, a
        owner[b] = a
        del near[a][b], near[b][a]
        for c, (total, number, faces) in near[b].items():
            del near[c][b]
            mine = near[a].get(c)
            if mine is None:
                mine = near[a][c] = near[c][a] = [0.0, 0.0, 0.0]
            mine[0] += total
            mine[1] += number
            mine[2] += faces
            if mine[2] and mine[0] >= least * mine[1]:
                heapq.heappush(heap, (-mine[0] / mine[1], min(a, c), max(a, c), mine[1]))
        near[b] = {}
    for k in range(count):
        root = k
        while owner[root] != root:
            root = int(owner[root])
        owner[k] = root
    return owner
