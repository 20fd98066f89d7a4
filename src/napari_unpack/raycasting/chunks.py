"""Sixteen samples of a ray at a time: the arithmetic of the tinted picture, for vector units.

The compiler turns loops of constant length over consecutive numbers into vector instructions,
if it can see that they do not overlap. So each kind of number has one flat scratch array, in
which row r holds quantity r of all sixteen samples at [16 r, 16 r + 16).

The gradient is that of the *interpolated* density one voxel to both sides, which equals the
same blend of the voxels' own central differences: it needs 32 voxels instead of 48, eight of
which the density has read already.
"""

from __future__ import annotations

import numpy as np
from numba import njit

LANES = 16
"""Samples of a chunk."""

FLOAT = {"contract", "reassoc", "nsz", "arcp", "nnan"}
"""Liberties the compiler may take with colours; never with positions, which all passes share."""

# Rows of the float scratch.
FZ, FY, FX = 0, LANES, 2 * LANES
PART = 3 * LANES
FACING, STEEP = 4 * LANES, 5 * LANES
FLOAT_ROWS = 6

# Rows of the voxel scratch: four voxels along x through each edge of the cell, then two each
# beside the cell's y faces, then two each beside its z faces.
VOXEL_ROWS = 32


@njit(cache=True, nogil=True, error_model="numpy")
def place(ks, count, phase, step, origin, direction, cells, nearest, f):  # type: ignore[no-untyped-def]
    """Find where samples lie along one axis.

    `ks` (16,) float64. Writes the cell's first voxel and the nearest voxel, (16,) int32, and the
    place in the cell, (16,) float32. Positions are at least -1/2: truncation does for a floor.
    """
    for i in range(count):
        v = origin + (ks[i] + phase) * step * direction
        n = np.int32(v + 1.0) - np.int32(1)
        cells[i] = n
        nearest[i] = np.int32(v + 0.5)
        f[i] = np.float32(v - n)


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def interpolate(v, f, low, scale, top, entries):  # type: ignore[no-untyped-def]
    """Interpolate the density of every sample and look up its place in the transfer function.

    Writes the table's row, at most `top` - 1, to `entries` (16,) int32 and the rest of the way
    to the next row to PART of `f`.
    """
    zero = np.float32(0)
    for i in range(LANES):
        fx, fy = f[FX + i], f[FY + i]
        a = np.float32(v[1 * LANES + i])
        b = np.float32(v[5 * LANES + i])
        c = np.float32(v[9 * LANES + i])
        d = np.float32(v[13 * LANES + i])
        a += fx * (np.float32(v[2 * LANES + i]) - a)
        b += fx * (np.float32(v[6 * LANES + i]) - b)
        c += fx * (np.float32(v[10 * LANES + i]) - c)
        d += fx * (np.float32(v[14 * LANES + i]) - d)
        a += fy * (b - a)
        c += fy * (d - c)
        u = (a + f[FZ + i] * (c - a) - low) * scale
        u = min(max(u, zero), top)
        n = min(np.int32(u), np.int32(top) - np.int32(1))
        entries[i] = n
        f[PART + i] = u - np.float32(n)


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def differentiate(v, f, lz, ly, lx, hz, hy, hx):  # type: ignore[no-untyped-def]
    """Take the gradient of every sample: its part along the light, and its length.

    Writes rows FACING (cosine, 0 to 1) and STEEP of `f`. The light's direction and hz, hy, hx
    take differences between voxels two apart to the world.
    """
    one = np.float32(1)
    for i in range(LANES):
        fz, fy, fx = f[FZ + i], f[FY + i], f[FX + i]
        ez, ey, ex = one - fz, one - fy, one - fx
        w00, w01, w10, w11 = ez * ey, ez * fy, fz * ey, fz * fy
        a1, a2 = np.float32(v[1 * LANES + i]), np.float32(v[2 * LANES + i])
        b1, b2 = np.float32(v[5 * LANES + i]), np.float32(v[6 * LANES + i])
        c1, c2 = np.float32(v[9 * LANES + i]), np.float32(v[10 * LANES + i])
        d1, d2 = np.float32(v[13 * LANES + i]), np.float32(v[14 * LANES + i])
        gx = (
            w00 * (ex * (a2 - np.float32(v[i])) + fx * (np.float32(v[3 * LANES + i]) - a1))
            + w01
            * (ex * (b2 - np.float32(v[4 * LANES + i])) + fx * (np.float32(v[7 * LANES + i]) - b1))
            + w10
            * (ex * (c2 - np.float32(v[8 * LANES + i])) + fx * (np.float32(v[11 * LANES + i]) - c1))
            + w11
            * (
                ex * (d2 - np.float32(v[12 * LANES + i]))
                + fx * (np.float32(v[15 * LANES + i]) - d1)
            )
        )
        a, b = ex * a1 + fx * a2, ex * b1 + fx * b2
        c, d = ex * c1 + fx * c2, ex * d1 + fx * d2
        before = ez * (
            ex * np.float32(v[16 * LANES + i]) + fx * np.float32(v[17 * LANES + i])
        ) + fz * (ex * np.float32(v[18 * LANES + i]) + fx * np.float32(v[19 * LANES + i]))
        after = ez * (
            ex * np.float32(v[20 * LANES + i]) + fx * np.float32(v[21 * LANES + i])
        ) + fz * (ex * np.float32(v[22 * LANES + i]) + fx * np.float32(v[23 * LANES + i]))
        gy = ey * (ez * b + fz * d - before) + fy * (after - (ez * a + fz * c))
        above = ey * (
            ex * np.float32(v[24 * LANES + i]) + fx * np.float32(v[25 * LANES + i])
        ) + fy * (ex * np.float32(v[26 * LANES + i]) + fx * np.float32(v[27 * LANES + i]))
        below = ey * (
            ex * np.float32(v[28 * LANES + i]) + fx * np.float32(v[29 * LANES + i])
        ) + fy * (ex * np.float32(v[30 * LANES + i]) + fx * np.float32(v[31 * LANES + i]))
        gz = ez * (ey * c + fy * d - above) + fz * (below - (ey * a + fy * b))
        gz, gy, gx = gz * hz, gy * hy, gx * hx
        steep = np.sqrt(gz * gz + gy * gy + gx * gx)
        facing = abs(gz * lz + gy * ly + gx * lx) / (steep + np.float32(1e-20))
        f[STEEP + i] = steep
        f[FACING + i] = min(facing, one)


@njit(cache=True, nogil=True)
def read_edge(volume, z, y, x, v, i):  # type: ignore[no-untyped-def]
    """Read all voxels of a cell near the volume's edge, clamped, into lane i of `v`."""
    depth, height, width = volume.shape
    for j in range(32):
        if j < 16:
            dz, dy, dx = j >> 3, (j >> 2) & 1, (j & 3) - 1
        elif j < 24:
            dz, dy, dx = (j >> 1) & 1, -1 if j < 20 else 2, j & 1
        else:
            dz, dy, dx = -1 if j < 28 else 2, (j >> 1) & 1, j & 1
        v[j * LANES + i] = volume[
            min(max(z + dz, 0), depth - 1),
            min(max(y + dy, 0), height - 1),
            min(max(x + dx, 0), width - 1),
        ]


@njit(cache=True, nogil=True, forceinline=True)
def read_cell(flat, at, line, plane, v, i):  # type: ignore[no-untyped-def]
    """Read the eight voxels of a cell, by the flat index of its first, into lane i of `v`."""
    c00, c01 = np.uint64(at), np.uint64(at + line)
    c10, c11 = np.uint64(at + plane), np.uint64(at + plane + line)
    one = np.uint64(1)
    v[1 * LANES + i] = flat[c00]
    v[2 * LANES + i] = flat[c00 + one]
    v[5 * LANES + i] = flat[c01]
    v[6 * LANES + i] = flat[c01 + one]
    v[9 * LANES + i] = flat[c10]
    v[10 * LANES + i] = flat[c10 + one]
    v[13 * LANES + i] = flat[c11]
    v[14 * LANES + i] = flat[c11 + one]


@njit(cache=True, nogil=True, forceinline=True)
def read_around(flat, at, line, plane, v, i):  # type: ignore[no-untyped-def]
    """Read the 24 voxels around a cell that its gradient needs into lane i of `v`."""
    one, two = np.uint64(1), np.uint64(2)
    c = np.uint64(at - 1)
    v[0 * LANES + i] = flat[c]
    v[3 * LANES + i] = flat[c + two + one]
    c = np.uint64(at + line - 1)
    v[4 * LANES + i] = flat[c]
    v[7 * LANES + i] = flat[c + two + one]
    c = np.uint64(at + plane - 1)
    v[8 * LANES + i] = flat[c]
    v[11 * LANES + i] = flat[c + two + one]
    c = np.uint64(at + plane + line - 1)
    v[12 * LANES + i] = flat[c]
    v[15 * LANES + i] = flat[c + two + one]
    c = np.uint64(at - line)
    v[16 * LANES + i] = flat[c]
    v[17 * LANES + i] = flat[c + one]
    c = np.uint64(at + plane - line)
    v[18 * LANES + i] = flat[c]
    v[19 * LANES + i] = flat[c + one]
    c = np.uint64(at + 2 * line)
    v[20 * LANES + i] = flat[c]
    v[21 * LANES + i] = flat[c + one]
    c = np.uint64(at + plane + 2 * line)
    v[22 * LANES + i] = flat[c]
    v[23 * LANES + i] = flat[c + one]
    c = np.uint64(at - plane)
    v[24 * LANES + i] = flat[c]
    v[25 * LANES + i] = flat[c + one]
    c = np.uint64(at - plane + line)
    v[26 * LANES + i] = flat[c]
    v[27 * LANES + i] = flat[c + one]
    c = np.uint64(at + 2 * plane)
    v[28 * LANES + i] = flat[c]
    v[29 * LANES + i] = flat[c + one]
    c = np.uint64(at + 2 * plane + line)
    v[30 * LANES + i] = flat[c]
    v[31 * LANES + i] = flat[c + one]
