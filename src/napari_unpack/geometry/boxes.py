"""The bounding box and voxel count of every object, in one pass over the label volume."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

# A box of voxels, z y x.
Box = tuple[slice, slice, slice]


@dataclass(frozen=True, eq=False)
class LabelBoxes:
    """Boxes of the objects present in a label volume, ordered by ID.

    Parameters
    ----------
    ids : (N,) ndarray of int64
        Object IDs present, ascending, without 0.
    lower, upper : (N, 3) ndarray of int64
        Half-open boxes in voxels, z y x: lower <= v < upper.
    counts : (N,) ndarray of int64
        Voxels of each object.
    """

    ids: NDArray[np.int64]
    lower: NDArray[np.int64]
    upper: NDArray[np.int64]
    counts: NDArray[np.int64]

    def index(self, object_id: int) -> int:
        """Return the row of an ID.

        Raises
        ------
        KeyError
            Where there is no such object.
        """
        # IDs are ascending, so a search finds the row without a table as long as the largest ID.
        row = int(np.searchsorted(self.ids, object_id))
        if row == len(self.ids) or self.ids[row] != object_id:
            raise KeyError(f"no object {object_id} in the label volume")
        return row

    def slices(self, object_id: int, margin: int = 0) -> Box:
        """Return the slices of an object's box, widened by a margin but not below zero.

        Parameters
        ----------
        object_id : int
        margin : int
            Voxels on every side.
        """
        row = self.index(object_id)
        low = np.maximum(self.lower[row] - margin, 0)
        return _box_of(low, self.upper[row] + margin)

    def around(self, ids: Iterable[int]) -> Box:
        """Return the slices of the box around all of some objects, at least one."""
        rows = [self.index(i) for i in ids]
        return _box_of(self.lower[rows].min(axis=0), self.upper[rows].max(axis=0))

    def center(self, object_id: int, spacing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the centre of an object's box in world mm, z y x.

        Parameters
        ----------
        object_id : int
        spacing : (3,) ndarray of float64, mm z y x
        """
        row = self.index(object_id)
        # Boxes are half-open and voxel centres are at integers.
        return (self.lower[row] + self.upper[row] - 1) / 2 * spacing

    def corners(self, object_id: int, spacing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (8, 3) outer corners of an object's box in world mm, z y x.

        Parameters
        ----------
        object_id : int
        spacing : (3,) ndarray of float64, mm z y x
        """
        row = self.index(object_id)
        # The outer faces of voxels lie half a voxel beyond their centres.
        return box_corners(self.lower[row] - 0.5, self.upper[row] - 0.5) * spacing

    def radius(
        self, object_id: int, spacing: NDArray[np.float64], stretch: NDArray[np.float64]
    ) -> float:
        """Return the radius of the sphere around an object's box, mm.

        Parameters
        ----------
        object_id : int
        spacing : (3,) ndarray of float64, mm z y x
        stretch : (3, 3) ndarray of float64
            Of the world in which it is measured; see `Camera.stretch`.
        """
        corners = self.corners(object_id, spacing)
        out = (corners - corners.mean(axis=0)) @ stretch.T
        return float(np.linalg.norm(out, axis=1).max())

    def front_areas(
        self, spacing: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the mm^2, (N,), that the three visible faces of every box cover, foreshortened.

        Parameters
        ----------
        spacing : (3,) ndarray of float64, mm z y x
        direction : (3,) ndarray of float64
            Direction of looking, world, of length 1.
        """
        edges = (self.upper - self.lower) * np.asarray(spacing, dtype=np.float64)
        # A box seen from anywhere shows one face of each of its three pairs.
        faces = np.stack(
            [edges[:, 1] * edges[:, 2], edges[:, 0] * edges[:, 2], edges[:, 0] * edges[:, 1]],
            axis=1,
        )
        areas: NDArray[np.float64] = faces @ np.abs(direction)
        return areas


def _box_of(low: NDArray[np.int64], high: NDArray[np.int64]) -> Box:
    z, y, x = (slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))
    return z, y, x


def bounding_box(mask: NDArray[np.bool_]) -> Box:
    """Return the smallest box around a (Z, Y, X) mask with at least one voxel."""
    # Three projections, not argwhere: memory stays that of the mask.
    hits = (np.flatnonzero(mask.any(axis=others)) for others in ((1, 2), (0, 2), (0, 1)))
    z, y, x = (slice(int(hit[0]), int(hit[-1]) + 1) for hit in hits)
    return z, y, x


def box_corners(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (8, 3) corners of an axis-aligned box.

    Parameters
    ----------
    lower, upper : (3,) ndarray
        Least and greatest coordinates, z y x.
    """
    # In the order that `appearance.decorations.EDGES` counts on.
    bits = np.indices((2, 2, 2)).reshape(3, 8).T
    return np.where(bits == 1, upper, lower).astype(np.float64)


def label_boxes(labels: NDArray[np.integer]) -> LabelBoxes:
    """Find the box and voxel count of every object: one pass, memory by the largest ID."""
    top = int(labels.max(initial=0))
    # Rows of IDs that do not occur keep it, and are dropped with their counts of 0.
    lower = np.full((top + 1, 3), np.iinfo(np.int64).max)
    upper, counts = np.zeros((top + 1, 3), np.int64), np.zeros(top + 1, np.int64)
    for z, plane in enumerate(labels):
        # Of one type, so that the kernel is compiled once; a plane at a time, to save memory.
        _scan(np.ascontiguousarray(plane, np.int32), z, lower, upper, counts)
    ids = np.flatnonzero(counts)
    return LabelBoxes(ids, lower[ids], upper[ids], counts[ids])


@njit(cache=True, nogil=True)
def _scan(plane, z, lower, upper, counts):  # type: ignore[no-untyped-def]
    """Extend boxes and counts by a plane of labels."""
    height, width = plane.shape
    for y in range(height):
        x = 0
        while x < width:
            label = plane[y, x]
            # Runs of one label are counted at once: labels seldom change along x.
            start = x
            while x < width and plane[y, x] == label:
                x += 1
            if label == 0:
                continue
            counts[label] += x - start
            low, high = lower[label], upper[label]
            low[0] = min(low[0], z)
            low[1] = min(low[1], y)
            low[2] = min(low[2], start)
            high[0] = max(high[0], z + 1)
            high[1] = max(high[1], y + 1)
            high[2] = max(high[2], x)


def differing_box(a: NDArray[np.generic], b: NDArray[np.generic]) -> Box | None:
    """Return the smallest box outside which two volumes are the same; None for equal ones.

    Parameters
    ----------
    a, b : (Z, Y, X) ndarray
        Of one shape.
    """
    # Plane by plane, so that no array of the whole volume is made.
    planes = [z for z in range(len(a)) if not np.array_equal(a[z], b[z])]
    if not planes:
        return None
    rows, columns = np.zeros(a.shape[1], np.bool_), np.zeros(a.shape[2], np.bool_)
    for z in planes:
        other = a[z] != b[z]
        rows |= other.any(axis=1)
        columns |= other.any(axis=0)
    sides = (np.array(planes), np.flatnonzero(rows), np.flatnonzero(columns))
    depth, height, width = (slice(int(side[0]), int(side[-1]) + 1) for side in sides)
    return depth, height, width
