"""From cells back to voxels: every voxel goes with those that it belongs with."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.segmentation.voting import LEAD, MOST, count_votes


def resolve(
    cells: NDArray[np.int32],
    matter: NDArray[np.bool_],
    following: NDArray[np.uint8],
    rounds: int = 3,
) -> NDArray[np.int32]:
    """Label voxels as their cells are, and move the borders to where the network sees them.

    Parameters
    ----------
    cells : (z, y, x) ndarray of int32
        Labels of cells of 2 x 2 x 2 voxels.
    matter : (Z, Y, X) ndarray of bool
        Voxels to label.
    following : (3, Z, Y, X) ndarray of uint8
        That a voxel belongs with the next; see `boundaries.Prediction`.
    rounds : int
        Voxels that a border moves at most.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    labels = _expand(cells, matter)
    for _ in range(rounds):
        labels = _vote(labels, following)
    return labels


@njit(cache=True, nogil=True)
def _expand(cells, matter):  # type: ignore[no-untyped-def]
    labels = np.zeros(matter.shape, np.int32)
    for z in range(matter.shape[0]):
        for y in range(matter.shape[1]):
            for x in range(matter.shape[2]):
                if matter[z, y, x]:
                    labels[z, y, x] = cells[z // 2, y // 2, x // 2]
    return labels


@njit(cache=True, nogil=True)
def _vote(labels, following):  # type: ignore[no-untyped-def]
    result = labels.copy()
    size = labels.shape
    names = np.zeros(MOST, np.int32)
    votes = np.zeros(MOST, np.float64)
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                if labels[z, y, x] == 0:
                    continue
                count, _ = count_votes(labels, following, 0.5, z, y, x, names, votes)
                best = 0
                for n in range(1, count):
                    if votes[n] > votes[best] + LEAD:
                        best = n
                result[z, y, x] = names[best]
    return result
