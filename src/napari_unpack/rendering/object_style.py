"""How an object is shown outside the bag: an opacity and a cut of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.axes import Matrix, Vector, transform_points, unit
from napari_unpack.geometry.boxes import LabelBoxes


@dataclass(frozen=True, eq=False)
class ObjectStyle:
    """How an object is shown when it is not in the bag.

    Parameters
    ----------
    transfer_function : TransferFunction, optional
        Of its own; None for the master's.
    cut : ((3,) ndarray, (3,) ndarray), optional
        Point and normal in world, mm: what lies behind the plane is not shown.
    """

    transfer_function: TransferFunction | None = None
    cut: tuple[Vector, Vector] | None = None

    def planes(self, voxel_from_world: Matrix) -> NDArray[np.float64] | None:
        """Return the cut as (1, 2, 3) point and normal in voxels; None where there is none."""
        if self.cut is None:
            return None
        point, normal = self.cut
        across = np.linalg.inv(voxel_from_world[:3, :3]).T @ normal
        return np.stack([transform_points(voxel_from_world, point), across])[None]


def cut_open(
    boxes: LabelBoxes, object_id: int, spacing: NDArray[np.float64], towards: Vector, depth: float
) -> tuple[Vector, Vector]:
    """Return the cut that takes the nearest part of an object away.

    Parameters
    ----------
    boxes : LabelBoxes
        Of the objects, voxels.
    object_id : int
    spacing : (3,) ndarray of float64, mm z y x
    towards : (3,) ndarray of float64
        Towards the viewer as the object is held, world. Of a stretched bag the first row of
        `Pose.rotation @ Camera.stretch`: depths are taken by the map to pivot space, which a
        mirror turns round.
    depth : float
        How much of the object's depth goes, 0 to 1.

    Returns
    -------
    point, normal : (3,) ndarray of float64
        Straight across the view; see `ObjectStyle.cut`.

    Raises
    ------
    KeyError
        If there is no such object.
    """
    nearness = unit(towards)
    reaches = boxes.corners(object_id, spacing) @ nearness
    center = boxes.center(object_id, spacing)
    reach = reaches.max() - depth * np.ptp(reaches)
    return center + (reach - center @ nearness) * nearness, -nearness
