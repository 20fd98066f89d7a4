"""Placements of objects: equations 3 and 4, rotations, and their interpolation.

All matrices are (4, 4), act on column vectors (z, y, x, 1) in mm, and compose right to left.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, Vector, fixed, transform_points, unit
from napari_unpack.geometry.view import Camera

# By so much products of the rows of a rotation may miss those of unit vectors at right angles, and
# a pose another one: a camera that is read back from a matrix moves slots by rounding.
ROUNDED = 1e-6


def translation(offset: ArrayLike) -> Matrix:
    """Return the (4, 4) translation by an offset in mm, z y x."""
    matrix = np.eye(4)
    matrix[:3, 3] = np.asarray(offset, dtype=np.float64)
    return matrix


def rotation_about(axis: ArrayLike, angle: float) -> Matrix:
    """Return the (3, 3) rotation about an axis, right-handed in (z, y, x).

    Parameters
    ----------
    axis : (3,) array_like
        z y x, of any length but 0.
    angle : float
        Radians.
    """
    # Here, as it loads half a second's worth of SciPy, and whoever reads files needs no turns.
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(unit(axis, "axis") * angle).as_matrix()


def slerp(first: Matrix, second: Matrix, fraction: float) -> Matrix:
    """Interpolate two (3, 3) rotations along the shortest arc.

    Parameters
    ----------
    first, second : (3, 3) ndarray
        Rotations.
    fraction : float
        0 gives the first, 1 the second.
    """
    from scipy.spatial.transform import Rotation, Slerp

    both = Rotation.from_matrix(np.stack([first, second]))
    return Slerp([0.0, 1.0], both)(float(np.clip(fraction, 0.0, 1.0))).as_matrix()


def is_rotation(matrix: Matrix) -> bool:
    """Tell whether a (3, 3) matrix turns and does nothing else: it does not mirror either."""
    # Many turns one after another, and saved floats, are off by far less.
    square = bool((np.abs(matrix @ matrix.T - np.eye(3)) <= ROUNDED).all())
    return square and bool(np.linalg.det(matrix) > 0)


def turns_and_moves(matrix: Matrix) -> bool:
    """Tell whether a matrix is (4, 4), turns, mirrors and moves, and does nothing else."""
    if matrix.shape != (4, 4) or matrix[3].tolist() != [0, 0, 0, 1]:
        return False
    turned = matrix[:3, :3]
    # To what single precision keeps, as NIfTI has it.
    square = np.allclose(turned @ turned.T, np.eye(3), atol=1e-4)
    return square and bool(np.isfinite(matrix).all())


def checked_place(matrix: ArrayLike | None, source: object) -> Matrix | None:
    """Return where a scan lies in the scanner; None where it is not told.

    Parameters
    ----------
    matrix : (4, 4) array_like of float, optional
        From mm along the scan's axes to the scanner's mm.
    source : object
        What tells it, for the message.

    Raises
    ------
    ValueError
        If it does anything but turn, mirror and move: one that holds the voxel size as well would
        count it twice.
    """
    if matrix is None:
        return None
    place = np.asarray(matrix, dtype=np.float64)
    if not turns_and_moves(place):
        raise ValueError(
            f"{source} must tell where its scan lies by a turn and a move of mm, without the voxel "
            f"size, got {place.tolist()}"
        )
    return place


@dataclass(frozen=True, eq=False)
class Pose:
    """Where an object stands in pivot space: its centre, its turn, its size.

    A point w of the bag (world mm) whose object has box centre b appears at
    center + scale * rotation @ stretch @ (w - b) in pivot space.

    Parameters
    ----------
    center : (3,) ndarray of float64
        Where the object's box centre is, pivot space mm (the paper's u).
    rotation : (3, 3) ndarray of float64
        From (stretched) world axes to pivot axes.
    scale : float
        Enlargement, 1 being true to the bag.
    stretch : (3, 3) ndarray of float64
        The bag's, see `Camera`: objects keep in the air the shape that they have in the bag.
    """

    center: Vector
    rotation: Matrix
    scale: float = 1.0
    stretch: Matrix = field(default_factory=lambda: np.eye(3))

    def kept(self) -> Pose:
        """Return it with arrays that nobody can write to and a plain scale."""
        turn, stretch = fixed(self.rotation), fixed(self.stretch)
        return Pose(fixed(self.center), turn, float(self.scale), stretch)

    def is_at(self, other: Pose) -> bool:
        """Tell whether it differs from another pose by rounding at most."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(Pose))
        return all(bool((np.abs(a - b) <= ROUNDED).all()) for a, b in pairs)

    def pivot_from_world(self, box_center: ArrayLike) -> Matrix:
        """Return the (4, 4) map from the packed bag's world mm to pivot space."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.rotation @ self.stretch
        # Turned about the box centre, which therefore comes to lie at `center`.
        matrix[:3, 3] = self.center - matrix[:3, :3] @ np.asarray(box_center, dtype=np.float64)
        return matrix

    def world_from_world(self, box_center: ArrayLike, camera: Camera) -> Matrix:
        """Return the T of eq. 3 with M = 1: the extra world-side transformation.

        Parameters
        ----------
        box_center : (3,) array_like
            Centre of the object's box, world mm.
        camera : Camera
            V.

        Notes
        -----
        Li et al. 2012, eq. 3, w = V T M v. V is the camera's pivot map here, M the
        identity since the bag's world is the world. Of a pose that keeps the camera's rotation
        it is the displacement of eq. 4, on the world's side of M (docs/paper.md, R7).
        """
        return np.linalg.inv(camera.pivot_from_world()) @ self.pivot_from_world(box_center)

    def cast_camera(self, view: Camera, flatness: float) -> Camera:
        """Return the camera that an object at this pose is cast with and seen by.

        Parameters
        ----------
        view : Camera
            The view's.
        flatness : float
            0 in the view's perspective, 1 as a sprite is (`Camera.flattened`).
        """
        # An object at the eye has no plane that could stay.
        return view.flattened(float(self.center[0]), flatness) or view

    def projection(self, box_center: ArrayLike, view: Camera, flatness: float) -> Projection:
        """Return how an object at this pose is seen.

        Parameters
        ----------
        box_center : (3,) array_like
            Centre of the object's box, world mm.
        view, flatness
            As for `cast_camera`.
        """
        return Projection(self.pivot_from_world(box_center), self.cast_camera(view, flatness))

    def toward(self, other: Pose, fraction: float) -> Pose:
        """Interpolate to another pose: straight centre, shortest turn, geometric size.

        Parameters
        ----------
        other : Pose
            Where to.
        fraction : float
            0 gives this pose, 1 the other.
        """
        f = float(np.clip(fraction, 0.0, 1.0))
        return replace(
            self,
            center=(1 - f) * self.center + f * other.center,
            rotation=slerp(self.rotation, other.rotation, f),
            # Geometric, so that growing from 1 to 2 looks as steady as from 2 to 4.
            scale=self.scale ** (1 - f) * other.scale**f,
        )


@dataclass(frozen=True, eq=False)
class Projection:
    """How an object is seen: from points of the scan to pixels, and from a pixel back.

    Parameters
    ----------
    pivot_from_scan : (4, 4) ndarray of float64
        From the packed bag's world mm to where the object is in pivot space.
    camera : Camera
        The view's own; of a sprite the one without perspective that it is drawn with.
    """

    pivot_from_scan: Matrix
    camera: Camera

    def pixels(self, points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64] | None:
        """Return where points are in the image, (..., 2); None where one is behind the eye.

        Parameters
        ----------
        points : (..., 3) array_like
            mm of the scan.
        size : (int, int)
            Height and width of the image, pixels.
        """
        pivot = transform_points(self.pivot_from_scan, points)
        if self.camera.behind_eye(pivot):
            return None
        return self.camera.pixels(pivot, size)

    def ray(self, pixel: ArrayLike, size: tuple[int, int]) -> tuple[Vector, Vector]:
        """Return a pixel's ray through the object: `Camera.ray`, in mm of the scan.

        Parameters
        ----------
        pixel, size
            As for `Camera.ray`.
        """
        point, way = self.camera.ray(pixel, size)
        scan: Matrix = np.linalg.inv(self.pivot_from_scan).astype(np.float64)
        return transform_points(scan, point), scan[:3, :3] @ way


def packed_pose(box_center: ArrayLike, camera: Camera, offset: ArrayLike = (0, 0, 0)) -> Pose:
    """Return the pose of an object at its packed place, moved by a world offset.

    Parameters
    ----------
    box_center : (3,) array_like
        Centre of the object's box, world mm.
    camera : Camera
        Whose pivot space it is.
    offset : (3,) array_like
        World mm.
    """
    # The T of eq. 3 with the displacement of eq. 4: the object keeps its turn and moves along D.
    moved = np.asarray(box_center, dtype=np.float64) + np.asarray(offset, dtype=np.float64)
    center = transform_points(camera.pivot_from_world(), moved)
    return Pose(center, camera.rotation.copy(), stretch=camera.stretch)
