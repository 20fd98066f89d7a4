"""Cached bricks: density and gradient of every voxel of a brick side by side.

Neighbouring rays read the same voxels again and again, 32 of them a lit sample. So each thread
keeps every brick that its rays are in, with one voxel around it and, beside each density, the
differences of its neighbours along z, y and x. To interpolate those four takes four loads, and a
cached brick stays in the processor's cache where rows of a volume would not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Bricks, Density
from napari_unpack.rendering.cpu.ray_sampling import BRICK
from napari_unpack.rendering.cpu.simd import EDGE, copy_row, gather_row

# Voxels from one block to the next: EDGE ** 3 and what the last row writes beyond its end.
BLOCK = 1008
# Blocks a thread keeps; when it wants more it begins afresh.
CAPACITY = 512

# Instead of a block's place: nothing can be seen in the brick; no object has asked for it.
EMPTY, ABSENT = -2, -1

_AROUND = BRICK + 4
_LINE = 16
_PLANE = _AROUND * _LINE


class BrickCache(NamedTuple):
    """The blocks of one thread.

    Parameters
    ----------
    places : (Bz * By * Bx,) ndarray of int32
        At which voxel of `cells` a brick's block begins, EMPTY or ABSENT.
    owners : (CAPACITY,) ndarray of int64
        Whose brick's each block is.
    cells : (CAPACITY * BLOCK * 4,) ndarray of int16 or float32
        Density and its differences along z, y, x, of one voxel after the other.
    names : (CAPACITY * BLOCK,) ndarray of uint16
        Labels, of the brick's own voxels only.
    around : (n,) ndarray of the volume's dtype
        Scratch for bricks at the volume's edge.
    starts, ids
        Of the `Bricks`; none where there are none.
    """

    places: NDArray[np.int32]
    owners: NDArray[np.int64]
    cells: NDArray[np.int16] | NDArray[np.float32]
    names: NDArray[np.uint16]
    around: Density
    starts: NDArray[np.int64]
    ids: NDArray[np.uint16]

    @classmethod
    def of(cls, volume: Density, full: NDArray[np.bool_], bricks: Bricks | None) -> BrickCache:
        """Make room for the blocks of one thread.

        Parameters
        ----------
        volume : (Z, Y, X) ndarray of uint16 or float32
        full : (Bz, By, Bx) ndarray of bool
            Which bricks may hold something to be seen.
        bricks : Bricks, optional
            They tell whether densities and their differences fit into 16 bits, which is faster
            by a twentieth, and spare looking at labels where a brick has but one.
        """
        cells: NDArray[np.int16] | NDArray[np.float32]
        narrow = volume.dtype == np.uint16 and bricks is not None and bricks.high.max() < 2**15
        cells = np.empty(CAPACITY * BLOCK * 4, np.float32)
        if narrow:
            cells = np.empty(CAPACITY * BLOCK * 4, np.int16)
        return cls(
            np.where(full.ravel(), np.int32(ABSENT), np.int32(EMPTY)),
            np.zeros(CAPACITY, np.int64),
            cells,
            np.zeros(CAPACITY * BLOCK, np.uint16),
            np.zeros(_AROUND * _PLANE + _LINE, volume.dtype),
            np.zeros(0, np.int64) if bricks is None else bricks.starts,
            np.zeros(0, np.uint16) if bricks is None else bricks.ids,
        )


@njit(cache=True, nogil=True, error_model="numpy")
def fill(  # type: ignore[no-untyped-def]
    volume, labels, brick, deep, high, wide, slot, cells, names, around, starts, ids
):
    """Fill the block that begins at voxel `slot` with a brick; see `BrickCache`.

    `volume` and `labels` are flat, of shape (deep, high, wide).

    Parameters
    ----------
    volume, labels : (Z * Y * X,) ndarray
        Flat.
    brick : int
        Which to cache.
    deep, high, wide : int
        Shape of the volume.
    slot : int
        Where its voxels go in `cells` and `names`.
    cells, names, around, starts, ids : ndarray
        Of `BrickCache`; the first three are written.
    """
    bricks_high, bricks_wide = -(-high // BRICK), -(-wide // BRICK)
    z = brick // (bricks_wide * bricks_high) * BRICK
    y = brick // bricks_wide % bricks_high * BRICK
    x = brick % bricks_wide * BRICK
    inside = (
        z >= 2 and y >= 2 and x >= 2
        and z + BRICK + 2 <= deep and y + BRICK + 2 <= high and x + BRICK + 2 <= wide
    )  # fmt: skip
    to = np.uint64(slot)
    if inside:
        at = ((z - 1) * high + y - 1) * wide + x - 1
        _gather(volume, at, wide, high * wide, cells, to)
    else:
        for a in range(_AROUND):
            for b in range(_AROUND):
                for c in range(_AROUND):
                    voxel = min(max(z - 2 + a, 0), deep - 1) * high
                    voxel = (voxel + min(max(y - 2 + b, 0), high - 1)) * wide
                    voxel += min(max(x - 2 + c, 0), wide - 1)
                    around[a * _PLANE + b * _LINE + c] = volume[voxel]
        _gather(around, _PLANE + _LINE + 1, _LINE, _PLANE, cells, to)
    if starts.size and starts[brick + 1] - starts[brick] == 1:
        owner = ids[starts[brick]]
        for i in range(EDGE**3):
            names[to + np.uint64(i)] = owner
    elif inside:
        at = (z * high + y) * wide + x
        for a in range(BRICK):
            for b in range(BRICK):
                row = to + np.uint64(((a + 1) * EDGE + b + 1) * EDGE + 1)
                copy_row(labels, np.uint64(at + (a * high + b) * wide), names, row)
    else:
        for a in range(min(BRICK, deep - z)):
            for b in range(min(BRICK, high - y)):
                row = to + np.uint64(((a + 1) * EDGE + b + 1) * EDGE + 1)
                for c in range(min(BRICK, wide - x)):
                    names[row + np.uint64(c)] = labels[((z + a) * high + y + b) * wide + x + c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _gather(flat, at, line, plane, cells, to):  # type: ignore[no-untyped-def]
    for a in range(EDGE):
        for b in range(EDGE):
            # Twelve voxels are written, of which the next row overwrites the last two.
            gather_row(
                flat, np.uint64(at + a * plane + b * line), np.uint64(line), np.uint64(plane),
                cells, to + np.uint64((a * EDGE + b) * EDGE),
            )  # fmt: skip
