"""The runs of one label along a ray: the march of every pass that looks at labels alone.

Where all bricks around belong to one owner the ray leaps over them; elsewhere sixteen labels are
read at a time, which costs less than asking every brick on the way.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.lattice import BRICK, leap, per_voxel, position

CHUNK = 16
"""Labels read at a time; also the most runs that `next_runs` finds."""

WORTH_A_LEAP = 2
"""Distance to another owner, in bricks, from which on a leap is cheaper than looking."""


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def next_runs(  # type: ignore[no-untyped-def]
    flat, shape, owners, distance, step, k, end, pz, py, px, dz, dy, dx, places, names, counts
):
    """Find the next runs of a ray from sample k on; return (next k, how many runs).

    Parameters
    ----------
    flat, shape : (n,) ndarray of uint16 and its (Z, Y, X)
        The labels.
    owners, distance : (Bz, By, Bx) ndarrays
        From `Bricks.owners` and `strides`; empty to look at every sample.
    step, k, end, pz, py, px, dz, dy, dx
        The ray and its samples left, k < end.
    places : (16,) ndarray of int64
        Scratch.
    names, counts : (16,) ndarrays of int64
        Written: label and samples of each run. The first may continue the run before.
    """
    if distance.size > 0:
        _, vz, vy, vx = position(k, 0.5, step, pz, py, px, dz, dy, dx)
        z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
        b, r, c = np.uint64(z // BRICK), np.uint64(y // BRICK), np.uint64(x // BRICK)
        d = distance[b, r, c]
        if d >= WORTH_A_LEAP:
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            free = min(end, leap(d, z, y, x, k, 0.5, pz, py, px, az, ay, ax))
            names[0] = owners[b, r, c]
            counts[0] = free - k
            return free, 1
    high, wide = shape[1], shape[2]
    first, last = float(k), float(end - 1)
    for i in range(CHUNK):
        t = (min(first + i, last) + 0.5) * step
        places[i] = (
            np.int64(pz + t * dz + 0.5) * high + np.int64(py + t * dy + 0.5)
        ) * wide + np.int64(px + t * dx + 0.5)
    for i in range(CHUNK):
        places[i] = flat[np.uint64(places[i])]
    label = places[0]
    other = np.int64(0)
    for i in range(CHUNK):
        other |= places[i] ^ label
    names[0] = label
    count = min(end - k, CHUNK)
    counts[0] = count
    if other == 0:
        return k + count, 1
    found, began = 0, 0
    for i in range(1, count):
        if places[i] != label:
            label = places[i]
            counts[found] = i - began
            began = i
            found += 1
            names[found] = label
    counts[found] = count - began
    return k + count, found + 1
