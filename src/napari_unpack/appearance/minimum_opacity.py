"""Objects of which the transfer function shows next to nothing, and how they are shown alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction

FAINT = 0.2
"""Opacity, through the middle of an object, below which it is hardly seen when it stands alone."""

VEILED = 0.35
"""The opacity it is given then."""


def veil(mask: NDArray[np.bool_], density: NDArray[np.generic], shown: TransferFunction) -> float:
    """Return the least opacity per voxel that makes an object seen; 0 where it is seen as it is.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        The object, in a crop around it.
    density : (Z, Y, X) ndarray
        Of the same crop.
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
    if 1.0 - np.exp(clear) >= FAINT:
        return 0.0
    return float(1.0 - (1.0 - VEILED) ** (1.0 / thickness))


def veiled(shown: TransferFunction, least: float) -> TransferFunction:
    """Return a transfer function that is nowhere more transparent than so."""
    points = [(density, max(opacity, least)) for density, opacity in shown.points]
    return TransferFunction(points, shown.colors)


def surely_seen(
    voxels: int, edges: NDArray[np.int64], mean_density: float, shown: TransferFunction
) -> bool:
    """Tell, without looking at its voxels, whether an object is no candidate for a veil.

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
    return bool(1.0 - (1.0 - opacity) ** max(thickness, 1.0) >= 2 * FAINT)


def _thickness(mask: NDArray[np.bool_], voxels: int) -> float:
    return float(min(voxels / np.count_nonzero(mask.any(axis=axis)) for axis in range(3)))
