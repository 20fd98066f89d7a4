"""Which packed object a pixel shows: the one that contributes most to it."""

from __future__ import annotations

from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
from napari_unpack.rendering.cpu import by_contribution, contributions
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume

LEAST_ALPHA = 0.02


def pick_packed(scene: Scene, crop: Subvolume, frame: Frame, row: float, col: float) -> list[int]:
    """List the packed objects on a pixel's ray.

    Parameters
    ----------
    scene : Scene
        What is packed.
    crop : Subvolume
        The whole volume.
    frame : Frame
        What the canvas shows.
    row, col : float
        Pixel of the frame.

    Returns
    -------
    list of int
        The object that contributes most, then those behind it, then those before it; empty
        where nothing is seen. Matter without a label is left out.

    Notes
    -----
    docs/paper.md, R13. One ray: well under a millisecond.
    """
    window = round(row), round(col), 1, 1
    rays = rays_for(
        frame.camera,
        frame.size,
        scene.spacing,
        voxel_from_world=crop.voxel_from_world,
        window=window,
    )
    look = scene.transfer_function
    shares = contributions(
        crop.volume,
        crop.labels,
        rays,
        scene.spacing,
        look.table(TABLE_ENTRIES),
        look.domain,
        scene.packed_tints,
        scene.clipping,
    )
    return [label for label, share in by_contribution(shares) if label > 0 and share > LEAST_ALPHA]
