"""Air inside objects, and what is suspended in it."""

from __future__ import annotations

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import Box, LabelBoxes, label_boxes
from napari_unpack.geometry.relabeling import numbered
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.morphology import dilate, erode
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.tasks import SILENT, Share

# Share of a cavity's surface that one object makes up where the cavity belongs to it.
WALLED = 0.45
# Share of a cavity's surface that may be gaps in its wall, and that may be wall of no object: the
# network misses a side of a carton. Two sides of six are not missed; the bag, whose skin is no
# object, is no cavity of what lies in it.
LEAK, UNNAMED = 0.05, 0.25
# Voxels from a cavity to the outside of a wall that no object has.
WALL = 2
# Share of its surface over which an object touches what it lies in, at least: a soap in a box
# lies on its floor.
LEAST_TOUCHING = 0.005


def fill_cavities(
    labels: NDArray[np.int32],
    spacing: Spacing,
    foreground: NDArray[np.bool_] | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Give enclosed air to the object that encloses it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    spacing : (float, float, float) of mm, z y x
    foreground : (Z, Y, X) ndarray of bool, optional
        Where given, what lies in it is wall even where no object has it, and gaps at most two
        voxels wide close: walls that are thin for the scanner have such.
    share : Share
    """
    # A cavity is a 6-connected component of background that does not reach the volume's border.
    # The air of a closed bottle leaves with the bottle; the gaps between packed things stay open.
    holes = _closed(labels == 0)
    share(0.2)
    filled = _given(labels, holes, spacing)
    share(0.3)
    if foreground is None:
        return filled
    # Opened by a voxel's 18 neighbours: gaps of up to two voxels close.
    wall = foreground | (filled > 0)
    deep = _closed(erode(~wall, connectivity=2))
    share(0.7)
    boxes, objects = label_boxes(deep), label_boxes(filled)
    for hole, voxels in zip(boxes.ids.tolist(), boxes.counts.tolist(), strict=True):
        box = boxes.slices(hole)
        if voxels >= MIN_OBJECT_VOXELS and _within_one(box, objects):
            near = boxes.slices(hole, WALL + 2)
            _fill_leaky(filled[near], deep[near] == hole, wall[near], spacing)
    share(0.9)
    # Specks of wall within, and what opening leaves out.
    return _given(filled, _closed(filled == 0), spacing)


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
    return numbered(~opens)[holes]


def _given(
    labels: NDArray[np.int32], holes: NDArray[np.int32], spacing: Spacing
) -> NDArray[np.int32]:
    """Give holes to the label around them, if it makes up enough of their surface."""
    count = int(holes.max(initial=0))
    if not count:
        return labels.copy()
    top = int(labels.max(initial=0))
    found = find_neighbours(np.where(holes > 0, holes + top, labels), spacing)
    most = found.most_touched()
    owner = np.zeros(count + 1, np.int32)
    for hole in range(1, count + 1):
        name = top + hole
        other = int(most[name])
        if found.touched(name, other) >= WALLED * found.surface[name]:
            owner[hole] = other
    return np.where(labels > 0, labels, owner[holes])


def _within_one(box: Box, objects: LabelBoxes) -> bool:
    """Return whether a cavity lies in the box of an object: the air of a whole bag does not."""
    low, high = np.array([(side.start, side.stop) for side in box]).T
    return bool(((objects.lower <= low) & (objects.upper >= high)).all(axis=1).any())


def _fill_leaky(
    labels: NDArray[np.int32],
    core: NDArray[np.bool_],
    wall: NDArray[np.bool_],
    spacing: Spacing,
) -> None:
    """Give a cavity and the wall around it that no object has to its object, in place.

    `core` is the cavity less one voxel; the arrays are of its box and what is around it.
    """
    wall = wall | (labels > 0)
    hole = dilate(core, connectivity=2) & ~wall
    if not hole.any():
        # A cavity before it, with which a narrow gap joins it, took it in as a pit.
        return
    # Pits of a rough wall are no gaps in it; the air of what lies in the cavity is no pit.
    pits = _closed(~wall & ~hole)
    beside = np.zeros(int(pits.max()) + 1, np.bool_)
    beside[pits[dilate(hole)]] = True
    beside[0] = False
    hole |= beside[pits]
    top = int(labels.max(initial=0))
    unnamed, name = top + 1, top + 2
    parted = np.where(hole, name, np.where(wall & (labels == 0), unnamed, labels))
    found = find_neighbours(parted.astype(np.int32), spacing)
    surface = found.surface[name]
    walls = found.area[found.start[name] : found.start[name + 1]].sum()
    other = int(found.most_touched(np.arange(top + 3) == unnamed)[name])
    if (
        walls >= (1 - LEAK) * surface
        and found.touched(name, unnamed) <= UNNAMED * surface
        and found.touched(name, other) >= WALLED * surface
    ):
        around = dilate(hole, connectivity=3, iterations=WALL) & (parted == unnamed)
        labels[hole | around] = other
