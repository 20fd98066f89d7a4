"""Density regions: where a component changes density, however well its objects touch.

Noise is averaged away over regions instead of being thresholded voxel by voxel: the gradient of
the log density is flooded from its minima, and adjacent basins are merged while their mean
densities are indistinguishable (statistical region merging, Nock & Nielsen, PAMI 26(11) 2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.relabeling import numbered
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.merging import roots
from napari_unpack.tasks import SILENT, Share

SOLID_METAL = 4.0
"""Log density above which metal is solid: tools, keys and coins. The foreground's median lies at
1.6; copper strands and thin sheet lie below."""


@dataclass(frozen=True)
class DensityScale:
    """How densities are compared.

    Parameters
    ----------
    air : float
        Density of the background.
    knee : float
        Densities above air are compared by log(1 + d / knee): absolutely below the knee,
        relatively above it.
    step : float
        Mean log densities closer than this are one region.
    """

    air: float
    knee: float
    step: float = 0.11


# Of CT numbers + 1000 air lies within a fortieth of what objects have above it; of CT numbers as
# such it is as far from 0 as water is from air.
FAR_AIR = 0.3


def air_offset(density: NDArray[np.generic], labels: NDArray[Any]) -> float:
    """Return the density of air where that is far from 0, as CT numbers have it, and else 0.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    labels : (Z, Y, X) ndarray of int or bool
        0 is mostly air.
    """
    thin = tuple(slice(None, None, max(1, n // 128)) for n in labels.shape)
    values, inside = density[thin].astype(np.float64), labels[thin] > 0
    measured = np.isfinite(values)
    around, held = values[~inside & measured], values[inside & measured]
    if not len(around) or not len(held):
        return 0.0
    air = float(np.median(around))
    return air if abs(air) > FAR_AIR * abs(float(np.median(held)) - air) else 0.0


def log_density(
    density: NDArray[np.generic], mask: NDArray[np.bool_], scale: DensityScale
) -> NDArray[np.float32]:
    """Return the log density inside a mask, 0 outside.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Densities; NaN counts as air.
    mask : (Z, Y, X) ndarray of bool
    scale : DensityScale
    """
    lifted = np.zeros(mask.shape, np.float32)
    values = density[mask].astype(np.float32)
    # What was not measured is air, or log1p would spread NaN over a whole basin.
    values = np.nan_to_num(values, nan=scale.air)
    lifted[mask] = np.log1p(np.maximum(values - scale.air, 0) / scale.knee)
    return lifted


def label_means(labels: NDArray[np.int32], values: NDArray[np.number]) -> NDArray[np.float64]:
    """Return the mean value of each label's voxels.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
    values : (Z, Y, X) ndarray

    Returns
    -------
    (N,) ndarray of float64
        By label; 0 for the background, and for labels without voxels.
    """
    # Of matter alone, which is a third of most scans.
    inside = labels > 0
    flat = labels[inside]
    counts = np.maximum(np.bincount(flat, minlength=1), 1)
    means: NDArray[np.float64] = np.bincount(flat, values[inside], len(counts)) / counts
    return means


def density_regions(
    density: NDArray[np.generic],
    mask: NDArray[np.bool_],
    scale: DensityScale,
    smallest: int,
    hosts: NDArray[np.int32] | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Split a mask at its density steps into 6-connected regions 1, 2, ...; 0 is outside.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    mask : (Z, Y, X) ndarray of bool
    scale : DensityScale
    smallest : int
        Parts of fewer voxels join the neighbour they differ least from.
    hosts : (Z, Y, X) ndarray of int32, optional
        Labels, not 0 in the mask, that no part crosses the borders of.
    share : Share
    """
    # Linear in the voxels but for sorting the boundaries of basins.
    lifted = log_density(density, mask, scale)
    share(0.05)
    noise = _noise(lifted, mask)
    share(0.1)
    # Smoothed twice with weights 2 and 1: noise must not make a basin of every voxel.
    once, smooth, gradient = (np.zeros_like(lifted) for _ in range(3))
    _average_neighbours(lifted, mask, once)
    _average_neighbours(once, mask, smooth)
    share(0.2)
    _measure_gradient(smooth, mask, gradient)
    # Below a third of the median slope all is flat; above 0.8 a factor of e, all is a step.
    floor = 0.3 * float(np.median(gradient[mask]))
    levels = np.clip((gradient - floor) * (250 / 0.8), 0, 254).astype(np.uint8)
    levels[~mask] = 255
    share(0.3)
    # Flooded in 255 levels: an array of buckets takes linear time, where a heap of floats sorts.
    minima = regional_minima(levels, mask)
    basins = flood(minima, mask, levels, share.part(0.5, 0.7))
    if hosts is not None:
        basins = intersected_labels(basins, hosts)
    rest = share.part(0.7, 1.0)
    return _merge_basins(basins, smooth, gradient, noise, scale.step, smallest, hosts, rest)


def regional_minima(levels: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Label the plateaus from which no path leads down 1, 2, ...; all else is 0.

    Parameters
    ----------
    levels : (Z, Y, X) ndarray of uint8
        Heights, below 255 inside the mask.
    mask : (Z, Y, X) ndarray of bool
        Where to look.
    """
    plateaus, count = cc3d.connected_components(
        np.where(mask, levels + np.uint8(1), 0).astype(np.uint8), connectivity=6, return_N=True
    )
    plateaus = plateaus.astype(np.int32)
    lowest = np.ones(count + 1, np.bool_)
    _find_descents(plateaus, levels, lowest)
    lowest[0] = False
    return numbered(lowest)[plateaus]


def intersected_labels(basins: NDArray[np.int32], hosts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Split labels where others end: 1, 2, ... for every pair, by basin and then by host.

    Parameters
    ----------
    basins, hosts : (Z, Y, X) ndarray of int32
        Labels; 0 is none.
    """
    names, latest = np.zeros(basins.size, np.int32), np.zeros(basins.max(initial=0) + 1, np.int32)
    # By name less 1: basin, host, and the pair of the same basin met before it.
    rows = np.zeros((3, len(latest) + 15), np.int32)
    flat = basins.reshape(-1), hosts.reshape(-1), names
    place, count = _number_pairs(*flat, latest, rows, 0, 0)
    while place < len(names):
        rows = np.concatenate([rows, np.zeros_like(rows)], axis=1)
        place, count = _number_pairs(*flat, latest, rows, count, place)
    of_basin, of_host = rows[0, :count], rows[1, :count]
    order = np.lexsort((of_host, of_basin))
    ranks = np.zeros(len(order) + 1, np.int32)
    ranks[order + 1] = np.arange(1, len(order) + 1)
    return ranks[names].reshape(basins.shape)


@njit(cache=True, nogil=True)
def _number_pairs(one, two, names, latest, rows, count, place):  # type: ignore[no-untyped-def]
    """Number pairs of basin and host in order of appearance, from a place on.

    Return how far that went before the rows were full, and how many pairs there are.
    """
    while place < len(one):
        if one[place]:
            name = latest[one[place]]
            while name and rows[1, name - 1] != two[place]:
                name = rows[2, name - 1]
            if name == 0:
                if count == rows.shape[1]:
                    break
                rows[0, count], rows[1, count] = one[place], two[place]
                rows[2, count] = latest[one[place]]
                count += 1
                name = latest[one[place]] = count
            names[place] = name
        place += 1
    return place, count


@njit(cache=True, nogil=True)
def _find_descents(plateaus, levels, lowest):  # type: ignore[no-untyped-def]
    """Write False for plateaus that have a lower neighbour."""
    depth, height, width = plateaus.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                here = plateaus[z, y, x]
                if here == 0:
                    continue
                for axis in range(3):
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    if k == depth or j == height or i == width or plateaus[k, j, i] == 0:
                        continue
                    if levels[k, j, i] < levels[z, y, x]:
                        lowest[here] = False
                    elif levels[k, j, i] > levels[z, y, x]:
                        lowest[plateaus[k, j, i]] = False


@njit(cache=True, nogil=True)
def _average_neighbours(values, mask, result):  # type: ignore[no-untyped-def]
    """Write the mean of every voxel, counted twice, and its face neighbours inside a mask."""
    depth, height, width = mask.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                if not mask[z, y, x]:
                    continue
                total, count = 2 * values[z, y, x], np.float32(2)
                if z > 0 and mask[z - 1, y, x]:
                    total, count = total + values[z - 1, y, x], count + 1
                if z + 1 < depth and mask[z + 1, y, x]:
                    total, count = total + values[z + 1, y, x], count + 1
                if y > 0 and mask[z, y - 1, x]:
                    total, count = total + values[z, y - 1, x], count + 1
                if y + 1 < height and mask[z, y + 1, x]:
                    total, count = total + values[z, y + 1, x], count + 1
                if x > 0 and mask[z, y, x - 1]:
                    total, count = total + values[z, y, x - 1], count + 1
                if x + 1 < width and mask[z, y, x + 1]:
                    total, count = total + values[z, y, x + 1], count + 1
                result[z, y, x] = total / count


@njit(cache=True, nogil=True)
def _measure_gradient(values, mask, result):  # type: ignore[no-untyped-def]
    """Write the gradient's length inside a mask, a voxel: air is no step."""
    depth, height, width = mask.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                if not mask[z, y, x]:
                    continue
                squared = np.float32(0)
                for axis in range(3):
                    a, b, c = z - (axis == 0), y - (axis == 1), x - (axis == 2)
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    low, high, span = values[z, y, x], values[z, y, x], 0
                    if a >= 0 and b >= 0 and c >= 0 and mask[a, b, c]:
                        low, span = values[a, b, c], span + 1
                    if k < depth and j < height and i < width and mask[k, j, i]:
                        high, span = values[k, j, i], span + 1
                    if span:
                        squared += ((high - low) / span) ** 2
                result[z, y, x] = np.sqrt(squared)


def _noise(lifted: NDArray[np.float32], mask: NDArray[np.bool_]) -> float:
    """Return the robust standard deviation of noise, from neighbours' differences along x."""
    both = mask[:, :, 1:] & mask[:, :, :-1]
    differences = (lifted[:, :, 1:] - lifted[:, :, :-1])[both]
    if not len(differences):
        return 0.0
    # 1.4826 times the median deviation is the standard deviation of a normal distribution.
    return float(1.4826 * np.median(np.abs(differences)) / np.sqrt(2))


def _merge_basins(
    basins: NDArray[np.int32],
    values: NDArray[np.float32],
    gradient: NDArray[np.float32],
    noise: float,
    step: float,
    smallest: int,
    hosts: NDArray[np.int32] | None,
    share: Share,
) -> NDArray[np.int32]:
    """Merge adjacent basins whose mean values do not differ; see Nock & Nielsen 2004."""
    # Basins in different hosts stay apart; small ones are merged with the neighbour that differs
    # least in any case.
    count = int(basins.max())
    sizes, sums = np.zeros(count + 1), np.zeros(count + 1)
    _add_values(basins.reshape(-1), values.reshape(-1), sizes, sums)
    pairs, faces, slopes = _adjacency(basins, gradient, count, share.part(0.0, 0.6))
    if hosts is not None:
        host = np.zeros(count + 1, np.int32)
        host[basins.reshape(-1)] = hosts.reshape(-1)
        within = host[pairs[:, 0]] == host[pairs[:, 1]]
        pairs, faces, slopes = pairs[within], faces[within], slopes[within]
    owner = np.arange(count + 1)
    # The most alike first, so that a region does not creep across a slow ramp.
    for limit in (step / 4, step / 2, step):
        share(0.7)
        means = sums / np.maximum(sizes, 1)
        # The order is that of the start: sorting again after every merge would cost its square.
        order = np.argsort(np.abs(means[pairs[:, 0]] - means[pairs[:, 1]]) + slopes, kind="stable")
        _merge(pairs[order], owner, sizes, sums, limit, noise)
    # In three steps, so that specks join each other before they join something large.
    for least in (smallest / 8, smallest / 2, smallest / 1):
        # A chain of specks at least halves with every round.
        for _ in range(8):
            best, gap = np.full(count + 1, -1), np.full(count + 1, np.inf)
            if not _absorb_small(pairs, faces, owner, sizes, sums, least, best, gap):
                break
    share(0.9)
    last = roots(owner)
    present = np.zeros(count + 1, np.bool_)
    present[last[1:]] = True
    names = numbered(present)[last]
    names[0] = 0
    return names[basins]


@njit(cache=True, nogil=True)
def _add_values(basins, values, sizes, sums):  # type: ignore[no-untyped-def]
    """Add the voxels of every basin to its size, and their values to its sum."""
    for k in range(len(basins)):
        sizes[basins[k]] += 1
        sums[basins[k]] += values[k]


def _adjacency(
    basins: NDArray[np.int32], gradient: NDArray[np.float32], count: int, share: Share
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the (P, 2) touching pairs, their faces and the mean slope across them."""
    keys, slopes = [], []
    for axis in share.part(0.0, 0.6).over(range(3)):
        one = np.moveaxis(basins, axis, 0)[:-1]
        two = np.moveaxis(basins, axis, 0)[1:]
        touch = (one != two) & (one > 0) & (two > 0)
        a, b = one[touch].astype(np.int64), two[touch].astype(np.int64)
        # One int64 a pair sorts faster than rows of two.
        keys.append(np.minimum(a, b) * (count + 1) + np.maximum(a, b))
        steep = np.moveaxis(gradient, axis, 0)
        slopes.append(np.maximum(steep[:-1][touch], steep[1:][touch]))
    share(0.6)
    found, where, faces = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    mean = np.bincount(where, np.concatenate(slopes), minlength=len(found)) / np.maximum(faces, 1)
    return np.stack([found // (count + 1), found % (count + 1)], axis=1), faces, mean


@njit(cache=True, nogil=True)
def _find(owner, k):  # type: ignore[no-untyped-def]
    """Return the root of a basin, halving the path to it."""
    while owner[k] != k:
        owner[k] = owner[owner[k]]
        k = owner[k]
    return k


@njit(cache=True, nogil=True)
def _merge(pairs, owner, sizes, sums, limit, noise):  # type: ignore[no-untyped-def]
    """Merge pairs in turn whose means differ by less than a limit and their noise."""
    for k in range(len(pairs)):
        a, b = _find(owner, pairs[k, 0]), _find(owner, pairs[k, 1])
        if a == b:
            continue
        gap = abs(sums[a] / sizes[a] - sums[b] / sizes[b])
        if gap <= limit + noise * np.sqrt(1 / sizes[a] + 1 / sizes[b]):
            owner[b] = a
            sizes[a] += sizes[b]
            sums[a] += sums[b]


@njit(cache=True, nogil=True)
def _absorb_small(pairs, faces, owner, sizes, sums, limit, best, least):  # type: ignore[no-untyped-def]
    """Merge small basins with the neighbour of the least difference for the faces shared.

    Return whether there was any.
    """
    for k in range(len(pairs)):
        a, b = _find(owner, pairs[k, 0]), _find(owner, pairs[k, 1])
        if a == b:
            continue
        gap = abs(sums[a] / sizes[a] - sums[b] / sizes[b]) / np.sqrt(faces[k])
        if sizes[a] < limit and gap < least[a]:
            least[a], best[a] = gap, b
        if sizes[b] < limit and gap < least[b]:
            least[b], best[b] = gap, a
    changed = False
    for k in range(1, len(owner)):
        if owner[k] != k or best[k] < 0:
            continue
        a, b = _find(owner, k), _find(owner, best[k])
        if a != b:
            owner[a] = b
            sizes[b] += sizes[a]
            sums[b] += sums[a]
            changed = True
    return changed
