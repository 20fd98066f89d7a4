"""The mask of least cost and boundary: a minimum cut, by convex total variation."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def least_boundary(
    cost: NDArray[np.float32],
    matter: NDArray[np.bool_],
    price: float,
    faces: tuple[float, float, float],
    active: NDArray[np.bool_],
    rounds: int = 200,
    close: float = 0.01,
) -> NDArray[np.bool_]:
    """Choose the voxels that cost least together with the boundary around them.

    Parameters
    ----------
    cost : (Z, Y, X) ndarray of float32
        Of every voxel that is chosen; negative where it should be.
    matter : (Z, Y, X) ndarray of bool
        Choice to begin with, kept where not `active`.
    price : float
        Of a face between a chosen voxel and one that is not.
    faces : tuple of float
        By axis, the area of a face.
    active : (Z, Y, X) ndarray of bool
        Where there is a choice.
    rounds : int
        Iterations at most.
    close : float
        Done when no value changed by more than this in ten iterations.

    Returns
    -------
    (Z, Y, X) ndarray of bool

    Notes
    -----
    min sum c u + price sum |u_i - u_j| over u in [0, 1] is convex, and the set where its solution
    exceeds 1/2 is a minimum cut (Chan, Esedoglu & Nikolova 2006). First-order primal-dual
    iteration (Chambolle & Pock 2011, algorithm 1), steps 0.28: their product times the 12 that
    bounds the squared norm of the differences is below 1.
    """
    # No boundary is worth more than all faces of a voxel: beyond that its own cost decides.
    clear = np.abs(cost) > 2 * price * sum(faces)
    u = np.where(active & clear, cost < 0, matter).astype(np.float32)
    active = active & ~clear
    ahead = u.copy()
    dual = np.zeros((3, *u.shape), np.float32)
    bounds = np.array(faces, np.float32) * np.float32(price)
    # A voxel's dual variables live on the edges behind it, active where either end is.
    edges = active.copy()
    for axis in range(3):
        np.moveaxis(edges, axis, 0)[1:] |= np.moveaxis(active, axis, 0)[:-1]
    ends, voxels = np.flatnonzero(edges), np.flatnonzero(active)
    scale = np.float32(1.0 / max(price, 1e-12))
    for k in range(0, rounds, 10):
        for _ in range(9):
            _ascend(dual, ahead, bounds * scale, ends)
            _descend(cost, dual, u, ahead, scale, voxels)
        _ascend(dual, ahead, bounds * scale, ends)
        change = _descend(cost, dual, u, ahead, scale, voxels)
        if change <= close / 10 and k:
            break
    return np.asarray(u > 0.5)


@njit(cache=True, nogil=True)
def _ascend(dual, ahead, bounds, ends):  # type: ignore[no-untyped-def]
    height, width = ahead.shape[1], ahead.shape[2]
    step = np.float32(0.28)
    for n in ends:
        x = n % width
        y = (n // width) % height
        z = n // (width * height)
        here = ahead[z, y, x]
        if z > 0:
            value = dual[0, z, y, x] + step * (here - ahead[z - 1, y, x])
            dual[0, z, y, x] = min(max(value, -bounds[0]), bounds[0])
        if y > 0:
            value = dual[1, z, y, x] + step * (here - ahead[z, y - 1, x])
            dual[1, z, y, x] = min(max(value, -bounds[1]), bounds[1])
        if x > 0:
            value = dual[2, z, y, x] + step * (here - ahead[z, y, x - 1])
            dual[2, z, y, x] = min(max(value, -bounds[2]), bounds[2])


@njit(cache=True, nogil=True)
def _descend(cost, dual, u, ahead, scale, voxels):  # type: ignore[no-untyped-def]
    depth, height, width = u.shape
    step = np.float32(0.28)
    largest = np.float32(0)
    for n in voxels:
        x = n % width
        y = (n // width) % height
        z = n // (width * height)
        slope = scale * cost[z, y, x] + dual[0, z, y, x] + dual[1, z, y, x] + dual[2, z, y, x]
        if z + 1 < depth:
            slope -= dual[0, z + 1, y, x]
        if y + 1 < height:
            slope -= dual[1, z, y + 1, x]
        if x + 1 < width:
            slope -= dual[2, z, y, x + 1]
        old = u[z, y, x]
        fresh = min(max(old - step * slope, np.float32(0)), np.float32(1))
        largest = max(largest, abs(fresh - old))
        ahead[z, y, x] = 2 * fresh - old
        u[z, y, x] = fresh
    return largest
