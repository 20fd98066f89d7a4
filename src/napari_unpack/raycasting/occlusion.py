"""Who hides whom along a direction: every counter of every occlusion ratio in one pass."""

from __future__ import annotations

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
from napari_unpack.raycasting.threads import over_bands
from napari_unpack.raycasting.walking import AHEAD, ground, outlook, read_labels, read_packed

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
    over = ground(labels, bricks, visible, rays)
    planes = clipping_planes(None)
    width = rays.size[1]

    def work(counts: NDArray[np.int64], first: int, last: int) -> None:
        # Threads share `blocks`: all they ever write to it is True.
        _count(  # type: ignore[call-arg]
            *over, table, step, near, planes, visible, first, last, width, slots, counts, blocks,
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
    labels, owners, reach, octants, axis, starts, ids, words, firsts, bits,
    table, step, near, planes, visible, first_row, last_row, width, slots, counts, blocks,
):  # fmt: skip
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = owners.size > 0
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
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            grid = octants[octant_of(az, ay, ax)]
            while k < end:
                label, free, brick = -1, end, np.uint64(0)
                if skip:
                    label, free, brick = outlook(
                        owners, reach, grid, axis, k, step, pz, py, px, dz, dy, dx, az, ay, ax
                    )
                    free = min(free, end)
                count, stops = 1, 1
                if label >= 0:
                    count, ahead[0] = free - k, label
                else:
                    free = min(free, k + AHEAD)
                    stops = free - k
                    if skip:
                        place, start = np.uint64(firsts[brick]), np.uint64(starts[brick])
                        read_packed(
                            words, place, np.int64(bits[brick]), ids, start,
                            k, free, step, pz, py, px, dz, dy, dx, ahead,
                        )  # fmt: skip
                    else:
                        read_labels(flat, high, wide, k, free, step, pz, py, px, dz, dy, dx, ahead)
                k = free
                for stop in range(stops):
                    label = ahead[stop]
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
    if label != 0:
        counts[0, label] += run
        if label != seen[0]:
            counts[3, label] += run
        if blocked:
            counts[4, label] += run
