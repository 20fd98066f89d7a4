"""Streaks: what metal draws through a scan, and what looks like matter but has no surface.

The surface of a thing is a step of density, which the scanner blurs over two voxels or so. A
streak fades, and ends where it falls below the level that tells foreground from air.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.density_regions import SOLID_METAL, DensityScale
from napari_unpack.segmentation.common.mask_components import mask_components
from napari_unpack.segmentation.foreground.thresholds import Levels

STEP = 0.75
"""Share of its density above air that a thing loses from two voxels inside to two outside."""

SURFACE = 0.65
"""Share of a surface where it does so, over that of the scan's median object, at least.

Of 452 objects found rightly on nineteen simulated scans and two of another simulator the least has
0.71, of the backpack's 0.69; of sixteen streaks thirteen have 0.62 or less. Against the median, as
a scan may be blurred, or sampled finely.
"""

BARE = 0.25
"""Share of its surface that is bare, at least: what lies within others is not judged."""


def find_streaks(
    labels: NDArray[np.int32], density: NDArray[np.generic], levels: Levels
) -> NDArray[np.bool_]:
    """Return by label, (M,), which objects fade into air; false for 0.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ..., 0 background.
    density : (Z, Y, X) ndarray
        NaN is no surface.
    levels : Levels
        Of air and foreground: where background is denser than `high`, two voxels on, it is no
        air, such as the flesh around a bone.
    """
    top = int(labels.max(initial=0))
    counts = np.zeros((top + 1, 3), np.int64)
    _count_faces(labels, density, levels.air, levels.high, counts)
    surface, bare, steep = counts.T
    judged = (bare > BARE * surface) & (bare > 0)
    shares = steep / np.maximum(bare, 1)
    usual = float(np.median(shares[judged])) if judged.any() else 0.0
    return np.asarray(judged & (shares < SURFACE * usual))


def without_streaks(
    labels: NDArray[np.int32],
    streaks: NDArray[np.bool_],
    density: NDArray[np.generic],
    scale: DensityScale,
    least: float,
) -> tuple[NDArray[np.int32], int]:
    """Drop streaks, but for the solid metal in them that they go out from.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ..., 0 background. Not changed.
    streaks : (M,) ndarray of bool
        By label.
    density : (Z, Y, X) ndarray
    scale : DensityScale
    least : float
        Voxels of a piece of metal that is kept.

    Returns
    -------
    labels : (Z, Y, X) ndarray of int32
        Pieces of metal have labels of their own after M - 1.
    count : int
        Of these pieces.
    """
    dropped = streaks[labels]
    solid = dropped & (density > scale.air + np.expm1(SOLID_METAL) * scale.knee)
    pieces, _ = mask_components(solid)
    kept = np.bincount(pieces.reshape(-1)) >= least
    kept[0] = False
    names = np.where(kept, len(streaks) - 1 + np.cumsum(kept), 0).astype(np.int32)
    return np.where(dropped, names[pieces], labels), int(kept.sum())


@njit(cache=True, nogil=True)
def _count_faces(labels, density, air, level, found):  # type: ignore[no-untyped-def]
    """Count the faces of each label, those that meet air, and those where density falls there."""
    size = labels.shape
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                here = labels[z, y, x]
                if here == 0:
                    continue
                for side in range(6):
                    axis, way = side // 2, 2 * (side % 2) - 1
                    c, b, a = way * (axis == 0), way * (axis == 1), way * (axis == 2)
                    k, j, i = z + c, y + b, x + a
                    if k < 0 or j < 0 or i < 0 or k >= size[0] or j >= size[1] or i >= size[2]:
                        continue
                    if labels[k, j, i] == here:
                        continue
                    found[here, 0] += 1
                    if labels[k, j, i] != 0:
                        continue
                    outer = np.float64(density[k, j, i])
                    k, j, i = k + c, j + b, i + a
                    inside = 0 <= k < size[0] and 0 <= j < size[1] and 0 <= i < size[2]
                    if inside and labels[k, j, i] == 0:
                        outer = min(outer, np.float64(density[k, j, i]))
                    if not outer < level:
                        continue
                    inner = np.float64(density[z, y, x])
                    k, j, i = z - c, y - b, x - a
                    inside = 0 <= k < size[0] and 0 <= j < size[1] and 0 <= i < size[2]
                    if inside and labels[k, j, i] == here:
                        inner = max(inner, np.float64(density[k, j, i]))
                    found[here, 1] += 1
                    found[here, 2] += inner - outer >= STEP * (inner - air)
