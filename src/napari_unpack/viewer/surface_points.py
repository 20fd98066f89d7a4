"""The point of an object's surface under a pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector, triple, unit
from napari_unpack.geometry.transforms import Projection
from napari_unpack.layers.view_camera import Frame
from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.protocols import Pixel

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

# How far around a point its surface's normal is found: steps of voxels must not decide.
NORMAL_VOXELS = 4

# Samples along a ray, smallest voxel edges: a tenth of a voxel is finer than its label is.
STEP = 0.1


def surface_point(target: SessionController, pixel: Pixel) -> SurfacePoint | None:
    """Return the point of a surface that a pixel of the canvas shows; None where there is none.

    Parameters
    ----------
    target : SessionController
    pixel : (2,) ndarray of float64
        Of the canvas, row and column.
    """
    frame, interaction = target.renderer.frame, target.interaction
    object_id = interaction.under(pixel)
    if frame is None or not object_id:
        return None
    projection = target.renderer.picker.projection_of(object_id, frame)
    if projection is None:
        return None
    start, way = projection.ray(interaction.frame_pixel(pixel), frame.size)
    planes = session_planes(target.session, object_id)
    at = first_on_ray(target.session, object_id, start, way, planes)
    return None if at is None else SurfacePoint(object_id, triple(at))


def surface_normal(target: SessionController, pixel: Pixel, frame: Frame) -> Vector | None:
    """Return the direction straight out of the packed object that a pixel shows.

    Parameters
    ----------
    target : SessionController
    pixel : (2,) ndarray of float64
        Of the frame, row and column.
    frame : Frame
        What the canvas shows.

    Returns
    -------
    (3,) ndarray of float64 or None
        Unit vector in world; None where no object is seen.
    """
    session, camera = target.session, frame.camera
    object_id = next(iter(target.renderer.picker.packed_at(*pixel)), 0)
    start, way = Projection(camera.pivot_from_world(), camera).ray(pixel, frame.size)
    planes, spacing = session.clipping, session.spacing
    at = first_on_ray(session, object_id, start, way, planes) if object_id else None
    if at is None:
        return None
    reach = NORMAL_VOXELS * spacing.max()
    low = np.maximum((at - reach) // spacing, 0).astype(np.int64)
    high = (at + reach) // spacing + 2
    box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    voxels = np.argwhere(session.labels[box] == object_id) + low
    away = at - voxels[before_planes(voxels, planes)] * spacing
    out = away[np.linalg.norm(away, axis=1) < reach].sum(axis=0)
    # Straight out as the bag is drawn, also where that is sheared.
    return unit(camera.in_world(np.linalg.solve(camera.linear.T, out))) if out.any() else None


def label_at(session: Session, voxel: NDArray[np.float64]) -> int | None:
    """Return the label at a point of the volume, None outside it.

    Parameters
    ----------
    session : Session
    voxel : (3,) ndarray of float64
        z y x, with fractions.
    """
    spot = np.rint(voxel).astype(np.int64)
    # Negative indices would count from the other end.
    if (spot < 0).any() or (spot >= session.labels.shape).any():
        return None
    return int(session.labels[tuple(spot)])


def session_planes(session: Session, object_id: int) -> NDArray[np.float64]:
    """Return the planes that cut an object as it is shown now, (N, 2, 3) in voxels.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    if session.states[object_id] is ObjectState.PACKED:
        return session.clipping
    own = session.style(object_id).planes(np.diag([*1 / session.spacing, 1.0]))
    return np.zeros((0, 2, 3)) if own is None else own


def before_planes(voxels: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (K,) of bool: which points no plane cuts away.

    Parameters
    ----------
    voxels : (K, 3) ndarray of float64
        z y x.
    planes : (N, 2, 3) ndarray of float64
        What lies behind one is not there, voxels.
    """
    shown = np.ones(len(voxels), np.bool_)
    for point, normal in planes:
        shown &= (voxels - point) @ normal >= 0
    return shown


def first_on_ray(
    session: Session, object_id: int, start: Vector, way: Vector, planes: NDArray[np.float64]
) -> Vector | None:
    """Return the first point of a ray that lies in an object, world mm; None where none does.

    Parameters
    ----------
    session : Session
    object_id : int
    start, way : (3,) ndarray of float64
        Of the ray, world mm; the way need not be of unit length.
    planes : (N, 2, 3) ndarray of float64
        What lies behind one is not there, voxels.
    """
    spacing, bag = session.spacing, session.bag
    row = bag.boxes.index(object_id)
    # Wider than the object, as its picture is: rays through the fringe still mean its edge.
    low = (bag.boxes.lower[row] - 1.5) * spacing
    high = (bag.boxes.upper[row] + 0.5) * spacing
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(low - start) / way, (high - start) / way]), axis=0)
    # A ray along an axis is inside these sides for ever, or never.
    near, far = float(np.nanmax(ends[0])), float(np.nanmin(ends[1]))
    if not near < far:
        return None
    length = (far - near) * float(np.linalg.norm(way))
    count = int(np.ceil(length / (STEP * spacing.min()))) + 1
    points = start + np.linspace(near, far, count)[:, None] * way
    voxels = points / spacing
    shown = before_planes(voxels, planes)
    for labels in (bag.labels, session.display_labels):
        spots = np.rint(voxels).astype(np.int64)
        inside = shown & ((spots >= 0) & (spots < labels.shape)).all(axis=1)
        hits = np.flatnonzero(inside)[labels[tuple(spots[inside].T)] == object_id]
        # Only where the ray misses the object itself does its fringe count.
        if len(hits):
            return np.asarray(points[hits[0]], dtype=np.float64)
    return None
