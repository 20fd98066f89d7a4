"""From the matrices a canvas draws with to a `geometry.Camera`, and back to a napari camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from napari_unpack.geometry.axes import Matrix, Vector, transform_points, unit
from napari_unpack.geometry.view import Camera


@dataclass(frozen=True, eq=False)
class Frame:
    """What a canvas showed when a layer was last drawn on it.

    Parameters
    ----------
    camera : Camera
        The viewer's camera in the session's world, mm.
    size : (int, int)
        Height and width of the view in device pixels.
    clip_from_pivot : (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1; mm) to clip space (x, y, z, w).
    """

    camera: Camera
    size: tuple[int, int]
    clip_from_pivot: Matrix

    def same_as(self, other: Frame | None) -> bool:
        """Return whether another frame would show the same picture."""
        return (
            other is not None and self.size == other.size and same_camera(self.camera, other.camera)
        )


def same_camera(a: Camera, b: Camera) -> bool:
    """Return whether two cameras see the same to within a thousandth of a pixel or so."""
    scale = 1e-6 * a.height
    return bool(
        np.allclose(a.rotation, b.rotation, rtol=0, atol=1e-6)
        and np.allclose(a.center, b.center, rtol=0, atol=scale)
        and abs(a.height - b.height) <= scale
        and abs(a.fov - b.fov) <= 1e-4
    )


def camera_from_render(render_from_world: ArrayLike, center: ArrayLike) -> Camera:
    """Read a camera out of the matrix a canvas draws with.

    Parameters
    ----------
    render_from_world : (4, 4) array_like
        From world mm (x, y, z, 1) to clip space (x right, y up, z away, w), acting on column
        vectors. The map before the projection must be a similarity.
    center : (3,) array_like
        World point the camera turns about, mm z y x; it is in the middle of the picture.

    Returns
    -------
    Camera

    Raises
    ------
    ValueError
        If the matrix projects nothing (its rows are zero or not finite).
    """
    matrix = np.asarray(render_from_world, dtype=np.float64)[:, [2, 1, 0, 3]]
    if not np.isfinite(matrix).all() or not matrix[1, :3].any() or not matrix[3].any():
        raise ValueError(f"render_from_world must be a projection, got {render_from_world!r}")
    middle = np.asarray(center, dtype=np.float64)
    up, depth, last = matrix[1, :3], matrix[2, :3], matrix[3]
    if np.linalg.norm(last[:3]) <= 1e-9 * abs(last[3]):
        up, depth = up / last[3], depth / last[3]
        away, height, fov = unit(depth), 2 / float(np.linalg.norm(up)), 0.0
    else:
        per_mm = float(np.linalg.norm(last[:3]))
        away = last[:3] / per_mm
        tangent = per_mm / float(np.linalg.norm(up))
        distance = float(last[:3] @ middle + last[3]) / per_mm
        height, fov = 2 * distance * tangent, float(np.degrees(2 * np.arctan(tangent)))
    down = unit(away * (up @ away) - up)
    return Camera(np.stack([-away, down, np.cross(-away, down)]), middle, height, fov)


def similarity(matrix: Matrix) -> tuple[float, Matrix] | None:
    """Split the linear part of an affine into scale and rotation; None if it is no similarity.

    Parameters
    ----------
    matrix : (4, 4) ndarray of float64

    Returns
    -------
    (float, (3, 3) ndarray) or None
        Scale and proper rotation.
    """
    linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
    determinant = float(np.linalg.det(linear))
    if determinant <= 0:
        return None
    scale = determinant ** (1 / 3)
    rotation = linear / scale
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
        return None
    return scale, rotation


def napari_view(
    camera: Camera, napari_from_world: Matrix, view_height: float
) -> tuple[Vector, float, Vector, Vector]:
    """Return what to set on a napari camera so that it shows what a `Camera` shows.

    Parameters
    ----------
    camera : Camera
        In the session's world, mm.
    napari_from_world : (4, 4) ndarray of float64
        A similarity from the session's world to napari's.
    view_height : float
        Height of the view in logical pixels.

    Returns
    -------
    center : (3,) ndarray
    zoom : float
        Logical pixels per unit of napari's world.
    direction, up : (3,) ndarray
        Of looking, and up in the picture.
    """
    linear = napari_from_world[:3, :3]
    scale = float(np.linalg.det(linear)) ** (1 / 3)
    center = transform_points(napari_from_world, camera.center)
    zoom = view_height / (camera.height * scale)
    return center, zoom, unit(linear @ camera.direction), unit(linear @ camera.up)
