"""Fragments of objects, and the affinities between them, from the network's prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.density_regions import regional_minima
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.learned.boundary_network import REACHES
from napari_unpack.tasks import SILENT, Share

# Of pairs of cells in a mean over all, by reach.
REACH_WEIGHTS = np.array([1.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True, eq=False)
class FragmentAffinities:
    """The affinities between pairs of fragments.

    Parameters
    ----------
    pairs : (N, 2) ndarray of int64
        Fragments, the smaller first.
    sums, counts : (N, K) ndarray of float64
        Of the affinities of cells of the one with cells of the other, and how many pairs of cells
        that is, by reach.
    """

    pairs: NDArray[np.int64]
    sums: NDArray[np.float64]
    counts: NDArray[np.float64]

    @property
    def touching(self) -> NDArray[np.float64]:
        """Faces of cells that each pair shares, (N,); 0 where only long reaches connect it."""
        return self.counts[:, 0]


def cells_with(foreground: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells of 2 x 2 x 2 voxels of which any is foreground, (Z, Y, X) to (z, y, x)."""
    padded = np.pad(foreground, [(0, n % 2) for n in foreground.shape])
    z, y, x = (n // 2 for n in padded.shape)
    return np.asarray(padded.reshape(z, 2, y, 2, x, 2).any(axis=(1, 3, 5)))


def find_fragments(far: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Split a mask of cells where their affinity is low, into many more parts than objects.

    Parameters
    ----------
    far : (K, z, y, x) ndarray of uint8
        See `boundary_network.Prediction`.
    mask : (z, y, x) ndarray of bool
        Cells of foreground.
    """
    # A watershed of the mean affinity of a cell with those one, three and six cells away along the
    # axes, turned round: lowest in the middle of an object, highest at its end.
    height = np.full(mask.shape, 255, np.uint8)
    _measure_looseness(far, mask, np.array(REACHES), height)
    return flood(regional_minima(height, mask), mask, height)


@njit(cache=True, nogil=True)
def _measure_looseness(far, mask, reaches, height):  # type: ignore[no-untyped-def]
    """Write 254 less the mean affinity of every cell, in steps of 4 so that minima are few."""
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
                        c, b, a = reach * (axis == 0), reach * (axis == 1), reach * (axis == 2)
                        k, j, i = z + c, y + b, x + a
                        if k < size[0] and j < size[1] and i < size[2] and mask[k, j, i]:
                            total += w * far[3 * r + axis, z, y, x]
                        k, j, i = z - c, y - b, x - a
                        if k >= 0 and j >= 0 and i >= 0 and mask[k, j, i]:
                            total += w * far[3 * r + axis, k, j, i]
                        weight += 2 * w
                height[z, y, x] = np.uint8(min(254.0 - total / weight * (250 / 255), 254.0) / 4) * 4


def measure_affinities(
    fragments: NDArray[np.int32], far: NDArray[np.uint8], share: Share = SILENT
) -> FragmentAffinities:
    """Sum up the affinities of the cells of every pair of fragments.

    Parameters
    ----------
    fragments : (z, y, x) ndarray of int32
        1, 2, ..., 0 background.
    far : (3 * K, z, y, x) ndarray of uint8
        See `boundary_network.Prediction`.
    share : Share
    """
    top = int(fragments.max()) + 1
    keys, reaches, values = [], [], []
    for k, reach in enumerate(share.part(0.0, 0.5).over(REACHES)):
        for axis in range(3):
            here = np.moveaxis(fragments, axis, 0)
            one, two = here[:-reach], here[reach:]
            meet = (one != two) & (one > 0) & (two > 0)
            a, b = one[meet].astype(np.int64), two[meet].astype(np.int64)
            keys.append(np.minimum(a, b) * top + np.maximum(a, b))
            values.append(np.moveaxis(far[3 * k + axis], axis, 0)[: len(one)][meet])
            reaches.append(np.full(len(a), k, np.int64))
    share(0.5)
    names, pair = np.unique(np.concatenate(keys), return_inverse=True)
    place = pair.reshape(-1) * len(REACHES) + np.concatenate(reaches)
    size = len(names) * len(REACHES)
    counts = np.bincount(place, minlength=size).reshape(-1, len(REACHES)).astype(np.float64)
    said = np.concatenate(values) / 255.0
    sums = np.bincount(place, said, size).reshape(counts.shape).astype(np.float64)
    return FragmentAffinities(np.stack(np.divmod(names, top), axis=1), sums, counts)


def measure_inner_affinities(
    fragments: NDArray[np.int32], far: NDArray[np.uint8]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum up the affinities within every fragment, as in `FragmentAffinities`; row 0 is empty.

    Parameters
    ----------
    fragments, far
        As for `measure_affinities`.
    """
    top = int(fragments.max(initial=0)) + 1
    sums, counts = (np.zeros((top, len(REACHES))) for _ in range(2))
    for k, reach in enumerate(REACHES):
        for axis in range(3):
            here = np.moveaxis(fragments, axis, 0)
            one, two = here[:-reach], here[reach:]
            same = (one == two) & (one > 0)
            said = np.moveaxis(far[3 * k + axis], axis, 0)[: len(one)][same] / 255.0
            sums[:, k] += np.bincount(one[same], said, top)
            counts[:, k] += np.bincount(one[same], minlength=top)
    return sums, counts


def cells_of(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return for every 2 x 2 x 2 voxels the label most of its labelled ones have."""
    cells = np.zeros([n // 2 for n in labels.shape], np.int32)
    _choose_labels(labels, np.zeros(8, np.int32), cells)
    return cells


@njit(cache=True, nogil=True)
def _choose_labels(labels, seen, cells):  # type: ignore[no-untyped-def]
    """Write to cells the label most of their labelled voxels have."""
    for z in range(cells.shape[0]):
        for y in range(cells.shape[1]):
            for x in range(cells.shape[2]):
                n = 0
                for k in range(8):
                    name = labels[2 * z + k // 4, 2 * y + k // 2 % 2, 2 * x + k % 2]
                    if name:
                        seen[n] = name
                        n += 1
                most = 0
                for a in range(n):
                    count = 0
                    for b in range(n):
                        count += seen[a] == seen[b]
                    if count > most:
                        most = count
                        cells[z, y, x] = seen[a]
