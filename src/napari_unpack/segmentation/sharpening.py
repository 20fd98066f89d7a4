"""Borders between touching objects, moved to where the density steps from one to the other."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.segmentation.voting import LEAD, MOST, count_votes

# Voxels around a border in which the densities of both sides are taken.
REACH = 3
# What matter varies by itself, a share of its density.
TEXTURE = 0.2
# What density says at most, where every neighbouring voxel says 1 at most.
LOUDEST = 8.0
# In the last rounds every neighbour votes for its label too, one across a face with this weight,
# one across an edge or a corner with less, as it is further away: borders do not fray.
EVEN = 0.5


def sharpen(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    air: float,
    following: NDArray[np.uint8],
    noise: float,
    dense: float = np.inf,
    rounds: int = 3,
    evening: int = 2,
) -> NDArray[np.int32]:
    """Move borders between labels to half-way between the densities on both sides.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    density : (Z, Y, X) ndarray
        Density; NaN counts as air.
    air : float
        Density of the background.
    following : (3, Z, Y, X) ndarray of uint8
        That a voxel belongs with the next; see `boundaries.Prediction`.
    noise : float
        Standard deviation of the density's noise.
    dense : float
        Above air; objects denser than this on average also lose to the background what has less
        than half of their density: it is the blur around them.
    rounds : int
        Voxels that a border moves at most.
    evening : int
        Rounds after these that even it.

    Returns
    -------
    (Z, Y, X) ndarray of int32

    Notes
    -----
    A voxel between two objects goes with the one for which most speaks: how near its density
    (not its logarithm: a blurred border lies half-way) is to the mean of the object's voxels
    around it, those inside it counting most; what the network says of its faces; and how many of
    them it shares. Where both sides are of one density only the last two speak. In the end its 26
    neighbours count as well, but not before: they would hold back a flat border that has still to
    move. About 343 reads a voxel of border and round.
    """
    values = np.nan_to_num(density.astype(np.float32), nan=air) - np.float32(air)
    flat = labels.reshape(-1)
    counts = np.bincount(flat)
    blurred = np.bincount(flat, values.reshape(-1), len(counts)) > dense * counts
    for even in (0.0,) * rounds + (EVEN,) * evening:
        labels = _moved(labels, values, find_inside(labels), following, noise, blurred, even)
    return labels


@njit(cache=True, nogil=True)
def find_inside(labels):  # type: ignore[no-untyped-def]
    """Return which voxels of objects share all faces with others of their object.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background, which has no inside.

    Returns
    -------
    (Z, Y, X) ndarray of bool
    """
    inside = np.zeros(labels.shape, np.bool_)
    size = labels.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                here = labels[z, y, x]
                alone = here > 0
                if z > 0:
                    alone &= labels[z - 1, y, x] == here
                if y > 0:
                    alone &= labels[z, y - 1, x] == here
                if x > 0:
                    alone &= labels[z, y, x - 1] == here
                if z + 1 < size[0]:
                    alone &= labels[z + 1, y, x] == here
                if y + 1 < size[1]:
                    alone &= labels[z, y + 1, x] == here
                if x + 1 < size[2]:
                    alone &= labels[z, y, x + 1] == here
                inside[z, y, x] = alone
    return inside


@njit(cache=True, nogil=True)
def _moved(labels, values, inside, following, noise, blurred, even):  # type: ignore[no-untyped-def]
    result = labels.copy()
    size = labels.shape
    names = np.zeros(MOST, np.int32)
    votes = np.zeros(MOST, np.float64)
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                mine = labels[z, y, x]
                if mine == 0 or inside[z, y, x]:
                    continue
                count, bare = count_votes(labels, following, 0.0, z, y, x, names, votes)
                bare &= blurred[mine]
                if count == 1 and not bare:
                    continue
                if even > 0:
                    _favour_many(labels, even, z, y, x, names[:count], votes)
                means = _means_around(labels, values, inside, z, y, x, names[:count])
                if bare and values[z, y, x] < means[0] / 2:
                    result[z, y, x] = 0
                    continue
                low, high = means.min(), means.max()
                spread = noise + TEXTURE * max(low, 0.0) + 1e-6
                step = high - low
                loud = min(LOUDEST, (step / spread) ** 2 / 2)
                value = min(max(values[z, y, x], low), high)
                best = 0
                for n in range(count):
                    votes[n] -= loud * ((value - means[n]) / max(step, 1e-6)) ** 2
                    if votes[n] > votes[best] + LEAD:
                        best = n
                result[z, y, x] = names[best]
    return result


@njit(cache=True, nogil=True)
def _favour_many(labels, even, z, y, x, names, votes):  # type: ignore[no-untyped-def]
    """Add to the votes for every label what its voxels among the 26 neighbours say."""
    size = labels.shape
    for k in range(max(z - 1, 0), min(z + 2, size[0])):
        for j in range(max(y - 1, 0), min(y + 2, size[1])):
            for i in range(max(x - 1, 0), min(x + 2, size[2])):
                away = abs(k - z) + abs(j - y) + abs(i - x)
                if away == 0:
                    continue
                for n in range(len(names)):
                    if names[n] == labels[k, j, i]:
                        votes[n] += even / np.sqrt(away)


@njit(cache=True, nogil=True)
def _means_around(labels, values, inside, z, y, x, names):  # type: ignore[no-untyped-def]
    sums, counts = np.zeros(len(names)), np.zeros(len(names))
    size = labels.shape
    for k in range(max(z - REACH, 0), min(z + REACH + 1, size[0])):
        for j in range(max(y - REACH, 0), min(y + REACH + 1, size[1])):
            for i in range(max(x - REACH, 0), min(x + REACH + 1, size[2])):
                name = labels[k, j, i]
                if name == 0:
                    continue
                for n in range(len(names)):
                    if names[n] == name:
                        # Something thin has no inside.
                        weight = 1.0 if inside[k, j, i] else 0.02
                        sums[n] += weight * values[k, j, i]
                        counts[n] += weight
    return sums / counts
