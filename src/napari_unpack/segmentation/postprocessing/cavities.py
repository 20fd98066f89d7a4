"""Air inside objects, and what hangs in it."""

from __future__ import annotations

import cc3d
import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.region import FEWEST
from napari_unpack.segmentation.common.validation import Spacing

WALLED = 0.45
"""A cavity belongs to an object that makes up at least this share of its surface."""

LEAK = 0.1
"""Share of a cavity's surface that may be gaps in its wall."""

LOOSE = 0.005
"""Share of its surface over which something at rest touches what it lies in at least."""


def fill_cavities(
    labels: NDArray[np.int32], spacing: Spacing, leaky: bool = False
) -> NDArray[np.int32]:
    """Give enclosed air to the object that encloses it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    leaky : bool
        Also where gaps at most two voxels wide lead out of it: walls that are thin for the
        scanner have such.

    Returns
    -------
    (Z, Y, X) ndarray of int32

    Notes
    -----
    A cavity is a 6-connected component of background that does not reach the volume's border.
    The air of a closed bottle leaves with the bottle; the gaps between packed things stay open.
    A leaky one is a component of the background opened by the 18 neighbours of a voxel.
    """
    filled = _given(labels, _closed(labels == 0), spacing)
    if not leaky:
        return filled
    deep = _closed(_deep(filled))
    sizes = np.bincount(deep.reshape(-1))
    large = np.where(sizes >= FEWEST, np.arange(len(sizes)), 0).astype(np.int32)
    large[0] = 0
    if not large.any():
        return filled
    given = _given(filled, _grown(filled, large[deep]), spacing)
    # The corners that opening leaves out.
    return _given(given, _closed(given == 0), spacing)


def join_hanging(
    labels: NDArray[np.int32], filled: NDArray[np.int32], spacing: Spacing
) -> NDArray[np.int32]:
    """Join what hangs in the air inside an object with it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    filled : (Z, Y, X) ndarray of int32
        The same with their cavities; see `fill_cavities`. Not changed.
    spacing : (float, float, float)
        Voxel size z y x, mm.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        With cavities.

    Notes
    -----
    A soap in a box lies on its floor. What one object surrounds and what touches it nowhere is
    held by something too thin to be seen: a motor in its housing is one with it.
    """
    before, after = find_neighbours(labels, spacing), find_neighbours(filled, spacing)
    around = after.most_touched()
    owner = np.arange(len(around))
    for name in np.flatnonzero(after.voxels).tolist():
        other = int(around[name])
        enclosed = after.touched(name, other) >= (1 - LOOSE) * after.surface[name]
        if enclosed and before.touched(name, other) < LOOSE * before.surface[name]:
            owner[name] = other
    # One that hangs in one that hangs.
    owner = owner[owner]
    return owner.astype(np.int32)[filled]


def _closed(air: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Name the components of air that do not reach the volume's border; all else is 0."""
    holes = cc3d.connected_components(air.view(np.uint8), connectivity=6)
    opens = np.zeros(int(holes.max()) + 1, np.bool_)
    for axis in range(3):
        for end in (0, -1):
            opens[np.unique(np.take(holes, end, axis=axis))] = True
    opens[0] = True
    return np.where(opens, 0, np.cumsum(~opens)).astype(np.int32)[holes]


def _given(
    labels: NDArray[np.int32], holes: NDArray[np.int32], spacing: Spacing
) -> NDArray[np.int32]:
    """Give holes to the label around them, if it makes up enough of their surface."""
    count = int(holes.max(initial=0))
    if not count:
        return labels
    top = int(labels.max(initial=0))
    found = find_neighbours(np.where(holes > 0, holes + top, labels), spacing)
    most = found.most_touched()
    owner = np.zeros(count + 1, np.int32)
    for hole in range(1, count + 1):
        name = top + hole
        surface, other = found.surface[name], int(most[name])
        walls = found.area[found.start[name] : found.start[name + 1]].sum()
        if walls >= (1 - LEAK) * surface and found.touched(name, other) >= WALLED * surface:
            owner[hole] = other
    return np.where(labels > 0, labels, owner[holes])


@njit(cache=True, nogil=True)
def _deep(labels):  # type: ignore[no-untyped-def]
    """Return which voxels and all that share a face or an edge with them are background."""
    deep = np.zeros(labels.shape, np.bool_)
    size = labels.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                bare = labels[z, y, x] == 0
                for k in range(max(z - 1, 0), min(z + 2, size[0])):
                    for j in range(max(y - 1, 0), min(y + 2, size[1])):
                        for i in range(max(x - 1, 0), min(x + 2, size[2])):
                            if not bare:
                                break
                            if abs(k - z) + abs(j - y) + abs(i - x) < 3:
                                bare = labels[k, j, i] == 0
                deep[z, y, x] = bare
    return deep


@njit(cache=True, nogil=True)
def _grown(labels, holes):  # type: ignore[no-untyped-def]
    """Grow holes over the background that shares a face or an edge with them."""
    grown = holes.copy()
    size = labels.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                if labels[z, y, x] != 0 or holes[z, y, x] != 0:
                    continue
                for k in range(max(z - 1, 0), min(z + 2, size[0])):
                    for j in range(max(y - 1, 0), min(y + 2, size[1])):
                        for i in range(max(x - 1, 0), min(x + 2, size[2])):
                            if abs(k - z) + abs(j - y) + abs(i - x) < 3:
                                grown[z, y, x] = max(grown[z, y, x], holes[k, j, i])
    return grown
