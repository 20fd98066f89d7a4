"""Isoperimetric distance trees: where a shape is narrowest, in linear time.

Two objects that touch leak into each other through a neck. On the maximum spanning tree of the
distance to the outside, every path between them runs through the middle of that neck, and the
isoperimetric potential, which has a closed form on a tree, climbs steeply across it (Grady, "Fast,
quality, segmentation of large volumes: isoperimetric distance trees", ECCV 2006).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import strides_of
from napari_unpack.segmentation.common.merging import root
from napari_unpack.segmentation.common.validation import Spacing

# Depths of a tree's edges are told apart to a quarter of the smallest voxel edge.
LEVELS_PER_VOXEL = 4


def isoperimetric_ratio(cut: NDArray[np.float64], voxel: float) -> NDArray[np.float64]:
    """Return cut / min(volume, rest) of every prefix, 1/mm (Grady & Schwartz 2006); inf at the end.

    Parameters
    ----------
    cut : (N,) ndarray of float64
        mm^2.
    voxel : float
        Volume of a voxel, mm^3.
    """
    count = np.arange(1, len(cut) + 1, dtype=np.float64)
    smaller = np.minimum(count, len(cut) - count)
    return np.where(smaller > 0, cut / np.maximum(smaller, 1) / voxel, np.inf)


def two_sides(order: NDArray[np.int64], k: int, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Return 1 for the first k + 1 voxels of an order, 2 for the others, 0 outside.

    Parameters
    ----------
    order : (N,) ndarray of int64
        Flat indices.
    k : int
    shape : (int, int, int)
        Of the result.
    """
    sides = np.zeros(int(np.prod(shape)), np.int32)
    sides[order[: k + 1]] = 1
    sides[order[k + 1 :]] = 2
    return sides.reshape(shape)


def tree_sweep(
    mask: NDArray[np.bool_],
    distance: NDArray[np.floating],
    spacing: Spacing,
    conductance: str = "unit",
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Grow the distance tree of a connected shape and sweep its potential.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        One 6-connected component. Voxels that the deepest one cannot reach are left out.
    distance : (Z, Y, X) ndarray of float
        Distance to the outside, mm; any non-negative depth that is small at necks serves.
    spacing : (float, float, float) of mm, z y x
    conductance : {"unit", "distance"}
        Of the tree's edges when the potential is solved.

    Returns
    -------
    order : (N,) ndarray of int64
        Flat indices into the mask, by ascending potential; the first is the ground.
    cut : (N,) ndarray of float64
        Area in mm^2 of the lattice faces between the first k + 1 voxels and the others.

    Notes
    -----
    Grady 2006: w_ij = D_i + D_j; ground at the deepest voxel; x_v = x_parent + s_v /
    c_v with s_v the voxels of v's subtree. Deviations: the distance is quantised to a quarter of
    the smallest voxel edge, so that Prim's queue is an array of buckets and the tree takes linear
    time; equal keys leave in order of arrival, which keeps plateaus from growing snakes; the cut
    is an area in mm^2, so that anisotropic voxels do not bias it.
    """
    padded = np.full([n + 2 for n in mask.shape], -1, np.int32)
    where = np.flatnonzero(mask)
    padded[1:-1, 1:-1, 1:-1][mask] = np.arange(len(where), dtype=np.int32)
    depth = np.rint(distance[mask] * (LEVELS_PER_VOXEL / min(spacing))).astype(np.int32)
    position = np.flatnonzero(padded.reshape(-1) >= 0)
    strides = strides_of(padded.shape)
    index = padded.reshape(-1)
    order, parent = _grow(index, position, depth, strides, int(np.argmax(depth)))
    potential = _potential(order, parent, depth, conductance == "distance")
    ranked = order[np.argsort(potential[order], kind="stable")]
    faces = np.prod(spacing) / np.array(spacing)
    return where[ranked], _cuts(index, position, strides, ranked, faces)


@njit(cache=True, nogil=True)
def _grow(index, position, depth, strides, root):  # type: ignore[no-untyped-def]
    """Grow the maximum spanning tree by Prim; return the nodes in order, and their parents."""
    # A doubly linked list of nodes for each level of weight.
    count = len(position)
    levels = 2 * depth.max() + 1
    head = np.full(levels, -1, np.int32)
    tail = np.full(levels, -1, np.int32)
    after = np.full(count, -1, np.int32)
    before = np.full(count, -1, np.int32)
    key = np.full(count, -1, np.int32)
    parent = np.full(count, -1, np.int32)
    order = np.empty(count, np.int64)
    steps = np.array([-strides[0], strides[0], -strides[1], strides[1], -strides[2], strides[2]])
    top = 2 * depth[root]
    head[top] = tail[top] = root
    key[root] = top
    reached = 0
    while True:
        while top >= 0 and head[top] < 0:
            top -= 1
        if top < 0:
            break
        node = head[top]
        head[top] = after[node]
        if head[top] < 0:
            tail[top] = -1
        else:
            before[head[top]] = -1
        key[node] = levels
        order[reached] = node
        reached += 1
        for step in steps:
            other = index[position[node] + step]
            if other < 0:
                continue
            weight = depth[node] + depth[other]
            old = key[other]
            if weight <= old:
                continue
            if old >= 0:
                # It waits with a lesser weight: out of that list.
                a, b = before[other], after[other]
                if a >= 0:
                    after[a] = b
                else:
                    head[old] = b
                if b >= 0:
                    before[b] = a
                else:
                    tail[old] = a
            key[other] = weight
            parent[other] = node
            last = tail[weight]
            before[other] = last
            after[other] = -1
            if last >= 0:
                after[last] = other
            else:
                head[weight] = other
            tail[weight] = other
            top = max(top, weight)
    return order[:reached], parent


@njit(cache=True, nogil=True)
def _potential(order, parent, depth, weighted):  # type: ignore[no-untyped-def]
    """Solve the potential on the tree: subtrees from the leaves up, sums from the root down."""
    size = np.ones(len(parent), np.float64)
    for k in range(len(order) - 1, 0, -1):
        size[parent[order[k]]] += size[order[k]]
    potential = np.zeros(len(parent), np.float64)
    for k in range(1, len(order)):
        node = order[k]
        above = parent[node]
        conductance = 1.0
        if weighted:
            conductance = max(depth[node] + depth[above], 1)
        potential[node] = potential[above] + size[node] / conductance
    return potential


@njit(cache=True, nogil=True)
def _cuts(index, position, strides, ranked, faces):  # type: ignore[no-untyped-def]
    """Return the area between every prefix and the rest: a face counts from its first node on."""
    rank = np.full(len(position), -1, np.int64)
    for k in range(len(ranked)):
        rank[ranked[k]] = k
    change = np.zeros(len(ranked), np.float64)
    for node in range(len(position)):
        if rank[node] < 0:
            continue
        for axis in range(3):
            other = index[position[node] + strides[axis]]
            if other < 0 or rank[other] < 0:
                continue
            change[min(rank[node], rank[other])] += faces[axis]
            change[max(rank[node], rank[other])] -= faces[axis]
    return np.cumsum(change)


def significant_minima(
    curve: NDArray[np.float64], first: int, last: int, drop: float, keep: int
) -> list[int]:
    """Return the deepest well-separated local minima of a positive curve, deepest first.

    Parameters
    ----------
    curve : (N,) ndarray of float64
        For instance the isoperimetric ratio of every prefix.
    first, last : int
        Only minima with first <= k < last count.
    drop : float
        A minimum counts where the curve must rise by this factor (above 1) before a deeper
        one can be reached.
    keep : int
        At most so many are returned.
    """
    if last <= first:
        return []
    window = curve[first:last]
    size = -(-len(window) // 1024)
    starts = np.arange(0, len(window), size)
    # One lowest point for each of at most 1024 bins: finer ripples are not significant.
    lows = np.array([s + int(np.argmin(window[s : s + size])) for s in starts])
    values = window[lows]
    found = [first + int(lows[k]) for k in _persistent(values, np.log(drop))]
    return found[:keep]


def _persistent(values: NDArray[np.float64], rise: float) -> list[int]:
    """Return the minima whose basin is at least so deep before it joins a deeper one."""
    order = np.argsort(values, kind="stable")
    logs = np.log(np.maximum(values, 1e-12))
    owner = np.full(len(values), -1)
    low: dict[int, int] = {}
    kept = {int(order[0])}
    for k in order.tolist():
        sides = [owner[j] for j in (k - 1, k + 1) if 0 <= j < len(values) and owner[j] >= 0]
        if not sides:
            owner[k], low[k] = k, k
            continue
        basins = sorted({root(owner, int(s)) for s in sides}, key=lambda r: logs[low[r]])
        owner[k] = basins[0]
        for basin in basins[1:]:
            if logs[k] - logs[low[basin]] >= rise:
                kept.add(low[basin])
            owner[basin] = basins[0]
    return sorted(kept, key=lambda k: values[k])
