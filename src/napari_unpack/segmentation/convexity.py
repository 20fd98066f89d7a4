"""Solidity: how much of its convex hull a shape fills."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from napari_unpack.segmentation.checks import Spacing


def solidity(mask: NDArray[np.bool_], spacing: Spacing) -> float:
    """Return volume over convex hull volume, in (0, 1].

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        At least one voxel.
    spacing : (float, float, float)
        Voxel size z y x, mm.

    Returns
    -------
    float
        1 for a convex shape, 0.5 and less for rings, shells and crumpled cloth.

    Notes
    -----
    Only the ends of every row along x can be corners of the hull, so the hull is taken of those,
    and then of its corners moved half a voxel along each axis: the centres alone would make a
    thin plate flat.
    """
    ends = _row_ends(mask)
    corners = ends
    try:
        if len(ends) > 32:
            corners = ends[ConvexHull(ends).vertices]
    except QhullError:
        corners = ends
    moves = np.concatenate([np.eye(3), -np.eye(3)]) / 2
    points = (corners[:, None, :] + moves).reshape(-1, 3) * np.array(spacing)
    hull = ConvexHull(points).volume
    return float(min(np.count_nonzero(mask) * np.prod(spacing) / hull, 1.0))


def _row_ends(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    rows = np.stack(np.nonzero(mask.any(axis=2)), axis=1)
    lines = mask[rows[:, 0], rows[:, 1]]
    first = lines.argmax(axis=1)
    last = mask.shape[2] - 1 - lines[:, ::-1].argmax(axis=1)
    both = [np.column_stack([rows, first]), np.column_stack([rows, last])]
    return np.unique(np.concatenate(both), axis=0).astype(np.float64)
