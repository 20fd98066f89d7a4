"""One object looked at alone: its own opacity, its own cut, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.axes import Matrix, Vector, transform_points, unit


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


def cut_open(session: Any, object_id: int, rotation: Matrix, depth: float) -> tuple[Vector, Vector]:
    """Return the cut that takes the nearest part of an object away.

    Parameters
    ----------
    session : Session
    object_id : int
    rotation : (3, 3) ndarray of float64
        How the object is held, `Pose.rotation`.
    depth : float
        How much of its depth goes, 0 to 1.

    Returns
    -------
    point, normal : (3,) ndarray of float64
        Straight across the view; see `ObjectStyle.cut`.
    """
    # Depths are taken by the map to pivot space, which a mirror turns round.
    towards = unit(rotation[0] @ session.camera.stretch)
    reaches = session.boxes.corners(object_id, session.spacing) @ towards
    center = session.boxes.center(object_id, session.spacing)
    reach = reaches.max() - depth * np.ptp(reaches)
    return center + (reach - center @ towards) * towards, -towards


@dataclass(frozen=True)
class Facts:
    """What is known of an object.

    Parameters
    ----------
    name : str
    size_mm : (float, float, float)
        Edges of its tightest box, the longest first.
    volume_mm3 : float
    mean, spread : float
        Of its densities: mean and standard deviation; NaN where none is finite.
    confidence : float
        NaN where it is not known.
    neighbours : tuple of int
        Objects that share a voxel's face with it, the most faces first.
    """

    name: str
    size_mm: tuple[float, float, float]
    volume_mm3: float
    mean: float
    spread: float
    confidence: float
    neighbours: tuple[int, ...]


def facts_of(session: Any, object_id: int) -> Facts:
    """Measure an object; tenths of a second for a large one, on any thread.

    Parameters
    ----------
    session : Session
    object_id : int

    Raises
    ------
    KeyError
        If there is no such object.
    """
    window = session.boxes.slices(object_id, margin=1)
    labels = session.labels[window]
    mine = labels == object_id
    densities = np.asarray(session.volume[window])[mine].astype(np.float64)
    densities = densities[np.isfinite(densities)]
    row = session.objects.loc[object_id]
    long, middle, short = (float(v) for v in session.bag.oriented(object_id).size)
    return Facts(
        str(row["name"]),
        (long, middle, short),
        float(row["volume_mm3"]),
        float(densities.mean()) if densities.size else float("nan"),
        float(densities.std()) if densities.size else float("nan"),
        float(row["confidence"]),
        _neighbours(labels, mine),
    )


def _neighbours(labels: NDArray[np.uint16], mine: NDArray[np.bool_]) -> tuple[int, ...]:
    counts: dict[int, int] = {}
    for axis in range(3):
        here, there = np.moveaxis(mine, axis, 0), np.moveaxis(labels, axis, 0)
        for own, other in ((here[1:], there[:-1]), (here[:-1], there[1:])):
            for label, faces in zip(
                *np.unique(other[own & (other > 0)], return_counts=True), strict=True
            ):
                counts[int(label)] = counts.get(int(label), 0) + int(faces)
    own_label = {int(i) for i in np.unique(labels[mine])}
    others = [i for i in counts if i not in own_label]
    return tuple(sorted(others, key=lambda i: (-counts[i], i)))
