"""A chunk of samples, of whatever rays: read, lit and laid over their pixels.

The gradient is that of the *interpolated* density one voxel to both sides, which equals the
same blend of the voxels' own central differences, as blocks hold them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.lanes import (
    AT,
    DEPTH,
    END,
    FX,
    FY,
    FZ,
    LABEL,
    LANE,
    LX,
    LY,
    LZ,
    PIXEL,
)
from napari_unpack.raycasting.vectors import LANES, blend_cell, lay_over, look_up

OPAQUE = 0.99
"""A ray ends once its alpha reaches this; the GLSL twin stops at the same."""

FLOAT = {"contract", "reassoc", "nsz", "arcp", "nnan"}
"""Liberties the compiler may take with colours; never with positions, which all passes share."""

# Rows of a chunk: the way from one entry of the transfer function to the next, light, highlight
# without its power, the way from one entry of the power to the next; both entries.
PART, LIGHT, GLOSS, REST = 0, LANES, 2 * LANES, 3 * LANES
FLOAT_ROWS = 4
ENTRY, SHINE = 0, LANES
ENTRY_ROWS = 2


@njit(cache=True, nogil=True, error_model="numpy")
def _blend(cells, names, queue, at, v):  # type: ignore[no-untyped-def]
    for i in range(LANES):
        q = np.uint64(at + i)
        blend_cell(
            cells, np.uint64(names[np.uint64(AT) + q]), queue[np.uint64(FZ) + q],
            queue[np.uint64(FY) + q], queue[np.uint64(FX) + q], v, np.uint64(i),
        )  # fmt: skip


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def _light(  # type: ignore[no-untyped-def]
    v, queue, at, f, low, scale, top, hz, hy, hx, steepness, ambient, diffuse, specular, gleam,
    entries,
):  # fmt: skip
    """Find every sample's place in the transfer function, and light it (geometry/shading.py).

    `v` holds density and differences, one sample after the other; hz, hy, hx take differences
    between voxels two apart to the world. Writes all rows of `f` and `entries`; entries are from
    0 to `top` - 1 and `gleam` - 1, of samples that are no numbers too.
    """
    zero, one = np.float32(0), np.float32(1)
    last, sharpest = np.int32(top - one), np.int32(gleam - one)
    for i in range(LANES):
        u = (v[4 * i] - low) * scale
        u = min(max(u, zero), top)
        n = min(max(np.int32(u), np.int32(0)), last)
        entries[ENTRY + i] = n
        f[PART + i] = u - np.float32(n)
        gz, gy, gx = v[4 * i + 1] * hz, v[4 * i + 2] * hy, v[4 * i + 3] * hx
        steep = np.sqrt(gz * gz + gy * gy + gx * gx)
        q = np.uint64(at) + np.uint64(i)
        along = gz * queue[np.uint64(LZ) + q] + gy * queue[np.uint64(LY) + q]
        along += gx * queue[np.uint64(LX) + q]
        facing = min(abs(along) / (steep + np.float32(1e-20)), one)
        s = min(steep * steepness, one)
        f[LIGHT + i] = ambient + diffuse * (one - s + s * facing)
        f[GLOSS + i] = specular * s
        u = facing * gleam
        n = min(max(np.int32(u), np.int32(0)), sharpest)
        entries[SHINE + i] = n
        f[REST + i] = u - np.float32(n)


@njit(cache=True, nogil=True, error_model="numpy")
def _color(table, tints, names, at, f, entries, colors):  # type: ignore[no-untyped-def]
    for i in range(LANES):
        look_up(
            table, np.uint64(entries[ENTRY + i]), f[PART + i], tints,
            np.uint64(names[np.uint64(LABEL) + np.uint64(at + i)]), colors, np.uint64(i),
        )  # fmt: skip


# Inlined, because numba counts references to arrays that are handed to a function with errors.
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def shade(  # type: ignore[no-untyped-def]
    at, count, cells, table, tints, look, corrected, families, shine, queue, names,
    v, f, entries, colors, picture, depth, rays, pixels,
):  # fmt: skip
    """Light the first samples of the chunk that begins at `at` of the queue and lay them over.

    Whoever has become opaque comes to the end of its ray; returns whether anybody has.
    """
    zero, one, half, opaque = np.float32(0), np.float32(1), np.float32(0.5), np.float32(OPAQUE)
    thicken, finest = corrected.size > 0, np.float32(corrected.shape[1] - 1)
    top, gleam = np.float32(table.size // 4 - 1), np.float32(shine.shape[0] - 1)
    _blend(cells, names, queue, at, v)
    _light(
        v, queue, at, f, look[0], look[1], top, half * look[11], half * look[12], half * look[13],
        look[10], look[6], look[7], look[8], gleam, entries,
    )  # fmt: skip
    _color(table, tints, names, at, f, entries, colors)
    ended = False
    for i in range(count):
        # Not a number where the volume has been written to since it was looked over.
        a = colors[4 * i + 3]
        a = min(a if a > zero else zero, one)
        p = np.uint64(names[np.uint64(PIXEL + at + i)])
        if thicken:
            u = a * finest
            n = np.uint64(min(u, finest - one))
            family = np.uint64(families[p])
            a = corrected[family, n]
            a += (u - np.float32(n)) * (corrected[family, n + np.uint64(1)] - a)
        alpha = picture[np.uint64(4) * p + np.uint64(3)]
        if alpha >= opaque:
            continue
        weight = (one - alpha) * a
        after = alpha + weight
        if after >= opaque:
            lane = np.uint64(names[np.uint64(LANE + at + i)])
            if np.int64(pixels[lane]) == np.int64(p):
                rays[np.uint64(END) + lane] = -np.inf
                ended = True
        if (alpha < half) & (after >= half):
            depth[p] = queue[np.uint64(DEPTH + at + i)]
        j = np.uint64(entries[SHINE + i])
        gloss = shine[j]
        gloss = f[GLOSS + i] * (gloss + f[REST + i] * (shine[j + np.uint64(1)] - gloss))
        lay_over(picture, p, weight, colors, np.uint64(i), f[LIGHT + i], gloss)
    return ended
