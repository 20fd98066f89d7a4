"""Lanes: rays that advance side by side, and the queue of samples that are to be lit.

The compiler turns loops of constant length over consecutive numbers into vector instructions,
if it can see that they do not overlap. So each kind of number has one flat scratch array, in
which row r holds quantity r of all lanes at [LANES r, LANES (r + 1)).
"""

from __future__ import annotations

import numpy as np

from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.simd import EDGE, LANES, lowest_of

# Liberties the compiler may take with positions, which all passes share: none that moves one.
ORDERED = {"nnan", "nsz"}

# Rows of the rays: origin and direction in voxels, `per_voxel`, the next sample, where in their
# step samples lie, and the first sample that is not theirs.
PZ, PY, PX = 0, LANES, 2 * LANES
DZ, DY, DX = 3 * LANES, 4 * LANES, 5 * LANES
AZ, AY, AX = 6 * LANES, 7 * LANES, 8 * LANES
K, PHASE, END = 9 * LANES, 10 * LANES, 11 * LANES
RAY_ROWS = 12

# Rows of where the samples lie: nearest voxel, its brick, and in the brick's block the sample's
# cell and nearest voxel; then where the block begins, and the label seen.
Z, Y, X = 0, LANES, 2 * LANES
BRICK, CELL, NEAREST = 3 * LANES, 4 * LANES, 5 * LANES
SLOT, SEEN = 6 * LANES, 7 * LANES
PLACE_ROWS = 8

# Rows of the samples: how far into the cell, and depth.
SPOT_ROWS = 4
# The queue of samples to be lit holds two chunks. Rows: how far into the cell, depth, and the
# light's direction; the cell in the blocks, the label, the pixel and its ray's lane.
QUEUE = 2 * LANES
FZ, FY, FX, DEPTH = 0, QUEUE, 2 * QUEUE, 3 * QUEUE
LZ, LY, LX = 4 * QUEUE, 5 * QUEUE, 6 * QUEUE
QUEUE_ROWS = 7
AT, LABEL, PIXEL, LANE = 0, QUEUE, 2 * QUEUE, 3 * QUEUE
NAME_ROWS = 4


@njit(cache=True, nogil=True, forceinline=True)
def _brick(j):  # type: ignore[no-untyped-def]
    # numba widens sums of int32 to int64, which takes vector units twice the time.
    return np.int32(j >> np.int32(3))


@njit(cache=True, nogil=True, forceinline=True)
def _corner(b):  # type: ignore[no-untyped-def]
    return np.int32(np.int32(b << np.int32(3)) - np.int32(1))


@njit(cache=True, nogil=True, forceinline=True)
def _within(z, y, x):  # type: ignore[no-untyped-def]
    edge = np.int32(EDGE)
    row = np.int32(np.int32(z) * edge) + np.int32(y)
    return np.int32(np.int32(np.int32(row) * edge) + np.int32(x))


@njit(cache=True, nogil=True, fastmath=ORDERED, error_model="numpy")
def place(rays, step, high, wide, n, spot):  # type: ignore[no-untyped-def]
    """Find where the next samples of all rays lie; `high` and `wide` count bricks.

    Writes rows Z to NEAREST of `n`, and all of `spot`. Positions are at least -1/2: truncation
    does for a floor.

    Parameters
    ----------
    rays : (RAY_ROWS * LANES,) ndarray of float64
    step : float
        Distance of samples, mm.
    high, wide : int
        Bricks along y and x.
    n, spot : ndarray of int32 and float32
        Written.
    """
    high, wide = np.int32(high), np.int32(wide)
    for i in range(LANES):
        t = (rays[K + i] + rays[PHASE + i]) * step
        z = rays[PZ + i] + t * rays[DZ + i]
        y = rays[PY + i] + t * rays[DY + i]
        x = rays[PX + i] + t * rays[DX + i]
        jz, jy, jx = np.int32(z + 0.5), np.int32(y + 0.5), np.int32(x + 0.5)
        cz, cy, cx = np.floor(z), np.floor(y), np.floor(x)
        spot[i] = np.float32(z - cz)
        spot[LANES + i] = np.float32(y - cy)
        spot[2 * LANES + i] = np.float32(x - cx)
        spot[3 * LANES + i] = np.float32(t)
        n[Z + i], n[Y + i], n[X + i] = jz, jy, jx
        bz, by, bx = _brick(jz), _brick(jy), _brick(jx)
        n[BRICK + i] = np.int32(np.int32(np.int32(bz * high) + by) * wide) + bx
        bz, by, bx = _corner(bz), _corner(by), _corner(bx)
        n[CELL + i] = _within(np.int32(cz) - bz, np.int32(cy) - by, np.int32(cx) - bx)
        n[NEAREST + i] = _within(jz - bz, jy - by, jx - bx)


@njit(cache=True, nogil=True, error_model="numpy")
def find_blocks(places, n):  # type: ignore[no-untyped-def]
    """Look up the blocks of the samples' bricks (SLOT); return whether one has none.

    Parameters
    ----------
    places : (B,) ndarray of int32
        Slot of every brick in the cache, negative where it has none.
    n : (PLACE_ROWS * LANES,) ndarray of int32
        SLOT is written.
    """
    least = np.int32(0)
    for i in range(LANES):
        slot = places[np.uint64(n[BRICK + i])]
        n[SLOT + i] = slot
        least = least | slot
    return least < np.int32(0)


@njit(cache=True, nogil=True, error_model="numpy")
def see(labels, shown, n):  # type: ignore[no-untyped-def]
    """Look at the labels of the samples; return whose are shown, a bit a lane.

    There is no branch, since none could be foretold. Lanes without a block look at any.

    Parameters
    ----------
    labels : ndarray of uint16
        Of the cached bricks.
    shown : (M,) ndarray of uint8
        By ID.
    n : (PLACE_ROWS * LANES,) ndarray of int32
        SEEN is written.
    """
    bits = np.uint64(0)
    for i in range(LANES):
        label = labels[np.uint64(np.uint32(max(n[SLOT + i], np.int32(0)) + n[NEAREST + i]))]
        n[SEEN + i] = np.int32(label)
        bits |= np.uint64(shown[np.uint64(label)]) << np.uint64(i)
    return bits


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def queue_up(bits, n, spot, pixels, lights, turning, waiting, queue, names):  # type: ignore[no-untyped-def]
    """Add the samples of some lanes to the queue; return how many have been added in all.

    `turning` tells whether rays differ in the light's direction.

    Parameters
    ----------
    bits : uint64
        A bit a lane.
    n, spot, pixels, lights : ndarray
        Of the lanes.
    turning : bool
        In perspective.
    waiting : int
        Samples added so far.
    queue, names : ndarray
        Written.
    """
    while bits:
        i = lowest_of(bits)
        bits &= bits - np.uint64(1)
        q = np.uint64(waiting & (QUEUE - 1))
        waiting += 1
        queue[np.uint64(FZ) + q] = spot[i]
        queue[np.uint64(FY) + q] = spot[i + np.uint64(LANES)]
        queue[np.uint64(FX) + q] = spot[i + np.uint64(2 * LANES)]
        queue[np.uint64(DEPTH) + q] = spot[i + np.uint64(3 * LANES)]
        names[np.uint64(AT) + q] = n[i + np.uint64(SLOT)] + n[i + np.uint64(CELL)]
        names[np.uint64(LABEL) + q] = n[i + np.uint64(SEEN)]
        names[np.uint64(PIXEL) + q] = pixels[i]
        names[np.uint64(LANE) + q] = np.int32(i)
        if turning:
            queue[np.uint64(LZ) + q] = lights[i]
            queue[np.uint64(LY) + q] = lights[i + np.uint64(LANES)]
            queue[np.uint64(LX) + q] = lights[i + np.uint64(2 * LANES)]
    return waiting
