"""Merging parts: who owns whom, and small and ragged ones with the neighbour they touch most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.validation import Spacing

# Free faces a voxel of a label that is all surface; a flat sheet of one layer has 2.
RAGGED = 2.4


def absorb_small(
    labels: NDArray[np.int32],
    spacing: Spacing,
    smallest: float,
    kept: NDArray[np.bool_] | None = None,
) -> NDArray[np.int32]:
    """Merge labels below a volume with the neighbour they touch most; drop those with none.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Not changed.
    spacing : (float, float, float) of mm, z y x
    smallest : float
        mm^3.
    kept : (M,) ndarray of bool, optional
        Labels that stay although they are small; nothing is merged with them while they are.
    """
    found = find_neighbours(labels, spacing)
    volume = found.voxels * float(np.prod(spacing))
    # Areas are measured once, not after every merge: the order of merges must not matter.
    spared = np.zeros(len(volume), np.bool_) if kept is None else kept
    most = found.most_touched(spared & (volume < smallest))
    owner = np.arange(len(most))
    order = np.argsort(volume[1:], kind="stable") + 1
    for name in order[(volume[order] < smallest) & ~spared[order]].tolist():
        other = int(most[name])
        # Two small ones may choose each other: the second then has nothing left and is dropped.
        owner[name] = other if root(owner, other) != name else 0
    return roots(owner).astype(np.int32)[labels]


def absorb_fringes(
    labels: NDArray[np.int32], density: NDArray[np.generic], spacing: Spacing
) -> NDArray[np.int32]:
    """Give the voxels of labels that are all surface, around something denser, to neighbours.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Not changed.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    """
    # The blurred edge of a dense thing, where noise carries some voxels over a density step and
    # leaves others, is a lace of voxels around it.
    found = find_neighbours(labels, spacing)
    face = float(np.prod(spacing)) ** (2 / 3)
    voxels, most = found.voxels, found.most_touched()
    lace = found.surface > RAGGED * face * np.maximum(voxels, 1)
    values = np.nan_to_num(density.reshape(-1).astype(np.float32))
    mean = np.bincount(labels.reshape(-1), values, len(lace)) / np.maximum(voxels, 1)
    # A thin cable in cloth is all surface too, but denser than what it lies in.
    lace &= (most > 0) & (mean[most] > 1.1 * mean)
    lace[0] = False
    if not lace.any():
        return labels
    rest = np.where(lace[labels], 0, labels).astype(np.int32, copy=False)
    grown = flood(rest, labels > 0)
    return np.where(grown > 0, grown, labels)


def root(owner: NDArray[np.int64], k: int) -> int:
    """Return who owns k in the end, halving the path to it.

    Parameters
    ----------
    owner : (M,) ndarray of int64
        Who owns each, itself where nobody else does; paths become shorter.
    k : int
    """
    while owner[k] != k:
        owner[k] = owner[owner[k]]
        k = int(owner[k])
    return k


def roots(owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return who owns each in the end, (M,); see `root`."""
    found = owner[owner]
    while (found != owner).any():
        found, owner = found[found], found
    return found
