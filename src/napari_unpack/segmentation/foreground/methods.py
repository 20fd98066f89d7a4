"""Which voxels are matter: the ways of telling, by name or by a density."""

from __future__ import annotations

from dataclasses import replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.mumford_shah import mumford_shah
from napari_unpack.segmentation.foreground.thresholds import Levels, find_levels, foreground, peel

WAYS = ("hysteresis", "otsu", "mumford-shah")
"""Names of the ways; a number is a fixed density."""


def checked_way(way: str | float) -> str | float:
    """Return a way of finding the foreground, or say what is wrong with it.

    Parameters
    ----------
    way : str or float
        One of `WAYS`, or the density from which there is matter.

    Raises
    ------
    TypeError
        If it is neither a name nor a number.
    ValueError
        If the name is unknown or the number is not finite.
    """
    wanted = f"foreground must be one of {', '.join(map(repr, WAYS))} or a density"
    if isinstance(way, str):
        if way not in WAYS:
            raise ValueError(f"{wanted}, got {way!r}")
        return way
    if not isinstance(way, Real) or isinstance(way, bool | np.bool_):
        raise TypeError(f"{wanted}, got {way!r}")
    if not np.isfinite(float(way)):
        raise ValueError(f"{wanted}, got {way!r}")
    return float(way)


def levels_of(sample: NDArray[np.generic], way: str | float) -> Levels:
    """Return the densities at which a volume's matter begins.

    Parameters
    ----------
    sample : (Z, Y, X) ndarray
        The density volume, or voxels drawn evenly from it.
    way : str or float
        See `checked_way`.

    Returns
    -------
    Levels
        With one level, not two, for otsu and a density.
    """
    levels = find_levels(sample)
    if way in ("hysteresis", "mumford-shah"):
        return levels
    level = levels.high if isinstance(way, str) else way
    return replace(levels, low=level, high=level)


def find_matter(
    density: NDArray[np.generic], spacing: Spacing, way: str | float
) -> tuple[NDArray[np.bool_], Levels]:
    """Tell matter from air.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Density; NaN is background.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    way : str or float
        See `checked_way`.

    Returns
    -------
    matter : (Z, Y, X) ndarray of bool
        Foreground without the blurred fringe of dense things.
    levels : Levels
        Where matter begins.

    Raises
    ------
    ValueError
        If no voxel is matter.
    """
    levels = levels_of(density, way)
    if way == "mumford-shah":
        matter = mumford_shah(density, levels, spacing)
        if not matter.any():
            raise ValueError(
                "nothing found in the foreground: all of it is smooth; "
                "pass foreground= with a density to choose it yourself"
            )
        return peel(matter, density, levels.air), levels
    return peel(foreground(density, levels), density, levels.air), levels


def typical_knee(density: NDArray[np.generic], matter: NDArray[np.bool_], air: float) -> float:
    """Return a quarter of the median density of matter above air; see `MaterialScale`."""
    values = density[matter][:: max(1, int(matter.size // 1_000_000))]
    return max((float(np.nanmedian(values.astype(np.float64))) - air) / 4, 1e-6)
