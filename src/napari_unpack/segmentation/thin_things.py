"""Things too thin to show on the working grid: wires, foils, needles."""

from __future__ import annotations

import cc3d
import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.segmentation.refining import Coarse, lifted
from napari_unpack.segmentation.sources import Box, Source


def named_things(
    unexplained: NDArray[np.int32], labels: NDArray[np.int32], fewest: int
) -> NDArray[np.int32]:
    """Decide what becomes of matter that the grid did not show.

    Parameters
    ----------
    unexplained : (z, y, x) ndarray of int32
        Voxels of such matter in every cell.
    labels : (z, y, x) ndarray of int32
        Objects on the grid.
    fewest : int
        Voxels of an object.

    Returns
    -------
    (z, y, x) ndarray of int32
        Whose such matter in a cell is: of a new object, above all labels, where connected cells
        (26 neighbours) hold enough voxels; else of the object they touch most; else 0.

    Notes
    -----
    Two thin things that pass through neighbouring cells are one here.
    """
    found, count = cc3d.connected_components(unexplained > 0, connectivity=26, return_N=True)
    pieces: NDArray[np.int32] = found.astype(np.int32)
    owner = np.zeros(count + 1, np.int32)
    if not count:
        return pieces
    voxels = np.bincount(pieces.reshape(-1), unexplained.reshape(-1), count + 1)
    large = voxels >= fewest
    large[0] = False
    owner[large] = int(labels.max()) + np.arange(1, int(large.sum()) + 1)
    pairs = _touched(pieces, labels, ~large)
    if len(pairs):
        touched, times = np.unique(pairs, axis=0, return_counts=True)
        for (piece, label), _ in sorted(
            zip(touched.tolist(), times.tolist(), strict=True), key=lambda row: (row[1], -row[0][1])
        ):
            owner[piece] = label
    return owner[pieces]


def write_things(
    source: Source,
    grid: Coarse,
    things: NDArray[np.int32],
    block: NDArray[np.int32],
    box: Box,
    cells: Box,
) -> None:
    """Give the thin things of one block their labels.

    Parameters
    ----------
    source : Source
        The volume.
    grid : Coarse
        The working grid.
    things : (z, y, x) ndarray of int32
        See `named_things`.
    block : (a, b, c) ndarray of int32
        Labels of the block; changed where they are 0.
    box, cells : tuple of slice
        The block in the volume and on the grid.
    """
    values = lifted(source.read(box), grid.levels.air, grid.unit)
    low = np.float32((grid.levels.low - grid.levels.air) / grid.unit)
    _write(values, low, np.array(grid.factors), np.ascontiguousarray(things[cells]), block)


@njit(cache=True, nogil=True)
def _touched(pieces, labels, small):  # type: ignore[no-untyped-def]
    """Return (piece, label) for every cell of a small piece and every label beside it."""
    depth, height, width = pieces.shape
    pairs = []
    for z, y, x in np.argwhere(pieces):
        if not small[pieces[z, y, x]]:
            continue
        for k in range(max(z - 1, 0), min(z + 2, depth)):
            for j in range(max(y - 1, 0), min(y + 2, height)):
                for i in range(max(x - 1, 0), min(x + 2, width)):
                    if labels[k, j, i]:
                        pairs.append((pieces[z, y, x], labels[k, j, i]))
    found = np.zeros((len(pairs), 2), np.int64)
    for n, pair in enumerate(pairs):
        found[n, 0], found[n, 1] = pair
    return found


@njit(cache=True, nogil=True)
def _write(values, low, factors, things, block):  # type: ignore[no-untyped-def]
    fz, fy, fx = factors
    for k, j, i in np.argwhere(things):
        for z in range(k * fz, min((k + 1) * fz, block.shape[0])):
            for y in range(j * fy, min((j + 1) * fy, block.shape[1])):
                for x in range(i * fx, min((i + 1) * fx, block.shape[2])):
                    if block[z, y, x] == 0 and values[z, y, x] >= low:
                        block[z, y, x] = things[k, j, i]
