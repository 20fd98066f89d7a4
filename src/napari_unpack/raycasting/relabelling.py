"""Bricks after a repair of the labels: only those that were touched are looked over again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.raycasting.bricks import Bricks
from napari_unpack.raycasting.lattice import BRICK


def relabelled(
    bricks: Bricks, labels: NDArray[np.uint16], box: tuple[slice, slice, slice]
) -> Bricks:
    """Return bricks of other labels of the same volume.

    Parameters
    ----------
    bricks : Bricks
        Of the volume and the labels before.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs now.
    box : (slice, slice, slice)
        Voxels outside which they are as before.

    Returns
    -------
    Bricks
        As `Bricks.of` makes them from nothing; ranges of density are shared with those before.
    """
    touched = tuple(slice(s.start // BRICK, -(-s.stop // BRICK)) for s in box)
    voxels = tuple(slice(s.start * BRICK, s.stop * BRICK) for s in touched)
    part = Bricks.of(np.ascontiguousarray(labels[voxels]))
    grid = bricks.low.shape
    begin = bricks.starts[:-1].reshape(grid).copy()
    counts = np.diff(bricks.starts).reshape(grid)
    begin[touched] = part.starts[:-1].reshape(part.low.shape) + len(bricks.ids)
    counts[touched] = np.diff(part.starts).reshape(part.low.shape)
    starts = np.concatenate([[0], np.cumsum(counts.ravel())])
    places = np.repeat(begin.ravel() - starts[:-1], counts.ravel()) + np.arange(starts[-1])
    ids = np.concatenate([bricks.ids, part.ids])[places]
    return Bricks(bricks.low, bricks.high, starts, ids)
