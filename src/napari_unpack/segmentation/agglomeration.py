"""Putting parts together, the surest pair first."""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.affinity import Parts, pair_features

Judge = Callable[[int, int, NDArray[np.float64]], float]


def agglomerate(
    parts: Parts, judge: Judge, least: float = 0.5, touching: float = 0.015
) -> NDArray[np.int64]:
    """Join touching parts while any two are more likely one object than not.

    Parameters
    ----------
    parts : Parts
        Measurements; used up.
    judge : callable
        `judge(one, two, features) -> probability` that two parts are one object.
    least : float
        Probability below which nothing is joined.
    touching : float
        Pairs that touch over a smaller share of the smaller surface are not judged: a corner
        against a corner joins nothing, and most pairs are such.

    Returns
    -------
    (M,) ndarray of int64
        For every label the label it now belongs to.

    Notes
    -----
    Best first with a heap: a join re-judges the neighbours of the joined part alone. About a
    millisecond a pair, most of it in convex hulls. Ties are broken by label.
    """
    count = len(parts.sums)
    owner = np.arange(count)
    version = np.zeros(count, np.int64)
    heap: list[tuple[float, int, int, int, int]] = []

    def consider(one: int, two: int) -> None:
        one, two = min(one, two), max(one, two)
        chance = judge(one, two, pair_features(parts, one, two))
        if chance >= least:
            heapq.heappush(heap, (-chance, one, two, int(version[one]), int(version[two])))

    surface = parts.area.sum(axis=1) + parts.sums[:, 4]
    near = parts.area > touching * np.minimum.outer(surface, surface)
    for one, two in np.argwhere(np.triu(near, 1)).tolist():
        consider(one, two)
    while heap:
        _, one, two, first, second = heapq.heappop(heap)
        if version[one] != first or version[two] != second:
            continue
        parts.join(one, two)
        owner[owner == two] = one
        version[one] += 1
        version[two] = -1
        surface[one] = parts.area[one].sum() + parts.sums[one, 4]
        enough = parts.area[one] > touching * np.minimum(surface[one], surface)
        for other in np.flatnonzero(enough).tolist():
            consider(one, other)
    return owner
