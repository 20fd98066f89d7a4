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
    return at_least(shown, least, lowest_of(density[mask], shown)) if least else shown


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


def lowest_of(values: NDArray[np.generic], shown: TransferFunction) -> float | None:
    """Return a density above air from which on an object's own begin; None where none is above.

    Parameters
    ----------
    values : (N,) ndarray
        Densities of its voxels.
    shown : TransferFunction
        Whose first point stands for air.
    """
    measured, air = values[np.isfinite(values)], shown.points[0][0]
    if not len(measured):
        return None
    faintest, typical = np.quantile(measured, [0.05, 0.5])
    lowest = float(min(faintest, (air + typical) / 2))
    return lowest if lowest > air else None


def at_least(shown: TransferFunction, least: float, lowest: float | None) -> TransferFunction:
    """Return a transfer function that is nowhere more transparent than so, but in air.

    Parameters
    ----------
    shown : TransferFunction
        What is raised.
    least : float
        Opacity per voxel.
    lowest : float, optional
        Density from which on; None raises air too.
    """
    rest = shown.points
    kept: list[tuple[float, float]] = []
    if lowest is not None:
        # An object is drawn with two voxels of what is around it, which would be a shell.
        ramp = (shown.points[0][0] + lowest) / 2
        kept = [point for point in rest if point[0] < ramp] + [
            (ramp, shown.opacity_at(ramp).item())
        ]
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
