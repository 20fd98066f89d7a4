"""Decorations around an image: the box at its depth, the scale bar before it, what is behind."""

from __future__ import annotations

import numpy as np

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.decorations import box_edges, draw_edges, scale_mark
from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.image_patch import Image, ImagePatch, compose


def box_patch(
    boxes: LabelBoxes,
    spacing: Vector,
    camera: Camera,
    size: tuple[int, int],
    decorations: Decorations,
) -> ImagePatch:
    """Return the edges of the box around all objects, with their depths.

    Parameters
    ----------
    boxes : LabelBoxes
        At least one, voxels.
    spacing : (3,) ndarray of float64, mm z y x
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.
    decorations : Decorations
        Its ink is used.
    """
    lower = (boxes.lower.min(axis=0) - 0.5) * spacing
    upper = (boxes.upper.max(axis=0) - 0.5) * spacing
    rgba, depth = draw_edges(box_edges(lower, upper, camera), camera, size, decorations.ink)
    return ImagePatch(rgba, depth, 0, 0)


def on_background(image: Image, camera: Camera, decorations: Decorations) -> Image:
    """Lay a premultiplied (H, W, 4) image over the background, and the scale bar over both.

    Parameters
    ----------
    image : (H, W, 4) ndarray of float32
        Premultiplied.
    camera : Camera
    decorations : Decorations
    """
    size = image.shape[0], image.shape[1]
    far = np.full(size, np.inf, np.float32)
    patches = [ImagePatch(image, far, 0, 0)]
    if decorations.scale:
        mark, row, col = scale_mark(camera, size, decorations.ink, decorations.unit)
        patches.append(ImagePatch(mark, far[row:, col:], row, col))
    return compose(size, patches, decorations.background)
