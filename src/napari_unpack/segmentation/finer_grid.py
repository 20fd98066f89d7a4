"""Whether a working grid shows the objects at all, told by one box at full resolution."""

from __future__ import annotations

from math import ceil, prod

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from napari_unpack.segmentation.common.array_source import Box, Source
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.working_grid import Factors, Find, reduction
from napari_unpack.tasks import Share

# Cells of the object that a typical bit of matter is in. On a grid of 16 million a bag's have
# 200,000; lumps of beads that the grid does not show have 1,000 to 3,000.
LARGE_OBJECT = 20_000
# Side of the box that is looked at, voxels: 20 pebbles of a radius of 25.
SIDE = 128
# Cells of a ball of radius 7, which the network tells from its neighbours even where cells are no
# cubes; at 5 one in three is lost, at 3 all are.
LEAST_CELLS = 1500
# How much smaller objects are in the box before a finer grid is worth its time.
SMALLER = 0.5


def finer_grid(
    source: Source,
    spacing: Spacing,
    labels: NDArray[np.int32],
    factors: Factors,
    find: Find,
    most: int,
    share: Share,
) -> int | None:
    """Return how many cells a grid is to have, where this one is too coarse for its objects.

    Parameters
    ----------
    source : Source
    spacing : (float, float, float) of mm, z y x
    labels : (z, y, x) ndarray of int32
        What was found on the grid; 0 is background.
    factors : (int, int, int)
        Voxels to a cell, z y x.
    find : Find
    most : int
        Cells at most.
    share : Share

    Returns
    -------
    int or None
        None where the grid will do: its objects are large, or are no smaller in the box of it with
        the most matter, which is looked at in full resolution. A bag costs nothing.
    """
    typical = _typical_size(labels)
    matter = np.count_nonzero(labels)
    # One object of all matter may be a casting, or a jar of beads.
    if typical >= LARGE_OBJECT and typical <= matter / 2:
        return None
    cells = _densest_box(labels > 0, factors)
    box = _voxels(cells, factors, source.shape)
    try:
        found = find(source.read(box), spacing, share)
    except ValueError:
        # Nothing stands out in a box of one density.
        return None
    size = _typical_size(found)
    if size > SMALLER * _typical_size(labels[cells]) * prod(factors):
        return None
    wanted = _cells_wanted(source.shape, spacing, max(1, size // LEAST_CELLS), most)
    finer = prod(reduction(source.shape, spacing, wanted)) < prod(factors)
    return wanted if finer else None


def _cells_wanted(shape: tuple[int, int, int], spacing: Spacing, voxels: int, most: int) -> int:
    """Return the fewest cells of which none has more voxels than that, or the most there may be."""
    # Factors are whole numbers: a grid may have far fewer cells than it is allowed.
    for n in range(voxels, 0, -1):
        cells = min(most, ceil(prod(shape) / n))
        if prod(reduction(shape, spacing, cells)) <= voxels:
            return cells
    return most


def _typical_size(labels: NDArray[np.int32]) -> int:
    """Return the size of the object that the median bit of matter is in."""
    sizes = np.sort(np.bincount(labels.reshape(-1))[1:])
    sums = np.cumsum(sizes)
    return int(sizes[np.searchsorted(sums, sums[-1] / 2)]) if len(sums) else 0


def _densest_box(matter: NDArray[np.bool_], factors: Factors) -> Box:
    """Return the cells of the box that has the most matter."""
    sides = [min(n, -(-SIDE // f)) for n, f in zip(matter.shape, factors, strict=True)]
    density = uniform_filter(matter.astype(np.float32), sides, mode="constant")
    middle = np.unravel_index(int(density.argmax()), matter.shape)
    starts = (
        min(max(int(m) - side // 2, 0), n - side)
        for m, side, n in zip(middle, sides, matter.shape, strict=True)
    )
    z, y, x = (slice(a, a + side) for a, side in zip(starts, sides, strict=True))
    return z, y, x


def _voxels(cells: Box, factors: Factors, shape: tuple[int, ...]) -> Box:
    ends = zip(cells, factors, shape, strict=True)
    z, y, x = (slice(s.start * f, min(s.stop * f, n)) for s, f, n in ends)
    return z, y, x
