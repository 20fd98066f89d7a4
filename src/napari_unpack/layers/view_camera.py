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
    corner : (float, float), optional
        Where the view begins in the canvas, row and column in device pixels: in napari's grid
        every layer has a view of its own.
    """

    camera: Camera
    size: tuple[int, int]
    clip_from_pivot: Matrix
    corner: tuple[float, float] = (0.0, 0.0)

    def same_as(self, other: Frame | None) -> bool:
        """Return whether another frame would show the same image at the same place."""
        return self is other or (
            other is not None
            and (self.size, self.corner) == (other.size, other.corner)
            and same_camera(self.camera, other.camera)
        )

    def holds(self, row: float, col: float) -> bool:
        """Return whether a pixel lies in it.

        Parameters
        ----------
        row, col : float
        """
        return 0 <= round(row) < self.size[0] and 0 <= round(col) < self.size[1]


# Relative lengths that differ by less count as equal.
ALIKE = 1e-5


def same_camera(a: Camera, b: Camera) -> bool:
    """Return whether two cameras see the same to within a thousandth of a pixel or so.

    Parameters
    ----------
    a, b : Camera
    """
    # A millionth of the view is a thousandth of a pixel of 1000.
    scale = 1e-6 * a.height
    return bool(
        np.allclose(a.rotation, b.rotation, rtol=0, atol=1e-6)
        and np.allclose(a.stretch, b.stretch, rtol=0, atol=1e-6)
        and np.allclose(a.center, b.center, rtol=0, atol=scale)
        and abs(a.height - b.height) <= scale
        and abs(a.fov - b.fov) <= 1e-4
    )


def camera_from_render(render_from_world: ArrayLike, center: ArrayLike) -> Camera:
    """Read a camera out of the matrix a canvas draws with.

    Parameters
    ----------
    render_from_world : (4, 4) array_like
        From a world (x, y, z, 1), napari's say, to clip space (x right, y up, z away, w), acting
        on column vectors. The map before the projection must be a similarity; it may mirror.
    center : (3,) array_like
        World point the camera turns about, z y x; it is in the middle of the image.

    Returns
    -------
    Camera
        Its lengths are units of that world.

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
    # Without perspective w is the same everywhere.
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
    axes = np.stack([-away, down, np.cross(-away, down)])
    if axes[2] @ matrix[0, :3] >= 0:
        return Camera(axes, middle, height, fov)
    # A canvas that shows left what is right: the axes of its image are a proper turn of the
    # world reflected in a point.
    axes[2] *= -1
    return Camera(-axes, middle, height, fov, -np.eye(3))


def parts_of(matrix: ArrayLike) -> tuple[float, Matrix, Matrix]:
    """Split the linear part of an affine into a length, a turn and a stretch.

    Parameters
    ----------
    matrix : (4, 4) array_like
        Any affine that can be inverted.

    Returns
    -------
    scale : float
        The cube root of the factor by which volumes grow.
    rotation : (3, 3) ndarray of float64
        Proper.
    stretch : (3, 3) ndarray of float64
        As `Camera.stretch`: exactly the identity, or minus that, where angles stay.

    Raises
    ------
    ValueError
        If it flattens space.

    Notes
    -----
    The linear part is scale * rotation @ stretch, its polar decomposition.
    """
    linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
    determinant = float(np.linalg.det(linear))
    scale = abs(determinant) ** (1 / 3)
    if not np.isfinite(scale) or scale == 0.0:
        raise ValueError(f"matrix must be an affine that can be inverted, got {matrix!r}")
    # A mirror would make the turn improper; it goes into the stretch.
    turned = linear * (np.sign(determinant) / scale)
    u, lengths, vh = np.linalg.svd(turned)
    rotation: Matrix = u @ vh
    # Exactly: whether angles stay decides how much has to be computed.
    upright = np.eye(3) if np.allclose(lengths, 1.0, atol=ALIKE) else (vh.T * lengths) @ vh
    return scale, rotation, np.sign(determinant) * (upright + upright.T) / 2


def camera_in_session(seen: Camera, seen_from_world: Matrix) -> Camera:
    """Return a camera of one world, napari's, as one of a session's world.

    Parameters
    ----------
    seen : Camera
        In the world that is seen, not stretched but for a mirror.
    seen_from_world : (4, 4) ndarray of float64
        Any affine from the session's world, mm, to that one.

    Returns
    -------
    Camera
        In mm, with the stretch of the affine: it shows the same image.
    """
    scale, rotation, stretch = parts_of(seen_from_world)
    back: Matrix = np.linalg.inv(seen_from_world).astype(np.float64)
    return Camera(
        seen.rotation @ rotation,
        transform_points(back, seen.center),
        seen.height / scale,
        seen.fov,
        seen.stretch @ stretch,
    )


def napari_view(
    camera: Camera, scene_from_world: Matrix, view_height: float
) -> tuple[Vector, float, Vector, Vector]:
    """Return what to set on a napari camera so that it shows what a `Camera` shows.

    Parameters
    ----------
    camera : Camera
        In the session's world, mm.
    scene_from_world : (4, 4) ndarray of float64
        From the session's world to napari's, its axes in the order displayed.
    view_height : float
        Height of the view in logical pixels.

    Returns
    -------
    center : (3,) ndarray
    zoom : float
        Logical pixels per unit of napari's world.
    direction, up : (3,) ndarray
        Of looking, and up in the image.
    """
    linear = scene_from_world[:3, :3]
    scale = abs(float(np.linalg.det(linear))) ** (1 / 3)
    center = transform_points(scene_from_world, camera.center)
    zoom = view_height / (camera.height * scale)
    return center, zoom, unit(linear @ camera.direction), unit(linear @ camera.up)
