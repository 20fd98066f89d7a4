"""Sixteen samples of a ray at a time: the arithmetic of the tinted picture, for vector units.

The compiler turns loops of constant length over consecutive numbers into vector instructions,
if it can see that they do not overlap. So each kind of number has one flat scratch array, in
which row r holds quantity r of all sixteen samples at [16 r, 16 r + 16).

The gradient is that of the *interpolated* density one voxel to both sides, which equals the
same blend of the voxels' own central differences: it needs 32 voxels instead of 48, eight of
which the density has read already. They come in rows along x, four of four and eight of two.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.voxel_loads import copy_pair, copy_quad

LANES = 16
"""Samples of a chunk."""

FLOAT = {"contract", "reassoc", "nsz", "arcp", "nnan"}
"""Liberties the compiler may take with colours; never with positions, which all passes share."""

# Rows of the float scratch.
FZ, FY, FX = 0, LANES, 2 * LANES
PART = 3 * LANES
ALPHA, WEIGHT = 4 * LANES, 5 * LANES
LIGHT, GLOSS = 6 * LANES, 7 * LANES
FLOAT_ROWS = 8

# Rows of the integer scratches: flat indices of a cell's first and of the nearest voxel, and the
# label; the entry of the transfer function and of the highlight, how far inside the volume, and
# the cell's first voxel.
FIRST, NEAREST, LABEL = 0, LANES, 2 * LANES
PLACE_ROWS = 3
ENTRY, SHINE, INNER = 0, LANES, 2 * LANES
CZ, CY, CX = 3 * LANES, 4 * LANES, 5 * LANES
ENTRY_ROWS = 6

# The voxel scratch: four rows of two voxels along x, the cell; then rows of two beside its y
# faces (before: near, far; after: near, far) and beside its z faces (before: upper, lower;
# after: upper, lower); then the cell's four rows again with a voxel more at both ends. A loop
# that read the middle of a row alone would not be vectorised.
PAIR = 2 * LANES
BESIDE = 4 * PAIR
QUADS = 12 * PAIR
QUAD = 4 * LANES
VOXELS = QUADS + 4 * QUAD


@njit(cache=True, nogil=True, error_model="numpy")
def place(  # type: ignore[no-untyped-def]
    ks, phase, step, pz, py, px, dz, dy, dx, deep, high, wide, places, entries, f
):
    """Find where all samples of a chunk lie.

    `ks` (16,) float64. Writes FIRST, NEAREST, CZ, CY, CX, INNER (negative where the voxels
    around the cell are not all inside) and the place in the cell, FZ, FY, FX. Positions are at
    least -1/2: truncation does for a floor.
    """
    line, plane = np.int64(wide), np.int64(wide) * np.int64(high)
    one, three = np.int32(1), np.int32(3)
    deep, high, wide = np.int32(deep), np.int32(high), np.int32(wide)
    for i in range(LANES):
        t = (ks[i] + phase) * step
        z, y, x = pz + t * dz, py + t * dy, px + t * dx
        iz, iy, ix = np.int32(z + 1.0) - one, np.int32(y + 1.0) - one, np.int32(x + 1.0) - one
        f[FZ + i], f[FY + i], f[FX + i] = np.float32(z - iz), np.float32(y - iy), np.float32(x - ix)
        entries[INNER + i] = (
            (iz - one) | (deep - three - iz) | (iy - one) | (high - three - iy)
            | (ix - one) | (wide - three - ix)
        )  # fmt: skip
        entries[CZ + i], entries[CY + i], entries[CX + i] = iz, iy, ix
        places[FIRST + i] = np.int64(iz) * plane + np.int64(iy) * line + np.int64(ix)
        places[NEAREST + i] = (
            np.int64(np.int32(z + 0.5)) * plane
            + np.int64(np.int32(y + 0.5)) * line
            + np.int64(np.int32(x + 0.5))
        )


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def interpolate(v, f, low, scale, top, entries):  # type: ignore[no-untyped-def]
    """Interpolate the density of every sample and look up its place in the transfer function.

    Writes the table's row, at most `top` - 1, to ENTRY of `entries` and the rest of the way to
    the next row to PART of `f`.
    """
    zero, one = np.float32(0), np.float32(1)
    for i in range(LANES):
        fx, fy = f[FX + i], f[FY + i]
        j = 2 * i
        a = np.float32(v[j])
        b = np.float32(v[PAIR + j])
        c = np.float32(v[2 * PAIR + j])
        d = np.float32(v[3 * PAIR + j])
        a += fx * (np.float32(v[j + 1]) - a)
        b += fx * (np.float32(v[PAIR + j + 1]) - b)
        c += fx * (np.float32(v[2 * PAIR + j + 1]) - c)
        d += fx * (np.float32(v[3 * PAIR + j + 1]) - d)
        a += fy * (b - a)
        c += fy * (d - c)
        u = (a + f[FZ + i] * (c - a) - low) * scale
        u = min(max(u, zero), top)
        n = np.int32(min(u, top - one))
        entries[ENTRY + i] = n
        f[PART + i] = u - np.float32(n)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _four(v, j):  # type: ignore[no-untyped-def]
    return np.float32(v[j]), np.float32(v[j + 1]), np.float32(v[j + 2]), np.float32(v[j + 3])


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def light(  # type: ignore[no-untyped-def]
    v, f, lz, ly, lx, hz, hy, hx, steepness, ambient, diffuse, specular, gleam, entries
):
    """Light every sample by its gradient (geometry/shading.py).

    Writes LIGHT, GLOSS (the highlight without its power) and SHINE, where the power is looked
    up. The light's direction and hz, hy, hx take differences between voxels two apart to the
    world.
    """
    one, half = np.float32(1), np.float32(0.5)
    for i in range(LANES):
        fz, fy, fx = f[FZ + i], f[FY + i], f[FX + i]
        ez, ey, ex = one - fz, one - fy, one - fx
        w00, w01, w10, w11 = ez * ey, ez * fy, fz * ey, fz * fy
        j = QUADS + 4 * i
        a0, a1, a2, a3 = _four(v, j)
        b0, b1, b2, b3 = _four(v, j + QUAD)
        c0, c1, c2, c3 = _four(v, j + 2 * QUAD)
        d0, d1, d2, d3 = _four(v, j + 3 * QUAD)
        # Blend the four rows first, then take the difference along x.
        gx = ex * (w00 * (a2 - a0) + w01 * (b2 - b0) + w10 * (c2 - c0) + w11 * (d2 - d0)) + fx * (
            w00 * (a3 - a1) + w01 * (b3 - b1) + w10 * (c3 - c1) + w11 * (d3 - d1)
        )
        a, b = ex * a1 + fx * a2, ex * b1 + fx * b2
        c, d = ex * c1 + fx * c2, ex * d1 + fx * d2
        j = BESIDE + 2 * i
        before = ez * (ex * np.float32(v[j]) + fx * np.float32(v[j + 1])) + fz * (
            ex * np.float32(v[PAIR + j]) + fx * np.float32(v[PAIR + j + 1])
        )
        after = ez * (ex * np.float32(v[2 * PAIR + j]) + fx * np.float32(v[2 * PAIR + j + 1])) + (
            fz * (ex * np.float32(v[3 * PAIR + j]) + fx * np.float32(v[3 * PAIR + j + 1]))
        )
        gy = ey * (ez * b + fz * d - before) + fy * (after - (ez * a + fz * c))
        above = ey * (ex * np.float32(v[4 * PAIR + j]) + fx * np.float32(v[4 * PAIR + j + 1])) + (
            fy * (ex * np.float32(v[5 * PAIR + j]) + fx * np.float32(v[5 * PAIR + j + 1]))
        )
        below = ey * (ex * np.float32(v[6 * PAIR + j]) + fx * np.float32(v[6 * PAIR + j + 1])) + (
            fy * (ex * np.float32(v[7 * PAIR + j]) + fx * np.float32(v[7 * PAIR + j + 1]))
        )
        gz = ez * (ey * c + fy * d - above) + fz * (below - (ey * a + fy * b))
        gz, gy, gx = gz * hz, gy * hy, gx * hx
        steep = np.sqrt(gz * gz + gy * gy + gx * gx)
        facing = min(abs(gz * lz + gy * ly + gx * lx) / (steep + np.float32(1e-20)), one)
        s = min(steep * steepness, one)
        f[LIGHT + i] = ambient + diffuse * (one - s + s * facing)
        f[GLOSS + i] = specular * s
        entries[SHINE + i] = np.int32(facing * gleam + half)


@njit(cache=True, nogil=True, forceinline=True)
def read_cell(flat, at, line, plane, v, i):  # type: ignore[no-untyped-def]
    """Read the four rows of a cell, by the flat index of its first voxel, into lane i of `v`."""
    slot = 2 * i
    copy_pair(flat, at, v, slot)
    copy_pair(flat, at + line, v, slot + PAIR)
    copy_pair(flat, at + plane, v, slot + 2 * PAIR)
    copy_pair(flat, at + plane + line, v, slot + 3 * PAIR)


@njit(cache=True, nogil=True, forceinline=True)
def read_around(flat, at, line, plane, v, i):  # type: ignore[no-untyped-def]
    """Read the rows around a cell that its gradient needs into lane i of `v`."""
    slot = BESIDE + 2 * i
    copy_pair(flat, at - line, v, slot)
    copy_pair(flat, at + plane - line, v, slot + PAIR)
    copy_pair(flat, at + 2 * line, v, slot + 2 * PAIR)
    copy_pair(flat, at + plane + 2 * line, v, slot + 3 * PAIR)
    copy_pair(flat, at - plane, v, slot + 4 * PAIR)
    copy_pair(flat, at - plane + line, v, slot + 5 * PAIR)
    copy_pair(flat, at + 2 * plane, v, slot + 6 * PAIR)
    copy_pair(flat, at + 2 * plane + line, v, slot + 7 * PAIR)
    slot = QUADS + 4 * i
    copy_quad(flat, at - 1, v, slot)
    copy_quad(flat, at + line - 1, v, slot + QUAD)
    copy_quad(flat, at + plane - 1, v, slot + 2 * QUAD)
    copy_quad(flat, at + plane + line - 1, v, slot + 3 * QUAD)


@njit(cache=True, nogil=True)
def _clamped(volume, z, y, x):  # type: ignore[no-untyped-def]
    depth, height, width = volume.shape
    return volume[min(max(z, 0), depth - 1), min(max(y, 0), height - 1), min(max(x, 0), width - 1)]


@njit(cache=True, nogil=True)
def read_edge(volume, z, y, x, v, i):  # type: ignore[no-untyped-def]
    """Read all rows of a cell near the volume's edge, clamped, into lane i of `v`."""
    for j in range(4):
        a, b = j >> 1, j & 1
        for n in range(2):
            near = -1 if a == 0 else 2
            slot = j * PAIR + 2 * i + n
            v[slot] = _clamped(volume, z + a, y + b, x + n)
            v[slot + BESIDE] = _clamped(volume, z + b, y + near, x + n)
            v[slot + 2 * BESIDE] = _clamped(volume, z + near, y + b, x + n)
        for n in range(4):
            v[QUADS + j * QUAD + 4 * i + n] = _clamped(volume, z + a, y + b, x + n - 1)
