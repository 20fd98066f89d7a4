"""How the session's world, in mm, lies in napari's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.rays import voxel_from_world

FIELDS = ("scale", "translate", "rotate", "shear", "affine", "units")


def placement_of(sources: Sequence[Any], spacing: NDArray[np.float64]) -> dict[str, Any]:
    """Return where our layers stand: on the user's own layer.

    Parameters
    ----------
    sources : sequence of napari layers
        The session's volume and labels come from the first of three dimensions.
    spacing : (3,) ndarray of float64
        Voxel size of the session, mm z y x, for a session that comes from no layer.

    Returns
    -------
    dict
        Arguments of a napari layer whose data are voxels.
    """
    layer = next((layer for layer in sources if layer.ndim == 3), None)
    if layer is None:
        return {"scale": np.asarray(spacing, dtype=np.float64)}
    return {name: getattr(layer, name) for name in FIELDS}


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
