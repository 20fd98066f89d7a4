"""The tightest box around points, turned any way, and how an unpacked object is held up by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.transforms import rotation_about

# Hull faces tried; more are thinned out evenly by area.
MOST_FACES = 400
# Of more points than these only the outermost along so many directions are looked at.
MOST_POINTS = 500
# Turns, over a right angle, by which faces are judged before the best are looked at closely.
ANGLES = 16
# Faces looked at closely.
FINALISTS = 12


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
    """Return the points of a mask that can lie on its hull, (n, 3) mm: the ends of every row.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        A box around an object.
    origin : (3,) array_like
        Voxel coordinates of the box's first voxel.
    spacing : (3,) array_like, mm z y x
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

    Notes
    -----
    Every face of the convex hull is tried as a side of the box: all at a few turns, and the
    best of them with the least rectangle around its projection (whose side lies on the
    projection's hull). Exact for boxes; for other shapes within a few per cent of the least box,
    whose sides may touch edges only. Everything lies within the box, whichever was found.
    """
    cloud = np.asarray(points, dtype=np.float64)
    # A cross for every point keeps the hull solid, however flat the points are.
    half = np.maximum(np.asarray(thickness, dtype=np.float64), 1e-3) / 2
    vertices = hull_vertices(cloud)
    solid = (vertices[:, None] + np.concatenate([np.diag(half), -np.diag(half)])[None]).reshape(
        -1, 3
    )
    from scipy.spatial import ConvexHull

    hull = ConvexHull(solid)
    corner_points = solid[hull.vertices]
    best: tuple[float, Matrix] | None = None
    # A single layer of voxels lies as they do; crosses alone would let the box tilt against them.
    flat = np.ptp(cloud, axis=0) == 0
    normals = np.eye(3)[flat]
    if not flat.any():
        normals = _tightest(corner_points, _distinct(hull.equations[:, :3]))
    for normal in normals:
        axes = np.eye(3) if flat.sum() > 1 else least_rectangle(corner_points, normal)
        extent = np.ptp(corner_points @ axes.T, axis=0)
        volume = float(np.prod(extent))
        if best is None or volume < best[0] * (1 - 1e-9):
            best = volume, axes
    assert best is not None
    axes = best[1]
    along = cloud @ axes.T
    low, high = along.min(0), along.max(0)
    size = high - low + 2 * (np.abs(axes) * half).max(axis=1)
    order = np.argsort(-size, kind="stable")
    middle = (low + high) / 2 @ axes
    axes = axes[order]
    if np.linalg.det(axes) < 0:
        axes[2] *= -1
    return OrientedBox(middle, axes, size[order])


def hull_vertices(points: ArrayLike) -> NDArray[np.float64]:
    """Return the (m, 3) corners of a cloud's convex hull; all points where they are few, or flat.

    Of round things only some, within half a per cent.
    """
    from scipy.spatial import ConvexHull, QhullError

    cloud = _outermost(np.asarray(points, dtype=np.float64))
    if len(cloud) < 20:
        return cloud
    try:
        return cloud[ConvexHull(cloud).vertices]
    except QhullError:  # flat or in a line: it has no volume
        return cloud


def _outermost(cloud: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a cloud that are outermost along one of many directions.

    Round things have thousands of corners; what is lost is half a per cent of a radius.
    """
    if len(cloud) <= MOST_POINTS:
        return cloud
    # A spiral of equal areas over the sphere, and the axes.
    k = np.arange(MOST_POINTS) + 0.5
    z = 1 - 2 * k / MOST_POINTS
    turn = np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - z * z)
    ways = np.stack([z, flat * np.cos(turn), flat * np.sin(turn)], 1)
    ways = np.concatenate([ways, np.eye(3), -np.eye(3)]).astype(np.float32)
    centred = (cloud - cloud.mean(axis=0)).astype(np.float32)
    # Few directions at a time: all at once take 4 kB a point.
    furthest = [_along(few, centred).argmax(axis=1) for few in np.array_split(ways, 32)]
    return cloud[np.unique(np.concatenate(furthest))]


def _tightest(points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals of the faces whose boxes are the least at a few turns, least first."""
    if len(normals) <= FINALISTS:
        return normals
    u, v = _across(normals)
    angles = np.arange(ANGLES) * (np.pi / 2 / ANGLES)
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    cloud = (points - points.mean(axis=0)).astype(np.float32)

    def width(ways: NDArray[np.float64]) -> NDArray[np.float32]:
        along = _along(ways.reshape(-1, 3).astype(np.float32), cloud)
        extent: NDArray[np.float32] = np.ptp(along, axis=1).reshape(ways.shape[:-1])
        return extent

    area = (width(cosine * u + sine * v) * width(cosine * v - sine * u)).min(axis=0)
    order = np.argsort(area * width(normals), kind="stable")
    return normals[order[:FINALISTS]]


def _along(ways: NDArray[np.float32], cloud: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (n, m) how far m points lie along n ways.

    As sums and not as a product of matrices, which libraries hand to threads of their own: beside
    the ray casters' those take ten times as long.
    """
    z, y, x = cloud.T
    along: NDArray[np.float32] = ways[:, :1] * z
    along += ways[:, 1:2] * y
    along += ways[:, 2:] * x
    return along


def _across(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two (n, 3) unit vectors across each of (n, 3) unit normals and each other."""
    helper = np.eye(3)[np.abs(normals).argmin(axis=-1)]
    u = np.cross(normals, helper)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    return u, np.cross(normals, u)


def _distinct(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    signs = np.sign(normals[np.arange(len(normals)), np.abs(normals).argmax(1)])
    unique = np.unique(np.round(normals * signs[:, None], 3), axis=0)
    step = max(1, -(-len(unique) // MOST_FACES))
    unique = np.concatenate([np.eye(3), unique[::step]])
    return unique / np.linalg.norm(unique, axis=1, keepdims=True)


def least_rectangle(points: NDArray[np.float64], normal: Vector) -> Matrix:
    """Return the axes of the box with one given normal whose other faces are smallest.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        World mm.
    normal : (3,) ndarray of float64
        Unit vector.

    Returns
    -------
    (3, 3) ndarray of float64
        Unit vectors in rows, the normal first.
    """
    from scipy.spatial import ConvexHull

    u, v = _across(normal)
    flat = points @ np.stack([u, v]).T
    rim = flat[ConvexHull(flat).vertices]
    edges = np.roll(rim, -1, axis=0) - rim
    # One side of the smallest rectangle around a polygon lies along one of its edges.
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    cosine, sine = np.cos(angles), np.sin(angles)
    along = np.outer(cosine, rim[:, 0]) + np.outer(sine, rim[:, 1])
    across = np.outer(-sine, rim[:, 0]) + np.outer(cosine, rim[:, 1])
    best = int((np.ptp(along, axis=1) * np.ptp(across, axis=1)).argmin())
    first = cosine[best] * u + sine[best] * v
    return np.stack([normal, first, np.cross(normal, first)])


# Degrees about the axes right and down by which a top and a side are turned to the viewer, so that
# depth shows.
SLANT = (18.0, -24.0)


def broad_side(box: OrientedBox, seen: ArrayLike) -> Matrix:
    """Return the turn that shows an object's largest face, nearest to how it is seen now.

    Parameters
    ----------
    box : OrientedBox
        Around the object, (stretched) world.
    seen : (3, 3) array_like
        From world axes to pivot axes, as the object is seen now (the camera's rotation).

    Returns
    -------
    (3, 3) ndarray of float64
        From world axes to pivot axes (towards the viewer, down, right).
    """
    now = np.asarray(seen, dtype=np.float64)
    best, fit = now, -np.inf
    for towards in (box.axes[2], -box.axes[2]):
        for right in (box.axes[0], -box.axes[0], box.axes[1], -box.axes[1]):
            # In (towards, down, right), down = right x towards keeps the turn proper.
            turn = np.stack([towards, np.cross(right, towards), right])
            alike = float((turn * now).sum())
            if alike > fit + 1e-9:
                best, fit = turn, alike
    about_right = rotation_about((0.0, 0.0, 1.0), np.radians(SLANT[0]))
    about_down = rotation_about((0.0, 1.0, 0.0), np.radians(SLANT[1]))
    return about_right @ about_down @ best


def image_extent(
    points: ArrayLike, rotation: Matrix, spacing: ArrayLike, middle: ArrayLike
) -> tuple[float, float]:
    """Return width and height in mm of the image of points held at a turn.

    Parameters
    ----------
    points : (n, 3) array_like
        Voxel centres, world mm.
    rotation : (3, 3) ndarray of float64
        From world axes to pivot axes, a stretch of the bag included.
    spacing : (3,) array_like
        Voxel size in mm, added around the centres.
    middle : (3,) array_like
        World point that stands in the middle of the image, which reaches as far to both sides.
    """
    away = (
        np.asarray(points, dtype=np.float64) - np.asarray(middle, dtype=np.float64)
    ) @ rotation.T
    extent = 2 * np.abs(away).max(axis=0)
    extent += np.abs(rotation) @ np.asarray(spacing, dtype=np.float64)
    return float(extent[2]), float(extent[1])
