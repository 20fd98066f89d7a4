"""Ray packets: the next skip over uniform bricks, computed for 32 rays at once.

A skip is one chain of some 85 cycles (position, brick, distance, wall, next sample), most of them
spent waiting. Many chains take hardly longer than one in vector units. What is rare is done ray by
ray: a change of object, and the end of a ray.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

# Rays of a packet.
LANES = 32

# Rows of the float scratch: a ray as `ray_of` and `per_voxel` give it, its sample, the first one
# that may lie elsewhere, and from the ray's origin to the middle of the brick.
PZ, PY, PX = 0, LANES, 2 * LANES
DZ, DY, DX = 3 * LANES, 4 * LANES, 5 * LANES
AZ, AY, AX = 6 * LANES, 7 * LANES, 8 * LANES
K, BEYOND = 9 * LANES, 10 * LANES
CZ, CY, CX = 11 * LANES, 12 * LANES, 13 * LANES
# The sample after the ray's last, and the one after those that are looked at now.
END, STOP = 14 * LANES, 15 * LANES
FLOAT_ROWS = 16

# Rows of the integer scratch: where the grid begins that serves a ray, its brick, and what
# `looks_of` says of it: whose it is, and how far it may be skipped.
GRID, BRICK, SKIP = 0, LANES, 2 * LANES
# The object that the ray was in last and how many samples of it, 0 for none yet, -1 where there is
# no ray; the object found now, how many samples of it, and what is to be done about it.
CURRENT, LENGTH = 3 * LANES, 4 * LANES
FOUND, COUNT, EVENT = 5 * LANES, 6 * LANES, 7 * LANES
INTEGER_ROWS = 8

# Found: labels that have to be read one by one.
SEVERAL = np.int32(-2)

# Events: the ray comes to another object, or to its end.
TURNS, ENDS = np.int32(1), np.int32(2)

# Samples of a mixed brick that are looked at together; `object_ids.AHEAD`.
TOGETHER = 16.0
# Liberties the compiler may take: none that could move a sample, or a comparison of numbers.
ORDERED = {"nnan", "nsz"}

# The largest distance ahead; owners stand above it in a look.
MOST = 255


def looks_of(
    owners: NDArray[np.int32], reach: NDArray[np.uint8], number: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Return 256 owner + distance of every brick in one number; -1 - number where it is mixed.

    Parameters
    ----------
    owners : (Bz, By, Bx) ndarray of int32
        From `Bricks.owners`.
    reach : (n, Bz, By, Bx) ndarray of uint8
        From `DirectionalSkipping.grids`: 0 where a brick is mixed.
    number : (Bz * By * Bx,) ndarray of int32
        Of mixed bricks, from `CompressedLabels`.
    """
    looks = np.where(reach > 0, owners * (MOST + 1) + reach, ~number.reshape(owners.shape))
    return np.ascontiguousarray(looks, np.int32)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED)
def look_ahead(looks, rows, columns, axis, step, f, n):  # type: ignore[no-untyped-def]
    """Look at the bricks in which the samples of all rays lie, and from there on.

    Parameters
    ----------
    looks : (n,) ndarray of int32
        Of `looks_of`, flat; `rows`, `columns` are its By and Bx.
    axis : int
        Of `DirectionalSkipping`.
    step : float
        Distance of samples, mm.
    f : (FLOAT_ROWS * LANES,) ndarray of float64
        Rays and their samples K, all within the volume; BEYOND is written.
    n : (INTEGER_ROWS * LANES,) ndarray of int32
        GRID of each ray; BRICK and SKIP are written.
    """
    low, three = np.int32(-8), np.int32(3)
    rows, columns = np.int32(rows), np.int32(columns)
    for i in range(LANES):
        t = (f[K + i] + 0.5) * step
        z = np.int32(f[PZ + i] + t * f[DZ + i] + 0.5)
        y = np.int32(f[PY + i] + t * f[DY + i] + 0.5)
        x = np.int32(f[PX + i] + t * f[DX + i] + 0.5)
        n[BRICK + i] = ((z >> three) * rows + (y >> three)) * columns + (x >> three)
        f[CZ + i] = np.float64(z & low) + 3.5 - f[PZ + i]
        f[CY + i] = np.float64(y & low) + 3.5 - f[PY + i]
        f[CX + i] = np.float64(x & low) + 3.5 - f[PX + i]
    for i in range(LANES):
        n[SKIP + i] = looks[np.uint64(n[GRID + i] + n[BRICK + i])]
    if axis == 0:
        _leap(CZ, AZ, f, n)
    elif axis == 1:
        _leap(CY, AY, f, n)
    else:
        _leap(CX, AX, f, n)
    if axis < 0:
        _leap_cubes(f, n)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED, forceinline=True)
def _leap(center, pace, f, n):  # type: ignore[no-untyped-def]
    """Leap over layers of bricks along one axis, else over the brick alone.

    `center` and `pace` are that axis's rows; see `ray_sampling.leap_along` and `ray_sampling.leap`.
    """
    one = np.int32(1)
    for i in range(LANES):
        layers = n[SKIP + i] & np.int32(MOST) if n[SKIP + i] > 0 else np.int32(0)
        az, ay, ax = f[AZ + i], f[AY + i], f[AX + i]
        z, y, x = f[CZ + i] * az, f[CY + i] * ay, f[CX + i] * ax
        z, y, x = z + 4.0 * abs(az), y + 4.0 * abs(ay), x + 4.0 * abs(ax)
        z = z if z < y else y
        z = z if z < x else x
        way = f[pace + i]
        edge = f[center + i] * way + (np.float64(layers) * 8.0 - 12.0) * abs(way)
        edge = np.floor((edge if layers > one else z) - 0.5 + 0.999)
        next_one = f[K + i] + 1.0
        f[BEYOND + i] = edge if edge > next_one else next_one


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED, forceinline=True)
def _leap_cubes(f, n):  # type: ignore[no-untyped-def]
    """Leap over cubes of bricks; see `ray_sampling.leap`."""
    for i in range(LANES):
        layers = n[SKIP + i] & np.int32(MOST) if n[SKIP + i] > 0 else np.int32(0)
        half = np.float64(layers) * 8.0 - 4.0
        half = half if half > 4.0 else np.float64(4.0)
        az, ay, ax = f[AZ + i], f[AY + i], f[AX + i]
        z, y, x = f[CZ + i] * az, f[CY + i] * ay, f[CX + i] * ax
        z, y, x = z + half * abs(az), y + half * abs(ay), x + half * abs(ax)
        z = z if z < y else y
        z = z if z < x else x
        edge = np.floor(z - 0.5 + 0.999)
        next_one = f[K + i] + 1.0
        f[BEYOND + i] = edge if edge > next_one else next_one


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED)
def stretch(f, n):  # type: ignore[no-untyped-def]
    """Take what was looked at for the next stretch of every ray: STOP, COUNT, FOUND.

    What is found in mixed bricks remains to be looked up.

    Parameters
    ----------
    f, n : ndarray of float64 and int32
        Quantities of the lanes; see `look_ahead`.
    """
    for i in range(LANES):
        look, k = n[SKIP + i], f[K + i]
        stop = f[BEYOND + i] if f[BEYOND + i] < f[END + i] else f[END + i]
        stop = stop if stop < k + TOGETHER or look >= 0 else k + TOGETHER
        f[STOP + i] = stop
        n[COUNT + i] = np.int32(stop - k)
        n[FOUND + i] = look >> np.int32(8)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=ORDERED)
def go_on(f, n):  # type: ignore[no-untyped-def]
    """Have all rays go to the end of their stretch, and tell which then need attention: EVENT.

    Parameters
    ----------
    f, n : ndarray of float64 and int32
        Quantities of the lanes; see `look_ahead`.
    """
    none = np.int32(0)
    for i in range(LANES):
        found, count, current = n[FOUND + i], n[COUNT + i], n[CURRENT + i]
        n[LENGTH + i] += count if (found == current) & (found != none) else none
        turns = (found != current) & (found != none) & (count != none)
        ends = (f[STOP + i] >= f[END + i]) & (current >= none)
        n[EVENT + i] = (TURNS if turns else none) | (ENDS if ends else none)
        f[K + i] = f[STOP + i]
