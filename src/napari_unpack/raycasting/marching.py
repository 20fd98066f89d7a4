"""The loop of the tinted picture: rays through bricks, samples in chunks, colours front to back.

Rays go tile by tile. Along each, the samples that may be seen are gathered sixteen at a time;
voxels are read row by row, the arithmetic in between is done for all sixteen (chunks.py). The
gradient is read only for samples that add to the picture.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.chunks import (
    ALPHA,
    CX,
    CY,
    CZ,
    ENTRY,
    ENTRY_ROWS,
    FIRST,
    FLOAT_ROWS,
    GLOSS,
    INNER,
    LABEL,
    LANES,
    LIGHT,
    NEAREST,
    PART,
    PLACE_ROWS,
    SHINE,
    VOXELS,
    WEIGHT,
    interpolate,
    light,
    place,
    read_around,
    read_cell,
    read_edge,
)
from napari_unpack.raycasting.lattice import (
    TILE,
    leap,
    octant_of,
    per_voxel,
    position,
    ray_of,
    sample_range,
)
from napari_unpack.raycasting.opacity import family_of

OPAQUE = 0.99
"""A ray ends once its alpha reaches this; the GLSL twin stops at the same."""


@njit(cache=True, nogil=True, forceinline=True)
def phase_of(row, col, jitter):  # type: ignore[no-untyped-def]
    """Return where in its step a ray is sampled: 1/2, or, jittered, a hash of the pixel.

    Jimenez's interleaved gradient noise, fract(52.9829189 fract(0.06711056 col + 0.00583715 row)).
    """
    if not jitter:
        return 0.5
    f = (0.06711056 * col + 0.00583715 * row) % 1.0
    return (52.9829189 * f) % 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def march(  # type: ignore[no-untyped-def]
    volume, labels, numbers, step, near, jitter, planes, reach, slots, full,
    table, opacity, tints, look, exponents, corrected, shine, first_row, last_row, image, depth,
):  # fmt: skip
    """Cast the rows of one band; see `tinted`, which prepares all the numbers."""
    one, zero = np.float32(1), np.float32(0)
    box = np.zeros((2, 3), np.int64)
    deep, high, wide = labels.shape
    box[1, 0], box[1, 1], box[1, 2] = deep, high, wide
    skip = reach.size > 0
    sz, sy, sx, reference = look[2], look[3], look[4], look[5]
    half = np.float32(0.5)
    hz, hy, hx = half * look[11], half * look[12], half * look[13]
    ambient, diffuse, specular, steepness = look[6], look[7], look[8], look[10]
    lit = diffuse > zero or specular > zero
    flat, names = volume.reshape(-1), labels.reshape(-1)
    line, plane = wide, high * wide
    low, scale = look[0], look[1]
    top = np.float32(table.shape[0] - 1)
    gleam = np.float32(shine.shape[0] - 1)
    clear = np.float32(1 - OPAQUE)
    thicken, finest = corrected.size > 0, np.float32(corrected.shape[1] - 1)
    width = image.shape[1]
    height = last_row - first_row
    ks = np.zeros(LANES)
    places = np.zeros(PLACE_ROWS * LANES, np.int64)
    entries = np.zeros(ENTRY_ROWS * LANES, np.int32)
    f = np.zeros(FLOAT_ROWS * LANES, np.float32)
    v = np.zeros(VOXELS, volume.dtype)
    f[LIGHT : LIGHT + LANES] = ambient + diffuse
    for tile in range(0, width, TILE):
        columns = min(TILE, width - tile)
        for pixel in range(height * columns):
            row = first_row + pixel // columns
            col = tile + pixel % columns
            pz, py, px, dz, dy, dx = ray_of(numbers, row, col)
            phase = phase_of(row, col, jitter)
            k, end = sample_range(box, planes, step, near, phase, pz, py, px, dz, dy, dx)
            if k >= end:
                continue
            wz, wy, wx = dz * sz, dy * sy, dx * sx
            speed = np.sqrt(wz * wz + wy * wy + wx * wx)
            family = np.uint64(0)
            if thicken:
                family = family_of(speed * step / reference, exponents)
            lz, ly, lx = np.float32(wz / speed), np.float32(wy / speed), np.float32(wx / speed)
            red = green = blue = zero
            through = one
            solid = False
            stop = k
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            grid = slots[octant_of(az, ay, ax)]
            while k < end:
                # Gather the samples of a chunk, leaping over what cannot be seen.
                count = 0
                while k < end and count < LANES:
                    if k >= stop:
                        stop = end
                        if skip:
                            _, vz, vy, vx = position(k, phase, step, pz, py, px, dz, dy, dx)
                            z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
                            b, r, c = np.uint64(z >> 3), np.uint64(y >> 3), np.uint64(x >> 3)
                            d = reach[grid, b, r, c]
                            stop = min(end, leap(d, z, y, x, k, phase, pz, py, px, az, ay, ax))
                            if not full[b, r, c]:
                                k = stop
                                continue
                    more = min(stop - k, LANES - count)
                    for i in range(more):
                        ks[count + i] = k + i
                    k += more
                    count += more
                if count == 0:
                    break
                for i in range(count, LANES):
                    ks[i] = ks[0]
                place(ks, phase, step, pz, py, px, dz, dy, dx, deep, high, wide, places, entries, f)
                for i in range(LANES):
                    label = np.uint64(names[np.uint64(places[NEAREST + i])])
                    places[LABEL + i] = np.int64(label)
                    f[ALPHA + i] = tints[label, 3]
                seen = False
                for i in range(count):
                    if f[ALPHA + i] <= zero:
                        continue
                    seen = True
                    if entries[INNER + i] >= 0:
                        read_cell(flat, places[FIRST + i], line, plane, v, i)
                    else:
                        read_edge(volume, entries[CZ + i], entries[CY + i], entries[CX + i], v, i)
                if not seen:
                    continue
                interpolate(v, f, low, scale, top, entries)
                for i in range(LANES):
                    j = np.uint64(entries[ENTRY + i])
                    a = opacity[j]
                    a += f[PART + i] * (opacity[j + np.uint64(1)] - a)
                    f[ALPHA + i] = min(a * f[ALPHA + i], one)
                if thicken:
                    for i in range(count):
                        u = f[ALPHA + i] * finest
                        n = np.uint64(min(u, finest - one))
                        a = corrected[family, n]
                        a += (u - np.float32(n)) * (corrected[family, n + np.uint64(1)] - a)
                        f[ALPHA + i] = a
                final = 0
                for i in range(count):
                    weight = through * f[ALPHA + i]
                    f[WEIGHT + i] = weight
                    through -= weight
                    final = i + 1
                    if not solid and through <= half:
                        solid = True
                        depth[row, col] = (ks[i] + phase) * step
                    if through <= clear:
                        k = end
                        break
                if lit:
                    for i in range(final):
                        if f[WEIGHT + i] > zero and entries[INNER + i] >= 0:
                            read_around(flat, places[FIRST + i], line, plane, v, i)
                    light(
                        v, f, lz, ly, lx, hz, hy, hx,
                        steepness, ambient, diffuse, specular, gleam, entries,
                    )  # fmt: skip
                for i in range(final):
                    weight = f[WEIGHT + i]
                    if weight <= zero:
                        continue
                    bright = f[LIGHT + i]
                    gloss = f[GLOSS + i] * shine[np.uint64(entries[SHINE + i])]
                    j, part = np.uint64(entries[ENTRY + i]), f[PART + i]
                    n = j + np.uint64(1)
                    label = np.uint64(places[LABEL + i])
                    r = (table[j, 0] + part * (table[n, 0] - table[j, 0])) * tints[label, 0]
                    g = (table[j, 1] + part * (table[n, 1] - table[j, 1])) * tints[label, 1]
                    b = (table[j, 2] + part * (table[n, 2] - table[j, 2])) * tints[label, 2]
                    red += weight * min(r * bright + gloss, one)
                    green += weight * min(g * bright + gloss, one)
                    blue += weight * min(b * bright + gloss, one)
            image[row, col, 0] = red
            image[row, col, 1] = green
            image[row, col, 2] = blue
            image[row, col, 3] = one - through
