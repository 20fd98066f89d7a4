"""Label assignment: from cells back to voxels, and borders moved to density steps.

Every voxel at a border votes among its own label and those across its six faces: by the network's
affinities alone (`assign_labels`), then also by densities on both sides (`sharpen_borders`).
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import label_means
from napari_unpack.tasks import SILENT, Share

# Of a voxel and its six neighbours.
MOST_LABELS = 7
# By how many votes another label must lead to take a voxel: in doubt nothing moves.
LEAD = 0.2
# Voxels around a border in which the mean densities of both sides are taken.
REACH = 3
# Standard deviation of one object's density, as a share of it, beside noise.
TEXTURE = 0.2
# Votes of the density at most, where every neighbouring voxel has 1 at most.
DENSITY_VOTES = 8.0
# In the last rounds every neighbour votes for its label too, one across a face with this weight,
# one across an edge or a corner with less, as it is further away: borders do not fray.
SMOOTHING = 0.5
# Of voxels that are blurred with the other side, in means; something thin has no others.
WEIGHT_AT_BORDER = 0.02


@njit(cache=True, nogil=True)
def _count_votes(labels, following, bar, z, y, x, names, votes):  # type: ignore[no-untyped-def]
    """Write the labels at a voxel and their votes; return how many, and whether it is bare."""
    size = labels.shape
    count, bare = 1, False
    names[0], votes[0] = labels[z, y, x], 0.0
    for side in range(6):
        axis, ahead = side // 2, side % 2
        k, j, i = z, y, x
        if axis == 0:
            k += 2 * ahead - 1
        elif axis == 1:
            j += 2 * ahead - 1
        else:
            i += 2 * ahead - 1
        inside = 0 <= k < size[0] and 0 <= j < size[1] and 0 <= i < size[2]
        name = labels[k, j, i] if inside else 0
        bare |= inside and name == 0
        if name > 0:
            affinity = following[axis, z, y, x] if ahead else following[axis, k, j, i]
            n = 0
            while n < count and names[n] != name:
                n += 1
            if n == count:
                names[n], votes[n] = name, 0.0
                count += 1
            votes[n] += affinity / 255.0 - bar
    return count, bare


def assign_labels(
    cells: NDArray[np.int32],
    foreground: NDArray[np.bool_],
    following: NDArray[np.uint8],
    rounds: int = 3,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Label voxels as their cells are, and move the borders to where affinities are low.

    Parameters
    ----------
    cells : (z, y, x) ndarray of int32
        Labels of cells of 2 x 2 x 2 voxels.
    foreground : (Z, Y, X) ndarray of bool
        Voxels to label.
    following : (3, Z, Y, X) ndarray of uint8
        Affinity with the next voxel; see `boundary_network.Prediction`.
    rounds : int
        Voxels that a border moves at most.
    share : Share
    """
    labels = _expand(cells, foreground)
    for n in range(rounds):
        before, labels = labels, labels.copy()
        vote = partial(_vote, before, following, labels)
        share.part(n / rounds, (n + 1) / rounds).over_slabs(labels.shape, vote)
    return labels


@njit(cache=True, nogil=True)
def _expand(cells, foreground):  # type: ignore[no-untyped-def]
    labels = np.zeros(foreground.shape, np.int32)
    for z in range(foreground.shape[0]):
        for y in range(foreground.shape[1]):
            for x in range(foreground.shape[2]):
                if foreground[z, y, x]:
                    labels[z, y, x] = cells[z // 2, y // 2, x // 2]
    return labels


@njit(cache=True, nogil=True)
def _vote(labels, following, result, slab):  # type: ignore[no-untyped-def]
    """Give every voxel to the label with the highest affinity across its faces."""
    size = labels.shape
    names = np.zeros(MOST_LABELS, np.int32)
    votes = np.zeros(MOST_LABELS, np.float64)
    for z in range(slab[0], slab[1]):
        for y in range(size[1]):
            for x in range(size[2]):
                if labels[z, y, x] == 0:
                    continue
                count, _ = _count_votes(labels, following, 0.5, z, y, x, names, votes)
                best = 0
                for n in range(1, count):
                    if votes[n] > votes[best] + LEAD:
                        best = n
                result[z, y, x] = names[best]


def sharpen_borders(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    air: float,
    following: NDArray[np.uint8],
    noise: float,
    dense: float = np.inf,
    rounds: int = 3,
    smoothing: int = 2,
    share: Share = SILENT,
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
        Affinity with the next voxel; see `boundary_network.Prediction`.
    noise : float
        Standard deviation of the density's noise.
    dense : float
        Above air; objects denser than this on average also lose to the background what has less
        than half of their density: it is the blur around them.
    rounds : int
        Voxels that a border moves at most.
    smoothing : int
        Rounds after these that smooth it.
    share : Share
    """
    # A voxel between two objects goes with the one that has most votes: by how near its density
    # (not its logarithm: a blurred border lies half-way) is to the mean of the object's voxels
    # around it, those inside it counting most; by the affinities across its faces; and by how many
    # faces it shares. Where both sides are of one density only the last two count. In the end its
    # 26 neighbours vote as well, but not before: they would hold back a flat border that has still
    # to move. About 343 reads a voxel of border and round.
    values = np.nan_to_num(density.astype(np.float32), nan=air) - np.float32(air)
    share()
    blurred = label_means(labels, values) > dense
    turns = (0.0,) * rounds + (SMOOTHING,) * smoothing
    for n, even in enumerate(turns):
        round_share = share.part(n / len(turns), (n + 1) / len(turns))
        inside, before, labels = find_inside(labels), labels, labels.copy()
        move = partial(_move, before, values, inside, following, noise, blurred, even, labels)
        round_share.over_slabs(labels.shape, move)
    return labels


@njit(cache=True, nogil=True)
def find_inside(labels):  # type: ignore[no-untyped-def]
    """Return which voxels of (Z, Y, X) labels share all faces with others of their object."""
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
def _move(  # type: ignore[no-untyped-def]
    labels, values, inside, following, noise, blurred, even, result, slab
):
    """Write to a slab of a copy of the labels where their borders move."""
    size = labels.shape
    names = np.zeros(MOST_LABELS, np.int32)
    votes = np.zeros(MOST_LABELS, np.float64)
    for z in range(slab[0], slab[1]):
        for y in range(size[1]):
            for x in range(size[2]):
                mine = labels[z, y, x]
                if mine == 0 or inside[z, y, x]:
                    continue
                count, bare = _count_votes(labels, following, 0.0, z, y, x, names, votes)
                # Only dense things have a halo above the foreground's level.
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
                # Half the square of the step over its spread: a log-likelihood, as votes add up.
                loud = min(DENSITY_VOTES, (step / spread) ** 2 / 2)
                # Noise beyond both means says no more than the mean itself.
                value = min(max(values[z, y, x], low), high)
                best = 0
                for n in range(count):
                    votes[n] -= loud * ((value - means[n]) / max(step, 1e-6)) ** 2
                    if votes[n] > votes[best] + LEAD:
                        best = n
                result[z, y, x] = names[best]


@njit(cache=True, nogil=True)
def _favour_many(labels, even, z, y, x, names, votes):  # type: ignore[no-untyped-def]
    """Add the votes of the 26 neighbours for their labels."""
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
    """Return the mean density of some labels around a voxel."""
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
                        weight = 1.0 if inside[k, j, i] else WEIGHT_AT_BORDER
                        sums[n] += weight * values[k, j, i]
                        counts[n] += weight
    return sums / counts
