"""Air inside objects, and what is suspended in it."""

from __future__ import annotations

import cc3d
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, generate_binary_structure

from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.tasks import SILENT, Share

# Share of a cavity's surface that one object makes up where the cavity belongs to it.
WALLED = 0.45
# Share of a cavity's surface that may be gaps in its wall.
LEAK = 0.1
# Share of its surface over which an object touches what it lies in, at least: a soap in a box
# lies on its floor.
LEAST_TOUCHING = 0.005


def fill_cavities(
    labels: NDArray[np.int32], spacing: Spacing, leaky: bool = False, share: Share = SILENT
) -> NDArray[np.int32]:
    """Give enclosed air to the object that encloses it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    spacing : (float, float, float) of mm, z y x
    leaky : bool
        Also where gaps at most two voxels wide lead out of it: walls that are thin for the
        scanner have such.
    share : Share
    """
    # A cavity is a 6-connected component of background that does not reach the volume's border.
    # The air of a closed bottle leaves with the bottle; the gaps between packed things stay open.
    # A leaky one is a component of the background opened by the 18 neighbours of a voxel.
    holes = _closed(labels == 0)
    share(0.2)
    filled = _given(labels, holes, spacing)
    share(0.3)
    if not leaky:
        return filled
    # Opened by a voxel's 18 neighbours: gaps of up to two voxels close.
    opened = binary_erosion(filled == 0, generate_binary_structure(3, 2), border_value=1)
    share(0.5)
    deep = _closed(opened)
    share(0.7)
    sizes = np.bincount(deep.reshape(-1))
    large = np.where(sizes >= MIN_OBJECT_VOXELS, np.arange(len(sizes)), 0).astype(np.int32)
    large[0] = 0
    if not large.any():
        return filled
    holes = large[deep]
    grown = holes.copy()
    for slab in share.part(0.7, 0.8).slabs(holes.shape):
        _grow(filled, holes, slab, grown)
    given = _given(filled, grown, spacing)
    share(0.9)
    # The corners that opening leaves out.
    return _given(given, _closed(given == 0), spacing)


def join_suspended(
    labels: NDArray[np.int32], filled: NDArray[np.int32], spacing: Spacing
) -> NDArray[np.int32]:
    """Merge what is suspended in the air inside an object, and the air, with it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    filled : (Z, Y, X) ndarray of int32
        The same with their cavities; see `fill_cavities`. Not changed.
    spacing : (float, float, float) of mm, z y x
    """
    # What one object surrounds and what touches it nowhere is held by something too thin to be
    # seen: a motor in its housing is one with it.
    before, after = find_neighbours(labels, spacing), find_neighbours(filled, spacing)
    around = after.most_touched()
    owner = np.arange(len(around))
    for name in np.flatnonzero(after.voxels).tolist():
        other = int(around[name])
        enclosed = after.touched(name, other) >= (1 - LEAST_TOUCHING) * after.surface[name]
        if enclosed and before.touched(name, other) < LEAST_TOUCHING * before.surface[name]:
            owner[name] = other
    # Something suspended in something suspended.
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
def _grow(labels, holes, slab, grown):  # type: ignore[no-untyped-def]
    """Grow a copy of holes over the background that shares a face or an edge with them."""
    size = labels.shape
    for z in range(slab[0], slab[1]):
        for y in range(size[1]):
            for x in range(size[2]):
                if labels[z, y, x] != 0 or holes[z, y, x] != 0:
                    continue
                for k in range(max(z - 1, 0), min(z + 2, size[0])):
                    for j in range(max(y - 1, 0), min(y + 2, size[1])):
                        for i in range(max(x - 1, 0), min(x + 2, size[2])):
                            if abs(k - z) + abs(j - y) + abs(i - x) < 3:
                                grown[z, y, x] = max(grown[z, y, x], holes[k, j, i])
