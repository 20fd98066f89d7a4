"""Who hides whom along a direction: every counter of every occlusion ratio in one pass."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.raycasting.bricks import Bricks, Strides
from napari_unpack.raycasting.lattice import (
    AHEAD,
    TILE,
    band_of,
    clipping_planes,
    leap,
    octant_of,
    per_voxel,
    position,
    ray_numbers,
    ray_of,
    read_labels,
    sample_range,
)
from napari_unpack.raycasting.threads import over_bands

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
    owners, strides = np.zeros((0, 0, 0), np.int32), Strides.none()
    if bricks is not None:
        owners = bricks.owners(visible)
        strides = Strides.of(owners, rays)
    planes = clipping_planes(None)
    width = rays.size[1]

    def work(counts: NDArray[np.int64], first: int, last: int) -> None:
        # Threads share `blocks`: all they ever write to it is True.
        _count(
            labels, table, step, near, planes, visible, owners, strides.grids, strides.slots,
            first, last, width, slots, counts, blocks,
        )  # fmt: skip

    parts = over_bands(
        rays.size[0], work, lambda: np.zeros((5, size), np.int64), threads, band_of(rays.size[0])
    )
    counts = np.sum(parts, axis=0)
    ids = np.flatnonzero(counts[0])
    met = slots[ids]
    return OcclusionCounts(
        ids, counts[0], counts[1], counts[2], counts[3], counts[4],
        blocks[np.ix_(met, met)] if len(candidates) <= MOST_IN_TABLE else None,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _count(  # type: ignore[no-untyped-def]
    labels, table, step, near, planes, visible, owners, distance, slots_of,
    first_row, last_row, width, slots, counts, blocks,
):  # fmt: skip
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = distance.size > 0
    flat, (_, high, wide) = labels.reshape(-1), labels.shape
    ahead = np.zeros(AHEAD, np.int64)
    tabulate = blocks.size > 0
    stamps = np.full(visible.shape[0], -1, np.int64)
    seen = np.empty(visible.shape[0], np.int64)
    height = last_row - first_row
    for tile in range(0, width, TILE):
        columns = min(TILE, width - tile)
        for pixel in range(height * columns):
            row, col = first_row + pixel // columns, tile + pixel % columns
            pz, py, px, dz, dy, dx = ray_of(table, row, col)
            k, end = sample_range(box, planes, step, near, 0.5, pz, py, px, dz, dy, dx)
            stamp = row * width + col
            met = 0
            current = 0
            blocked = False
            run = 0
            free = first_read = k
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            grid = slots_of[octant_of(az, ay, ax)]
            while k < end:
                # Where all bricks ahead belong to one, its samples need no visit.
                count, label = 1, -1
                if k >= free:
                    d = 0
                    free = end
                    if skip:
                        _, vz, vy, vx = position(k, 0.5, step, pz, py, px, dz, dy, dx)
                        z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
                        b, r, c = np.uint64(z >> 3), np.uint64(y >> 3), np.uint64(x >> 3)
                        d = distance[grid, b, r, c]
                        free = min(end, leap(max(d, 1), z, y, x, k, 0.5, pz, py, px, az, ay, ax))
                    if d > 0:
                        count, label = free - k, int(owners[b, r, c])
                    else:
                        first_read, free = k, min(free, k + AHEAD)
                        read_labels(flat, high, wide, k, free, step, pz, py, px, dz, dy, dx, ahead)
                if label < 0:
                    label = ahead[np.uint64(k - first_read)]
                k += count
                if label == current:
                    run += count
                    continue
                _flush(counts, current, run, met, seen, blocked)
                run = 0
                current = 0
                if not visible[label]:
                    continue
                current = label
                run = count
                if stamps[label] != stamp:
                    stamps[label] = stamp
                    seen[met] = label
                    met += 1
                    counts[1, label] += 1
                    if met > 1:
                        counts[2, label] += 1
                blocked = met > 1
                if tabulate and blocked:
                    for i in range(met):
                        if seen[i] != label:
                            blocks[slots[seen[i]], slots[label]] = True
            _flush(counts, current, run, met, seen, blocked)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _flush(counts, label, run, met, seen, blocked):  # type: ignore[no-untyped-def]
    if label == 0:
        return
    counts[0, label] += run
    if label != seen[0]:
        counts[3, label] += run
    if blocked:
        counts[4, label] += run
