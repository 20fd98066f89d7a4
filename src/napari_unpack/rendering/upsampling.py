"""Upsampled subvolumes of small objects, whose edges are smooth instead of stairs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PchipInterpolator

from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.geometry.boxes import box_corners, label_boxes
from napari_unpack.rendering import TransferFunctionLike
from napari_unpack.rendering.cpu import Bricks
from napari_unpack.rendering.object_casting import Appearance
from napari_unpack.rendering.subvolumes import Subvolume

Array = NDArray[np.float32]

# Voxels along the longest side from which stairs are too small to be seen.
LONG = 160

MOST_VOXELS = 1_200_000
FINEST = 4

# Coverage between which density rises from air's to the object's. The middle is below 1/2, or a
# wire one voxel thick, whose smoothed coverage is 4/9 on its axis, would be lost.
EDGE = 0.3, 0.55
# Coverage from which labels are the object's: where density is still air's, so that the edge is
# where density ends and not where labels do.
REACH = 0.02


def upsampled(
    subvolume: Subvolume, object_id: int, spacing: NDArray[np.float64], air: float
) -> Subvolume:
    """Divide the voxels around an object, and let density end smoothly at its edge.

    Parameters
    ----------
    subvolume : Subvolume
    object_id : int
    spacing : (3,) ndarray of float64
        Voxel size of the volume, mm.
    air : float
        The lowest density of the volume.

    Returns
    -------
    Subvolume
        The one given where the object is large; else one of no more than `MOST_VOXELS`, all of
        whose labels but the object's are 0.

    Notes
    -----
    A label holds for a whole voxel, so an object enlarged to many pixels a voxel shows stairs
    wherever it touches another. Here its coverage, 1 inside and 0 outside, is smoothed by the
    cubic B-spline, and density is lowered to that of air where coverage falls (`EDGE`), so that
    opacity is continuous and the gradient is that of a smooth surface, as it is towards air.
    Between voxels density is interpolated by monotone cubics, which do not ring beside metal.
    A deviation from Li et al. 2012, section 4.1, where labels are read from the nearest voxel;
    the packed bag is cast so.
    """
    finer = divisions(subvolume.labels == object_id, spacing)
    # Large objects show no stairs, and their copies would be large.
    if max(finer) == 1:
        return subvolume
    coverage = (subvolume.labels == object_id).astype(np.float32)
    volume = subvolume.volume.astype(np.float32)
    for axis, parts in enumerate(finer):
        volume = between(volume, axis, parts)
        coverage = smoothed(coverage, axis, parts)
    ramp = np.clip((coverage - EDGE[0]) / (EDGE[1] - EDGE[0]), 0.0, 1.0)
    volume = air + (volume - air) * ramp
    if subvolume.volume.dtype == np.uint16:
        # Kernels read CT numbers as whole numbers.
        volume = np.rint(volume)
    density = np.ascontiguousarray(volume.astype(subvolume.volume.dtype))
    labels = np.ascontiguousarray(np.where(coverage > REACH, object_id, 0).astype(np.uint16))
    voxel_from_world: Matrix = fine_from_coarse(finer) @ subvolume.voxel_from_world
    # Smoothed coverage reaches beyond the voxels that the labels claim.
    reached = label_boxes(labels)
    ends = box_corners(reached.lower[-1] - 0.5, reached.upper[-1] - 0.5)
    corners = transform_points(np.linalg.inv(voxel_from_world).astype(np.float64), ends)
    return replace(
        subvolume,
        volume=density,
        labels=labels,
        bricks=Bricks.of(labels, density),
        voxel_from_world=voxel_from_world,
        corners=corners,
        finer=finer,
        edit=None,
    )


def appearance_at(subvolume: Subvolume, appearance: Appearance) -> Appearance:
    """Return the appearance in which finer voxels are as bright, dense and lit as before.

    Parameters
    ----------
    subvolume : Subvolume
    appearance : Appearance
        Made for the voxels of the volume: steps, opacity and gradient count in their edges.
    """
    fine = appearance.spacing / subvolume.finer
    times = float(appearance.spacing.min() / fine.min())
    if times == 1.0:
        return appearance
    light = appearance.shading
    return replace(
        appearance,
        spacing=fine,
        step_scale=appearance.step_scale * times,
        transfer_function=_PerPart(appearance.transfer_function, times),
        shading=light and replace(light, gradient_floor=light.gradient_floor / times),
    )


@dataclass(frozen=True)
class _PerPart:
    """A transfer function whose opacity is that of one of some parts of a voxel in a row."""

    whole: TransferFunctionLike
    parts: float

    @property
    def domain(self) -> tuple[float, float]:
        return self.whole.domain

    def table(self, entries: int = 1024) -> NDArray[np.float32]:
        table = np.array(self.whole.table(entries))
        # As many parts in a row let through what the whole voxel does.
        table[:, 3] = 1.0 - (1.0 - table[:, 3]) ** (1.0 / self.parts)
        return table


def divisions(inside: NDArray[np.bool_], spacing: NDArray[np.float64]) -> tuple[int, int, int]:
    """Return into how many parts voxels are divided along each axis.

    Parameters
    ----------
    inside : (z, y, x) ndarray of bool
        The object in its subvolume.
    spacing : (3,) ndarray of float64
        Voxel size, mm. Long edges are divided more.
    """
    if not inside.any():
        return 1, 1, 1
    most = _most_parts(np.ptp(np.nonzero(inside), axis=1) + 1, spacing)
    # The finest that fits into the memory allowed.
    for parts in range(most, 1, -1):
        z, y, x = (max(1, round(parts * edge)) for edge in spacing / spacing.min())
        if inside.size * z * y * x <= MOST_VOXELS:
            return z, y, x
    return 1, 1, 1


def has_stairs(size: NDArray[np.int64], spacing: NDArray[np.float64]) -> bool:
    """Return whether an object so large, in voxels, is small enough to show them.

    Parameters
    ----------
    size : (3,) ndarray of int64
        Of the object's box, voxels.
    spacing : (3,) ndarray of float64, mm z y x
    """
    return _most_parts(size, spacing) > 1


def _most_parts(size: NDArray[np.int64], spacing: NDArray[np.float64]) -> int:
    return min(FINEST, int(np.ceil(LONG / (size * spacing / spacing.min()).max())))


def between(array: Array, axis: int, parts: int) -> Array:
    """Divide the voxels along one axis; monotone cubics are between centres, which stay.

    Parameters
    ----------
    array : (z, y, x) ndarray of float32
    axis, parts : int
        Which axis, and into how many parts its voxels are divided.
    """
    count = array.shape[axis]
    # Cubics need two points.
    if count == 1:
        return np.repeat(array, parts, axis)
    cubics = PchipInterpolator(np.arange(count), array, axis)
    return np.asarray(cubics(np.clip(_parts(count, parts), 0, count - 1)), np.float32)


def smoothed(array: Array, axis: int, parts: int) -> Array:
    """Divide the voxels along one axis, weighing them by cubic B-splines; beyond is nothing.

    Parameters
    ----------
    array, axis, parts : see `between`
    """
    count = array.shape[axis]
    # Four knots beyond either end, where coverage is 0: edges at the box fade too.
    knots = np.arange(-4, count + 4) + 0.0
    weights = BSpline.design_matrix(_parts(count, parts), knots, 3)[:, 2 : count + 2].toarray()
    spread = np.tensordot(weights.astype(np.float32), array, (1, axis))
    return np.moveaxis(spread, 0, axis)


def _parts(count: int, parts: int) -> NDArray[np.float64]:
    # Where the parts of so many voxels are, voxels.
    return (np.arange(count * parts) + 0.5) / parts - 0.5


def fine_from_coarse(finer: tuple[int, int, int]) -> Matrix:
    """Return the affine from voxels to their parts, both with centres at integers."""
    matrix = np.diag([*map(float, finer), 1.0])
    matrix[:3, 3] = (np.array(finer) - 1) / 2
    return matrix
