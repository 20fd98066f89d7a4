"""The walk of the ID passes along a ray: over what is alike at once, else label by label."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.raycasting.bricks import Bricks
from napari_unpack.raycasting.corridors import Corridors
from napari_unpack.raycasting.lattice import leap, leap_along, position

AHEAD = 16
"""Labels that are read together: those of a brick, but for rays of very short steps."""


def ground(
    labels: NDArray[np.uint16], bricks: Bricks | None, visible: NDArray[np.bool_], rays: Rays
) -> tuple[Any, ...]:
    """Return what `stretch` walks over, in the order in which it takes it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    bricks : Bricks, optional
        Of these labels. Without them every sample is looked at.
    visible : (M,) ndarray of bool
        By ID; the background is not visible.
    rays : Rays
        Of the picture.

    Returns
    -------
    tuple
        Labels, owners, reach, slots, axis (`Corridors`), starts, ids (`Bricks`), words, first,
        bits (`PackedLabels`); empty but for the labels where there are no bricks.
    """
    if bricks is None:
        none = Corridors.none()
        long, short = np.zeros(0, np.int64), np.zeros(0, np.uint8)
        return (
            labels, np.zeros((0, 0, 0), np.int32), none.grids, none.slots, none.axis,
            long, np.zeros(0, np.uint16), np.zeros(0, np.uint64), long, short,
        )  # fmt: skip
    owners = bricks.owners(visible)
    ahead, packed = Corridors.of(owners, rays), bricks.packed(labels)
    return (
        labels, owners, ahead.grids, ahead.slots, ahead.axis,
        bricks.starts, bricks.ids, packed.words, packed.first, packed.bits,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def outlook(  # type: ignore[no-untyped-def]
    owners, reach, grid, axis, k, step, pz, py, px, dz, dy, dx, az, ay, ax
):
    """Look at the bricks that lie at sample k and from there on.

    `grid` is the one of `reach` that serves the ray, az, ay, ax are `per_voxel`. Returns whose
    they are (0 nobody's that is visible, -1 the brick is mixed), the first sample that may lie
    elsewhere, and the brick.
    """
    _, vz, vy, vx = position(k, 0.5, step, pz, py, px, dz, dy, dx)
    z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
    bz, by, bx = np.uint64(z >> 3), np.uint64(y >> 3), np.uint64(x >> 3)
    own = int(owners[bz, by, bx])
    layers = int(reach[grid, bz, by, bx])
    if axis >= 0 and layers > 1:
        if axis == 0:
            free = leap_along(layers - 1, z, k, 0.5, pz, az)
        elif axis == 1:
            free = leap_along(layers - 1, y, k, 0.5, py, ay)
        else:
            free = leap_along(layers - 1, x, k, 0.5, px, ax)
    else:
        free = leap(max(layers, 1), z, y, x, k, 0.5, pz, py, px, az, ay, ax)
    rows, columns = np.uint64(owners.shape[1]), np.uint64(owners.shape[2])
    return own, free, (bz * rows + by) * columns + bx


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def read_packed(  # type: ignore[no-untyped-def]
    words, place, shift, ids, start, k, free, step, pz, py, px, dz, dy, dx, ahead
):
    """Read the labels of samples k to `free` - 1, all in one brick, into `ahead` (AHEAD,) int64.

    `place` and `shift` are the brick's `PackedLabels.first` and `bits`, `start` its
    `Bricks.starts`.
    """
    seven, six = np.int64(7), np.uint64(6)
    mask = np.uint64((np.int64(1) << (np.int64(1) << shift)) - 1)
    at = float(k)
    for i in range(AHEAD):
        t = (at + i + 0.5) * step
        z = np.int64(pz + t * dz + 0.5) & seven
        y = np.int64(py + t * dy + 0.5) & seven
        # All those wanted are in the brick; for the others any voxel of it will do.
        ahead[i] = ((z << 6) | (y << 3) | (np.int64(px + t * dx + 0.5) & seven)) << shift
    for i in range(free - k):
        bit = np.uint64(ahead[i])
        number = (words[place + (bit >> six)] >> (bit & np.uint64(63))) & mask
        ahead[i] = np.int64(ids[start + number])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def read_labels(flat, high, wide, k, free, step, pz, py, px, dz, dy, dx, ahead):  # type: ignore[no-untyped-def]
    """Read the labels of samples k to `free` - 1 into `ahead` (AHEAD,) int64.

    All at once: most of them miss the cache, and so they miss it together.
    """
    first, last = float(k), float(free - 1)
    for i in range(AHEAD):
        t = (min(first + i, last) + 0.5) * step
        plane, line = np.int64(pz + t * dz + 0.5), np.int64(py + t * dy + 0.5)
        ahead[i] = (plane * high + line) * wide + np.int64(px + t * dx + 0.5)
    for i in range(AHEAD):
        ahead[i] = np.int64(flat[np.uint64(ahead[i])])
