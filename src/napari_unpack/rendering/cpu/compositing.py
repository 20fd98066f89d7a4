"""Front-to-back compositing of the tinted image (Li et al. 2012, section 4.1), 32 rays at once.

The rays of a band advance side by side, each at its own sample; a ray that ends makes room for the
next (ray_lanes.py). Samples in a visible label join a queue, whatever ray they belong to, and a
full queue is interpolated, lit and composited at once (brick_cache.py, simd). The gradient is that
of the interpolated density one voxel to both sides, which equals the same blend of the voxels'
central differences. Opacities per voxel are corrected for the length that a step really has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.brick_cache import ABSENT, BLOCK, CAPACITY, EMPTY, fill
from napari_unpack.rendering.cpu.ray_sampling import (
    TILE,
    leap,
    octant_of,
    per_voxel,
    ray_of,
    sample_range,
)
from napari_unpack.rendering.cpu.simd import LANES, blend_cell, forward, lay_over, look_up

# isort: off
from napari_unpack.rendering.cpu.ray_lanes import (
    AT, AX, AY, AZ, BRICK, DEPTH, DX, DY, DZ, END, FX, FY, FZ, LABEL, LANE, LX, LY, LZ, NAME_ROWS,
    PHASE, PIXEL, PLACE_ROWS, PX, PY, PZ, QUEUE, QUEUE_ROWS, RAY_ROWS, SLOT, SPOT_ROWS, K, X, Y, Z,
    find_blocks, place, queue_up, see,
)  # fmt: skip
# isort: on

# A ray ends once its alpha reaches this; the GLSL twin stops at the same.
OPAQUE = 0.99
# Liberties the compiler may take with colours; never with positions, which all passes share.
FLOAT = {"contract", "reassoc", "nsz", "arcp", "nnan"}

# Rows of a chunk: the way from one entry of the transfer function to the next, light, highlight
# without its power, the way from one entry of the power to the next; both entries.
PART, LIGHT, GLOSS, REST = 0, LANES, 2 * LANES, 3 * LANES
FLOAT_ROWS = 4
ENTRY, SHINE = 0, LANES
ENTRY_ROWS = 2


@njit(cache=True, nogil=True, error_model="numpy")
def _blend(cells, names, queue, at, v):  # type: ignore[no-untyped-def]
    for i in range(LANES):
        q = np.uint64(at + i)
        blend_cell(
            cells, np.uint64(names[np.uint64(AT) + q]), queue[np.uint64(FZ) + q],
            queue[np.uint64(FY) + q], queue[np.uint64(FX) + q], v, np.uint64(i),
        )  # fmt: skip


@njit(cache=True, nogil=True, fastmath=FLOAT, error_model="numpy")
def _light(  # type: ignore[no-untyped-def]
    v, queue, at, f, low, scale, top, hz, hy, hx, steepness, ambient, diffuse, specular, gleam,
    entries,
):  # fmt: skip
    """Find every sample's place in the transfer function, and light it (geometry/shading.py).

    `v` holds density and differences, one sample after the other; hz, hy, hx take differences
    between voxels two apart to the world. Writes all rows of `f` and `entries`; entries are from
    0 to `top` - 1 and `gleam` - 1, of samples that are no numbers too.
    """
    zero, one = np.float32(0), np.float32(1)
    last, sharpest = np.int32(top - one), np.int32(gleam - one)
    for i in range(LANES):
        u = (v[4 * i] - low) * scale
        u = min(max(u, zero), top)
        n = min(max(np.int32(u), np.int32(0)), last)
        entries[ENTRY + i] = n
        f[PART + i] = u - np.float32(n)
        gz, gy, gx = v[4 * i + 1] * hz, v[4 * i + 2] * hy, v[4 * i + 3] * hx
        steep = np.sqrt(gz * gz + gy * gy + gx * gx)
        q = np.uint64(at) + np.uint64(i)
        along = gz * queue[np.uint64(LZ) + q] + gy * queue[np.uint64(LY) + q]
        along += gx * queue[np.uint64(LX) + q]
        facing = min(abs(along) / (steep + np.float32(1e-20)), one)
        s = min(steep * steepness, one)
        f[LIGHT + i] = ambient + diffuse * (one - s + s * facing)
        f[GLOSS + i] = specular * s
        u = facing * gleam
        n = min(max(np.int32(u), np.int32(0)), sharpest)
        entries[SHINE + i] = n
        f[REST + i] = u - np.float32(n)


@njit(cache=True, nogil=True, error_model="numpy")
def _color(table, tints, names, at, f, entries, colors):  # type: ignore[no-untyped-def]
    for i in range(LANES):
        look_up(
            table, np.uint64(entries[ENTRY + i]), f[PART + i], tints,
            np.uint64(names[np.uint64(LABEL) + np.uint64(at + i)]), colors, np.uint64(i),
        )  # fmt: skip


# Inlined, because numba counts references to arrays that are handed to a function with errors.
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def shade(  # type: ignore[no-untyped-def]
    at, count, cells, table, tints, look, corrected, families, shine, queue, names,
    v, f, entries, colors, picture, depth, rays, pixels,
):  # fmt: skip
    """Light the first samples of the chunk that begins at `at` of the queue and composite them.

    Rays whose pixel has become opaque end; returns whether there are any.

    Parameters
    ----------
    at, count : int
        First sample of the chunk in the queue, and how many to light.
    cells, table, tints, look, corrected, families, shine
        As for `march`.
    queue, names : ndarray
        Of the samples; see ray_lanes.py.
    v, f, entries, colors : ndarray
        Scratch of one chunk.
    picture, depth : (H * W * 4,), (H * W,) ndarray of float32
        Written.
    rays, pixels : ndarray
        Of the lanes.
    """
    zero, one, half, opaque = np.float32(0), np.float32(1), np.float32(0.5), np.float32(OPAQUE)
    thicken, finest = corrected.size > 0, np.float32(corrected.shape[1] - 1)
    top, gleam = np.float32(table.size // 4 - 1), np.float32(shine.shape[0] - 1)
    _blend(cells, names, queue, at, v)
    _light(
        v, queue, at, f, look[0], look[1], top, half * look[11], half * look[12], half * look[13],
        look[10], look[6], look[7], look[8], gleam, entries,
    )  # fmt: skip
    _color(table, tints, names, at, f, entries, colors)
    ended = False
    for i in range(count):
        # NaN comes where the volume has been written to since its bricks were made.
        a = colors[4 * i + 3]
        a = min(a if a > zero else zero, one)
        p = np.uint64(names[np.uint64(PIXEL + at + i)])
        # Opacity correction: 1 - (1 - a)^(step / min(spacing)), from the table of the ray's step.
        if thicken:
            u = a * finest
            n = np.uint64(min(u, finest - one))
            family = np.uint64(families[p])
            a = corrected[family, n]
            a += (u - np.float32(n)) * (corrected[family, n + np.uint64(1)] - a)
        alpha = picture[np.uint64(4) * p + np.uint64(3)]
        # Samples queued behind one that made the pixel opaque are dropped.
        if alpha >= opaque:
            continue
        # Front to back: a sample counts with what the samples before it let through.
        weight = (one - alpha) * a
        after = alpha + weight
        if after >= opaque:
            lane = np.uint64(names[np.uint64(LANE + at + i)])
            # The lane may have gone on to another pixel since this sample joined the queue.
            if np.int64(pixels[lane]) == np.int64(p):
                rays[np.uint64(END) + lane] = -np.inf
                ended = True
        # The depth of a pixel is where alpha first reaches 1/2.
        if (alpha < half) & (after >= half):
            depth[p] = queue[np.uint64(DEPTH + at + i)]
        j = np.uint64(entries[SHINE + i])
        gloss = shine[j]
        gloss = f[GLOSS + i] * (gloss + f[REST + i] * (shine[j + np.uint64(1)] - gloss))
        lay_over(picture, p, weight, colors, np.uint64(i), f[LIGHT + i], gloss)
    return ended


# Opacities tabulated for one length of step.
ENTRIES = 2049
# Lengths of step closer than this share a table.
RATIO = 1.001
# As many tables for an image; lengths that share one are farther apart where these are few.
MOST_LENGTHS = 256


def correction(rays: Rays, spacing: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Tabulate 1 - (1 - a)^e for every e = step length / min(spacing) in an image.

    Parameters
    ----------
    rays : Rays
        Of the image; in perspective the outer rays have longer steps.
    spacing : (3,) array_like, mm z y x

    Returns
    -------
    exponents : (n,) ndarray of float64
        In geometric order.
    table : (n, ENTRIES) ndarray of float32
        Corrected opacity over a in [0, 1]; no rows at all where every step is one voxel long.
    """
    low, high = _range(rays, np.asarray(spacing, dtype=np.float64))
    if abs(low - 1) < 1e-6 and abs(high - 1) < 1e-6:
        return np.ones(1), np.zeros((0, ENTRIES), np.float32)
    count = 1 + int(np.ceil(np.log(high / low) / np.log(RATIO) - 1e-6))
    exponents = np.geomspace(low, max(high, low), min(max(count, 1), MOST_LENGTHS))
    through = 1.0 - np.linspace(0.0, 1.0, ENTRIES)
    return exponents, (1.0 - through[None] ** exponents[:, None]).astype(np.float32)


def _range(rays: Rays, mm: NDArray[np.float64]) -> tuple[float, float]:
    # Length is convex over an image: most in a corner, least at its only stationary point or
    # on the border, wherever that is where the bag is stretched.
    middle, down, right = rays.table[3:] * mm * rays.step / mm.min()
    rows, columns = np.asarray(rays.size, dtype=np.float64) - 1
    corners = [middle + r * down + c * right for r in (0.0, rows) for c in (0.0, columns)]
    found = [*corners]
    for start, along, count in (
        (corners[0], right, columns),
        (corners[2], right, columns),
        (corners[0], down, rows),
        (corners[1], down, rows),
    ):
        part = -(start @ along) / max(float(along @ along), 1e-300)
        found.append(start + np.clip(part, 0.0, count) * along)
    r, c = np.linalg.lstsq(np.stack([down, right], axis=1), -middle, rcond=None)[0]
    if 0 <= r <= rows and 0 <= c <= columns:
        found.append(middle + r * down + c * right)
    lengths = np.linalg.norm(found, axis=1)
    return float(lengths.min()), float(lengths.max())


@njit(cache=True, nogil=True, error_model="numpy")
def family_of(exponent, exponents):  # type: ignore[no-untyped-def]
    """Return the row of the table nearest to one ray's exponent.

    Parameters
    ----------
    exponent : float
        Step length over `min(spacing)`.
    exponents : (n,) ndarray of float64
        Of `correction`.
    """
    last = exponents.shape[0] - 1
    if last == 0:
        return np.uint64(0)
    n = np.rint(np.log(exponent / exponents[0]) / np.log(exponents[last] / exponents[0]) * last)
    return np.uint64(min(max(n, 0.0), np.float64(last)))


# Voxels across a tile, where TILE pixels would be more.
BREADTH = 24.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def phase_of(row, col, jitter):  # type: ignore[no-untyped-def]
    """Return where in its step a ray is sampled: 1/2, or, jittered, a hash of the pixel.

    Jimenez's interleaved gradient noise, fract(52.9829189 fract(0.06711056 col + 0.00583715 row)).

    Parameters
    ----------
    row, col : int
        Pixel.
    jitter : bool
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
    """Cast the rows of one band; see `tinted`, which prepares all the numbers.

    Each round of the loop (1) gives lanes without a ray the next pixel, (2) places one sample a
    lane, (3) caches the bricks it lies in, or skips where they are empty, (4) queues samples whose
    label is visible and advances, and (5) composites the queue when it is full.

    Parameters
    ----------
    volume, labels : (Z, Y, X) ndarray
        Density, and uint16 object IDs.
    numbers, step, near
        Of `ray_numbers`.
    jitter : bool
        Start rays at a hash of their pixel.
    planes : (N, 2, 3) ndarray of float64
        Clipping planes, voxels.
    reach, slots
        `Strides.grids` and `Strides.slots`.
    table, tints : (n, 4) ndarray of float32
        Transfer function, and tints by ID.
    shown : (M,) ndarray of bool
        By ID, whether its tint is visible.
    look : (14,) ndarray of float32
        Domain, spacing and light; see `tinted`.
    exponents, corrected : ndarray
        Of `correction`.
    shine : (n,) ndarray of float32
        Powers of the highlight.
    first_row, last_row : int
        The band, half-open.
    blocks : tuple
        Arrays of this thread's `BrickCache`.
    families : (H * W,) ndarray
        Row of `corrected` by pixel; empty where no correction is needed.
    image, depth : (H, W, 4), (H, W) ndarray of float32
        Written.
    """
    # One long function: numba counts references to all arrays that a helper with several ways
    # out is handed, for every ray and every skip.
    places, owners, cells, near_names, around, starts, ids = blocks
    # Rays are clipped to the volume; samples outside would read beyond the arrays.
    box = np.zeros((2, 3), np.int64)
    deep, high, wide = labels.shape
    box[1, 0], box[1, 1], box[1, 2] = deep, high, wide
    bricks_high, bricks_wide = (high + 7) >> 3, (wide + 7) >> 3
    densities, objects = volume.reshape(-1), labels.reshape(-1)
    # In perspective the light's direction turns from pixel to pixel; else one serves all rays.
    turning = near > -np.inf
    width, height = image.shape[1], last_row - first_row
    picture, depths = image.reshape(-1), depth.reshape(-1)
    flat_table, flat_tints = table.reshape(-1), tints.reshape(-1)
    # Scratch of this band, one row a quantity; see ray_lanes.py.
    rays = np.zeros(RAY_ROWS * LANES)
    grids, pixels = np.zeros(LANES, np.int64), np.zeros(LANES, np.int32)
    lights, alive = np.zeros(3 * LANES, np.float32), np.zeros(LANES, np.bool_)
    n, spot = np.zeros(PLACE_ROWS * LANES, np.int32), np.zeros(SPOT_ROWS * LANES, np.float32)
    queue = np.zeros(QUEUE_ROWS * QUEUE, np.float32)
    names = np.zeros(NAME_ROWS * QUEUE, np.int32)
    v, colors = np.zeros(4 * LANES, np.float32), np.zeros(4 * LANES, np.float32)
    f = np.zeros(FLOAT_ROWS * LANES, np.float32)
    entries = np.zeros(ENTRY_ROWS * LANES, np.int32)
    # A tile is so narrow that the bricks behind it fit into the cache of bricks.
    pitch = np.sqrt(numbers[2, 0] ** 2 + numbers[2, 1] ** 2 + numbers[2, 2] ** 2)
    breadth = max(4, min(TILE, int(BREADTH / max(pitch, 1e-9))))
    tile, columns, at_pixel = 0, min(breadth, width), 0
    # Counts: samples that joined the queue, samples composited, cached bricks, lanes with a ray.
    waiting = start = used = running = 0
    over, lit = True, turning
    while True:
        # 1. Lanes whose ray has ended take the next pixel whose ray meets the volume.
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
                # The ray misses the volume, or clipping planes leave nothing of it.
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
                # Length of a step in mm, for opacity correction, and the light along the ray.
                wz, wy, wx = dz * look[2], dy * look[3], dx * look[4]
                speed = np.sqrt(wz * wz + wy * wy + wx * wx)
                if families.size:
                    families[pixels[i]] = family_of(speed * step / look[5], exponents)
                lights[i], lights[LANES + i] = wz / speed, wy / speed
                lights[2 * LANES + i] = wx / speed
            running += alive[i]
            if not alive[i]:
                # A lane without a ray stands at the first voxel, where no read is out of bounds.
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
        # When cached bricks run out all of them are dropped, and the queue refers to their slots:
        # it is composited to its end first.
        drain = running == 0 or used > CAPACITY - LANES
        if not drain:
            # 2. One sample a lane: its voxel, its brick and where in the cell it lies.
            place(rays, step, bricks_high, bricks_wide, n, spot)
            # 3. Cache the bricks that are new; skip over those in which nothing is visible.
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
            # 4. Queue the samples whose label is visible, as bits without a branch, and advance.
            bits = see(near_names, shown, n)
            there, ended = forward(rays, K, END, n, SLOT)
            waiting = queue_up(
                bits & there, n, spot, pixels, lights, turning, waiting, queue, names
            )
            over = ended != 0
        # 5. Interpolate, light and composite a full chunk; opaque rays end early.
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
