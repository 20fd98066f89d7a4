"""A region: the voxels of one object, or of what may still be several, in their own box."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import Box, bounding_box
from napari_unpack.segmentation.common.array_source import within
from napari_unpack.segmentation.common.validation import Spacing

# Fewer show no shape, so that neither the oracle nor a classifier can say anything of them.
MIN_OBJECT_VOXELS = 100
# A lighter or a key has more.
MIN_OBJECT_MM3 = 500.0
# Of the whole volume that `MIN_OBJECT_MM3` may be: where it is more, the volume is no bag, or its
# unit is not mm.
LARGEST_SHARE = 1 / 2000
# Of all matter in objects below the default size, from which it is no measure of these objects: of
# bags it is 0.007 at most, of a jar of beads all.
SMALL_SHARE = 0.1
# Of such objects, for it: one or two are specks.
LEAST_SMALL = 5


def default_smallest_object(shape: tuple[int, int, int], spacing: Spacing) -> float:
    """Return the size below which nothing is an object by default, mm^3.

    Parameters
    ----------
    shape : (int, int, int)
        Voxels, z y x.
    spacing : (float, float, float) of mm, z y x
    """
    voxel = float(np.prod(spacing))
    is_bag = LARGEST_SHARE * voxel * float(np.prod(shape)) >= MIN_OBJECT_MM3
    return MIN_OBJECT_MM3 if is_bag else MIN_OBJECT_MM3 * min(voxel, 1.0)


def fewest_voxels(labels: NDArray[np.int32], usual: float) -> float:
    """Return below how many voxels labels are no objects, where nobody has said it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background.
    usual : float
        Voxels, see `default_smallest_object`; `MIN_OBJECT_VOXELS` where much of the matter is in
        smaller ones, such as the beads in a jar.
    """
    counts = np.bincount(labels.reshape(-1))[1:]
    small = counts[(counts > 0) & (counts < usual)]
    many = len(small) >= LEAST_SMALL and small.sum() > SMALL_SHARE * counts.sum()
    return MIN_OBJECT_VOXELS if many else usual


@dataclass(frozen=True, eq=False)
class Region:
    """What an oracle rates: the voxels of an object, or of what may be one, in their box.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        The region's voxels in its bounding box.
    density : (Z, Y, X) ndarray
        Density in the same box, a view of the volume.
    origin : (int, int, int)
        First voxel of the box in the volume.
    spacing : (float, float, float) of mm, z y x
    whole : ndarray, optional
        Density of the whole volume, so that what lies beyond the box can be seen.
    air : float
        Density of air, from which `confidence.features` counts; see `density_regions.air_offset`.
    """

    mask: NDArray[np.bool_]
    density: NDArray[np.generic]
    origin: tuple[int, int, int]
    spacing: Spacing
    whole: NDArray[np.generic] | None = None
    air: float = 0.0

    @staticmethod
    def of(
        mask: NDArray[np.bool_],
        density: NDArray[np.generic],
        box: Box,
        spacing: Spacing,
        air: float = 0.0,
    ) -> Region:
        """Return the region of a mask in a box of a volume.

        Parameters
        ----------
        mask : (Z, Y, X) ndarray of bool
            Of the box's shape.
        density : (Z', Y', X') ndarray
            Of the whole volume.
        box : (slice, slice, slice)
        spacing : (float, float, float) of mm, z y x
        air : float
            See the class.
        """
        first = (box[0].start, box[1].start, box[2].start)
        return Region(np.ascontiguousarray(mask), density[box], first, spacing, density, air)

    @cached_property
    def voxels(self) -> int:
        """Number of voxels."""
        return int(np.count_nonzero(self.mask))

    @property
    def voxel_volume(self) -> float:
        """Volume of one voxel, mm^3."""
        return float(np.prod(self.spacing))

    @property
    def volume(self) -> float:
        """Volume, mm^3."""
        return self.voxels * self.voxel_volume

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """Densities of the region's voxels, NaN as 0, (N,) float32."""
        return np.nan_to_num(self.density[self.mask].astype(np.float32))

    @property
    def field(self) -> tuple[NDArray[np.generic], NDArray[np.int64]]:
        """The largest density known, and where this region's box begins in it."""
        if self.whole is None:
            return self.density, np.zeros(3, np.int64)
        return self.whole, np.array(self.origin, np.int64)

    def part(self, mask: NDArray[np.bool_]) -> Region:
        """Return the region of some of this one's voxels, cropped to their box."""
        box = bounding_box(mask)
        first = tuple(o + b.start for o, b in zip(self.origin, box, strict=True))
        return Region(
            np.ascontiguousarray(mask[box]),
            self.density[box],
            (first[0], first[1], first[2]),
            self.spacing,
            self.whole,
            self.air,
        )

    @property
    def box(self) -> Box:
        """The region's place in the volume."""
        a, b, c = (slice(o, o + n) for o, n in zip(self.origin, self.mask.shape, strict=True))
        return a, b, c


# Returns the confidence in [0, 1] that a region is exactly one object.
Oracle = Callable[[Region], float]


def united(one: Region, two: Region, density: NDArray[np.generic]) -> Region:
    """Return the region of the voxels of two.

    Parameters
    ----------
    one, two : Region
    density : (Z, Y, X) ndarray
        Of the whole volume.
    """
    low = np.minimum(one.origin, two.origin).tolist()
    ends = [np.add(region.origin, region.mask.shape) for region in (one, two)]
    high = np.maximum(*ends).tolist()
    box = slice(low[0], high[0]), slice(low[1], high[1]), slice(low[2], high[2])
    mask = np.zeros(np.subtract(high, low), np.bool_)
    for region in (one, two):
        mask[within(region.box, box)] |= region.mask
    return Region.of(mask, density, box, one.spacing, one.air)
