"""Drawing and counting on whole tables by ID, for sessions and layers.

Arguments are what the kernels take and are not checked, so that a frame costs no more than its
rays. The public functions of `api` check theirs and stand on these.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry import rays as geometry_rays
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.backends import with_backend

if TYPE_CHECKING:
    from napari_unpack.rendering.cpu import Bricks, Runs

# Rows of the transfer function's table.
TABLE_ENTRIES = 1024

# First row, first column, height and width of the part of an image to be cast.
Window = tuple[int, int, int, int]


class TransferFunctionLike(Protocol):
    """What rendering needs of a transfer function (`appearance.TransferFunction` has it)."""

    @property
    def domain(self) -> tuple[float, float]:
        """The densities of the first and last row of the table."""

    def table(self, n: int = ...) -> NDArray[np.float32]:
        """Return (n, 4) float32: straight RGB and opacity per voxel."""


def rays_for(
    camera: Camera,
    size: tuple[int, int],
    spacing: ArrayLike,
    voxel_from_world: ArrayLike | None = None,
    step_scale: float = 1.0,
    window: Window | None = None,
) -> Rays:
    """Make the rays of an image with the usual step.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Height and width of the whole image, pixels.
    spacing : (3,) array_like, mm z y x
    voxel_from_world : (4, 4) array_like, optional
        By default the bag's own place. For an object at a pose it is
        voxel_from_world(spacing) @ inv(pose.world_from_world(box_center, camera)).
    step_scale : float
        1 puts samples `min(spacing)` mm of the volume apart on the central ray.
    window : (int, int, int, int), optional
        First row, first column, height, width of the part of the image wanted.
    """
    mm = np.asarray(spacing, dtype=np.float64)
    affine = (
        geometry_rays.voxel_from_world(mm)
        if voxel_from_world is None
        else np.asarray(voxel_from_world, dtype=np.float64)
    )
    # An enlarged object passes fewer mm of volume per mm of ray.
    looking = camera.in_world((-1.0, 0.0, 0.0))
    speed = float(np.linalg.norm(mm * (affine[:3, :3] @ looking)))
    rays = geometry_rays.cast_rays(camera, size, affine, step_scale * float(mm.min()) / speed)
    if window is None:
        return rays
    row, col, height, width = window
    return rays.window(row, col, (height, width))


def cast_tinted(
    volume: NDArray[np.uint16] | NDArray[np.float32],
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    camera: Camera,
    transfer_function: TransferFunctionLike,
    tints: NDArray[np.float32],
    size: tuple[int, int],
    *,
    voxel_from_world: ArrayLike | None = None,
    window: Window | None = None,
    step_scale: float = 1.0,
    shading: Shading | None = None,
    bricks: Bricks | None = None,
    jitter: bool = False,
    clipping: ArrayLike | None = None,
    backend: str = "auto",
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cast a tinted image, colour and depth.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16 or float32
        Density, C-contiguous, without NaN.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    spacing : (3,) array_like, mm z y x
    camera : Camera
    transfer_function : TransferFunctionLike
        Colour and opacity by density.
    tints : (M, 4) ndarray of float32
        By ID, M above every label; alpha 0 hides.
    size : (int, int)
        Height and width of the whole image, pixels.
    voxel_from_world, window, step_scale
        See `rays_for`.
    shading : Shading, optional
    bricks : rendering.cpu.Bricks, optional
        Of this volume and these labels, kept by the caller from image to image.
    jitter : bool
        Trade banding for grain.
    clipping : (N, 2, 3) array_like, optional
        Planes (point, normal) in voxels; what lies behind one is cut away.
    backend : {"auto", "cpu", "gl"}

    Returns
    -------
    image : (h, w, 4) ndarray of float32
        Premultiplied RGBA of the window, by default the whole image.
    depth : (h, w) ndarray of float32
        t in mm from the camera's pivot plane where alpha reaches 0.5, +inf where it does not.
    """
    rays = rays_for(camera, size, spacing, voxel_from_world, step_scale, window)
    table, domain = transfer_function.table(TABLE_ENTRIES), transfer_function.domain
    return with_backend(
        backend,
        lambda on: on.tinted(
            volume, labels, rays, spacing, table, domain, tints, shading, bricks, jitter, clipping
        ),
    )


def cast_ids(
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    camera: Camera,
    visible: NDArray[np.bool_],
    size: tuple[int, int],
    layers: int = 1,
    *,
    voxel_from_world: ArrayLike | None = None,
    step_scale: float = 1.0,
    bricks: Bricks | None = None,
    clipping: ArrayLike | None = None,
    backend: str = "auto",
) -> NDArray[np.int32]:
    """Cast object-ID layers, (layers, h, w): the k-th distinct object on each ray, else 0.

    Parameters
    ----------
    labels, spacing, camera, size, voxel_from_world, step_scale, bricks, clipping, backend
        As for `cast_tinted`.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False.
    layers : int
        How many objects of a ray to list.
    """
    rays = rays_for(camera, size, spacing, voxel_from_world, step_scale)
    clear = off_faces(rays)
    return with_backend(
        backend, lambda on: on.id_layers(labels, clear, visible, layers, bricks, clipping)
    )


def cast_occlusion(
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    camera: Camera,
    visible: NDArray[np.bool_],
    size: tuple[int, int],
    *,
    step_scale: float = 1.0,
    bricks: Bricks | None = None,
    backend: str = "auto",
) -> OcclusionCounts:
    """Count who hides whom; the camera is made orthographic.

    Parameters
    ----------
    labels, spacing, camera, visible, size, step_scale, bricks, backend
        As for `cast_ids`; the camera looks along -D.
    """
    rays = off_faces(rays_for(camera.orthographic(), size, spacing, step_scale=step_scale))
    return with_backend(backend, lambda on: on.occlusion_counts(labels, rays, visible, bricks))


def cast_runs(
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    camera: Camera,
    visible: NDArray[np.bool_],
    size: tuple[int, int],
    *,
    bricks: Bricks | None = None,
    known: Runs | None = None,
) -> Runs:
    """List what the rays of `cast_occlusion` meet, on the CPU, or take what is known of them.

    Parameters
    ----------
    labels, spacing, camera, visible, size, bricks
        As for `cast_occlusion`.
    known : Runs, optional
        Of the same labels.

    Returns
    -------
    Runs
        `.counts(visible)` is what `cast_occlusion` returns. Those known, if they are of the same
        rays and no object else is visible now.
    """
    from napari_unpack.rendering.cpu import occlusion_runs

    rays = off_faces(rays_for(camera.orthographic(), size, spacing))
    # Objects that have left are skipped in the counting, so no ray is cast again.
    if known is not None and known.serves(rays, visible):
        return known
    return occlusion_runs(labels, rays, visible, bricks)


def off_faces(rays: Rays) -> Rays:
    """Move the samples of parallel rays a quarter of a step on, clear of voxel faces.

    Notes
    -----
    Along an axis of the volume, a step of one voxel from the middle of an odd number of them
    puts every sample on a face, and rounding would pass over one sheet of voxels and look at
    its neighbour twice. The rays stay where they are. In perspective nothing is changed.
    """
    if rays.near != -np.inf:
        return rays
    table = rays.table.copy()
    table[0] += table[3] * rays.step / 4
    return Rays(table, rays.size, rays.step, rays.near)
