"""Object-ID layers: which objects a pixel's ray meets, first to last.

Li et al. 2012, section 4.2: the image of front faces' IDs and, by depth peeling, those behind.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

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
        Of the picture, in voxels.
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
            while k < end:
                label, free, brick = -1, end, np.uint64(0)
                if skip:
                    label, free, brick = outlook(
                        owners, reach, grid, axis, k, step, pz, py, px, dz, dy, dx, az, ay, ax
                    )
                    free = min(free, end)
                stops = 1
                if label >= 0:
                    ahead[0] = label
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
                    if label == previous:
                        continue
                    previous = label
                    if not visible[label]:
                        continue
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
