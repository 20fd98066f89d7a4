"""Object-ID layers: the distinct objects on every ray, nearest first (Li et al. 2012, section 4.2).

A ray skips what is uniform (bricks of one object, empty space) and reads labels only in bricks
where objects meet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Bricks
from napari_unpack.rendering.cpu.ray_sampling import (
    TILE,
    band_of,
    clipping_planes,
    leap,
    leap_along,
    octant_of,
    per_voxel,
    position,
    ray_numbers,
    ray_of,
    sample_range,
)
from napari_unpack.rendering.cpu.space_skipping import DirectionalSkipping
from napari_unpack.rendering.cpu.thread_pool import over_bands

# Labels that are read together: those of a brick, but for rays of very short steps.
AHEAD = 16


def ground(
    labels: NDArray[np.uint16], bricks: Bricks | None, visible: NDArray[np.bool_], rays: Rays
) -> tuple[Any, ...]:
    """Return what `stretch` walks over, in the order in which it takes it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    bricks : Bricks, optional
        Of these labels. Without them every sample is looked at.
    visible : (M,) ndarray of bool
        By ID; the background is not visible.
    rays : Rays

    Returns
    -------
    tuple
        Labels, owners, reach, slots, axis (`DirectionalSkipping`), starts, ids (`Bricks`), words,
        first, bits (`CompressedLabels`); empty but for the labels where there are no bricks.
    """
    if bricks is None:
        none = DirectionalSkipping.none()
        long, short = np.zeros(0, np.int64), np.zeros(0, np.uint8)
        return (
            labels, np.zeros((0, 0, 0), np.int32), none.grids, none.slots, none.axis,
            long, np.zeros(0, np.uint16), np.zeros(0, np.uint64), long, short,
        )  # fmt: skip
    owners = bricks.owners(visible)
    ahead, packed = DirectionalSkipping.of(owners, rays), bricks.packed(labels)
    return (
        labels, owners, ahead.grids, ahead.slots, ahead.axis,
        bricks.starts, bricks.ids, packed.words, packed.first, packed.bits,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def bricks_ahead(  # type: ignore[no-untyped-def]
    owners, reach, grid, axis, k, step, pz, py, px, dz, dy, dx, az, ay, ax
):
    """Look at the bricks that lie at sample k and from there on.

    `grid` is the one of `reach` that serves the ray, az, ay, ax are `per_voxel`. Returns whose
    they are (0 no object's that is visible, -1 the brick is mixed), the first sample that may lie
    elsewhere, and the brick.

    Parameters
    ----------
    owners : (Bz, By, Bx) ndarray of int32
        From `Bricks.owners`.
    reach, grid, axis
        Of `DirectionalSkipping`; the grid that serves the ray.
    k, step : int, float
        Number of the sample, and distance of samples, mm.
    pz, py, px, dz, dy, dx : float
        The ray, voxels.
    az, ay, ax : float
        From `per_voxel`.
    """
    _, vz, vy, vx = position(k, 0.5, step, pz, py, px, dz, dy, dx)
    z, y, x = int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)
    bz, by, bx = np.uint64(z >> 3), np.uint64(y >> 3), np.uint64(x >> 3)
    own = int(owners[bz, by, bx])
    layers = int(reach[grid, bz, by, bx])
    if axis >= 0 and layers > 1:
        if axis == 0:
            beyond = leap_along(layers - 1, z, k, 0.5, pz, az)
        elif axis == 1:
            beyond = leap_along(layers - 1, y, k, 0.5, py, ay)
        else:
            beyond = leap_along(layers - 1, x, k, 0.5, px, ax)
    else:
        beyond = leap(max(layers, 1), z, y, x, k, 0.5, pz, py, px, az, ay, ax)
    rows, columns = np.uint64(owners.shape[1]), np.uint64(owners.shape[2])
    return own, beyond, (bz * rows + by) * columns + bx


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def read_compressed(  # type: ignore[no-untyped-def]
    words, place, shift, ids, start, k, beyond, step, pz, py, px, dz, dy, dx, ahead
):
    """Read the labels of samples k to `beyond` - 1, all in one brick, into `ahead` (AHEAD,) int64.

    `place` and `shift` are the brick's `CompressedLabels.first` and `bits`, `start` its
    `Bricks.starts`.

    Parameters
    ----------
    words, place, shift
        Of `CompressedLabels`: words, and the brick's `first` and `bits`.
    ids, start
        Of `Bricks`, and the brick's `starts`.
    k, beyond : int
        First sample, and the one after the last.
    step, pz, py, px, dz, dy, dx : float
        Distance of samples, mm, and the ray, voxels.
    ahead : (AHEAD,) ndarray of int64
        Written.
    """
    seven, six = np.int64(7), np.uint64(6)
    mask = np.uint64((np.int64(1) << (np.int64(1) << shift)) - 1)
    at = float(k)
    for i in range(AHEAD):
        t = (at + i + 0.5) * step
        z = np.int64(pz + t * dz + 0.5) & seven
        y = np.int64(py + t * dy + 0.5) & seven
        # All those wanted are in the brick; for the others any voxel of it will do.
        ahead[i] = ((z << 6) | (y << 3) | (np.int64(px + t * dx + 0.5) & seven)) << shift
    for i in range(beyond - k):
        bit = np.uint64(ahead[i])
        number = (words[place + (bit >> six)] >> (bit & np.uint64(63))) & mask
        ahead[i] = np.int64(ids[start + number])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def read_labels(flat, high, wide, k, beyond, step, pz, py, px, dz, dy, dx, ahead):  # type: ignore[no-untyped-def]
    """Read the labels of samples k to `beyond` - 1 into `ahead` (AHEAD,) int64.

    All at once: most of them miss the cache, and so they miss it together.

    Parameters
    ----------
    flat : (Z * Y * X,) ndarray of uint16
        Labels.
    high, wide : int
        Their shape along y and x.
    k, beyond : int
        First sample, and the one after the last.
    step, pz, py, px, dz, dy, dx : float
        Distance of samples, mm, and the ray, voxels.
    ahead : (AHEAD,) ndarray of int64
        Written.
    """
    first, last = float(k), float(beyond - 1)
    for i in range(AHEAD):
        t = (min(first + i, last) + 0.5) * step
        plane, line = np.int64(pz + t * dz + 0.5), np.int64(py + t * dy + 0.5)
        ahead[i] = (plane * high + line) * wide + np.int64(px + t * dx + 0.5)
    for i in range(AHEAD):
        ahead[i] = np.int64(flat[np.uint64(ahead[i])])


def id_layers(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    layers: int = 1,
    bricks: Bricks | None = None,
    clipping: ArrayLike | None = None,
    threads: int | None = None,
) -> NDArray[np.int32]:
    """List the distinct visible objects on every ray, nearest first.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    rays : Rays
        Of the image, in voxels.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False. Hidden objects are as air.
    layers : int
        How many objects of a ray to list.
    bricks : Bricks, optional
        Of these labels; saves visiting what is uniform, changes nothing.
    clipping : (N, 2, 3) array_like, optional
        Planes (point, normal) in voxels; what lies behind one is cut away.
    threads : int, optional
        Workers, by default one a core.

    Returns
    -------
    (layers, H, W) ndarray of int32
        The k-th distinct object on each ray, 0 where there is none.

    Notes
    -----
    Every sample counts as opaque (section 4.2). Peeling is per pixel: an object is listed in
    different layers on different rays.
    """
    table, step, near = ray_numbers(rays)
    out = np.zeros((layers, *rays.size), np.int32)
    over = ground(labels, bricks, visible, rays)
    planes = clipping_planes(clipping)

    def work(_: None, first: int, last: int) -> None:
        _cast(*over, table, step, near, planes, visible, first, last, out)  # type: ignore[call-arg]

    over_bands(rays.size[0], work, lambda: None, threads, band_of(rays.size[0]))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _cast(  # type: ignore[no-untyped-def]
    labels, owners, reach, octants, axis, starts, ids, words, firsts, bits,
    table, step, near, planes, visible, first, last, out,
):  # fmt: skip
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = owners.size > 0
    flat, (_, high, wide) = labels.reshape(-1), labels.shape
    ahead = np.zeros(AHEAD, np.int64)
    height, width = last - first, out.shape[2]
    for tile in range(0, width, TILE):
        columns = min(TILE, width - tile)
        for pixel in range(height * columns):
            row, col = first + pixel // columns, tile + pixel % columns
            pz, py, px, dz, dy, dx = ray_of(table, row, col)
            k, end = sample_range(box, planes, step, near, 0.5, pz, py, px, dz, dy, dx)
            found = 0
            previous = 0
            az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
            grid = octants[octant_of(az, ay, ax)]
            # Go from stretch to stretch of one label until enough objects are found.
            while k < end:
                label, beyond, brick = -1, end, np.uint64(0)
                if skip:
                    label, beyond, brick = bricks_ahead(
                        owners, reach, grid, axis, k, step, pz, py, px, dz, dy, dx, az, ay, ax
                    )
                    beyond = min(beyond, end)
                # A uniform stretch is one label; in a mixed brick up to AHEAD labels are read.
                stops = 1
                if label >= 0:
                    ahead[0] = label
                else:
                    beyond = min(beyond, k + AHEAD)
                    stops = beyond - k
                    if skip:
                        place, start = np.uint64(firsts[brick]), np.uint64(starts[brick])
                        read_compressed(
                            words, place, np.int64(bits[brick]), ids, start,
                            k, beyond, step, pz, py, px, dz, dy, dx, ahead,
                        )  # fmt: skip
                    else:
                        read_labels(
                            flat, high, wide, k, beyond, step, pz, py, px, dz, dy, dx, ahead
                        )
                k = beyond
                for stop in range(stops):
                    label = ahead[stop]
                    if label == previous:
                        continue
                    previous = label
                    # Hidden objects are as air.
                    if not visible[label]:
                        continue
                    # A layer lists each object once; lists are too short for a table.
                    known = False
                    for i in range(found):
                        if out[i, row, col] == label:
                            known = True
                            break
                    if not known:
                        out[found, row, col] = label
                        found += 1
                        if found == out.shape[0]:
                            k = end
                            break
