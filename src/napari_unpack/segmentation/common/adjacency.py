"""Which labels touch, and over which area: sparse, for any number of labels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.validation import Spacing


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The touching areas of labels, as a sparse matrix in rows of neighbours.

    Parameters
    ----------
    start : (M + 1,) ndarray of int64
        Label k touches `other[start[k]:start[k + 1]]`.
    other : (2 P,) ndarray of int64
        Labels, rising for each; background is none.
    area : (2 P,) ndarray of float64
        Touching area with each of these, mm^2.
    surface : (M,) ndarray of float64
        The whole surface of every label, faces to background and to the volume's border
        included, mm^2.
    voxels : (M,) ndarray of int64
        Of every label.
    """

    start: NDArray[np.int64]
    other: NDArray[np.int64]
    area: NDArray[np.float64]
    surface: NDArray[np.float64]
    voxels: NDArray[np.int64]

    def most_touched(self, but: NDArray[np.bool_] | None = None) -> NDArray[np.int64]:
        """Return for every label the neighbour it touches over most, 0 where it has none, (M,).

        Of equal areas the lower label counts. Labels named in `but`, (M,), are no neighbours.
        """
        if but is not None and but.any():
            area = np.where(but[self.other], 0.0, self.area)
            other = np.where(but[self.other], 0, self.other)
            return replace(self, area=area, other=other).most_touched()
        touched = np.diff(self.start)
        owner = np.repeat(np.arange(len(touched)), touched)
        # The last of each owner's rows is its largest; of equal areas the lower name stands last.
        order = np.lexsort((-self.other, self.area, owner))
        best = np.zeros(len(touched), np.int64)
        best[touched > 0] = self.other[order][self.start[1:][touched > 0] - 1]
        return best

    def pairs(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return every two that touch, (P, 2), rising, and over which area, (P,)."""
        ends = np.stack([np.repeat(np.arange(len(self.voxels)), np.diff(self.start)), self.other])
        # Both directions are there.
        once = ends[0] < ends[1]
        return ends[:, once].T, self.area[once]

    def touched(self, one: int, two: int) -> float:
        """Return the area over which two labels touch, mm^2.

        Parameters
        ----------
        one, two : int
        """
        others = self.other[self.start[one] : self.start[one + 1]]
        where = int(np.searchsorted(others, two))
        there = where < len(others) and others[where] == two
        return float(self.area[self.start[one] + where]) if there else 0.0


def find_neighbours(labels: NDArray[np.int32], spacing: Spacing) -> Neighbours:
    """Measure the touching areas of all labels.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Labels, 0 background.
    spacing : (float, float, float) of mm, z y x
    """
    # Two passes over the volume, and sorting of the faces between labels.
    count = int(labels.max(initial=0)) + 1
    faces = np.prod(spacing) / np.array(spacing)
    surface, voxels = np.zeros(count), np.zeros(count, np.int64)
    number = _measure_surfaces(labels, faces, surface, voxels)
    # The number of faces is known, so that no list has to grow.
    keys, axes = np.empty(number, np.int64), np.empty(number, np.int8)
    _find_faces(labels, count, keys, axes)
    # Sorting, not a table of pairs: among thousands of fragments hardly any two touch.
    names, where = np.unique(keys, return_inverse=True)
    area = np.bincount(where, faces[axes], len(names)).astype(np.float64)
    one, two = np.divmod(names, count)
    # Both directions, so that a row holds all neighbours of its label.
    ends, others = np.concatenate([one, two]), np.concatenate([two, one])
    order = np.lexsort((others, ends))
    start = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=count))])
    return Neighbours(start, others[order], np.tile(area, 2)[order], surface, voxels)


@njit(cache=True, nogil=True)
def _measure_surfaces(labels, faces, surface, voxels):  # type: ignore[no-untyped-def]
    """Add to the surface and voxels of every label; return the number of faces between two."""
    between = 0
    size = labels.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                here = labels[z, y, x]
                if here:
                    voxels[here] += 1
                    if z == 0:
                        surface[here] += faces[0]
                    if y == 0:
                        surface[here] += faces[1]
                    if x == 0:
                        surface[here] += faces[2]
                for axis in range(3):
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    other = 0
                    if k < size[0] and j < size[1] and i < size[2]:
                        other = labels[k, j, i]
                    if other != here:
                        if here:
                            surface[here] += faces[axis]
                        if other:
                            surface[other] += faces[axis]
                        between += here != 0 and other != 0
    return between


@njit(cache=True, nogil=True)
def _find_faces(labels, count, keys, axes):  # type: ignore[no-untyped-def]
    """Write for every face between two labels their names as one key, and its axis."""
    size = labels.shape
    n = 0
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                here = np.int64(labels[z, y, x])
                if here == 0:
                    continue
                for axis in range(3):
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    if k == size[0] or j == size[1] or i == size[2]:
                        continue
                    other = np.int64(labels[k, j, i])
                    if other != here and other != 0:
                        keys[n] = min(here, other) * count + max(here, other)
                        axes[n] = axis
                        n += 1
