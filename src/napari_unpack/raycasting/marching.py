"""The loop of the tinted picture: rays side by side, samples in chunks, colours front to back.

The rays of a band walk side by side, tile by tile, each at its own sample; one that has come to
its end makes room for the next (lanes.py). Samples in a visible label join a queue, whatever
ray they are of, and are lit a chunk at a time (chunks.py). Voxels are read from blocks
(blocks.py).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.raycasting.blocks import ABSENT, BLOCK, CAPACITY, EMPTY, fill
from napari_unpack.raycasting.chunks import ENTRY_ROWS, FLOAT_ROWS, shade
from napari_unpack.raycasting.lanes import (
    AX,
    AY,
    AZ,
    BRICK,
    DX,
    DY,
    DZ,
    END,
    LX,
    LY,
    LZ,
    NAME_ROWS,
    PHASE,
    PLACE_ROWS,
    PX,
    PY,
    PZ,
    QUEUE,
    QUEUE_ROWS,
    RAY_ROWS,
    SLOT,
    SPOT_ROWS,
    K,
    X,
    Y,
    Z,
    find_blocks,
    place,
    queue_up,
    see,
)
from napari_unpack.raycasting.lattice import (
    TILE,
    leap,
    octant_of,
    per_voxel,
    ray_of,
    sample_range,
)
from napari_unpack.raycasting.opacity import family_of
from napari_unpack.raycasting.vectors import LANES, forward

BREADTH = 24.0
"""Voxels across a tile, where TILE pixels would be more."""


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
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
    volume, labels, numbers, step, near, jitter, planes, reach, slots, table, tints, shown, look,
    exponents, corrected, shine, first_row, last_row, blocks, families, image, depth,
):  # fmt: skip
    """Cast the rows of one band; see `tinted`, which prepares all the numbers."""
    # One long function: numba counts references to all arrays that a helper with several ways
    # out is handed, for every ray and every leap.
    places, owners, cells, near_names, around, starts, ids = blocks
    box = np.zeros((2, 3), np.int64)
    deep, high, wide = labels.shape
    box[1, 0], box[1, 1], box[1, 2] = deep, high, wide
    bricks_high, bricks_wide = (high + 7) >> 3, (wide + 7) >> 3
    densities, objects = volume.reshape(-1), labels.reshape(-1)
    turning = near > -np.inf
    width, height = image.shape[1], last_row - first_row
    picture, depths = image.reshape(-1), depth.reshape(-1)
    flat_table, flat_tints = table.reshape(-1), tints.reshape(-1)
    rays = np.zeros(RAY_ROWS * LANES)
    grids, pixels = np.zeros(LANES, np.int64), np.zeros(LANES, np.int32)
    lights, alive = np.zeros(3 * LANES, np.float32), np.zeros(LANES, np.bool_)
    n, spot = np.zeros(PLACE_ROWS * LANES, np.int32), np.zeros(SPOT_ROWS * LANES, np.float32)
    queue = np.zeros(QUEUE_ROWS * QUEUE, np.float32)
    names = np.zeros(NAME_ROWS * QUEUE, np.int32)
    v, colors = np.zeros(4 * LANES, np.float32), np.zeros(4 * LANES, np.float32)
    f = np.zeros(FLOAT_ROWS * LANES, np.float32)
    entries = np.zeros(ENTRY_ROWS * LANES, np.int32)
    # So narrow that the blocks behind a tile are not more than there are.
    pitch = np.sqrt(numbers[2, 0] ** 2 + numbers[2, 1] ** 2 + numbers[2, 2] ** 2)
    breadth = max(4, min(TILE, int(BREADTH / max(pitch, 1e-9))))
    tile, columns, at_pixel = 0, min(breadth, width), 0
    # Samples that have joined the queue, those lit, blocks in use, and lanes.
    waiting = start = used = running = 0
    over, lit = True, turning
    while True:
        for i in range(LANES if over else 0):
            if rays[K + i] < rays[END + i]:
                continue
            running -= alive[i]
            alive[i] = False
            while tile < width and not alive[i]:
                row, col = first_row + at_pixel // columns, tile + at_pixel % columns
                at_pixel += 1
                if at_pixel == height * columns:
                    tile += breadth
                    columns = min(breadth, width - tile)
                    at_pixel = 0
                pz, py, px, dz, dy, dx = ray_of(numbers, row, col)
                phase = phase_of(row, col, jitter)
                k, end = sample_range(box, planes, step, near, phase, pz, py, px, dz, dy, dx)
                if k >= end:
                    continue
                alive[i] = True
                az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
                rays[PZ + i], rays[PY + i], rays[PX + i] = pz, py, px
                rays[DZ + i], rays[DY + i], rays[DX + i] = dz, dy, dx
                rays[AZ + i], rays[AY + i], rays[AX + i] = az, ay, ax
                rays[K + i], rays[PHASE + i], rays[END + i] = k, phase, end
                grids[i] = slots[octant_of(az, ay, ax)]
                pixels[i] = row * width + col
                wz, wy, wx = dz * look[2], dy * look[3], dx * look[4]
                speed = np.sqrt(wz * wz + wy * wy + wx * wx)
                if families.size:
                    families[pixels[i]] = family_of(speed * step / look[5], exponents)
                lights[i], lights[LANES + i] = wz / speed, wy / speed
                lights[2 * LANES + i] = wx / speed
            running += alive[i]
            if not alive[i]:
                # To the volume's first voxel, where nothing is out of bounds.
                for q in range(RAY_ROWS):
                    rays[q * LANES + i] = 0.0
                rays[END + i] = np.inf
            elif not lit:
                # Parallel rays share their light.
                lit = True
                for q in range(QUEUE):
                    queue[LZ + q] = lights[i]
                    queue[LY + q] = lights[LANES + i]
                    queue[LX + q] = lights[2 * LANES + i]
        if running == 0 and waiting == start:
            break
        # Nobody may wait for a block that makes room.
        drain = running == 0 or used > CAPACITY - LANES
        if not drain:
            place(rays, step, bricks_high, bricks_wide, n, spot)
            if find_blocks(places, n):
                for i in range(LANES):
                    if n[SLOT + i] >= 0:
                        continue
                    brick = np.int64(n[BRICK + i])
                    # A lane before this one may have asked for it.
                    slot = places[brick]
                    if slot == ABSENT:
                        slot = np.int32(used * BLOCK)
                        places[brick] = slot
                        owners[used] = brick
                        used += 1
                        fill(
                            densities, objects, brick, deep, high, wide, np.int64(slot),
                            cells, near_names, around, starts, ids,
                        )  # fmt: skip
                    n[SLOT + i] = slot
                    if slot == EMPTY:
                        z, y, x = np.int64(n[Z + i]), np.int64(n[Y + i]), np.int64(n[X + i])
                        rays[K + i] = leap(
                            np.int64(reach[grids[i], z >> 3, y >> 3, x >> 3]), z, y, x,
                            np.int64(rays[K + i]), rays[PHASE + i],
                            rays[PZ + i], rays[PY + i], rays[PX + i],
                            rays[AZ + i], rays[AY + i], rays[AX + i],
                        )  # fmt: skip
            if running < LANES:
                for i in range(LANES):
                    if not alive[i]:
                        n[SLOT + i] = EMPTY
            bits = see(near_names, shown, n)
            there, ended = forward(rays, K, END, n, SLOT)
            waiting = queue_up(
                bits & there, n, spot, pixels, lights, turning, waiting, queue, names
            )
            over = ended != 0
        if waiting - start >= LANES or (drain and waiting > start):
            closed = shade(
                start & (QUEUE - 1), min(LANES, waiting - start), cells, flat_table,
                flat_tints, look, corrected, families, shine, queue, names, v, f, entries, colors,
                picture, depths, rays, pixels,
            )  # fmt: skip
            over = over or closed
            start += LANES
        if drain:
            waiting = start = 0
            for i in range(used):
                places[owners[i]] = ABSENT
            used = 0
    for i in range(used):
        places[owners[i]] = ABSENT
