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
