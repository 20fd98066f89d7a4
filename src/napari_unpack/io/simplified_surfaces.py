"""Surfaces of fewer triangles, and how far they may be from the ones they were."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Points = NDArray[np.float64]
Triangles = NDArray[np.int64]


def simplified(
    points: Points, triangles: Triangles, cell: float
) -> tuple[Points, Triangles, float]:
    """Make one point of all that lie in a cell of a grid and face the same way.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        mm.
    triangles : (m, 3) ndarray of int64
        Of a closed surface.
    cell : float
        Edge of the grid's cubes, mm.

    Returns
    -------
    points : (k, 3) ndarray of float64
        Each the mean of those that became it.
    triangles : (l, 3) ndarray of int64
    error : float
        How far a point was moved at most, mm. A triangle's inside moves no farther than its
        corners, so neither surface is farther than that from the other.

    Notes
    -----
    Rossignac and Borrel 1993, Multi-resolution 3D approximations for rendering complex scenes.
    Deviation: by facing as well, of six sides, so that the two faces of a sheet stay two.
    """
    facing = _normals(points, triangles)
    axis = np.abs(facing).argmax(axis=1)
    side = 2 * axis + (facing[np.arange(len(points)), axis] > 0)
    place = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    key = np.ravel_multi_index((*place.T, side), (*(place.max(axis=0) + 1), 6))
    _, became, count = np.unique(key, return_inverse=True, return_counts=True)
    made = np.stack([np.bincount(became, points[:, k]) / count for k in range(3)], axis=1)
    left = became[triangles]
    a, b, c = left.T
    left = left[(a != b) & (b != c) & (c != a)]
    if not len(left):
        # Smaller than a cell in every way: it would be gone.
        return points, triangles, 0.0
    used, renamed = np.unique(left, return_inverse=True)
    moved = np.linalg.norm(points - made[became], axis=1)
    gone = ~np.isin(became, used)
    if gone.any():
        # Of what has become a line or a point nothing is drawn there.
        moved[gone] = cKDTree(made[used]).query(points[gone])[0]
    return made[used], renamed.reshape(-1, 3), float(moved.max())


def _normals(points: Points, triangles: Triangles) -> NDArray[Any]:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    corners = triangles.ravel()
    return np.stack(
        [np.bincount(corners, np.repeat(normal[:, k], 3), len(points)) for k in range(3)], axis=1
    )
