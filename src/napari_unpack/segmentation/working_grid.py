"""The working grid: a volume too large to be worked on whole, reduced by block means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import Box, Source, blocks
from napari_unpack.segmentation.common.block_jobs import BlockJob, RunBlocks, run_on_threads
from napari_unpack.segmentation.common.validation import Spacing, constant_volume
from napari_unpack.segmentation.foreground.thresholds import MOST_SAMPLES
from napari_unpack.tasks import SILENT, Progress, Share

# Voxels that are segmented whole, a bag of 250 in each direction.
WORKING_VOXELS = 16_000_000
# Voxels that are read at once by each thread.
BLOCK = 16_000_000

Factors = tuple[int, int, int]

Find = Callable[[NDArray[Any], Spacing, Progress], NDArray[np.int32]]
"""`find(density, spacing, progress) -> labels` finds the objects of a grid."""


@dataclass(frozen=True, eq=False)
class WorkingGrid:
    """A reduced volume.

    Parameters
    ----------
    density : (z, y, x) ndarray of float
        Mean of the finite densities in every cell; NaN where there is none.
    factors : (int, int, int)
        Voxels to a cell, z y x; the last cell of an axis may have fewer.
    spacing : (float, float, float)
        Cell size z y x, mm.
    sample : (a, b, c) ndarray
        Every so many-th voxel of the volume itself, about 4 million.
    """

    density: NDArray[np.floating[Any]]
    factors: Factors
    spacing: Spacing
    sample: NDArray[Any]


def reduction(shape: tuple[int, int, int], spacing: Spacing, most: int = WORKING_VOXELS) -> Factors:
    """Choose how many voxels become one cell along each axis.

    Parameters
    ----------
    shape : (int, int, int)
        Voxels z y x.
    spacing : (float, float, float) of mm, z y x
    most : int
        Cells at most.

    Returns
    -------
    (int, int, int)
        The smallest factors that suffice, the finer axes reduced first so that cells come near
        to cubes; an axis of one cell is left alone.
    """
    factors = [1, 1, 1]

    def cells(axis: int) -> int:
        return -(-shape[axis] // factors[axis])

    while int(np.prod([cells(a) for a in range(3)], dtype=np.int64)) > most:
        axes = [a for a in range(3) if cells(a) > 1]
        finest = min(axes, key=lambda a: (factors[a] * spacing[a], -cells(a)))
        factors[finest] += 1
    return factors[0], factors[1], factors[2]


def reduced(
    source: Source,
    spacing: Spacing,
    factors: Factors,
    most: int = BLOCK,
    share: Share = SILENT,
    run: RunBlocks = run_on_threads,
) -> WorkingGrid:
    """Reduce a volume in one pass, block by block.

    Parameters
    ----------
    source : Source
    spacing : (float, float, float) of mm, z y x
    factors : (int, int, int)
        See `reduction`.
    most : int
        Voxels read at once.
    share : Share
    run : RunBlocks
        What works on blocks.

    Raises
    ------
    ValueError
        If the volume is constant or has no finite value.
    """
    wide = np.float64 if source.dtype.itemsize > 4 else np.float32
    shape = tuple(-(-n // f) for n, f in zip(source.shape, factors, strict=True))
    means = np.empty(shape, wide)
    stride = max(1, int(np.ceil((source.size / MOST_SAMPLES) ** (1 / 3))))
    sample = np.empty(tuple(-(-n // stride) for n in source.shape), source.dtype)
    low, high = np.inf, -np.inf
    places = list(blocks(source.shape, factors, most))
    jobs = (BlockJob(reduced_block, box, (box, factors, stride)) for box, _ in places)
    found = run(source, jobs, len(places), share)
    for (box, cells), (part, seen, least, largest) in zip(places, found, strict=True):
        means[cells] = part
        low, high = min(low, least), max(high, largest)
        sample[tuple(slice(-(-s.start // stride), -(-s.stop // stride)) for s in box)] = seen
    if low > high:
        raise ValueError("volume has no finite value: all of it is NaN or infinite")
    if low == high:
        raise constant_volume(low)
    z, y, x = (s * f for s, f in zip(spacing, factors, strict=True))
    return WorkingGrid(means, factors, (z, y, x), sample)


def reduced_block(
    source: Source, box: Box, factors: Factors, stride: int, _share: Share
) -> tuple[NDArray[np.floating[Any]], NDArray[Any], float, float]:
    """Return the means of a block's cells, its voxels of the sample, and its extreme densities.

    Parameters
    ----------
    source : Source
    box : tuple of slice
    factors : (int, int, int)
    stride : int
        Of the sample.
    """
    block = source.read(box)
    wide = np.float64 if source.dtype.itemsize > 4 else np.float32
    shape = [-(-n // f) for n, f in zip(block.shape, factors, strict=True)]
    means: NDArray[np.floating[Any]] = np.empty(shape, wide)
    least, largest = _means(block, np.array(factors), means)
    z, y, x = (slice(-s.start % stride, None, stride) for s in box)
    return means, block[z, y, x].copy(), least, largest


@njit(cache=True, nogil=True)
def _means(block, factors, means):  # type: ignore[no-untyped-def]
    """Write the mean of every cell; return the least and largest finite value."""
    low, high = np.inf, -np.inf
    depth, height, width = block.shape
    sums = np.zeros(means.shape[2])
    counts = np.zeros(means.shape[2], np.int64)
    for k in range(means.shape[0]):
        for j in range(means.shape[1]):
            sums[:] = 0
            counts[:] = 0
            for z in range(k * factors[0], min((k + 1) * factors[0], depth)):
                for y in range(j * factors[1], min((j + 1) * factors[1], height)):
                    for i in range(means.shape[2]):
                        for x in range(i * factors[2], min((i + 1) * factors[2], width)):
                            value = np.float64(block[z, y, x])
                            if np.isfinite(value):
                                sums[i] += value
                                counts[i] += 1
                                low = min(low, value)
                                high = max(high, value)
            for i in range(means.shape[2]):
                means[k, j, i] = sums[i] / counts[i] if counts[i] else np.nan
    return low, high
