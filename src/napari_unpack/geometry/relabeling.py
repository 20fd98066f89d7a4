"""Relabeling: labels of any integers as uint16, and the way back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

# As many as uint16 tells apart from the background.
MOST_OBJECTS = 65_535
# A quarter full at most, so that a search ends after one or two places.
_SLOTS = 1 << 18


def compact_labels(labels: NDArray[np.integer]) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
    """Number the objects of a label volume 1, 2, 3 ... in the order of their IDs.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
        Object IDs, 0 background, from 0 to below 2**63.

    Returns
    -------
    compact : (Z, Y, X) ndarray of uint16
        C-contiguous.
    ids : (N + 1,) ndarray of int64
        The given ID of every compact one, ascending; `ids[0]` is 0.

    Raises
    ------
    ValueError
        If there are more than 65,535 objects.

    Notes
    -----
    Two passes over the voxels and a hash table of the IDs: linear in the voxels, whatever the
    largest ID. Only the IDs found are sorted.
    """
    # Files may hold bytes in an order that kernels do not read.
    labels = labels.astype(labels.dtype.newbyteorder("="), copy=False)
    keys = np.full(_SLOTS, -1, np.int64)
    if _gather(labels, keys, MOST_OBJECTS) > MOST_OBJECTS:
        raise ValueError(f"labels must hold at most {MOST_OBJECTS:,} objects, got more")
    used = np.flatnonzero(keys >= 0)
    # Ascending, so that the order of objects stays what it was.
    order = used[np.argsort(keys[used])]
    numbers = np.zeros(_SLOTS, np.uint16)
    numbers[order] = np.arange(1, len(order) + 1)
    compact = np.empty(labels.shape, np.uint16)
    _number(labels, keys, numbers, compact)
    return compact, np.concatenate([np.zeros(1, np.int64), keys[order]])


def numbered(kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return by label, (M,), the numbers 1, 2, ... of those that are kept, 0 of all others."""
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)


@njit(cache=True, nogil=True, inline="always")
def _slot(keys, label):  # type: ignore[no-untyped-def]
    """Return where a label stands or may be put: linear probing after Fibonacci hashing."""
    mask = np.int64(len(keys) - 1)
    # Multiplication by 2^64 over the golden ratio spreads neighbouring IDs (Knuth 6.4).
    at = np.int64((np.uint64(label) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) & mask
    while keys[at] != label and keys[at] != -1:
        at = (at + 1) & mask
    return at


@njit(cache=True, nogil=True)
def _gather(labels, keys, most):  # type: ignore[no-untyped-def]
    found = 0
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            # Neighbours along x mostly share a label, which spares the search.
            last = np.int64(0)
            for x in range(labels.shape[2]):
                label = np.int64(labels[z, y, x])
                if label == last:
                    continue
                last = label
                if label == 0:
                    continue
                at = _slot(keys, label)
                if keys[at] == -1:
                    found += 1
                    if found > most:
                        return found
                    keys[at] = label
    return found


@njit(cache=True, nogil=True)
def _number(labels, keys, numbers, out):  # type: ignore[no-untyped-def]
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            # As above: the number found last serves until the label changes.
            last, number = np.int64(0), np.uint16(0)
            for x in range(labels.shape[2]):
                label = np.int64(labels[z, y, x])
                if label != last:
                    last = label
                    number = np.uint16(0)
                    if label != 0:
                        number = numbers[_slot(keys, label)]
                out[z, y, x] = number
