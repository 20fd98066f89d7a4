"""Opacity of a step: what an opacity per voxel comes to over the length a step really has."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays

ENTRIES = 2049
"""Opacities tabulated for one length of step."""

RATIO = 1.001
"""Lengths of step closer than this share a table."""

MOST_LENGTHS = 256
"""As many tables for a picture; lengths that share one are farther apart where these are few."""


def correction(rays: Rays, spacing: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Tabulate 1 - (1 - a)^e for every e = step length / min(spacing) in a picture.

    Parameters
    ----------
    rays : Rays
        Of the picture; in perspective the outer rays have longer steps.
    spacing : (3,) array_like
        Voxel size in mm, z y x.

    Returns
    -------
    exponents : (n,) ndarray of float64
        In geometric order.
    table : (n, ENTRIES) ndarray of float32
        Corrected opacity over a in [0, 1]; no rows at all where every step is one voxel long.
    """
    low, high = _range(rays, np.asarray(spacing, dtype=np.float64))
    if abs(low - 1) < 1e-6 and abs(high - 1) < 1e-6:
        return np.ones(1), np.zeros((0, ENTRIES), np.float32)
    count = 1 + int(np.ceil(np.log(high / low) / np.log(RATIO) - 1e-6))
    exponents = np.geomspace(low, max(high, low), min(max(count, 1), MOST_LENGTHS))
    through = 1.0 - np.linspace(0.0, 1.0, ENTRIES)
    return exponents, (1.0 - through[None] ** exponents[:, None]).astype(np.float32)


def _range(rays: Rays, mm: NDArray[np.float64]) -> tuple[float, float]:
    # Length is convex over a picture: most in a corner, least at its only stationary point or
    # on the border, wherever that is where the bag is stretched.
    middle, down, right = rays.table[3:] * mm * rays.step / mm.min()
    rows, columns = np.asarray(rays.size, dtype=np.float64) - 1
    corners = [middle + r * down + c * right for r in (0.0, rows) for c in (0.0, columns)]
    found = [*corners]
    for start, along, count in (
        (corners[0], right, columns),
        (corners[2], right, columns),
        (corners[0], down, rows),
        (corners[1], down, rows),
    ):
        part = -(start @ along) / max(float(along @ along), 1e-300)
        found.append(start + np.clip(part, 0.0, count) * along)
    r, c = np.linalg.lstsq(np.stack([down, right], axis=1), -middle, rcond=None)[0]
    if 0 <= r <= rows and 0 <= c <= columns:
        found.append(middle + r * down + c * right)
    lengths = np.linalg.norm(found, axis=1)
    return float(lengths.min()), float(lengths.max())


@njit(cache=True, nogil=True, error_model="numpy")
def family_of(exponent, exponents):  # type: ignore[no-untyped-def]
    """Return the row of the table nearest to one ray's exponent."""
    last = exponents.shape[0] - 1
    if last == 0:
        return np.uint64(0)
    n = np.rint(np.log(exponent / exponents[0]) / np.log(exponents[last] / exponents[0]) * last)
    return np.uint64(min(max(n, 0.0), np.float64(last)))
