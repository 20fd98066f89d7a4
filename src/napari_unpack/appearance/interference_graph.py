"""Which objects are so near in a view that their colours must differ: equation 1."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.kernels import njit
from napari_unpack.thread_count import thread_count

# From this ID on, IDs are renumbered for the time being.
MOST_IDS = 65_536


def interference(ids: ArrayLike, distance: float = 5, layers: int | None = None) -> nx.Graph:
    """Join the objects that come near one another in a view.

    Parameters
    ----------
    ids : (L, H, W) or (H, W) array_like of int
        Object-ID layers, the first in front; 0 is nothing.
    distance : float
        DT, pixels: objects interfere where pixels of them are at most this far apart, centre to
        centre.
    layers : int, optional
        LT: how many of the layers count, by default all.

    Returns
    -------
    networkx.Graph
        Nodes are the IDs in these layers, ascending. Edges carry `weight`, the contact length
        in pixels: how many pixels on the borders of the two come within DT of the other object,
        at least 1.

    Raises
    ------
    ValueError
        If the array is not 2D or 3D, an ID or `distance` is negative, or `layers` is below 1.
    TypeError
        If the IDs are not integers.

    Notes
    -----
    Li et al. 2012, section 4.2, eq. 1, exact. Two objects on one pixel in different layers are
    at distance 0 (docs/paper.md, R5). Where the nearest pixels of two objects do not coincide,
    both lie on a border of their object in their layer: a step from one towards the other would
    be nearer still. So only border pixels look around, and only at border pixels, of which a
    disk of radius DT holds about DT. O(pixels + border pixels x L x DT).
    """
    stack, names = _compacted(checked_layers(ids, distance, layers))
    if stack.size == 0:
        return nx.Graph()
    top = int(stack.max()) + 1
    present, starts, columns, labels = _borders(stack, top)
    graph = nx.Graph()
    graph.add_nodes_from(_named(np.flatnonzero(present), names))
    if len(graph) < 2:
        return graph
    halves = half_widths(distance)

    def work(band: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return _meet(stack, starts, columns, labels, halves, top, *band)  # type: ignore[no-any-return]

    # Four bands a core: rows with many borders do not keep the others waiting.
    edges = np.linspace(0, stack.shape[1], 1 + 4 * thread_count()).astype(int)
    bands = [(int(a), int(b)) for a, b in pairwise(edges) if b > a]
    with ThreadPoolExecutor(thread_count(), "unpack") as pool:
        for keys, counts in pool.map(work, bands):
            ends = _named(keys // top, names), _named(keys % top, names)
            for a, b, count in zip(*ends, counts.tolist(), strict=True):
                before = graph.edges[a, b]["weight"] if graph.has_edge(a, b) else 0
                graph.add_edge(a, b, weight=before + count)
    for _, _, data in graph.edges(data=True):
        # Objects that only overlap in depth have no border length, and interfere all the same.
        data["weight"] = max(data["weight"], 1)
    return graph


def checked_layers(ids: ArrayLike, distance: float, layers: int | None) -> NDArray[np.integer]:
    """Return the (L, H, W) layers that count.

    Parameters
    ----------
    ids, distance, layers : see `interference`
        What it was called with.

    Raises
    ------
    ValueError, TypeError
        As `interference` says.
    """
    stack = np.asarray(ids)
    if stack.ndim == 2:
        stack = stack[None]
    if stack.ndim != 3:
        raise ValueError(f"ids must be (L, H, W) or (H, W), got shape {stack.shape}")
    if not np.issubdtype(stack.dtype, np.integer):
        raise TypeError(f"ids must be integers, got {stack.dtype}")
    if stack.size and stack.min() < 0:
        raise ValueError(f"ids must not be negative, got {int(stack.min())}")
    if not (np.isfinite(distance) and distance >= 0):
        raise ValueError(f"distance must be a number of pixels >= 0, got {distance!r}")
    if layers is not None and layers < 1:
        raise ValueError(f"layers must be at least 1, got {layers!r}")
    return stack[:layers]


def _compacted(stack: NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.integer] | None]:
    """Return the stack for the kernels, whose tables have a row an ID, and the IDs' names."""
    if stack.size == 0 or int(stack.max()) < MOST_IDS:
        return np.ascontiguousarray(stack, dtype=np.int32), None
    # Large IDs would make tables by ID too long, so they are numbered for the while.
    names = np.unique(stack)
    if names[0] != 0:
        names = np.concatenate([np.zeros(1, names.dtype), names])
    return np.searchsorted(names, stack).astype(np.int32), names


def _named(rows: NDArray[np.integer], names: NDArray[np.integer] | None) -> list[int]:
    return [int(i) for i in (rows if names is None else names[rows])]


def half_widths(distance: float) -> NDArray[np.int64]:
    """Return the (2 R + 1,) half widths of the rows of a disk, in whole pixels."""
    rows = np.arange(-int(distance), int(distance) + 1)
    # The small surplus keeps a square root of 3.9999999 from losing its pixel.
    return np.floor(np.sqrt(distance**2 - rows**2) + 1e-9).astype(np.int64)


@njit(cache=True, nogil=True)
def _borders(ids, top):  # type: ignore[no-untyped-def]
    """List the border pixels row by row.

    Returns which IDs are present (top,), where every row's list starts (L * H + 1,), and of all
    border pixels the columns and IDs.
    """
    layers, height, width = ids.shape
    present = np.zeros(top, np.bool_)
    starts = np.zeros(layers * height + 1, np.int64)
    columns = np.empty(4096, np.int32)
    labels = np.empty(4096, np.int32)
    found = 0
    for layer in range(layers):
        for row in range(height):
            if found + width > columns.size:
                # Doubling keeps the time that copying takes proportional to what is found.
                room = 2 * (found + width)
                columns = np.concatenate((columns[:found], np.empty(room, np.int32)))
                labels = np.concatenate((labels[:found], np.empty(room, np.int32)))
            here = ids[layer, row]
            above = ids[layer, max(row - 1, 0)]
            below = ids[layer, min(row + 1, height - 1)]
            left = here[0]
            for col in range(width):
                label = here[col]
                right = here[min(col + 1, width - 1)]
                if label != 0 and (
                    left != label or right != label or above[col] != label or below[col] != label
                ):
                    columns[found] = col
                    labels[found] = label
                    found += 1
                if label != left or col == 0:
                    present[label] = True
                left = label
            starts[layer * height + row + 1] = found
    present[0] = False
    return present, starts, columns[:found].copy(), labels[:found].copy()


@njit(cache=True, nogil=True)
def _meet(ids, starts, columns, labels, halves, top, first, last):  # type: ignore[no-untyped-def]
    """Return the keys a * top + b, a < b, of pairs met in a band of rows, and their pixels."""
    layers, height = ids.shape[:2]
    reach = halves.size // 2
    keys = np.full(1024, -1, np.int64)
    counts = np.zeros(1024, np.int64)
    # As variables: numba would compile `_add` and `_overlaps` for each constant anew.
    used, once = np.int64(0), np.int64(1)
    stamps = np.full(top, -1, np.int64)
    stamp = 0
    # Where each row's list has been left behind by the disk, which moves right only.
    behind = np.empty((layers, halves.size), np.int64)
    for layer in range(layers):
        for row in range(first, last):
            keys, counts, used = _overlaps(ids, layer, row, top, keys, counts, used)
            for other_layer in range(layers):
                for k in range(halves.size):
                    r = min(max(row + k - reach, 0), height - 1)
                    behind[other_layer, k] = starts[other_layer * height + r]
            for pixel in range(starts[layer * height + row], starts[layer * height + row + 1]):
                col, label = columns[pixel], labels[pixel]
                stamp += 1
                # A stamp a pixel says what was counted: no list has to be cleared.
                stamps[label] = stamp
                for other_layer in range(layers):
                    other = ids[other_layer, row, col]
                    if other != 0 and stamps[other] != stamp:
                        stamps[other] = stamp
                        # One number a pair, smaller ID first, is quicker to look up than two.
                        pair = min(label, other) * top + max(label, other)
                        keys, counts, used = _add(keys, counts, used, pair, once)
                    for k in range(max(0, reach - row), min(halves.size, height - row + reach)):
                        end = starts[other_layer * height + row + k - reach + 1]
                        near = behind[other_layer, k]
                        while near < end and columns[near] < col - halves[k]:
                            near += 1
                        behind[other_layer, k] = near
                        while near < end and columns[near] <= col + halves[k]:
                            other = labels[near]
                            near += 1
                            if stamps[other] != stamp:
                                stamps[other] = stamp
                                pair = min(label, other) * top + max(label, other)
                                keys, counts, used = _add(keys, counts, used, pair, once)
    met = keys >= 0
    return keys[met], counts[met]


@njit(cache=True, nogil=True)
def _overlaps(ids, layer, row, top, keys, counts, used):  # type: ignore[no-untyped-def]
    """Note the pairs that share a pixel of a row; of overlaps the edge counts, not the area."""
    above = below = 0
    for other_layer in range(layer + 1, ids.shape[0]):
        for col in range(ids.shape[2]):
            label, other = ids[layer, row, col], ids[other_layer, row, col]
            if label != above or other != below:
                above, below = label, other
                if label != 0 and other != 0 and label != other:
                    pair = min(label, other) * top + max(label, other)
                    keys, counts, used = _add(keys, counts, used, pair, np.int64(0))
    return keys, counts, used


@njit(cache=True, nogil=True)
def _add(keys, counts, used, pair, count):  # type: ignore[no-untyped-def]
    """Add to a pair's count in an open-addressing table, which grows when half full."""
    place = _find(keys, pair)
    if keys[place] < 0:
        # Half full at most, so that searches stay short.
        if 2 * (used + 1) > keys.size:
            larger = np.full(2 * keys.size, -1, np.int64)
            moved = np.zeros(2 * keys.size, np.int64)
            for k in range(keys.size):
                if keys[k] >= 0:
                    new = _find(larger, keys[k])
                    larger[new] = keys[k]
                    moved[new] = counts[k]
            keys, counts = larger, moved
            place = _find(keys, pair)
        keys[place] = pair
        used += 1
    counts[place] += count
    return keys, counts, used


@njit(cache=True, nogil=True)
def _find(keys, pair):  # type: ignore[no-untyped-def]
    mask = keys.size - 1
    # Shifted bits mix the smaller ID in, by which alone tables would fill in clusters.
    place = (pair ^ (pair >> 15)) & mask
    while keys[place] >= 0 and keys[place] != pair:
        place = (place + 1) & mask
    return place
