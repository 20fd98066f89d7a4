"""Labels of half the size, as the next level of a pyramid."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit


def halved(labels: NDArray[Any]) -> NDArray[Any]:
    """Return labels in which a voxel stands for 2 x 2 x 2, of which it has the most frequent label.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray
        The last block of an axis of odd length is half as long.

    Notes
    -----
    Of labels as frequent the largest is taken, whichever side it is on: objects stay where they
    are, and are rather too large than gone. To take one voxel of each block would move them.
    """
    # Files may hold bytes in an order that kernels do not read.
    fine = np.ascontiguousarray(labels, dtype=labels.dtype.newbyteorder("="))
    coarse = np.empty(tuple(-(-n // 2) for n in fine.shape), fine.dtype)
    _halve(fine, coarse)
    return coarse


@njit(cache=True, nogil=True)
def _halve(fine, coarse):  # type: ignore[no-untyped-def]
    depth, height, width = fine.shape
    block = np.empty(8, fine.dtype)
    for z in range(coarse.shape[0]):
        for y in range(coarse.shape[1]):
            for x in range(coarse.shape[2]):
                count = 0
                for a in range(2 * z, min(2 * z + 2, depth)):
                    for b in range(2 * y, min(2 * y + 2, height)):
                        for c in range(2 * x, min(2 * x + 2, width)):
                            block[count] = fine[a, b, c]
                            count += 1
                best, most = block[0], 0
                for k in range(count):
                    alike = 0
                    for other in range(count):
                        if block[other] == block[k]:
                            alike += 1
                    if alike > most or (alike == most and block[k] > best):
                        best, most = block[k], alike
                    # Nearly all blocks are of one label.
                    if alike == count:
                        break
                coarse[z, y, x] = best
