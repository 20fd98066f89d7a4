"""The bag's own shell: the thin skin around everything, which is no object in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.density_regions import label_means
from napari_unpack.segmentation.common.depths import label_depths
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.tasks import SILENT, Share

SKIN_THICKNESS = 8.0
"""Fabric, piping and zips are at most this thick on average, mm."""

EXTENT = 0.94
"""A bag reaches over this share of the extent of all parts, its skin along two axes at least."""

OUTERMOST = 0.6
"""Share of a skin's voxels that are the first seen along an axis from outside."""

FEWEST = 3
"""There is no bag around fewer other parts."""

CASE_FILLS, CASE_HOLDS = 0.25, 0.9
"""A case fills at most this share of its box, and this share of all else lies between its walls.

Of nineteen simulated bags, two of another simulator and the backpack two have a part of all of
their extent that is no bag, between whose walls a third and 0.02 of all else lies; that of cases
is 0.96 and more."""


def find_shell(
    labels: NDArray[np.int32], spacing: Spacing, share: Share = SILENT
) -> NDArray[np.bool_]:
    """Return by label, (M,), which parts are the bag and not its content.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts 1, 2, ..., 0 background.
    spacing : (float, float, float) of mm, z y x
    share : Share
    """
    # Where there is a skin, other thin parts nearly all of which are outermost belong to it. Four
    # passes over the volume.
    boxes = label_boxes(labels)
    top = int(labels.max())
    shell = np.zeros(top + 1, np.bool_)
    if len(boxes.ids) <= FEWEST:
        return shell
    low, high = boxes.lower, boxes.upper
    spans = (high - low) / np.maximum(high.max(axis=0) - low.min(axis=0), 1)
    wide = (spans >= EXTENT).sum(axis=1) >= 2
    if not wide.any():
        return shell
    reach = np.maximum(np.round(SKIN_THICKNESS / 2 / np.array(spacing)).astype(np.int64), 1)
    outer = np.zeros(top + 1, np.int64)
    _count_outermost(labels, reach, np.zeros(3, np.int64), np.zeros(labels.shape, np.bool_), outer)
    share(0.2)
    depth = label_depths(labels, spacing)
    share(0.7)
    # A plate of thickness t has mean depth t / 4.
    thin = 4 * label_means(labels, depth)[boxes.ids] <= SKIN_THICKNESS
    first = outer[boxes.ids] / boxes.counts
    skin = wide & thin & (first >= OUTERMOST)
    if skin.any() and len(boxes.ids) - int(skin.sum()) >= FEWEST:
        shell[boxes.ids[skin | (thin & (first >= 0.8))]] = True
    return shell


def find_case(labels: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return by label, (M,), which parts are a case around all others, such as a hard bag.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts 1, 2, ..., 0 background.
    """
    boxes = label_boxes(labels)
    case = np.zeros(int(labels.max(initial=0)) + 1, np.bool_)
    if len(boxes.ids) <= FEWEST:
        return case
    sides = boxes.upper - boxes.lower
    spans = sides / (boxes.upper.max(axis=0) - boxes.lower.min(axis=0))
    hollow = boxes.counts <= CASE_FILLS * sides.prod(axis=1)
    for name in boxes.ids[(spans >= EXTENT).all(axis=1) & hollow].tolist():
        own = labels == name
        rest, between = (labels > 0) & ~own, np.zeros_like(own)
        for axis in range(3):
            after = np.logical_or.accumulate(own, axis)
            before = np.flip(np.logical_or.accumulate(np.flip(own, axis), axis), axis)
            between |= after & before
        case[name] = np.count_nonzero(between & rest) >= CASE_HOLDS * np.count_nonzero(rest)
    return case


def drop_skin(
    labels: NDArray[np.int32], doubted: NDArray[np.bool_], spacing: Spacing
) -> NDArray[np.int32]:
    """Drop those of the doubted objects that are no thicker than a bag's skin.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ..., 0 background.
    doubted : (M,) ndarray of bool
        By label, whether it may be the bag's.
    spacing : (float, float, float) of mm, z y x
    """
    boxes = label_boxes(labels)
    dropped = np.zeros(len(doubted), np.bool_)
    for label in boxes.ids[doubted[boxes.ids]].tolist():
        inside = labels[boxes.slices(label)] == label
        depths = label_depths(inside.astype(np.int32), spacing)[inside]
        # A plate of thickness t has mean depth t / 4.
        dropped[label] = 4 * depths.mean() <= SKIN_THICKNESS
    return np.where(dropped, 0, np.arange(len(dropped), dtype=np.int32))[labels]


@njit(cache=True, nogil=True)
def _count_outermost(labels, reach, voxel, seen, counts):  # type: ignore[no-untyped-def]
    """Count by label the voxels no deeper than `reach` behind the first along an axis."""
    for axis in range(3):
        length = labels.shape[axis]
        one, two = labels.shape[(axis + 1) % 3], labels.shape[(axis + 2) % 3]
        for a in range(one):
            for b in range(two):
                voxel[(axis + 1) % 3], voxel[(axis + 2) % 3] = a, b
                for way in range(2):
                    left = -1
                    for k in range(length):
                        voxel[axis] = k if way == 0 else length - 1 - k
                        z, y, x = voxel[0], voxel[1], voxel[2]
                        label = labels[z, y, x]
                        if left < 0 and label:
                            left = reach[axis]
                        if left == 0:
                            break
                        if left > 0:
                            left -= 1
                            if label and not seen[z, y, x]:
                                seen[z, y, x] = True
                                counts[label] += 1
