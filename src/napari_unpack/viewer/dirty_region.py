"""Casting a part of the packed image anew: where an object has left or come back."""

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

# Around an object's box where the image can change: two of fringe, one for interpolation.
FRINGE_VOXELS = 3


def recast_objects(
    scene: Scene, subvolume: Subvolume, image: RenderedImage, ids: Iterable[int]
) -> RenderedImage | None:
    """Cast the windows of some objects anew, on the processor, and keep the rest of the image.

    Parameters
    ----------
    scene : Scene
        What is packed now.
    subvolume : Subvolume
        The whole volume; see `rendering.subvolumes.SubvolumeCache.whole`.
    image : RenderedImage
        The packed image so far, right but for these objects.
    ids : iterable of int
        Objects that have left, come back, or changed their look.

    Returns
    -------
    RenderedImage or None
        As if all of it had been cast; None where no pixel is left.

    Notes
    -----
    Exact, since the rays of a window are rays of the image. Costs the objects' common
    rectangle.
    """
    part = image.patch.row, image.patch.col, *image.patch.size
    window = window_of_objects(scene, image.camera, image.size, part, ids)
    if window is None:
        return image
    row, col, height, width = window
    # The image before is still shown, and may be faded from.
    rgba, depth = image.patch.rgba.copy(), image.patch.depth.copy()
    colors, there = cast_tinted(
        subvolume.volume,
        subvolume.labels,
        scene.spacing,
        image.camera,
        scene.transfer_function,
        scene.packed_tints,
        image.size,
        voxel_from_world=subvolume.voxel_from_world,
        window=window,
        shading=LIGHT,
        bricks=subvolume.bricks,
        clipping=scene.clipping,
        backend="cpu",
    )
    top, left = row - image.patch.row, col - image.patch.col
    rgba[top : top + height, left : left + width] = colors
    depth[top : top + height, left : left + width] = there
    patch = ImagePatch(rgba, depth, image.patch.row, image.patch.col, image.patch.plane)
    return RenderedImage.of(patch, image.camera, image.size)


def window_of_objects(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    part: tuple[int, int, int, int],
    ids: Iterable[int],
) -> tuple[int, int, int, int] | None:
    """Return where some objects may be seen in a part of an image.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    size : (int, int)
        Height and width of the whole image, pixels.
    part : (int, int, int, int)
        First row, first column, height and width of the part.
    ids : iterable of int

    Returns
    -------
    (int, int, int, int) or None
        First row, first column, height and width, of the whole image; None for nowhere.
    """
    pivot_from_world = camera.pivot_from_world()
    low, high = np.array(size), np.zeros(2, dtype=np.int64)
    for object_id in ids:
        row = scene.boxes.index(object_id)
        corners = box_corners(
            scene.boxes.lower[row] - 0.5 - FRINGE_VOXELS,
            scene.boxes.upper[row] - 0.5 + FRINGE_VOXELS,
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
