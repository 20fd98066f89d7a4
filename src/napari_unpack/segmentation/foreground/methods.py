"""The methods that tell foreground from air, by name or by a density."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.mumford_shah import mumford_shah
from napari_unpack.segmentation.foreground.thresholds import (
    Levels,
    NothingFoundError,
    above_levels,
    find_levels,
    peel,
)
from napari_unpack.tasks import SILENT, Share

# Names of methods; a number is a fixed density.
FOREGROUND_METHODS = ("hysteresis", "otsu", "mumford-shah")


@dataclass(frozen=True)
class KnownScale:
    """What is known of the densities of a volume to those who see a block of it.

    Parameters
    ----------
    levels : Levels
    knee : float
        See `typical_knee`.
    """

    levels: Levels
    knee: float


@dataclass(frozen=True)
class ForegroundOptions:
    """What of a volume may be objects.

    Parameters
    ----------
    method : str or float
        One of `FOREGROUND_METHODS`, or the density from which there is foreground.
    supports, shell : bool
        Leave out the scanner's table, and the bag itself.
    known : KnownScale, optional
        Where the densities are a block's, which is no scanner's slice; by default it is found in
        them.
    found : tuple of (Z, Y, X) ndarray of bool and Levels, optional
        What `find_foreground` has returned of this very volume, so that nobody asks it again.
    """

    method: str | float = "hysteresis"
    supports: bool = True
    shell: bool = True
    known: KnownScale | None = None
    found: tuple[NDArray[np.bool_], Levels] | None = field(default=None, compare=False, repr=False)

    def find(
        self, density: NDArray[np.generic], spacing: Spacing, share: Share
    ) -> tuple[NDArray[np.bool_], Levels]:
        """Return what was found, or find it; see `find_foreground`.

        Parameters
        ----------
        density, spacing, share
            As for `find_foreground`.
        """
        if self.found is not None:
            return self.found
        begun = share.part(0.0, 1.0, "Finding the foreground")
        return find_foreground(density, spacing, self.method, begun, self.known)


def checked_foreground(method: str | float) -> str | float:
    """Return a method of finding the foreground, or say what is wrong with it.

    Raises
    ------
    TypeError
        If it is neither a name nor a number.
    ValueError
        If the name is unknown or the number is not finite.
    """
    wanted = f"foreground must be one of {', '.join(map(repr, FOREGROUND_METHODS))} or a density"
    if isinstance(method, str):
        if method not in FOREGROUND_METHODS:
            raise ValueError(f"{wanted}, got {method!r}")
        return method
    if not isinstance(method, Real) or isinstance(method, bool | np.bool_):
        raise TypeError(f"{wanted}, got {method!r}")
    if not np.isfinite(float(method)):
        raise ValueError(f"{wanted}, got {method!r}")
    return float(method)


def foreground_levels(sample: NDArray[np.generic], method: str | float) -> Levels:
    """Return where a volume's foreground begins: one level, not two, for otsu and a density.

    Parameters
    ----------
    sample : (Z, Y, X) ndarray
        The density volume, or voxels drawn evenly from it.
    method : str or float
        See `checked_foreground`.
    """
    levels = find_levels(sample)
    if method in ("hysteresis", "mumford-shah"):
        return levels
    level = levels.high if isinstance(method, str) else method
    return replace(levels, low=level, high=level)


def find_foreground(
    density: NDArray[np.generic],
    spacing: Spacing,
    method: str | float,
    share: Share = SILENT,
    known: KnownScale | None = None,
) -> tuple[NDArray[np.bool_], Levels]:
    """Tell foreground from air.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Density; NaN is background.
    spacing : (float, float, float) of mm, z y x
    method : str or float
        See `checked_foreground`.
    share : Share
    known : KnownScale, optional
        See `ForegroundOptions`.

    Returns
    -------
    foreground : (Z, Y, X) ndarray of bool
        Foreground without the blurred fringe of dense things.
    levels : Levels
        Where the foreground begins.

    Raises
    ------
    NothingFoundError
        If no voxel is foreground.
    """
    levels = foreground_levels(density, method) if known is None else known.levels
    share(0.3)
    if method == "mumford-shah":
        foreground = mumford_shah(density, levels, spacing, share.part(0.3, 1.0))
        if not foreground.any():
            raise NothingFoundError(
                "nothing found in the foreground: all of it is smooth; "
                "pass foreground= with a density to choose it yourself"
            )
        return peel(foreground, density, levels.air), levels
    foreground = above_levels(density, levels)
    share(0.7)
    return peel(foreground, density, levels.air), levels


def typical_knee(density: NDArray[np.generic], foreground: NDArray[np.bool_], air: float) -> float:
    """Return a quarter of the median density of the foreground above air; see `DensityScale`.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    foreground : (Z, Y, X) ndarray of bool
    air : float
        Density.
    """
    values = density[foreground][:: max(1, int(foreground.size // 1_000_000))]
    return max((float(np.nanmedian(values.astype(np.float64))) - air) / 4, 1e-6)
