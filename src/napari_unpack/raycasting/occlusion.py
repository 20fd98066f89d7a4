"""Who hides whom along a direction: every counter of every occlusion ratio in one pass."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.raycasting.bricks import Bricks
from napari_unpack.raycasting.lattice import (
    TILE,
    band_of,
    clipping_planes,
    octant_of,
    per_voxel,
    ray_numbers,
    ray_of,
    sample_range,
)
from napari_unpack.raycasting.packets import (
    AX,
    AY,
    AZ,
    BRICK,
    DX,
    DY,
    DZ,
    FLOAT_ROWS,
    FREE,
    GRID,
    INTEGER_ROWS,
    LANES,
    LOOK,
    MOST,
    PX,
    PY,
    PZ,
    K,
    look_ahead,
    looks_of,
)
from napari_unpack.raycasting.threads import over_bands
from napari_unpack.raycasting.walking import AHEAD, ground, read_labels, read_packed

MOST_IN_TABLE = 4096
"""Above this many objects there is no table of who blocks whom: it grows with their square."""


def occlusion_counts(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
    threads: int | None = None,
) -> OcclusionCounts:
    """Count how much of every object is hidden by others.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    rays : Rays
        Orthographic, looking along -D; at the voxel pitch or finer to decide what is free.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False. Hidden objects are as air.
    bricks : Bricks, optional
        Of these labels; saves visiting what is uniform, changes nothing.
    threads : int, optional
        Workers, by default one a core.

    Returns
    -------
    OcclusionCounts

    Notes
    -----
    Li et al. 2012, section 5.1, eq. 2 and both listings, plus `exact` (notes/readings.md 1).
    All denominators are exact. The paper bounds each object's pass by its box; here all objects
    share one pass over the whole lattice.
    """
    table, step, near = ray_numbers(rays)
    size = len(visible)
    candidates = np.flatnonzero(visible)
    slots = np.full(size, -1, np.int32)
    if len(candidates) <= MOST_IN_TABLE:
        slots[candidates] = np.arange(len(candidates))
        blocks = np.zeros((len(candidates),) * 2, np.bool_)
    else:
        blocks = np.zeros((0, 0), np.bool_)
    _, owners, reach, octants, axis, *voxels = ground(labels, bricks, visible, rays)
    looks = looks_of(owners, reach).reshape(-1)
    octants = octants * owners.size
    planes = clipping_planes(None)
    width = rays.size[1]

    def work(own: tuple[NDArray[Any], ...], first: int, last: int) -> None:
        # Threads share `blocks`: all they ever write to it is True.
        _count(  # type: ignore[call-arg]
            labels, looks, *owners.shape[1:], octants, axis, *voxels, table, step, near, planes,
            visible, first, last, width, slots, *own, blocks,
        )  # fmt: skip

    def state() -> tuple[NDArray[Any], ...]:
        counts = np.zeros((5, size), np.int64)
        return counts, np.full((size, LANES), -1, np.int32), np.zeros((LANES, size), np.int32)

    parts = over_bands(rays.size[0], work, state, threads, band_of(rays.size[0]))
    counts = np.sum([counts for counts, _, _ in parts], axis=0)
    ids = np.flatnonzero(counts[0])
    met = slots[ids]
    return OcclusionCounts(
        ids, counts[0], counts[1], counts[2], counts[3], counts[4],
        blocks[np.ix_(met, met)] if len(candidates) <= MOST_IN_TABLE else None,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _count(  # type: ignore[no-untyped-def]
    labels, looks, rows, columns, octants, axis, starts, ids, words, firsts, bits,
    table, step, near, planes, visible, first_row, last_row, width, slots,
    counts, stamps, seen, blocks,
):  # fmt: skip
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = looks.size > 0
    flat, (_, high, wide) = labels.reshape(-1), labels.shape
    ahead = np.zeros(AHEAD, np.int64)
    tabulate = blocks.size > 0
    f, n = np.zeros(FLOAT_ROWS * LANES), np.zeros(INTEGER_ROWS * LANES, np.int32)
    ends = np.zeros(LANES, np.int64)
    stamp, met = np.full(LANES, -1, np.int64), np.zeros(LANES, np.int64)
    current, run = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    height = last_row - first_row
    for tile in range(0, width, TILE):
        tiled = min(TILE, width - tile)
        pixel, walking = 0, 0
        while True:
            # Rays that have ended make room for the next ones of the tile.
            for lane in range(LANES):
                while stamp[lane] < 0 and pixel < height * tiled:
                    row, col = first_row + pixel // tiled, tile + pixel % tiled
                    pixel += 1
                    pz, py, px, dz, dy, dx = ray_of(table, row, col)
                    k, end = sample_range(box, planes, step, near, 0.5, pz, py, px, dz, dy, dx)
                    if k >= end:
                        continue
                    az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
                    f[PZ + lane], f[PY + lane], f[PX + lane] = pz, py, px
                    f[DZ + lane], f[DY + lane], f[DX + lane] = dz, dy, dx
                    f[AZ + lane], f[AY + lane], f[AX + lane] = az, ay, ax
                    n[GRID + lane] = octants[octant_of(az, ay, ax)]
                    f[K + lane], ends[lane] = k, end
                    stamp[lane] = row * width + col
                    met[lane] = current[lane] = run[lane] = 0
                    walking += 1
            if walking == 0:
                break
            if skip:
                look_ahead(looks, rows, columns, axis, step, f, n)
            for lane in range(LANES):
                if stamp[lane] < 0:
                    continue
                k, stop = int(f[K + lane]), int(min(f[FREE + lane], float(ends[lane])))
                look = np.int64(n[LOOK + lane])
                count, stops = 1, 1
                if look & MOST:
                    count, ahead[0] = stop - k, look >> 8
                elif skip:
                    stop = min(stop, k + AHEAD)
                    stops = stop - k
                    b = np.uint64(n[BRICK + lane])
                    place, start = np.uint64(firsts[b]), np.uint64(starts[b])
                    read_packed(
                        words, place, np.int64(bits[b]), ids, start, k, stop, step,
                        f[PZ + lane], f[PY + lane], f[PX + lane],
                        f[DZ + lane], f[DY + lane], f[DX + lane], ahead,
                    )  # fmt: skip
                else:
                    stop = min(ends[lane], k + AHEAD)
                    stops = stop - k
                    read_labels(
                        flat, high, wide, k, stop, step,
                        f[PZ + lane], f[PY + lane], f[PX + lane],
                        f[DZ + lane], f[DY + lane], f[DX + lane], ahead,
                    )  # fmt: skip
                label, length, number = current[lane], run[lane], met[lane]
                for i in range(stops):
                    found = ahead[i]
                    if found == label:
                        length += count
                        continue
                    _flush(counts, label, length, number, seen[lane, 0])
                    length = label = 0
                    if not visible[found]:
                        continue
                    label, length = found, count
                    if stamps[found, lane] != stamp[lane]:
                        stamps[found, lane] = stamp[lane]
                        seen[lane, number] = found
                        number += 1
                        counts[1, found] += 1
                        if number > 1:
                            counts[2, found] += 1
                    if tabulate and number > 1:
                        for earlier in range(number):
                            other = seen[lane, earlier]
                            if other != found:
                                blocks[slots[other], slots[found]] = True
                current[lane], run[lane], met[lane] = label, length, number
                f[K + lane] = stop
                if stop >= ends[lane]:
                    _flush(counts, label, length, number, seen[lane, 0])
                    stamp[lane] = -1
                    walking -= 1
                    # It goes on being looked at: let it stand inside.
                    f[K + lane] = ends[lane] - 1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _flush(counts, label, run, met, foremost):  # type: ignore[no-untyped-def]
    if label != 0:
        counts[0, label] += run
        if label != foremost:
            counts[3, label] += run
        if met > 1:
            counts[4, label] += run
