"""From slices that lie anywhere to a volume on a regular grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from napari_unpack.geometry.axes import Matrix
from napari_unpack.io.scan import Spacing

SHIFT_TOLERANCE = 0.1
"""Of a pixel: positions are rounded to hundredths of a millimetre."""

GAP_TOLERANCE = 0.1
"""Of the distance of slices, for the same reason."""

LARGEST_GAP = 4.0
"""In distances of slices: across more than that nothing is made up."""


@dataclass(frozen=True, eq=False)
class SliceStack:
    """Parallel slices of one size.

    Parameters
    ----------
    planes : (N, R, C) ndarray
        Densities.
    positions : (N, 3) ndarray of float64, mm x y z
        Of each slice's first pixel, in the patient's system.
    rows, columns : (3,) ndarray of float64
        Unit vectors along which the row and the column number grow, x y z.
    spacing : (float, float) of mm
        Distance of rows, and of columns.
    """

    planes: NDArray[np.generic]
    positions: NDArray[np.float64]
    rows: NDArray[np.float64]
    columns: NDArray[np.float64]
    spacing: tuple[float, float]

    @property
    def heights(self) -> NDArray[np.float64]:
        """(N,) positions along the slices' common normal, mm."""
        return self.positions @ np.cross(self.columns, self.rows)

    def volume(
        self, air: float, source: object
    ) -> tuple[NDArray[np.generic], Spacing, Matrix, list[str]]:
        """Return the volume, from the highest slice down, its voxel size, where it lies, and notes.

        See `Scan.scanner_from_scan`; the notes tell what was done to it.

        Parameters
        ----------
        air : float
            What is where no slice was.
        source : object
            The file's name, for messages.

        Raises
        ------
        ValueError
            If two slices lie in one place, or a gap is too large to be bridged.

        Notes
        -----
        As 3D Slicer's acquisition geometry regularisation: slices that are shifted against each
        other, as of a tilted gantry, are moved back, and unequal distances made equal, both by
        linear interpolation. A volume that is regular already is not touched.
        """
        order = np.argsort(self.heights, kind="stable")[::-1]
        planes, heights = self.planes[order], self.heights[order]
        gaps, done = -np.diff(heights), []
        # The median: one missing slice may not stretch all others.
        gap = float(np.median(gaps))
        if gaps.min() <= GAP_TOLERANCE * gap:
            raise ValueError(
                f"{source} holds two slices at {heights[int(gaps.argmin())]:.4g} mm that differ: "
                "save one scan in a series"
            )
        if gaps.max() > LARGEST_GAP * gap:
            raise ValueError(
                f"the slices of {source} are {gap:.3g} mm apart, but {gaps.max():.3g} mm at "
                f"{heights[int(gaps.argmax())]:.4g} mm: slices are missing there"
            )
        planes, first, shifted = self._upright(planes, self.positions[order], heights, air)
        if shifted > SHIFT_TOLERANCE:
            done.append(
                f"its slices are shifted by up to {shifted:.3g} pixels, as of a tilted gantry: "
                "they were moved back"
            )
        if np.abs(gaps - gap).max() > GAP_TOLERANCE * gap:
            planes = _evenly(planes, heights, gap)
            done.append(
                f"its slices are {gaps.min():.3g} to {gaps.max():.3g} mm apart: they were "
                f"interpolated to {gap:.3g} mm"
            )
        place = np.eye(4)
        # The planes go down, against the normal.
        down = -np.cross(self.columns, self.rows)
        place[:3] = np.stack([down, self.rows, self.columns, first], axis=1)
        # Directions of two decimals are not quite at right angles: the nearest that are.
        left, _, right = np.linalg.svd(place[:3, :3])
        place[:3, :3] = left @ right
        return planes, (gap, *self.spacing), place, done

    def _upright(
        self,
        planes: NDArray[np.generic],
        positions: NDArray[np.float64],
        heights: NDArray[np.float64],
        air: float,
    ) -> tuple[NDArray[np.generic], NDArray[np.float64], float]:
        """Return planes moved in themselves so that pixels lie over each other.

        With it the place of the first pixel, mm x y z, and how far they were moved, in pixels.
        """
        normal = np.cross(self.columns, self.rows)
        beside = positions - positions[0] - np.outer(heights - heights[0], normal)
        # In pixels, by row and column.
        shifts = np.stack([beside @ self.rows, beside @ self.columns], axis=1) / self.spacing
        most = float(np.abs(shifts).max())
        if most <= SHIFT_TOLERANCE:
            return planes, positions[0], most
        shifts -= shifts.min(axis=0)
        before = shifts[0] * self.spacing
        first = positions[0] - before[0] * self.rows - before[1] * self.columns
        # Room for all of them, so that nothing of a slice is cut off.
        room = np.ceil(shifts.max(axis=0)).astype(int)
        moved = np.empty((len(planes), *(np.array(planes.shape[1:]) + room)), np.float32)
        for target, plane, shift in zip(moved, planes, shifts, strict=True):
            padded = np.pad(plane, [(0, room[0]), (0, room[1])], constant_values=air)
            ndimage.shift(padded.astype(np.float32), shift, target, order=1, cval=air)
        return _as_before(moved, planes.dtype), first, most


def _evenly(
    planes: NDArray[np.generic], heights: NDArray[np.float64], gap: float
) -> NDArray[np.generic]:
    """Return planes at equal distances, linear between those that there are."""
    count = round((heights[0] - heights[-1]) / gap) + 1
    wanted = heights[0] - gap * np.arange(count)
    # Heights fall, and searchsorted wants them to rise.
    above = np.clip(np.searchsorted(-heights, -wanted, side="right") - 1, 0, len(heights) - 2)
    share = np.clip((heights[above] - wanted) / (heights[above] - heights[above + 1]), 0, 1)
    made = np.empty((count, *planes.shape[1:]), np.float32)
    for target, k, part in zip(made, above, share, strict=True):
        target[...] = planes[k] * np.float32(1 - part) + planes[k + 1] * np.float32(part)
    return _as_before(made, planes.dtype)


def _as_before(array: NDArray[np.float32], dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    # Interpolated densities lie between those that there are: the type that held them does.
    return np.rint(array).astype(dtype) if dtype.kind in "iu" else array.astype(dtype)
