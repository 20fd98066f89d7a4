"""Repair of labels by hand: split, merge, delete, and what a brush has changed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.boxes import Box, LabelBoxes, differing_box
from napari_unpack.segmentation.common.density_regions import air_offset
from napari_unpack.segmentation.isoperimetric.two_point_cut import cut_between
from napari_unpack.segmentation.review.doubts import Doubt, Said
from napari_unpack.segmentation.review.evidence import Evidence

Labels = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class LabelEdit:
    """Voxels that get another label.

    Parameters
    ----------
    box : (slice, slice, slice)
        Around them, z y x.
    where : (N,) ndarray of int64
        Flat indices into the box, ascending.
    before, after : (N,) ndarray of int
        Labels they had, and get.
    """

    box: Box
    where: NDArray[np.int64]
    before: Labels
    after: Labels

    @cached_property
    def touched(self) -> frozenset[int]:
        """Objects that gain or lose voxels."""
        both = np.concatenate([self.before, self.after])
        return frozenset(int(i) for i in np.unique(both) if i)

    def apply(self, labels: Labels) -> Labels:
        """Return labels with the edit made; a copy."""
        changed = labels.copy()
        part = changed[self.box]
        part[np.unravel_index(self.where, part.shape)] = self.after
        return changed

    def reverse(self) -> LabelEdit:
        """Return the edit that takes this one back."""
        return LabelEdit(self.box, self.where, self.after, self.before)


def split_between(
    labels: Labels,
    boxes: LabelBoxes,
    density: ArrayLike,
    spacing: Sequence[float],
    a: Sequence[int],
    b: Sequence[int],
    new_id: int,
) -> LabelEdit:
    """Split the object that holds two voxels, so that each part holds one of them.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
    boxes : LabelBoxes
    density : (Z, Y, X) array_like
        The cut prefers its steps.
    spacing : (3,) sequence of float, mm z y x
    a, b : (3,) sequence of int
        Two voxels of one object.
    new_id : int
        The smaller part's; the larger keeps the object's.
    """
    one = int(labels[tuple(a)])
    box = boxes.slices(one)
    first = np.array([part.start for part in box])
    mask = labels[box] == one
    whole = np.asarray(density)
    # Steps count beside the density above air.
    air = air_offset(whole, labels)
    values = whole[box] - air if air else whole[box]
    far = cut_between(mask, values, spacing, np.asarray(a) - first, np.asarray(b) - first)
    if 2 * np.count_nonzero(far) > np.count_nonzero(mask):
        far = mask & ~far
    return _relabel(labels, box, far, new_id)


def merge_objects(labels: Labels, boxes: LabelBoxes, ids: Iterable[int]) -> LabelEdit:
    """Make one object of several; the largest's ID stays.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
    boxes : LabelBoxes
    ids : iterable of int
        Objects, two or more.
    """
    kept, *others = sorted(ids, key=lambda i: (-int(boxes.counts[boxes.index(i)]), i))
    box = boxes.around(others)
    return _relabel(labels, box, np.isin(labels[box], others), kept)


def delete_objects(labels: Labels, boxes: LabelBoxes, ids: Iterable[int]) -> LabelEdit:
    """Make objects background.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
    boxes : LabelBoxes
    ids : iterable of int
        Objects, one or more.
    """
    chosen = list(ids)
    box = boxes.around(chosen)
    return _relabel(labels, box, np.isin(labels[box], chosen), 0)


def edit_of_answer(
    doubt: Doubt, said: Said, evidence: Evidence, labels: Labels, boxes: LabelBoxes, new_id: int
) -> LabelEdit | None:
    """Return what an answer changes; None where the labels say so already.

    Parameters
    ----------
    doubt : Doubt
    said : {"same", "different", "nothing", "skip"}
        "nothing" makes background of the first side.
    evidence : Evidence
        Whose pieces the sides are made of.
    labels : (Z, Y, X) ndarray of int
    boxes : LabelBoxes
    new_id : int
        Of the first side, where it becomes an object of its own.
    """
    one, two = doubt.objects
    if not doubt.changed_by(said):
        return None
    if said == "same":
        return merge_objects(labels, boxes, doubt.objects)
    if doubt.kind != "join":
        return delete_objects(labels, boxes, [one])
    box = boxes.slices(one)
    side = np.zeros(len(evidence.sums), np.bool_)
    side[doubt.side] = True
    mask = side[evidence.pieces[box]] & (labels[box] == two)
    return _relabel(labels, box, mask, new_id if said == "different" else 0)


def difference(labels: Labels, wanted: Labels) -> LabelEdit | None:
    """Return the edit that leads from labels to others of the same shape; None where equal.

    Parameters
    ----------
    labels, wanted : (Z, Y, X) ndarray of int
    """
    box = differing_box(labels, wanted)
    if box is None:
        return None
    old, new = labels[box], wanted[box]
    where = np.flatnonzero(old != new)
    spots = np.unravel_index(where, old.shape)
    return LabelEdit(box, where, old[spots], new[spots].astype(labels.dtype))


def _relabel(labels: Labels, box: Box, mask: NDArray[np.bool_], label: int) -> LabelEdit:
    where = np.flatnonzero(mask)
    before = labels[box][mask]
    return LabelEdit(box, where, before, np.full(len(where), label, labels.dtype))
