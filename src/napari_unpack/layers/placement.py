"""How the session's world, in mm, lies in napari's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.layers.view_camera import similarity

FIELDS = ("scale", "translate", "rotate", "shear", "affine", "units")


def placement_of(sources: Sequence[Any], spacing: NDArray[np.float64]) -> dict[str, Any]:
    """Return where our layers stand: on the user's own layer, if that keeps shapes.

    Parameters
    ----------
    sources : sequence of napari layers
        The session's volume and labels come from the first of three dimensions.
    spacing : (3,) ndarray of float64
        Voxel size of the session, mm z y x.

    Returns
    -------
    dict
        Arguments of a napari layer whose data are voxels. A source whose transform shears or
        mirrors, or whose scale is not in proportion to the spacing, is not followed: the bag then
        stands at the origin in mm.
    """
    layer = _leading(sources)
    if layer is None or not _keeps_shapes(layer, spacing):
        return {"scale": np.asarray(spacing, dtype=np.float64)}
    return {name: getattr(layer, name) for name in FIELDS}


def not_followed(sources: Sequence[Any], spacing: NDArray[np.float64]) -> str:
    """Return what to say where `placement_of` cannot follow the user's layer; else nothing."""
    layer = _leading(sources)
    if layer is None or _keeps_shapes(layer, spacing):
        return ""
    return (
        f"{layer.name} is sheared, mirrored, or scaled otherwise than its voxels of "
        f"{' x '.join(f'{mm:g}' for mm in spacing)} mm. The bag is shown as it is, at the origin."
    )


def _leading(sources: Sequence[Any]) -> Any | None:
    return next((layer for layer in sources if layer.ndim == 3), None)


def _keeps_shapes(layer: Any, spacing: NDArray[np.float64]) -> bool:
    return similarity(data_to_world(layer) @ voxel_from_world(spacing)) is not None


def data_to_world(layer: Any) -> Matrix:
    """Return a 3D layer's (4, 4) map from its data to napari's world, z y x."""
    origin = np.asarray(layer.data_to_world((0.0, 0.0, 0.0)), dtype=np.float64)
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    for axis in range(3):
        matrix[:3, axis] = np.asarray(layer.data_to_world(np.eye(3)[axis])) - origin
    return matrix


def napari_from_world(layer: Any) -> Matrix:
    """Return the map from the session's world, mm, to napari's for one of our layers."""
    return data_to_world(layer) @ voxel_from_world(layer.spacing)
