"""Casting a part of the packed picture anew: where an object has left or come back."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.rendering import cast_tinted
from napari_unpack.rendering.image_patch import ImagePatch, window_of
from napari_unpack.rendering.scene import LIGHT, Scene
from napari_unpack.rendering.subvolumes import Subvolume

FRINGE = 3
"""Voxels around an object's box in which its picture can change: its fringe and one for
interpolation."""


def recast_objects(
    scene: Scene, crop: Subvolume, shot: RenderedImage, ids: Iterable[int], backend: str
) -> RenderedImage | None:
    """Cast the windows of some objects anew and keep the rest of the picture.

    Parameters
    ----------
    scene : Scene
        What is packed now.
    crop : Subvolume
        The whole volume; see `scene.picture_cache.SubvolumeCache.whole`.
    shot : RenderedImage
        The packed picture so far, right but for these objects.
    ids : iterable of int
        Objects that have left, come back, or changed their look.
    backend : {"auto", "cpu", "gl"}
        Who casts.

    Returns
    -------
    RenderedImage or None
        As if all of it had been cast; None where no pixel is left.

    Notes
    -----
    Exact, since the rays of a window are rays of the picture. Costs the objects' common
    rectangle.
    """
    window = _window(scene, shot, ids)
    if window is None:
        return shot
    row, col, height, width = window
    rgba, depth = shot.patch.rgba.copy(), shot.patch.depth.copy()
    image, there = cast_tinted(
        crop.volume,
        crop.labels,
        scene.spacing,
        shot.camera,
        scene.transfer_function,
        scene.packed_tints,
        shot.size,
        voxel_from_world=crop.voxel_from_world,
        window=window,
        shading=LIGHT,
        bricks=crop.bricks,
        clipping=scene.clipping,
        backend=backend,
    )
    top, left = row - shot.patch.row, col - shot.patch.col
    rgba[top : top + height, left : left + width] = image
    depth[top : top + height, left : left + width] = there
    patch = ImagePatch(rgba, depth, shot.patch.row, shot.patch.col, shot.patch.plane)
    return RenderedImage.of(patch, shot.camera, shot.size)


def _window(
    scene: Scene, shot: RenderedImage, ids: Iterable[int]
) -> tuple[int, int, int, int] | None:
    """Return the rectangle (row, col, height, width) that covers objects, cut to the patch."""
    patch = shot.patch
    part = patch.row, patch.col, *patch.rgba.shape[:2]
    return window_of_objects(scene, shot.camera, shot.size, part, ids)


def window_of_objects(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    part: tuple[int, int, int, int],
    ids: Iterable[int],
) -> tuple[int, int, int, int] | None:
    """Return where some objects may be seen in a part of a picture.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    size : (int, int)
        Height and width of the whole picture, pixels.
    part : (int, int, int, int)
        First row, first column, height and width of the part.
    ids : iterable of int

    Returns
    -------
    (int, int, int, int) or None
        First row, first column, height and width, of the whole picture; None for nowhere.
    """
    pivot_from_world = camera.pivot_from_world()
    low, high = np.array(size), np.zeros(2, dtype=np.int64)
    for object_id in ids:
        row = scene.boxes.index(object_id)
        corners = box_corners(
            scene.boxes.lower[row] - 0.5 - FRINGE, scene.boxes.upper[row] - 0.5 + FRINGE
        )
        pivot = transform_points(pivot_from_world, corners * scene.spacing)
        window = window_of(pivot, camera, size)
        if window is not None:
            low = np.minimum(low, window[:2])
            high = np.maximum(high, np.array(window[:2]) + window[2:])
    low = np.maximum(low, part[:2])
    high = np.minimum(high, np.array(part[:2]) + part[2:])
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
