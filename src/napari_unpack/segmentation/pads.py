"""The pad on a scanner's table: a soft thin outline between the table and the bag."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

HEIGHT = 40.0


def pad_and_beyond(
    share: NDArray[np.float32],
    table: NDArray[np.bool_],
    spacing: tuple[float, float],
    clear: float = 0.55,
    emptiness: float = 0.25,
) -> NDArray[np.bool_]:
    """Find the cross-section of a pad on a table, and of what lies beyond the table.

    Parameters
    ----------
    share : (H, W) ndarray of float32
        Fraction of slices in which a pixel is matter.
    table : (H, W) ndarray of bool
        Cross-section of the table, wider than it is high, with the bag above or below it.
    spacing : (float, float)
        Pixel size, mm.
    clear : float
        In a quarter of the table's columns the outline is at least this persistent.
    emptiness : float
        Between outline and table, where it is clear, fewer voxels than this share are matter.

    Returns
    -------
    (H, W) ndarray of bool
        The outline of the pad, where there is one, and all that is seen from the bag behind it
        or behind the table.

    Notes
    -----
    The outline is the most persistent line that moves at most one pixel a column, no further
    than 40 mm from the table: found by dynamic programming. Under the bag's weight it wanders
    from slice to slice, so that a threshold would lose it there.
    """
    if not table.any():
        return np.zeros_like(table)
    columns = np.flatnonzero(table.any(axis=0))
    heights = np.arange(len(table))[:, None]
    middle = heights.mean() if not share.any() else np.average(heights[:, 0], weights=share.sum(1))
    if middle > np.average(heights[:, 0], weights=table.sum(axis=1)):
        return pad_and_beyond(share[::-1], table[::-1], spacing, clear, emptiness)[::-1]
    surface = table[:, columns].argmax(axis=0)
    reach = min(int(HEIGHT / spacing[0]), int(surface.min()))
    behind = np.zeros_like(table)
    behind[:, columns] = heights >= surface
    if reach < 4 or len(columns) < 16:
        return behind
    rows = surface[None, :] - 2 - np.arange(reach - 2)[:, None]
    band = maximum_filter1d(share, 3, axis=0)[rows, columns]
    lift = _ridge(np.ascontiguousarray(band), surface)
    found = band[lift, np.arange(len(columns))]
    distinct = found >= clear
    under = (np.arange(reach - 2)[:, None] < lift[None, :] - 1) & distinct
    inside = share[rows, columns][under]
    if distinct.mean() < 0.25 or not len(inside) or inside.mean() > emptiness:
        return behind
    top = surface - 2 - lift - 1
    behind[:, columns] = heights >= top - 1
    return behind


@njit(cache=True, nogil=True)
def _ridge(band, surface):  # type: ignore[no-untyped-def]
    height, width = band.shape
    total = np.full((height, width), -1e9)
    came = np.zeros((height, width), np.int64)
    total[:, 0] = band[:, 0]
    for x in range(1, width):
        slope = surface[x] - surface[x - 1]
        for k in range(height):
            for move in (0, -1, 1):
                j = k - slope + move
                if 0 <= j < height and total[j, x - 1] > total[k, x] - band[k, x]:
                    total[k, x] = total[j, x - 1] + band[k, x]
                    came[k, x] = j
    path = np.zeros(width, np.int64)
    path[-1] = np.argmax(total[:, -1])
    for x in range(width - 1, 0, -1):
        path[x - 1] = came[path[x], x]
    return path
