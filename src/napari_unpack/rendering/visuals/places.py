"""Where a card stands: a rectangle of the screen, or one in pivot space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, flip_matrix
from napari_unpack.geometry.view import Camera

Frame = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Top left corner, edge to the right, edge down, each (4,) in clip space (x, y, z, w)."""


@dataclass(frozen=True)
class ScreenPlace:
    """A rectangle in normalised device coordinates; by default the whole viewport.

    Parameters
    ----------
    left, top, right, bottom : float
        Outer edges of the picture, -1 left and bottom, 1 right and top.
    t : float
        Depth of what has none of its own, mm from the pivot plane away from the viewer.
    ndc_depth : float, optional
        Put the whole card at this depth instead, -1 nearest, 1 farthest (a background).
    """

    left: float = -1.0
    top: float = 1.0
    right: float = 1.0
    bottom: float = -1.0
    t: float = 0.0
    ndc_depth: float | None = None

    @classmethod
    def of_pixels(
        cls, row: int, col: int, size: tuple[int, int], canvas: tuple[int, int], t: float = 0.0
    ) -> ScreenPlace:
        """Place a patch of `size` (h, w) whose first pixel is (row, col) of a canvas (H, W)."""
        height, width = canvas
        return cls(
            left=2 * col / width - 1,
            top=1 - 2 * row / height,
            right=2 * (col + size[1]) / width - 1,
            bottom=1 - 2 * (row + size[0]) / height,
            t=t,
        )

    def frame(self, clip_from_pivot: Matrix) -> Frame:
        """Return where the picture's corner and edges are in clip space."""
        return (
            np.array([self.left, self.top, 0.0, 1.0]),
            np.array([self.right - self.left, 0.0, 0.0, 0.0]),
            np.array([0.0, self.bottom - self.top, 0.0, 0.0]),
        )

    @property
    def t_origin(self) -> float:
        """What to add to the picture's depths, mm: they count from the pivot plane."""
        return 0.0


@dataclass(frozen=True)
class PivotPlace:
    """A rectangle in pivot space that faces the viewer: a sprite.

    Parameters
    ----------
    center : (float, float, float)
        Its middle, mm: towards the viewer, down, right.
    half : (float, float)
        Half its height and half its width, mm.

    Notes
    -----
    The picture's depths count from the middle's plane, away from the viewer.
    """

    center: tuple[float, float, float]
    half: tuple[float, float]
    ndc_depth: float | None = None

    @property
    def t(self) -> float:
        """Depth of what has none of its own, mm: the plane of the middle."""
        return -float(self.center[0])

    @property
    def t_origin(self) -> float:
        """What to add to the picture's depths, mm: they count from the middle's plane."""
        return self.t

    def frame(self, clip_from_pivot: Matrix) -> Frame:
        """Return where the picture's corner and edges are in clip space."""
        towards, down, right = self.center
        corner = np.array([towards, down - self.half[0], right - self.half[1], 1.0])
        return (
            clip_from_pivot @ corner,
            clip_from_pivot[:, 2] * 2 * self.half[1],
            clip_from_pivot[:, 1] * 2 * self.half[0],
        )


Place = ScreenPlace | PivotPlace


def depth_row(clip_from_pivot: Matrix, ndc_depth: float | None = None) -> NDArray[np.float64]:
    """Return (a, b, c, d) of z_ndc(t) = (a t + b) / (c t + d).

    Parameters
    ----------
    clip_from_pivot : (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space (x, y, z, w). Its depth
        must not depend on down and right, which holds for every camera that is not sheared.
    ndc_depth : float, optional
        The answer for every t instead.

    Returns
    -------
    (4,) ndarray of float64
    """
    if ndc_depth is not None:
        return np.array([0.0, ndc_depth, 0.0, 1.0])
    z, w = clip_from_pivot[2], clip_from_pivot[3]
    return np.array([-z[0], z[3], -w[0], w[3]])


def clip_from_pivot(render_from_world: ArrayLike, camera: Camera) -> Matrix:
    """Make the matrix cards want from the one vispy draws with.

    Parameters
    ----------
    render_from_world : (4, 4) array_like
        From world mm (x, y, z, 1) to clip space, acting on column vectors: `matrices.matrix_of`
        of the vispy transform from the scene to "render".
    camera : Camera
        Whose pivot space is meant.

    Returns
    -------
    (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space (x, y, z, w).
    """
    world_from_pivot = flip_matrix(np.linalg.inv(camera.pivot_from_world()))
    order = [2, 1, 0, 3]
    product: Matrix = (np.asarray(render_from_world, dtype=np.float64) @ world_from_pivot)[:, order]
    return product


def clip_of_camera(camera: Camera, aspect: float, depth: float = 1e4) -> Matrix:
    """Return the clip matrix of a camera on a canvas of its own, for pictures without napari.

    Parameters
    ----------
    camera : Camera
        In world mm.
    aspect : float
        Width of the canvas over its height.
    depth : float
        How many mm before and behind the pivot plane are kept; in perspective what is nearer
        than a hundredth of the viewing distance is cut.

    Returns
    -------
    (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) to clip space.
    """
    matrix = np.zeros((4, 4))
    matrix[0, 2] = 2 / (camera.height * aspect)
    matrix[1, 1] = -2 / camera.height
    if np.isinf(camera.distance):
        matrix[2, 0], matrix[3, 3] = -1 / depth, 1.0
        return matrix
    far_eye, near_eye = camera.distance + depth, camera.distance / 100
    # At eye distance e = distance + t: w = e / distance, z_ndc from -1 at near to 1 at far.
    matrix[3, 0], matrix[3, 3] = -1 / camera.distance, 1.0
    slope = (far_eye + near_eye) / (far_eye - near_eye)
    shift = -2 * far_eye * near_eye / (far_eye - near_eye)
    matrix[2, 0] = -slope / camera.distance
    matrix[2, 3] = slope + shift / camera.distance
    return matrix
