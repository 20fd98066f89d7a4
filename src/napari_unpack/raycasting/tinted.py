"""The tinted picture: one pass of ray casting with a colour and an opacity an object.

Li et al. 2012, section 4.1: the density is interpolated, the label is not, and the tint of the
label's object multiplies what the master transfer function makes of the density.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import Shading
from napari_unpack.raycasting.bricks import Bricks, Density, leaps
from napari_unpack.raycasting.interpolation import density_at, gradient_at
from napari_unpack.raycasting.lattice import (
    clipping_planes,
    leap,
    ray_numbers,
    ray_of,
    sample_range,
)
from napari_unpack.raycasting.threads import over_bands

OPAQUE = 0.99
"""A ray ends once its alpha reaches this; the GLSL twin stops at the same."""

UNLIT = Shading(ambient=1.0, diffuse=0.0, specular=0.0)
"""No light at all: the transfer function's colours as they are."""


def tinted(
    volume: Density,
    labels: NDArray[np.uint16],
    rays: Rays,
    spacing: ArrayLike,
    table: NDArray[np.float32],
    domain: tuple[float, float],
    tints: NDArray[np.float32],
    shading: Shading | None,
    bricks: Bricks | None = None,
    jitter: bool = False,
    clipping: ArrayLike | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cast a tinted picture.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16 or float32
        Density, C-contiguous, without NaN.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    rays : Rays
        Of the picture, in voxels.
    spacing : (3,) array_like
        Voxel size in mm, z y x.
    table : (K, 4) ndarray of float32
        Transfer function: straight RGB and opacity per voxel (per `min(spacing)` mm), looked up
        linearly over `domain` and clamped.
    domain : (float, float)
        Densities of the first and last row of the table.
    tints : (M, 4) ndarray of float32
        By ID, M above every label: RGB multiplies the colour, alpha the opacity.
    shading : Shading, optional
        The light; None for none.
    bricks : Bricks, optional
        Of this volume and these labels; saves visiting what cannot be seen, changes nothing.
    jitter : bool
        Shift the samples of every ray by a fraction of a step of its own (`phase_of`), which
        trades banding for grain.
    clipping : (N, 2, 3) array_like, optional
        Planes (point, normal) in voxels; what lies behind one is cut away.
    threads : int, optional
        Workers, by default one a core.

    Returns
    -------
    image : (H, W, 4) ndarray of float32
        Premultiplied RGBA.
    depth : (H, W) ndarray of float32
        t in mm where alpha first reaches 0.5, +inf where it never does.

    Notes
    -----
    Opacity is corrected for the length of a step, 1 - (1 - a)^(length / min(spacing)), after
    the tint's alpha is multiplied on. A sample's colour is at most 1 in each channel, highlight
    included. The gradient is the central difference of the interpolated density one voxel to
    both sides, in density per `min(spacing)` mm of world; see `Shading` for the light.
    """
    numbers, step, near = ray_numbers(rays)
    image = np.zeros((*rays.size, 4), np.float32)
    depth = np.full(rays.size, np.inf, np.float32)
    distance = np.zeros((0, 0, 0), np.uint8)
    if bricks is not None:
        distance = leaps(bricks.occupied(table, domain, tints))
    look = _look(spacing, domain, len(table), shading)
    planes = clipping_planes(clipping)
    table = np.ascontiguousarray(table, np.float32)
    tints = np.ascontiguousarray(tints, np.float32)

    def work(_: None, first: int, last: int) -> None:
        _cast(
            volume, labels, numbers, step, near, jitter, planes, distance,
            table, tints, look, first, last, image, depth,
        )  # fmt: skip

    over_bands(rays.size[0], work, lambda: None, threads)
    return image, depth


def _look(
    spacing: ArrayLike, domain: tuple[float, float], entries: int, shading: Shading | None
) -> NDArray[np.float32]:
    # What the kernel needs to know of the transfer function's domain and of the light.
    mm = np.asarray(spacing, dtype=np.float64)
    light = shading or UNLIT
    scale = (entries - 1) / (domain[1] - domain[0])
    floor = max(light.gradient_floor * (domain[1] - domain[0]), 1e-12)
    return np.array(
        [
            domain[0],
            scale,
            *mm,
            mm.min(),
            light.ambient,
            light.diffuse,
            light.specular,
            light.shininess,
            1.0 / floor,
        ],
        np.float32,
    )


@njit(cache=True, nogil=True)
def phase_of(row, col, jitter):  # type: ignore[no-untyped-def]
    """Return where in its step a ray is sampled: 1/2, or, jittered, a hash of the pixel.

    Jimenez's interleaved gradient noise, fract(52.9829189 fract(0.06711056 col + 0.00583715 row)).
    """
    if not jitter:
        return 0.5
    f = (0.06711056 * col + 0.00583715 * row) % 1.0
    return (52.9829189 * f) % 1.0


@njit(cache=True, nogil=True)
def _cast(  # type: ignore[no-untyped-def]
    volume, labels, numbers, step, near, jitter, planes, distance,
    table, tints, look, first_row, last_row, image, depth,
):  # fmt: skip
    one = np.float32(1)
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = distance.size > 0
    lo, scale = look[0], look[1]
    sz, sy, sx, reference = look[2], look[3], look[4], look[5]
    ambient, diffuse, specular, shininess = look[6], look[7], look[8], look[9]
    steepness = look[10]
    top = table.shape[0] - 1
    shaded = diffuse > 0 or specular > 0
    for row in range(first_row, last_row):
        for col in range(image.shape[1]):
            pz, py, px, dz, dy, dx = ray_of(numbers, row, col)
            phase = phase_of(row, col, jitter)
            k, end = sample_range(box, planes, step, near, phase, pz, py, px, dz, dy, dx)
            if k >= end:
                continue
            wz, wy, wx = dz * sz, dy * sy, dx * sx
            speed = np.sqrt(wz * wz + wy * wy + wx * wx)
            exponent = np.float32(speed * step / reference)
            lz, ly, lx = np.float32(wz / speed), np.float32(wy / speed), np.float32(wx / speed)
            red = green = blue = alpha = np.float32(0)
            free = k
            while k < end:
                t = (k + phase) * step
                vz, vy, vx = pz + t * dz, py + t * dy, px + t * dx
                z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
                if skip and k >= free:
                    d = distance[z >> 3, y >> 3, x >> 3]
                    free = leap(max(d, 1), z, y, x, k, step, phase, pz, py, px, dz, dy, dx)
                    if d > 0:
                        k = free
                        continue
                k += 1
                tint = tints[labels[z, y, x]]
                if tint[3] <= 0:
                    continue
                u = (density_at(volume, vz, vy, vx) - lo) * scale
                u = min(max(u, np.float32(0)), np.float32(top))
                i = min(int(u), top - 1)
                f = u - np.float32(i)
                e = one - f
                a = (e * table[i, 3] + f * table[i + 1, 3]) * tint[3]
                if a <= 0:
                    continue
                if exponent != one:
                    a = one - (one - min(a, one)) ** exponent
                light = ambient + diffuse
                highlight = np.float32(0)
                if shaded:
                    gz, gy, gx = gradient_at(volume, vz, vy, vx)
                    gz, gy, gx = gz * reference / sz, gy * reference / sy, gx * reference / sx
                    steep = np.sqrt(gz * gz + gy * gy + gx * gx)
                    if steep > 0:
                        c = min(abs(gz * lz + gy * ly + gx * lx) / steep, one)
                        s = min(steep * steepness, one)
                        light = ambient + diffuse * (one - s + s * c)
                        highlight = specular * s * c**shininess
                weight = (one - alpha) * a
                r = (e * table[i, 0] + f * table[i + 1, 0]) * tint[0] * light + highlight
                g = (e * table[i, 1] + f * table[i + 1, 1]) * tint[1] * light + highlight
                b = (e * table[i, 2] + f * table[i + 1, 2]) * tint[2] * light + highlight
                red += weight * min(r, one)
                green += weight * min(g, one)
                blue += weight * min(b, one)
                before = alpha
                alpha += weight
                if before < 0.5 and alpha >= 0.5:
                    depth[row, col] = t
                if alpha >= OPAQUE:
                    break
            image[row, col, 0] = red
            image[row, col, 1] = green
            image[row, col, 2] = blue
            image[row, col, 3] = alpha
