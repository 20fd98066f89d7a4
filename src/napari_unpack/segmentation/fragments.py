"""Fragments of objects, and how strongly any two belong together, from what the network says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_array

from napari_unpack.segmentation.boundaries import REACHES
from napari_unpack.segmentation.flooding import flood
from napari_unpack.segmentation.materials import minima


@dataclass(frozen=True, eq=False)
class Ties:
    """Pairs of fragments.

    Parameters
    ----------
    pairs : (N, 2) ndarray of int64
        Fragments, the smaller first.
    sums, counts : (N,) ndarray of float64
        Of the probabilities that cells of the one belong with cells of the other, and how many.
    touching : (N,) ndarray of float64
        Faces of cells that they share; 0 where only long reaches tie them.
    """

    pairs: NDArray[np.int64]
    sums: NDArray[np.float64]
    counts: NDArray[np.float64]
    touching: NDArray[np.float64]


def cells_with(matter: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells of which any voxel is matter."""
    padded = np.pad(matter, [(0, n % 2) for n in matter.shape])
    z, y, x = (n // 2 for n in padded.shape)
    return np.asarray(padded.reshape(z, 2, y, 2, x, 2).any(axis=(1, 3, 5)))


def find_fragments(far: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Part a mask of cells where they stop to belong together.

    Parameters
    ----------
    far : (K, z, y, x) ndarray of uint8
        See `boundaries.Prediction`.
    mask : (z, y, x) ndarray of bool
        Cells of matter.

    Returns
    -------
    (z, y, x) ndarray of int32
        1, 2, ..., many more than there are objects; 0 outside the mask.

    Notes
    -----
    A watershed of how little a cell belongs with those around it, one, three and six cells away
    along the axes: lowest in the middle of an object, highest at its end.
    """
    height = _looseness(far, mask, np.array(REACHES))
    return flood(minima(height, mask), mask, height)


@njit(cache=True, nogil=True)
def _looseness(far, mask, reaches):  # type: ignore[no-untyped-def]
    height = np.full(mask.shape, 255, np.uint8)
    size = mask.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                if not mask[z, y, x]:
                    continue
                total, weight = 0.0, 0.0
                for r in range(3):
                    reach = reaches[r]
                    w = 1.0 if r else 2.0
                    for axis in range(3):
                        k, j, i = z, y, x
                        if axis == 0:
                            k += reach
                        elif axis == 1:
                            j += reach
                        else:
                            i += reach
                        if k < size[0] and j < size[1] and i < size[2] and mask[k, j, i]:
                            total += w * far[3 * r + axis, z, y, x]
                        weight += w
                        k, j, i = z, y, x
                        if axis == 0:
                            k -= reach
                        elif axis == 1:
                            j -= reach
                        else:
                            i -= reach
                        if k >= 0 and j >= 0 and i >= 0 and mask[k, j, i]:
                            total += w * far[3 * r + axis, k, j, i]
                        weight += w
                height[z, y, x] = np.uint8(min(254.0 - total / weight * (250 / 255), 254.0) / 4) * 4
    return height


def tie(fragments: NDArray[np.int32], far: NDArray[np.uint8], weights: NDArray[np.float64]) -> Ties:
    """Sum up, for every pair of fragments, how their cells belong together.

    Parameters
    ----------
    fragments : (z, y, x) ndarray of int32
        1, 2, ..., 0 background.
    far : (K, z, y, x) ndarray of uint8
        See `boundaries.Prediction`.
    weights : (len(REACHES),) ndarray of float64
        Of pairs of cells by reach.

    Returns
    -------
    Ties
    """
    top = int(fragments.max()) + 1
    shape = (top, top)
    sums, counts, touching = (coo_array(shape, dtype=np.float64).tocsr() for _ in range(3))
    for k, reach in enumerate(REACHES):
        for axis in range(3):
            if reach >= fragments.shape[axis]:
                continue
            here = np.moveaxis(fragments, axis, 0)
            said = np.moveaxis(far[3 * k + axis], axis, 0)[:-reach]
            one, two = here[:-reach], here[reach:]
            meet = (one != two) & (one > 0) & (two > 0)
            a, b = one[meet], two[meet]
            low, high = np.minimum(a, b), np.maximum(a, b)
            value = said[meet].astype(np.float64) * (weights[k] / 255)
            sums += coo_array((value, (low, high)), shape=shape).tocsr()
            number = coo_array((np.full(len(low), weights[k]), (low, high)), shape=shape).tocsr()
            counts += number
            if reach == 1:
                touching += number / weights[k]
    counts = counts.tocoo()
    low, high = counts.coords
    if not len(low):
        return Ties(np.zeros((0, 2), np.int64), *(np.zeros(0) for _ in range(3)))
    return Ties(
        np.stack([low, high], axis=1).astype(np.int64),
        np.asarray(sums[low, high]).reshape(-1),
        counts.data,
        np.asarray(touching[low, high]).reshape(-1),
    )
