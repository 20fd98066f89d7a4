"""The loop of the tinted picture: rays through bricks, samples in chunks, colours front to back.

Rays go tile by tile. Along each, the samples that may be seen are gathered sixteen at a time;
voxels are read one by one, the arithmetic in between is done for all sixteen (chunks.py). The
gradient is read only for samples that add to the picture.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.chunks import (
    FACING,
    FLOAT_ROWS,
    FX,
    FY,
    FZ,
    LANES,
    PART,
    STEEP,
    VOXEL_ROWS,
    differentiate,
    interpolate,
    place,
    read_around,
    read_cell,
    read_edge,
)
from napari_unpack.raycasting.lattice import (
    TILE,
    leap,
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
    volume, labels, numbers, step, near, jitter, planes, distance,
    table, tints, look, exponents, corrected, shine, first_row, last_row, image, depth,
):  # fmt: skip
    """Cast the rows of one band; see `tinted`, which prepares all the numbers."""
    one, zero = np.float32(1), np.float32(0)
    box = np.zeros((2, 3), np.int64)
    deep, high, wide = labels.shape
    box[1, 0], box[1, 1], box[1, 2] = deep, high, wide
    skip = distance.size > 0
    sz, sy, sx, reference = look[2], look[3], look[4], look[5]
    half = np.float32(0.5)
    hz, hy, hx = half * look[11], half * look[12], half * look[13]
    ambient, diffuse, specular, steepness = look[6], look[7], look[8], look[10]
    flat, names = volume.reshape(-1), labels.reshape(-1)
    line, plane = wide, high * wide
    low, scale = look[0], look[1]
    top = np.float32(table.shape[0] - 1)
    gleam = np.float32(shine.shape[0] - 1)
    thicken, finest = corrected.size > 0, np.float32(corrected.shape[1] - 1)
    width = image.shape[1]
    height = last_row - first_row
    ks = np.zeros(LANES)
    entries = np.zeros(LANES, np.int32)
    nz, ny, nx = np.zeros(LANES, np.int32), np.zeros(LANES, np.int32), np.zeros(LANES, np.int32)
    cz, cy, cx = np.zeros(LANES, np.int32), np.zeros(LANES, np.int32), np.zeros(LANES, np.int32)
    f = np.zeros(FLOAT_ROWS * LANES, np.float32)
    fz, fy, fx = f[FZ : FZ + LANES], f[FY : FY + LANES], f[FX : FX + LANES]
    v = np.zeros(VOXEL_ROWS * LANES, volume.dtype)
    opacities = np.zeros(LANES, np.float32)
    weights = np.zeros(LANES, np.float32)
    objects = np.zeros(LANES, np.uint64)
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
            red = green = blue = alpha = zero
            solid = False
            stop = k
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            while k < end:
                # Gather the samples of a chunk, leaping over what cannot be seen.
                count = 0
                while k < end and count < LANES:
                    if k >= stop:
                        stop = end
                        if skip:
                            _, vz, vy, vx = position(k, phase, step, pz, py, px, dz, dy, dx)
                            z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
                            d = distance[z >> 3, y >> 3, x >> 3]
                            stop = min(
                                end, leap(max(d, 1), z, y, x, k, phase, pz, py, px, az, ay, ax)
                            )
                            if d > 0:
                                k = stop
                                continue
                    for _ in range(min(stop - k, LANES - count)):
                        ks[count] = k
                        k += 1
                        count += 1
                if count == 0:
                    break
                for i in range(count, LANES):
                    ks[i] = ks[0]
                place(ks, LANES, phase, step, pz, dz, cz, nz, fz)
                place(ks, LANES, phase, step, py, dy, cy, ny, fy)
                place(ks, LANES, phase, step, px, dx, cx, nx, fx)
                for i in range(count):
                    iz, iy, ix = int(cz[i]), int(cy[i]), int(cx[i])
                    at = iz * plane + iy * line + ix
                    nearest = int(nz[i]) * plane + int(ny[i]) * line + int(nx[i])
                    label = np.uint64(names[np.uint64(nearest)])
                    objects[i] = label
                    opacity = tints[label, 3]
                    opacities[i] = opacity
                    if opacity <= 0:
                        continue
                    if (
                        iz >= 1 and iz < deep - 2 and iy >= 1 and iy < high - 2
                        and ix >= 1 and ix < wide - 2
                    ):  # fmt: skip
                        read_cell(flat, at, line, plane, v, i)
                    else:
                        read_edge(volume, iz, iy, ix, v, i)
                interpolate(v, f, low, scale, top, entries)
                final = 0
                for i in range(count):
                    weights[i] = zero
                    final = i + 1
                    opacity = opacities[i]
                    if opacity <= 0:
                        continue
                    j, part = np.uint64(entries[i]), f[PART + i]
                    a = table[j, 3]
                    a = (a + part * (table[j + np.uint64(1), 3] - a)) * opacity
                    if a <= 0:
                        continue
                    if thicken:
                        u = min(a, one) * finest
                        n = np.uint64(min(u, finest - one))
                        a = corrected[family, n]
                        a += (u - np.float32(n)) * (corrected[family, n + np.uint64(1)] - a)
                    weight = (one - alpha) * a
                    weights[i] = weight
                    alpha += weight
                    if not solid and alpha >= half:
                        solid = True
                        depth[row, col] = (ks[i] + phase) * step
                    iz, iy, ix = int(cz[i]), int(cy[i]), int(cx[i])
                    at = iz * plane + iy * line + ix
                    if (
                        iz >= 1 and iz < deep - 2 and iy >= 1 and iy < high - 2
                        and ix >= 1 and ix < wide - 2
                    ):  # fmt: skip
                        read_around(flat, at, line, plane, v, i)
                    if alpha >= OPAQUE:
                        k = end
                        break
                differentiate(v, f, lz, ly, lx, hz, hy, hx)
                for i in range(final):
                    weight = weights[i]
                    if weight <= 0:
                        continue
                    c = f[FACING + i]
                    s = min(f[STEEP + i] * steepness, one)
                    light = ambient + diffuse * (one - s + s * c)
                    gloss = specular * s * shine[np.uint64(c * gleam + half)]
                    j, part = np.uint64(entries[i]), f[PART + i]
                    n = j + np.uint64(1)
                    label = objects[i]
                    r = (table[j, 0] + part * (table[n, 0] - table[j, 0])) * tints[label, 0]
                    g = (table[j, 1] + part * (table[n, 1] - table[j, 1])) * tints[label, 1]
                    b = (table[j, 2] + part * (table[n, 2] - table[j, 2])) * tints[label, 2]
                    red += weight * min(r * light + gloss, one)
                    green += weight * min(g * light + gloss, one)
                    blue += weight * min(b * light + gloss, one)
            image[row, col, 0] = red
            image[row, col, 1] = green
            image[row, col, 2] = blue
            image[row, col, 3] = alpha
