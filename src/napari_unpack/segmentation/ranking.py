"""Names of objects: 1, 2, ... from the largest to the smallest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def ranks(voxels: NDArray[np.number]) -> NDArray[np.int32]:
    """Return the new name of every label, the largest first; 0 for those without voxels.

    Parameters
    ----------
    voxels : (M,) ndarray
        Of every label; of 0, which is background, none count.

    Returns
    -------
    (M,) ndarray of int32
    """
    counts = voxels.copy()
    counts[0] = 0
    present = int(np.count_nonzero(counts))
    names = np.zeros(len(counts), np.int32)
    names[np.argsort(-counts, kind="stable")[:present]] = np.arange(1, present + 1)
    return names


def rank_labels(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Renumber labels 1, 2, ... from the largest to the smallest.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Not changed.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    return ranks(np.bincount(labels.reshape(-1)))[labels]
