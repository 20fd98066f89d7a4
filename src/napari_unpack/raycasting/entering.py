"""Where the rays of a tile enter and leave the volume, worked out side by side."""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.lattice import FAR, TILE, ray_of, sample_range
from napari_unpack.raycasting.packets import ORDERED

ENTRY, EXIT, SURE = 0, TILE, 2 * TILE
"""Rows of the scratch: the first sample inside, the one after the last, and whether that is so."""

ROWS = 3


@njit(cache=True, nogil=True, error_model="numpy")
def enter_tile(box, planes, table, step, near, first, last, left, right, out):  # type: ignore[no-untyped-def]
    """List the rays of a tile that have samples in a box.

    Parameters
    ----------
    box : (2, 3) ndarray of int64
    planes : (N, 2, 3) ndarray of float64
    table, step, near
        Of `ray_numbers`.
    first, last, left, right : int
        Rows and columns of the tile, at most TILE columns.
    out : (n, 4) ndarray of int64
        Row, column, first sample and the one after the last are written to it; n as many as the
        tile has pixels.

    Returns
    -------
    int
        How many rays have.

    Notes
    -----
    The same as `sample_range` of each ray.
    """
    rays = np.zeros(ROWS * TILE)
    # Without an eye and planes, three samples at either end tell: work for vector units.
    simple = near < -FAR * step and planes.shape[0] == 0 and not table[4:].any()
    number = 0
    for row in range(first, last):
        if simple:
            _enter_row(box, table, step, row, left, rays)
        for i in range(right - left):
            col = left + i
            k, end = np.int64(rays[ENTRY + i]), np.int64(rays[EXIT + i])
            if rays[SURE + i] == 0.0:
                pz, py, px, dz, dy, dx = ray_of(table, row, col)
                k, end = sample_range(box, planes, step, near, 0.5, pz, py, px, dz, dy, dx)
            if k < end:
                out[number, 0], out[number, 1], out[number, 2], out[number, 3] = row, col, k, end
                number += 1
    return number


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED, forceinline=True)
def _enter_row(box, table, step, row, left, rays):  # type: ignore[no-untyped-def]
    z0, y0, x0 = float(box[0, 0]), float(box[0, 1]), float(box[0, 2])
    z1, y1, x1 = float(box[1, 0]), float(box[1, 1]), float(box[1, 2])
    far = FAR * step
    # Without an eye all look one way; the sums are those of `ray_of`, in its order.
    oz, oy, ox = _along(table, 0, row), _along(table, 1, row), _along(table, 2, row)
    rz, ry, rx = table[2, 0], table[2, 1], table[2, 2]
    dz, dy, dx = table[3, 0], table[3, 1], table[3, 2]
    for i in range(TILE):
        col = np.float64(np.int32(left) + np.int32(i))
        pz, py, px = oz + col * rz, oy + col * ry, ox + col * rx
        first, last = _between(z0 - 0.5, z1 - 0.5, pz, dz, -far, far)
        first, last = _between(y0 - 0.5, y1 - 0.5, py, dy, first, last)
        first, last = _between(x0 - 0.5, x1 - 0.5, px, dx, first, last)
        k, end = np.floor(first / step - 0.5) - 1.0, np.ceil(last / step - 0.5) + 2.0
        entry, leave = 4.0 * FAR, -4.0 * FAR
        for late in (2.0, 1.0, 0.0):
            t, back = (k + late + 0.5) * step, (end - late - 0.5) * step
            z, y, x = pz + t * dz + 0.5, py + t * dy + 0.5, px + t * dx + 0.5
            inside = (z0 <= z) & (z < z1) & (y0 <= y) & (y < y1) & (x0 <= x) & (x < x1)
            entry = k + late if inside else entry
            z, y, x = pz + back * dz + 0.5, py + back * dy + 0.5, px + back * dx + 0.5
            inside = (z0 <= z) & (z < z1) & (y0 <= y) & (y < y1) & (x0 <= x) & (x < x1)
            leave = end - late if inside else leave
        missed = first >= last
        rays[ENTRY + i] = 0.0 if missed else entry
        rays[EXIT + i] = 0.0 if missed else leave
        rays[SURE + i] = 1.0 if missed | (entry < leave) else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _along(table, axis, row):  # type: ignore[no-untyped-def]
    return table[0, axis] + row * table[1, axis]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED, forceinline=True)
def _between(low, high, origin, direction, first, last):  # type: ignore[no-untyped-def]
    """See `lattice._slab`; where there is no ray, the last lies before the first."""
    a, b = (low - origin) / direction, (high - origin) / direction
    into, out = (a if a < b else b), (b if a < b else a)
    level, within = direction == 0.0, (low <= origin) & (origin < high)
    into = (first if within else last) if level else into
    out = last if level else out
    return into if into > first else first, out if out < last else last
