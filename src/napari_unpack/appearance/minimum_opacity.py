"""A minimum opacity for objects that the transfer function hardly shows, when they stand alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.boxes import LabelBoxes

# Opacity, through the middle of an object, below which it is hardly seen when it stands alone.
HARDLY_SEEN = 0.2
# The opacity through its middle that such an object is given.
GIVEN_OPACITY = 0.35
# Voxels around an object, among which is air.
AROUND = 2


def visible_alone(
    object_id: int,
    labels: NDArray[np.uint16],
    volume: NDArray[np.generic],
    boxes: LabelBoxes,
    mean_density: float,
    shown: TransferFunction,
) -> TransferFunction:
    """Return a transfer function under which an object is seen when it stands alone.

    Parameters
    ----------
    object_id : int
    labels : (Z, Y, X) ndarray of uint16
    volume : (Z, Y, X) ndarray
    boxes : LabelBoxes
        Of these labels, voxels.
    mean_density : float
        Of the object; NaN where it is not known.
    shown : TransferFunction
        The master's.

    Returns
    -------
    TransferFunction
        The master's itself where that shows enough of the object, else one with a minimum
        opacity: a person who takes something out of a bag expects to see it leave.

    Raises
    ------
    KeyError
        If there is no such object.
    """
    row = boxes.index(object_id)
    edges = boxes.upper[row] - boxes.lower[row]
    # Most objects are settled by their facts: looking at the voxels of all would take seconds.
    if surely_seen(int(boxes.counts[row]), edges, mean_density, shown):
        return shown
    part = boxes.slices(object_id)
    mask, density = labels[part] == object_id, volume[part]
    least = minimum_opacity(mask, density, shown)
    if not least:
        return shown
    around = boxes.slices(object_id, AROUND)
    # The first point may be of padding, or a person's.
    air = air_among(labels[around], volume[around])
    air = shown.points[0][0] if air is None else air
    return at_least(shown, least, own_range(density[mask], air))


def air_among(labels: NDArray[np.integer], volume: NDArray[np.generic]) -> float | None:
    """Return the density of what is no object's, None where all is.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
    volume : (Z, Y, X) ndarray
    """
    beside = volume[(labels == 0) & np.isfinite(volume)]
    # Of the lowest densities some may be of padding.
    return float(np.median(beside)) if beside.size else None


def minimum_opacity(
    mask: NDArray[np.bool_], density: NDArray[np.generic], shown: TransferFunction
) -> float:
    """Return the least opacity per voxel that makes an object seen; 0 where it is seen as it is.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        The object, in a box around it.
    density : (Z, Y, X) ndarray
        Of the same box.
    shown : TransferFunction

    Notes
    -----
    Opacity along a ray through n voxels of opacity a is 1 - (1 - a)^n; n is taken as the voxels
    met by a ray that meets the object at all, on average, along the axis where they are fewest:
    an object is held with its broad side to the viewer.
    """
    voxels = np.nan_to_num(np.asarray(density[mask], dtype=np.float64))
    if not len(voxels):
        return 0.0
    thickness = _thickness(mask, len(voxels))
    clear = np.log1p(-np.minimum(shown.opacity_at(voxels), 0.9999)).mean() * thickness
    if 1.0 - np.exp(clear) >= HARDLY_SEEN:
        return 0.0
    return float(1.0 - (1.0 - GIVEN_OPACITY) ** (1.0 / thickness))


def own_range(values: NDArray[np.generic], air: float) -> tuple[float, float] | None:
    """Return up to where air goes, and from where on an object's own densities; None: no telling.

    Parameters
    ----------
    values : (N,) ndarray
        Densities of its voxels.
    air : float
        Density of what is around it.
    """
    measured = values[np.isfinite(values)]
    if not len(measured):
        return None
    faintest, typical = np.quantile(measured, [0.05, 0.5])
    lowest = float(min(faintest, (air + typical) / 2))
    middle = (air + lowest) / 2
    return (middle, lowest) if air < middle < lowest else None


def at_least(
    shown: TransferFunction, least: float, between: tuple[float, float] | None
) -> TransferFunction:
    """Return a transfer function that is nowhere more transparent than so, but in air.

    Parameters
    ----------
    shown : TransferFunction
        What is raised.
    least : float
        Opacity per voxel.
    between : (float, float), optional
        See `own_range`: it rises between them; None raises air too.
    """
    rest = shown.points
    kept: list[tuple[float, float]] = []
    if between is not None:
        # An object is drawn with two voxels of what is around it, which would be a shell.
        air, lowest = between
        kept = [*(p for p in rest if p[0] < air), (air, shown.opacity_at(air).item())]
        rest = ((lowest, shown.opacity_at(lowest).item()), *(p for p in rest if p[0] > lowest))
    raised = [(density, max(opacity, least)) for density, opacity in rest]
    return TransferFunction(kept + raised, shown.colors)


def surely_seen(
    voxels: int, edges: NDArray[np.int64], mean_density: float, shown: TransferFunction
) -> bool:
    """Tell, without looking at its voxels, whether an object needs no minimum opacity.

    Parameters
    ----------
    voxels : int
        How many it has.
    edges : (3,) ndarray of int
        Of its box, voxels.
    mean_density : float
        NaN where it is not known.
    shown : TransferFunction
    """
    if not np.isfinite(mean_density):
        return False
    # A box is no narrower than what is in it: the object is at least so thick.
    thickness = voxels * int(edges.min()) / float(np.prod(edges.astype(float)))
    opacity = float(shown.opacity_at(mean_density))
    return bool(1.0 - (1.0 - opacity) ** max(thickness, 1.0) >= 2 * HARDLY_SEEN)


def _thickness(mask: NDArray[np.bool_], voxels: int) -> float:
    return float(min(voxels / np.count_nonzero(mask.any(axis=axis)) for axis in range(3)))
