"""The tightest box around points, turned any way: how things lie and which face is largest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, Vector

MOST_FACES = 400
"""Hull faces tried; more are thinned out evenly by area."""


@dataclass(frozen=True, eq=False)
class OrientedBox:
    """A box turned any way.

    Parameters
    ----------
    center : (3,) ndarray of float64
        World mm.
    axes : (3, 3) ndarray of float64
        Rows are its unit axes in world, longest edge first; a proper rotation.
    size : (3,) ndarray of float64
        Edge lengths in mm, descending.
    """

    center: Vector
    axes: Matrix
    size: Vector

    @property
    def normal(self) -> Vector:
        """Normal of the largest face: the axis of the shortest edge."""
        return self.axes[2]


def outline(mask: NDArray[np.bool_], origin: ArrayLike, spacing: ArrayLike) -> NDArray[np.float64]:
    """Return the points of a mask that can lie on its hull.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        A crop around an object.
    origin : (3,) array_like
        Voxel coordinates of the crop's first voxel.
    spacing : (3,) array_like
        Voxel size in mm, z y x.

    Returns
    -------
    (n, 3) ndarray of float64
        World mm, z y x: the two ends of every row, as voxel centres.
    """
    z, y = np.nonzero(mask.any(axis=2))
    rows = mask[z, y]
    first = rows.argmax(axis=1)
    last = mask.shape[2] - 1 - rows[:, ::-1].argmax(axis=1)
    points = np.concatenate([np.stack([z, y, first], 1), np.stack([z, y, last], 1)])
    return (points + np.asarray(origin)) * np.asarray(spacing, dtype=np.float64)


def oriented_box(points: ArrayLike, thickness: ArrayLike = (0.0, 0.0, 0.0)) -> OrientedBox:
    """Find the box of least volume with one face on the hull.

    Parameters
    ----------
    points : (n, 3) array_like
        World mm, at least one.
    thickness : (3,) array_like
        Size in mm of what each point stands for (the voxel), z y x.

    Returns
    -------
    OrientedBox

    Notes
    -----
    Every face of the convex hull is tried as a side of the box, with the least rectangle around
    its projection (whose side lies on the projection's hull). Exact for boxes; for other shapes
    within a few per cent of the least box, whose sides may touch edges only.
    """
    cloud = np.asarray(points, dtype=np.float64)
    # A cross for every point keeps the hull solid, however flat the points are.
    half = np.maximum(np.asarray(thickness, dtype=np.float64), 1e-3) / 2
    vertices = _hull_vertices(cloud)
    solid = (vertices[:, None] + np.concatenate([np.diag(half), -np.diag(half)])[None]).reshape(
        -1, 3
    )
    from scipy.spatial import ConvexHull

    hull = ConvexHull(solid)
    corner_points = solid[hull.vertices]
    best: tuple[float, Matrix] | None = None
    for normal in _distinct(hull.equations[:, :3]):
        axes = _least_rectangle(corner_points, normal)
        extent = np.ptp(corner_points @ axes.T, axis=0)
        volume = float(np.prod(extent))
        if best is None or volume < best[0] * (1 - 1e-9):
            best = volume, axes
    assert best is not None
    axes = best[1]
    along = corner_points @ axes.T
    size = np.ptp(along, axis=0)
    order = np.argsort(-size, kind="stable")
    middle = (along.min(0) + along.max(0)) / 2 @ axes
    axes = axes[order]
    if np.linalg.det(axes) < 0:
        axes[2] *= -1
    return OrientedBox(middle, axes, size[order])


def _hull_vertices(cloud: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.spatial import ConvexHull, QhullError

    if len(cloud) < 20:
        return cloud
    try:
        return cloud[ConvexHull(cloud).vertices]
    except QhullError:  # flat or in a line: the cross of every point makes it solid later
        return cloud


def _distinct(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    signs = np.sign(normals[np.arange(len(normals)), np.abs(normals).argmax(1)])
    unique = np.unique(np.round(normals * signs[:, None], 3), axis=0)
    step = max(1, -(-len(unique) // MOST_FACES))
    unique = np.concatenate([np.eye(3), unique[::step]])
    return unique / np.linalg.norm(unique, axis=1, keepdims=True)


def _least_rectangle(points: NDArray[np.float64], normal: Vector) -> Matrix:
    from scipy.spatial import ConvexHull

    helper = np.eye(3)[np.abs(normal).argmin()]
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    flat = points @ np.stack([u, v]).T
    rim = flat[ConvexHull(flat).vertices]
    edges = np.roll(rim, -1, axis=0) - rim
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    cosine, sine = np.cos(angles), np.sin(angles)
    along = np.outer(cosine, rim[:, 0]) + np.outer(sine, rim[:, 1])
    across = np.outer(-sine, rim[:, 0]) + np.outer(cosine, rim[:, 1])
    best = int((np.ptp(along, axis=1) * np.ptp(across, axis=1)).argmin())
    first = cosine[best] * u + sine[best] * v
    return np.stack([normal, first, np.cross(normal, first)])
