"""The round field of view of a scanner: beyond it nothing was measured, at its rim nonsense."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def measured_section(
    density: NDArray[np.generic], rim: float = 3.5, padded: float = 0.98
) -> NDArray[np.bool_] | None:
    """Return the pixels of a slice that the scanner measured, where its field of view is round.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Density.
    rim : float
        Pixels within this of the circle's edge are not trusted.
    padded : float
        The field is round where at least this share of the corners holds one same value.

    Returns
    -------
    (Y, X) ndarray of bool or None
        None where the field of view is not round.

    Notes
    -----
    Reconstructions fill the corners outside the circle inscribed in the slice with a constant,
    and the last pixels of the circle hold the jump to it: a ring through all slices. At most 32
    slices are looked at.
    """
    _, height, width = density.shape
    if height != width or height < 32:
        return None
    y, x = np.ogrid[:height, :width]
    middle = (width - 1) / 2
    radius = np.hypot(y - middle, x - middle)
    slices = density[:: max(1, len(density) // 32)]
    corners = slices[:, radius > middle + 2.5]
    same = corners == corners.reshape(-1)[0]
    if same.mean() < padded or not _noisy_all_round(slices, radius, corners.reshape(-1)[0]):
        return None
    return np.asarray(radius <= middle - rim)


def _noisy_all_round(
    slices: NDArray[np.generic], radius: NDArray[np.float64], padding: np.generic
) -> bool:
    """Return whether every sixteenth of the circle's outermost pixels differs from the padding."""
    middle = (radius.shape[1] - 1) / 2
    rows, columns = np.nonzero((radius < middle) & (radius > middle - 12))
    differs = (slices[:, rows, columns] != padding).mean(axis=0)
    sector = ((np.arctan2(rows - middle, columns - middle) / np.pi + 1) * 8).astype(int) % 16
    share = np.bincount(sector, differs, 16) / np.maximum(np.bincount(sector, minlength=16), 1)
    return float(share.min()) > 0.05
