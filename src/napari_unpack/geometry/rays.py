"""The rays of an image, and the one lattice of samples every pass shares.

A ray is affine in the pixel, in perspective too, because it is parametrised by depth t: its
signed distance in mm from the pivot plane along the direction of looking, growing away from the
viewer. The sample k of *every* ray lies at t = (k + 1/2) step for integer k. Boxes and
empty-space skipping choose which k to visit and never move them (docs/paper.md, R11), so an
object counts the same samples whether the whole volume is cast or its box alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.view import Camera


@dataclass(frozen=True, eq=False)
class Rays:
    """The rays of an H x W image in voxel coordinates.

    The ray of pixel (r, c) passes p(t) = P + t D with P = origin + r * origin_row +
    c * origin_col and D = direction + r * direction_row + c * direction_col.

    Parameters
    ----------
    table : (6, 3) ndarray of float64
        Rows origin, origin_row, origin_col (voxels) and direction, direction_row,
        direction_col (voxels per mm of t).
    size : (int, int)
        Height and width, pixels.
    step : float
        Distance of samples in t, mm.
    near : float
        No sample at t <= near is visited: the eye's plane in perspective, else -inf.
    """

    table: NDArray[np.float64]
    size: tuple[int, int]
    step: float
    near: float = -np.inf

    def point(self, row: float, col: float, t: float) -> Vector:
        """Return the voxel coordinates of one point on one ray.

        Parameters
        ----------
        row, col : float
            Pixel.
        t : float
            Depth along the ray, mm.
        """
        weights = np.array([1.0, row, col])
        return weights @ self.table[:3] + t * (weights @ self.table[3:])

    def corner_ways(self) -> NDArray[np.float64]:
        """Return the directions of the rays of the four corners, (4, 3), voxels per mm of t."""
        rows, cols = self.size[0] - 1, self.size[1] - 1
        corners = np.array([(1, r, c) for r in (0, rows) for c in (0, cols)], np.float64)
        return corners @ self.table[3:]

    def window(self, row: int, col: int, size: tuple[int, int]) -> Rays:
        """Return the rays of a sub-rectangle.

        Parameters
        ----------
        row, col : int
            Its first pixel.
        size : (int, int)
            Its height and width, pixels.
        """
        table = self.table.copy()
        # Origins and directions are affine in the pixel: only the first pixel moves.
        for first in (0, 3):
            table[first] += row * table[first + 1] + col * table[first + 2]
        return Rays(table, size, self.step, self.near)


def cast_rays(
    camera: Camera, size: tuple[int, int], voxel_from_world: ArrayLike, step: float
) -> Rays:
    """Make the rays of a camera's image through a volume.

    Parameters
    ----------
    camera : Camera
        The view, world mm.
    size : (int, int)
        Height and width of the image, pixels. Pixels are square; `camera.height` mm span H.
    voxel_from_world : (4, 4) array_like
        Affine from world mm to voxel coordinates. Any affine: anisotropic spacing, a napari
        layer's, or the inverse of a flying object's pose (eq. 3).
    step : float
        Distance of samples along t, mm.

    Raises
    ------
    ValueError
        If the size or the step is not positive.
    """
    if min(size) < 1:
        raise ValueError(f"size must be at least (1, 1) pixels, got {size!r}")
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"step must be a positive number of mm, got {step!r}")
    height, width = int(size[0]), int(size[1])
    # Pixels are square, so the width follows from the height.
    pixel = camera.height / height
    towards, down, right = camera.in_world(np.diag([1.0, pixel, pixel]))
    first = camera.center - down * (height - 1) / 2 - right * (width - 1) / 2
    zero = np.zeros(3)
    if camera.fov == 0.0:
        near, directions = -np.inf, [-towards, zero, zero]
    else:
        # D = (P - eye) / distance, so that t advances one mm of depth per unit.
        eye = camera.center + towards * camera.distance
        near = -camera.distance
        directions = [(first - eye) / camera.distance, down / -near, right / -near]
    affine = np.asarray(voxel_from_world, dtype=np.float64)
    linear = affine[:3, :3]
    points = np.stack([first, down, right, *directions]) @ linear.T
    # Directions are differences of points: the translation acts on the origin alone.
    points[0] += affine[:3, 3]
    return Rays(points, (height, width), float(step), near)


def world_from_voxel(spacing: ArrayLike) -> Matrix:
    """Return the (4, 4) scale from voxel coordinates to world mm for a voxel size z, y, x."""
    return np.diag([*np.asarray(spacing, dtype=np.float64), 1.0])


def voxel_from_world(spacing: ArrayLike) -> Matrix:
    """Return the (4, 4) scale from world mm to voxel coordinates for a voxel size z, y, x."""
    return np.diag([*(1.0 / np.asarray(spacing, dtype=np.float64)), 1.0])
