"""Crumpled cloth: hundreds of thin light folds to a scanner, one bundle to a hand."""

from __future__ import annotations

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import label_means
from napari_unpack.segmentation.common.depths import label_depths
from napari_unpack.segmentation.common.morphology import dilate
from napari_unpack.segmentation.common.validation import Spacing

# Voxels that four times the mean depth of a fold, the thickness of a plate, is at most.
LAYERS = 6.0
# Folds are less than this share of the foreground where thin light parts are walls and sheets.
PREVALENCE = 0.25


def bundle_folds(
    parts: NDArray[np.int32], density: NDArray[np.generic], spacing: Spacing, light: float
) -> NDArray[np.int32]:
    """Give folds that lie against each other one label.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        Parts 1, 2, ..., 0 background. Not changed.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    light : float
        The mean density of a fold is at most this.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        A bundle has the label of its largest fold; it may be in several pieces, one voxel apart.
    """
    # Folds of one or two voxels have neither an inside nor a border of their own: their mean
    # density and touching areas say nothing about what belongs together, nearness does.
    top = int(parts.max())
    flat = parts.reshape(-1)
    thickness = 4 * label_means(parts, label_depths(parts, spacing))
    mean = label_means(parts, np.nan_to_num(density.astype(np.float32)))
    fold = (thickness <= LAYERS * float(np.cbrt(np.prod(spacing)))) & (mean <= light)
    fold[0] = False
    if not fold.any() or np.bincount(flat)[fold].sum() < PREVALENCE * np.count_nonzero(flat):
        return parts
    folds = fold[parts]
    bundles = cc3d.connected_components(dilate(folds), connectivity=6)
    bundles[~folds] = 0
    owner = np.arange(top + 1, dtype=np.int32)
    first, second = bundles[folds].astype(np.int64), parts[folds].astype(np.int64)
    pairs, voxels = np.unique(first * (top + 1) + second, return_counts=True)
    bundle, name = pairs // (top + 1), pairs % (top + 1)
    # Largest share last, so that it is the one that stays in the tables of owners.
    rank = np.argsort(voxels, kind="stable")
    leader = np.zeros(int(bundle.max()) + 1, np.int32)
    leader[bundle[rank]] = name[rank]
    owner[name[rank]] = leader[bundle[rank]]
    return owner[parts]
