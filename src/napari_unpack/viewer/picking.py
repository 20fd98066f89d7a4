"""Which packed object a pixel shows: the one that contributes most to it."""

from __future__ import annotations

from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
from napari_unpack.rendering.cpu import by_contribution, contributions
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume

# Contribution to a pixel below which an object cannot be seen there.
LEAST_ALPHA = 0.02


def pick_packed(
    scene: Scene, subvolume: Subvolume, frame: Frame, row: float, col: float
) -> list[int]:
    """List the packed objects on a pixel's ray.

    Parameters
    ----------
    scene : Scene
        With what is packed.
    subvolume : Subvolume
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
        voxel_from_world=subvolume.voxel_from_world,
        window=window,
    )
    function = scene.transfer_function
    shares = contributions(
        subvolume.volume,
        subvolume.labels,
        rays,
        scene.spacing,
        function.table(TABLE_ENTRIES),
        function.domain,
        scene.packed_tints,
        scene.clipping,
    )
    return [label for label, share in by_contribution(shares) if label > 0 and share > LEAST_ALPHA]
