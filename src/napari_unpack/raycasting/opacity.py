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
    mm = np.asarray(spacing, dtype=np.float64)
    r, c = np.meshgrid(
        np.linspace(0, rays.size[0] - 1, 9), np.linspace(0, rays.size[1] - 1, 9), indexing="ij"
    )
    weights = np.stack([np.ones_like(r), r, c], axis=-1)
    lengths = np.linalg.norm((weights @ rays.table[3:]) * mm, axis=-1) * rays.step / mm.min()
    low, high = float(lengths.min()), float(lengths.max())
    if abs(low - 1) < 1e-6 and abs(high - 1) < 1e-6:
        return np.ones(1), np.zeros((0, ENTRIES), np.float32)
    count = 1 + int(np.ceil(np.log(high / low) / np.log(RATIO) - 1e-6))
    exponents: NDArray[np.float64] = low * np.power(
        RATIO, np.arange(max(count, 1)), dtype=np.float64
    )
    through = 1.0 - np.linspace(0.0, 1.0, ENTRIES)
    return exponents, (1.0 - through[None] ** exponents[:, None]).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def family_of(exponent, exponents):  # type: ignore[no-untyped-def]
    """Return the row of the table nearest to one ray's exponent."""
    n = np.rint(np.log(exponent / exponents[0]) / np.log(RATIO))
    return np.uint64(min(max(n, 0.0), exponents.shape[0] - 1.0))
