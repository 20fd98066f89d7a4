"""One cast of one crop: which window of the picture it touches, and what it looks like there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering import TransferFunctionLike, cast_tinted
from napari_unpack.rendering.image_patch import ImagePatch, nothing, window_of
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
        The light; None for none.
    spacing : (3,) ndarray of float64
        Voxel size, mm.
    step_scale : float
        Distance of samples in the smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
        Who casts.
    clipping : (N, 2, 3) ndarray of float64, optional
        Planes (point, normal) in voxels of the crop; what lies behind one is cut away.
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


def cast_crop(
    crop: Subvolume, moved: Matrix | None, camera: Camera, size: tuple[int, int], look: Appearance
) -> ImagePatch:
    """Cast a crop where it appears in a picture.

    Parameters
    ----------
    crop : Subvolume
        What.
    moved : (4, 4) ndarray of float64, optional
        The T of eq. 3, world to world; None where the crop stays at its place.
    camera : Camera
        Where one looks from.
    size : (int, int)
        Height and width of the whole picture, pixels.
    look : Appearance
        How it appears.

    Returns
    -------
    ImagePatch
        Without pixels where the crop is out of the picture.
    """
    pivot, voxel_from_world = camera.pivot_from_world(), crop.voxel_from_world
    if moved is not None:
        pivot, voxel_from_world = pivot @ moved, voxel_from_world @ np.linalg.inv(moved)
    plane = -float(transform_points(pivot, crop.center)[0])
    window = window_of(transform_points(pivot, crop.corners), camera, size)
    if window is None:
        return nothing(plane)
    rgba, depth = cast_tinted(
        crop.volume,
        crop.labels,
        look.spacing,
        camera,
        look.transfer_function,
        look.tints,
        size,
        voxel_from_world=voxel_from_world,
        window=window,
        step_scale=look.step_scale,
        shading=look.shading,
        bricks=crop.bricks,
        clipping=look.clipping,
        backend=look.backend,
    )
    return ImagePatch(rgba, depth, window[0], window[1], plane)
