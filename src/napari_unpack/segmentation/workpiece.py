"""A region made ready for cutting: its depth, and a small copy of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.coarse import Coarse, coarsened
from napari_unpack.segmentation.measures import chamfer
from napari_unpack.segmentation.region import Region

MOST_BLOCKS = 30_000


@dataclass(frozen=True, eq=False)
class Workpiece:
    """What every source of candidates works on.

    Parameters
    ----------
    region : Region
        6-connected.
    smallest : float
        No part is smaller than this, mm^3.
    depth : (Z, Y, X) ndarray of float32
        Distance to the outside, mm.
    coarse : Coarse
        The same in at most 30,000 blocks.
    """

    region: Region
    smallest: float
    depth: NDArray[np.float32]
    coarse: Coarse

    @staticmethod
    def of(region: Region, smallest: float) -> Workpiece:
        """Prepare a region."""
        depth = chamfer(region.mask, region.spacing)
        small = coarsened(region.mask, depth, region.density, region.spacing, MOST_BLOCKS)
        return Workpiece(region, smallest, depth, small)

    @property
    def fewest(self) -> int:
        """The smallest part in blocks."""
        return max(1, int(np.ceil(self.smallest / float(np.prod(self.coarse.spacing)))))


Proposal = tuple[str, NDArray[np.int32], NDArray[np.float32] | None]
"""Provenance, parts of the blocks, and where borders settle (see `coarse.carried_back`)."""

Proposals = Iterator[Proposal]


def largest_steps(values: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the largest step of every voxel to a face neighbour, both inside a mask.

    Parameters
    ----------
    values : (Z, Y, X) ndarray of float32
        Of blocks.
    mask : (Z, Y, X) ndarray of bool
        Which of them count.

    Returns
    -------
    (Z, Y, X) ndarray of float32
    """
    steps = np.zeros(mask.shape, np.float32)
    for axis in range(3):
        along, inside = np.moveaxis(values, axis, 0), np.moveaxis(mask, axis, 0)
        here = np.moveaxis(steps, axis, 0)
        step = np.where(inside[1:] & inside[:-1], np.abs(along[1:] - along[:-1]), 0)
        here[1:] = np.maximum(here[1:], step)
        here[:-1] = np.maximum(here[:-1], step)
    return steps
