"""Solidity: how much of its convex hull a shape fills."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.validation import Spacing


def solidity(mask: NDArray[np.bool_], spacing: Spacing) -> float:
    """Return volume over convex hull volume: 1 for a convex shape, below 0.5 for rings and shells.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        At least one voxel.
    spacing : (float, float, float) of mm, z y x
    """
    # Only voxels that end their rows along all axes can be corners of the hull, so the hull is
    # taken of those, and then of its corners moved half a voxel along each axis: the centres alone
    # would make a thin plate flat.
    corners = mask_corners(mask, np.zeros(3), spacing)
    filled = np.count_nonzero(mask) * float(np.prod(spacing)) / hull_volume(corners)
    # Hull and voxels round differently: a box may come out a little above 1.
    return min(filled, 1.0)


def mask_corners(
    mask: NDArray[np.bool_], first: NDArray[np.integer] | NDArray[np.float64], spacing: Spacing
) -> NDArray[np.float64]:
    """Return the corners of the convex hull of a mask's voxels.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        At least one voxel.
    first : (3,) ndarray
        Index of the mask's first voxel.
    spacing : (float, float, float) of mm, z y x

    Returns
    -------
    (K, 3) ndarray of float64
        mm. Face centres of voxels.
    """
    ends = _corners(_extremes(mask))
    moves = np.concatenate([np.eye(3), -np.eye(3)]) / 2
    return _corners((ends[:, None, :] + moves + first).reshape(-1, 3) * np.array(spacing))


# Along which the furthest points are sought; on a Fibonacci lattice.
DIRECTIONS = 96


def support_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the few points of many that reach furthest along directions all over the sphere.

    Parameters
    ----------
    points : (N, 3) ndarray of float64
        mm.

    Returns
    -------
    (K, 3) ndarray of float64
        At most `DIRECTIONS` of the points. Their hull has all of a box, and 95 % of a ball. Where
        they lie in a plane and the points do not, the corners of the points' hull.
    """
    # No more points than directions: there is nothing to gain.
    if len(points) <= DIRECTIONS:
        return points
    # Every turn by the golden angle, which spreads directions evenly over the sphere.
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / DIRECTIONS, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z * z)
    directions = np.stack([z, ring * np.cos(turn), ring * np.sin(turn)])
    found = np.asarray(points[np.unique(np.argmax(points @ directions, axis=0))])
    # Of what is hundreds of times longer than wide every direction finds an end.
    return found if np.linalg.matrix_rank(found - found[0]) == 3 else _corners(points)


def hull_volume(corners: NDArray[np.float64]) -> float:
    """Return the volume of the convex hull of at least four points not in a plane."""
    return float(ConvexHull(corners).volume)


def _corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    # So few points cost less to carry than a hull costs to find.
    if len(points) <= 12:
        return points
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        # All in a plane: each may be a corner.
        return points


def _extremes(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the voxels, (N, 3), that are first or last of their rows along all three axes."""
    nz, ny, nx = mask.shape
    # First and last of every row; -1 where it has none. Made here: in a kernel an array costs as
    # much to compile as a loop.
    along_z, along_y, along_x = (
        np.full((*rows, 2), -1, np.int32) for rows in ((ny, nx), (nz, nx), (nz, ny))
    )
    _find_ends(np.ascontiguousarray(mask), along_z, along_y, along_x)
    z, y = np.nonzero(along_x[..., 0] >= 0)
    ends = along_x[z, y]
    z, y, x = np.repeat(z, 2), np.repeat(y, 2), ends.reshape(-1)
    at_z, at_y = along_z[y, x], along_y[z, x]
    found = (z == at_z[:, 0]) | (z == at_z[:, 1])
    found &= (y == at_y[:, 0]) | (y == at_y[:, 1])
    # A row of one voxel has one end.
    found[1::2] &= ends[:, 0] != ends[:, 1]
    return np.stack([z[found], y[found], x[found]], axis=1).astype(np.float64)


@njit(cache=True, nogil=True)
def _find_ends(mask, along_z, along_y, along_x):  # type: ignore[no-untyped-def]
    """Find the first and the last voxel of every row along every axis."""
    depth, height, width = mask.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                if mask[z, y, x]:
                    if along_z[y, x, 0] < 0:
                        along_z[y, x, 0] = z
                    if along_y[z, x, 0] < 0:
                        along_y[z, x, 0] = y
                    if along_x[z, y, 0] < 0:
                        along_x[z, y, 0] = x
                    along_z[y, x, 1] = z
                    along_y[z, x, 1] = y
                    along_x[z, y, 1] = x
