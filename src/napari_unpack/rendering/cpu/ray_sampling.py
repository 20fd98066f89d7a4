"""Samples of rays inside a box, for every kernel alike, and trilinear density at one point.

Sample k lies at t = (k + 1/2) step on every ray. Positions are computed afresh from k, never
by adding steps, so that skipping some samples cannot move the others by a rounding error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.ray_packets import ORDERED


@njit(cache=True, nogil=True, error_model="numpy")
def density_at(volume, z, y, x):  # type: ignore[no-untyped-def]
    """Interpolate the density at any point, in voxels; float32.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
    z, y, x : float
        Voxels.
    """
    iz, iy, ix = np.int64(np.floor(z)), np.int64(np.floor(y)), np.int64(np.floor(x))
    fz, fy, fx = np.float32(z - iz), np.float32(y - iy), np.float32(x - ix)
    bottom, right, back = volume.shape[1] - 1, volume.shape[2] - 1, volume.shape[0] - 1
    z0, z1 = min(max(iz, 0), back), min(max(iz + 1, 0), back)
    y0, y1 = min(max(iy, 0), bottom), min(max(iy + 1, 0), bottom)
    x0, x1 = min(max(ix, 0), right), min(max(ix + 1, 0), right)
    ez, ey, ex = np.float32(1) - fz, np.float32(1) - fy, np.float32(1) - fx
    near = ey * (ex * np.float32(volume[z0, y0, x0]) + fx * np.float32(volume[z0, y0, x1])) + fy * (
        ex * np.float32(volume[z0, y1, x0]) + fx * np.float32(volume[z0, y1, x1])
    )
    far = ey * (ex * np.float32(volume[z1, y0, x0]) + fx * np.float32(volume[z1, y0, x1])) + fy * (
        ex * np.float32(volume[z1, y1, x0]) + fx * np.float32(volume[z1, y1, x1])
    )
    return ez * near + fz * far


# No ray has more samples than this on either side of the pivot plane.
FAR = 1.0e9
# Voxels along the edge of a brick (bricks.py).
BRICK = 8
# Pixels along the edge of a tile: the voxels behind one stay in the processor's cache.
TILE = 32


def clipping_planes(clipping: ArrayLike | None) -> NDArray[np.float64]:
    """Return clipping planes as an (N, 2, 3) array of (point, normal), voxels.

    Raises
    ------
    ValueError
        If the shape is another.
    """
    if clipping is None:
        return np.zeros((0, 2, 3))
    planes = np.ascontiguousarray(clipping, dtype=np.float64)
    if planes.ndim != 3 or planes.shape[1:] != (2, 3):
        raise ValueError(
            f"clipping must be (N, 2, 3): a point and a normal a plane, got {planes.shape}"
        )
    return planes


def band_of(height: int) -> int:
    """Return how many rows one band of an image has: a row of tiles, fewer in small images."""
    return max(4, min(TILE, -(-height // 32)))


def ray_numbers(rays: Rays) -> tuple[NDArray[np.float64], float, float]:
    """Return what kernels need of rays: table, step, near."""
    return np.ascontiguousarray(rays.table, dtype=np.float64), rays.step, rays.near


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ray_of(table, row, col):  # type: ignore[no-untyped-def]
    """Return the origin and direction of one pixel's ray, voxels and voxels per mm.

    Parameters
    ----------
    table : (6, 3) ndarray of float64
        `Rays.table`.
    row, col : int
        Pixel.
    """
    return (
        table[0, 0] + row * table[1, 0] + col * table[2, 0],
        table[0, 1] + row * table[1, 1] + col * table[2, 1],
        table[0, 2] + row * table[1, 2] + col * table[2, 2],
        table[3, 0] + row * table[4, 0] + col * table[5, 0],
        table[3, 1] + row * table[4, 1] + col * table[5, 1],
        table[3, 2] + row * table[4, 2] + col * table[5, 2],
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def position(k, phase, step, pz, py, px, dz, dy, dx):  # type: ignore[no-untyped-def]
    """Return t and the position of sample k; every kernel and `sample_range` agree to the bit.

    Parameters
    ----------
    k, phase, step : float
        Number of the sample, where in its step it lies, and the step, mm.
    pz, py, px, dz, dy, dx : float
        The ray, voxels.
    """
    t = (k + phase) * step
    return t, pz + t * dz, py + t * dy, px + t * dx


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _slab(low, high, origin, direction, first, last):  # type: ignore[no-untyped-def]
    if direction == 0.0:
        if origin < low or origin >= high:
            return first, first
        return first, last
    a = (low - origin) / direction
    b = (high - origin) / direction
    return max(first, min(a, b)), min(last, max(a, b))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _inside(box, pz, py, px, dz, dy, dx, t):  # type: ignore[no-untyped-def]
    z = np.floor(pz + t * dz + 0.5)
    y = np.floor(py + t * dy + 0.5)
    x = np.floor(px + t * dx + 0.5)
    return box[0, 0] <= z < box[1, 0] and box[0, 1] <= y < box[1, 1] and box[0, 2] <= x < box[1, 2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def sample_range(box, planes, step, near, phase, pz, py, px, dz, dy, dx):  # type: ignore[no-untyped-def]
    """Return the half-open range of k whose samples have their nearest voxel in a box.

    `box` (2, 3) int64 holds the lower and upper voxel; `planes` cut further (`clipping_planes`);
    `phase` is 1/2 but for jittered rays.

    Parameters
    ----------
    box : (2, 3) ndarray of int64
        First voxel and the one after the last.
    planes : (N, 2, 3) ndarray of float64
        Clipping planes, voxels.
    step, near, phase : float
        Of the rays, mm; where in a step samples lie.
    pz, py, px, dz, dy, dx : float
        The ray, voxels.
    """
    # One way out only: with more, numba counts references to the arrays for every ray.
    first, last = -FAR * step, FAR * step
    first, last = _slab(box[0, 0] - 0.5, box[1, 0] - 0.5, pz, dz, first, last)
    first, last = _slab(box[0, 1] - 0.5, box[1, 1] - 0.5, py, dy, first, last)
    first, last = _slab(box[0, 2] - 0.5, box[1, 2] - 0.5, px, dx, first, last)
    k = end = 0
    if first < last:
        # The division above may be off by a rounding error: look one further on both sides, then
        # ask the very formula the kernels use, which is monotone in k.
        k = int(np.floor(first / step - phase)) - 1
        end = int(np.ceil(last / step - phase)) + 2
        if (k + phase) * step <= near:
            k = max(k + 1, int(np.floor(near / step - phase)))
            while k < end and (k + phase) * step <= near:
                k += 1
        while k < end and not _inside(box, pz, py, px, dz, dy, dx, (k + phase) * step):
            k += 1
        while end > k and not _inside(box, pz, py, px, dz, dy, dx, (end - 1 + phase) * step):
            end -= 1
        for i in range(planes.shape[0]):
            height = (
                (pz - planes[i, 0, 0]) * planes[i, 1, 0]
                + (py - planes[i, 0, 1]) * planes[i, 1, 1]
                + (px - planes[i, 0, 2]) * planes[i, 1, 2]
            )
            slope = dz * planes[i, 1, 0] + dy * planes[i, 1, 1] + dx * planes[i, 1, 2]
            if slope == 0.0:
                if height < 0.0:
                    end = k
            else:
                edge = min(max(-height / slope / step - phase, -FAR), FAR)
                if slope > 0.0:
                    k = max(k, int(np.ceil(edge)))
                else:
                    end = min(end, int(np.floor(edge)) + 1)
    return k, max(k, end)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def per_voxel(direction, step):  # type: ignore[no-untyped-def]
    """Return how many samples a ray has per voxel along one axis, at most FAR, with its sign.

    Parameters
    ----------
    direction : float
        Voxels a mm along one axis.
    step : float
        mm.
    """
    return min(max(1.0 / (direction * step), -FAR), FAR)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def octant_of(az, ay, ax):  # type: ignore[no-untyped-def]
    """Return the octant a ray looks into, as `Strides` counts them; az, ay, ax are `per_voxel`.

    Parameters
    ----------
    az, ay, ax : float
        From `per_voxel`.
    """
    return (4 if az > 0 else 0) + (2 if ay > 0 else 0) + (1 if ax > 0 else 0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def leap(distance, z, y, x, k, phase, pz, py, px, az, ay, ax):  # type: ignore[no-untyped-def]
    """Return the first k that may lie outside a cube of bricks around voxel (z, y, x).

    The cube reaches `distance` - 1 bricks ahead of the voxel's own; az, ay, ax are `per_voxel`.
    Errs on the side of too few.

    Parameters
    ----------
    distance : int
        Bricks, as `Strides` counts them.
    z, y, x : int
        Voxel of the sample.
    k, phase : float
        Number of the sample, and where in its step it lies.
    pz, py, px, az, ay, ax : float
        Origin of the ray, voxels, and `per_voxel`.
    """
    # A brick's middle, and from there to the cube's face that the ray leaves by.
    half = distance * BRICK - 0.5 * BRICK
    middle = 0.5 * BRICK - 0.5
    ez = ((z & -BRICK) + middle - pz) * az + half * abs(az)
    ey = ((y & -BRICK) + middle - py) * ay + half * abs(ay)
    ex = ((x & -BRICK) + middle - px) * ax + half * abs(ax)
    # A thousandth of slack for rounding: one look too many does no harm, one too few does.
    return max(k + 1, int(np.floor(min(ez, ey, ex) - phase + 0.999)))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def leap_along(layers, at, k, phase, origin, pace):  # type: ignore[no-untyped-def]
    """Return the first k that may lie outside some layers of bricks along one axis.

    The first of them is that of voxel `at`; `origin` is the ray's and `pace` its `per_voxel`.
    Errs on the side of too few.

    Parameters
    ----------
    layers : int
        Layers of bricks to skip.
    at : int
        Voxel of the sample along the axis.
    k, phase : float
        Number of the sample, and where in its step it lies.
    origin, pace : float
        Of the ray along the axis, voxels, and `per_voxel`.
    """
    half = layers * BRICK - 0.5 * BRICK
    edge = ((at & -BRICK) + (0.5 * BRICK - 0.5) - origin) * pace + half * abs(pace)
    return max(k + 1, int(np.floor(edge - phase + 0.999)))


# Rows of the scratch: the first sample inside, the one after the last, and whether that is so.
ENTRY, EXIT, SURE = 0, TILE, 2 * TILE

ROWS = 3


@njit(cache=True, nogil=True, error_model="numpy")
def enter_tile(box, planes, table, step, near, first, last, left, right, out):  # type: ignore[no-untyped-def]
    """List the rays of a tile that have samples in a box; return how many.

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
    """See `ray_sampling._slab`; where there is no ray, the last lies before the first."""
    a, b = (low - origin) / direction, (high - origin) / direction
    into, out = (a if a < b else b), (b if a < b else a)
    level, within = direction == 0.0, (low <= origin) & (origin < high)
    into = (first if within else last) if level else into
    out = last if level else out
    return into if into > first else first, out if out < last else last
