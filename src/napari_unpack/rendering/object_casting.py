"""Draw one subvolume: which window of the image it covers, and its colours and depths there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering import TransferFunctionLike, cast_tinted
from napari_unpack.rendering.image_patch import ImagePatch, Window, nothing, overlap, window_of
from napari_unpack.rendering.subvolumes import Subvolume


@dataclass(frozen=True, eq=False)
class Appearance:
    """How densities and objects appear, and who casts.

    Parameters
    ----------
    transfer_function : TransferFunctionLike
        Colour and opacity by density.
    tints : (M, 4) ndarray of float32
        By ID.
    shading : Shading, optional
    spacing : (3,) ndarray of float64, mm z y x
    step_scale : float
        Distance of samples in the smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
    clipping : (N, 2, 3) ndarray of float64, optional
        Planes (point, normal) in voxels of the subvolume; what lies behind one is cut away.
    """

    transfer_function: TransferFunctionLike
    tints: NDArray[np.float32]
    shading: Shading | None
    spacing: NDArray[np.float64]
    step_scale: float = 1.0
    backend: str = "auto"
    clipping: NDArray[np.float64] | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """All of it, hashable."""
        return (
            self.transfer_function.table().tobytes(),
            tuple(self.transfer_function.domain),
            self.tints.tobytes(),
            self.shading,
            self.step_scale,
            self.backend,
            b"" if self.clipping is None else self.clipping.tobytes(),
        )


def cast_subvolume(
    subvolume: Subvolume,
    moved: Matrix | None,
    camera: Camera,
    size: tuple[int, int],
    appearance: Appearance,
    part: Window | None = None,
) -> ImagePatch:
    """Cast a subvolume where it appears in an image; without pixels where it is out of it.

    Parameters
    ----------
    subvolume : Subvolume
    moved : (4, 4) ndarray of float64, optional
        The T of eq. 3, world to world; None where the subvolume stays at its place.
    camera : Camera
    size : (int, int)
        Height and width of the whole image, pixels.
    appearance : Appearance
    part : (int, int, int, int), optional
        First row, first column, height and width of what is wanted of the image.
    """
    pivot, voxel_from_world = camera.pivot_from_world(), subvolume.voxel_from_world
    if moved is not None:
        pivot, voxel_from_world = pivot @ moved, voxel_from_world @ np.linalg.inv(moved)
    plane = -float(transform_points(pivot, subvolume.center)[0])
    window = window_of(transform_points(pivot, subvolume.corners), camera, size)
    if window is not None and part is not None:
        window = overlap(window, part)
    if window is None:
        return nothing(plane)
    rgba, depth = cast_tinted(
        subvolume.volume,
        subvolume.labels,
        appearance.spacing,
        camera,
        appearance.transfer_function,
        appearance.tints,
        size,
        voxel_from_world=voxel_from_world,
        window=window,
        step_scale=appearance.step_scale,
        shading=appearance.shading,
        bricks=subvolume.bricks,
        clipping=appearance.clipping,
        backend=appearance.backend,
    )
    return ImagePatch(rgba, depth, window[0], window[1], plane)
