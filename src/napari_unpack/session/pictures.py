"""Pictures of what is packed and of single objects, on either backend and without a window.

The three layers of Li et al. 2012, section 5.3: the packed bag, objects in the air, sprites.
napari's layers draw these patches as cards (layers/); `session.scene` composes them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera
from napari_unpack.session.depicted import BOOK, LIGHT, Depicted, packed_look, solo_look
from napari_unpack.session.fine_crops import refined
from napari_unpack.session.picture_casting import cast_crop
from napari_unpack.session.picture_patch import Patch

SAMPLES_AT_REST = 3
"""Samples a voxel edge of what stands still: a thin coin shows stripes with one."""


def packed_patch(
    session: Depicted,
    camera: Camera,
    size: tuple[int, int],
    step_scale: float = 1.0,
    backend: str = "auto",
    shading: Shading | None = LIGHT,
) -> Patch:
    """Cast what is packed.

    Parameters
    ----------
    session : Depicted
        Whose bag.
    camera : Camera
        Where one looks from.
    size : (int, int)
        Height and width of the picture, pixels.
    step_scale : float
        Distance of samples in the smallest voxel edge; 2 is quicker and coarser.
    backend : {"auto", "cpu", "gl"}
        Who casts.
    shading : Shading, optional
        The light; None for none.

    Returns
    -------
    Patch
        The window of the picture that the volume's box covers.
    """
    # The crop first: tints may be of more objects than the labels have, never of fewer.
    crop = BOOK.of(session).whole()
    return cast_crop(crop, None, camera, size, packed_look(session, shading, step_scale, backend))


def object_patch(
    session: Depicted,
    object_id: int,
    pose: Pose,
    camera: Camera,
    size: tuple[int, int],
    step_scale: float = 1.0,
    backend: str = "auto",
    shading: Shading | None = LIGHT,
    *,
    smooth: bool = False,
) -> Patch:
    """Cast one object alone where a pose places it; only its projected box is cast.

    Parameters
    ----------
    session : Depicted
        Whose object.
    object_id : int
        Which.
    pose : Pose
        Where it is, in the pivot space of the camera.
    camera : Camera
        Where one looks from.
    size : (int, int)
        Height and width of the whole picture, pixels.
    step_scale : float
        Distance of samples in the object's own smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
        Who casts.
    shading : Shading, optional
        The light; None for none.
    smooth : bool
        Cast a small object from a finer grid (`fine_crops.refined`), without stairs.

    Returns
    -------
    Patch
        Without pixels where the object is out of the picture.

    Raises
    ------
    KeyError
        If there is no such object.

    Notes
    -----
    Li et al. 2012, eq. 3: rays are mapped back by T^-1 into the packed volume. The samples are
    those of `geometry.rays`, so at its packed pose an object looks as it does in the bag.
    """
    cache = BOOK.of(session)
    crop = cache.crop(object_id)
    if smooth:
        mm = np.asarray(session.spacing, dtype=np.float64)
        crop = cache.keep(
            ("fine crop", object_id),
            lambda: refined(cache.crop(object_id), object_id, mm, cache.air),
        )
    moved = pose.world_from_world(crop.center, camera)
    look = solo_look(session, object_id, crop, shading, step_scale, backend)
    return cast_crop(crop, moved, camera, size, look)


def sprite_patch(
    session: Depicted,
    object_id: int,
    pose: Pose,
    pixels_per_mm: float,
    step_scale: float = 1.0,
    backend: str = "auto",
    shading: Shading | None = LIGHT,
) -> Patch:
    """Cast the small picture of an unpacked object.

    Parameters
    ----------
    session : Depicted
        Whose object.
    object_id : int
        Which.
    pose : Pose
        Its turn and scale; where it is does not matter.
    pixels_per_mm : float
        Resolution in pivot space.
    step_scale, backend, shading
        As for `object_patch`, but with `SAMPLES_AT_REST` times the samples: a sprite is small,
        and cast once.

    Returns
    -------
    Patch
        Orthographic, on a transparent ground, no row or column empty at its border. `row` and
        `col` count from the pixel whose centre is the object's box centre, so the card's top
        left corner is (row - 0.5, col - 0.5) / pixels_per_mm from `pose.center` along the
        pivot's axes down and right. Depth and plane are relative to the box centre.

    Raises
    ------
    ValueError
        If the resolution is not positive.
    KeyError
        If there is no such object.
    """
    if not (np.isfinite(pixels_per_mm) and pixels_per_mm > 0):
        raise ValueError(f"pixels_per_mm must be a positive number, got {pixels_per_mm!r}")
    cache = BOOK.of(session)
    crop = cache.crop(object_id)
    still = replace(pose, center=np.zeros(3))
    reach = np.abs(transform_points(still.pivot_from_world(crop.center), crop.corners)).max(0)
    half = np.ceil(reach[1:] * pixels_per_mm).astype(int)
    size = int(2 * half[0] + 1), int(2 * half[1] + 1)
    camera = Camera(np.eye(3), np.zeros(3), size[0] / pixels_per_mm, stretch=pose.stretch)
    step = step_scale / SAMPLES_AT_REST
    whole = object_patch(
        session, object_id, still, camera, size, step, backend, shading, smooth=True
    )
    patch = whole.trimmed()
    return patch.at(patch.row - int(half[0]), patch.col - int(half[1]), patch.plane)
