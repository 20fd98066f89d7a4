"""Candidates at density steps: materials inside a region, and basins of its gradient."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.flooding import flood
from napari_unpack.segmentation.workpiece import Proposals, Workpiece, largest_steps


def density_candidates(piece: Workpiece) -> Proposals:
    """Propose to part what differs in density.

    Parameters
    ----------
    piece : Workpiece
        What to cut.

    Yields
    ------
    Proposal
        "materials" (Otsu's two classes, then three, of the voxels off the rim) and "basins" (a
        watershed of the gradient from its calm places).
    """
    from scipy.ndimage import gaussian_filter
    from skimage.filters import threshold_multiotsu

    small = piece.coarse
    weight = gaussian_filter(small.mask.astype(np.float32), 0.7)
    smooth = gaussian_filter(np.where(small.mask, small.density, 0), 0.7)
    smooth = np.where(small.mask, smooth / np.maximum(weight, 1e-3), 0).astype(np.float32)
    inner = small.mask & (small.depth > 1.5 * max(small.spacing))
    if np.count_nonzero(inner) < 2 * piece.fewest:
        return
    slope = largest_steps(smooth, small.mask)
    low, high = np.quantile(smooth[inner], [0.01, 0.99])
    settle = np.clip(slope / max(float(np.quantile(slope[inner], 0.99)), 1e-6), 0, 1)
    if high > low + 0.02 * abs(float(high)):
        values = np.clip(smooth[inner], low, high)
        for classes in (2, 3):
            try:
                levels = threshold_multiotsu(values, classes, nbins=64)
            except ValueError:
                continue
            kinds = np.where(inner, np.digitize(smooth, levels) + 1, 0).astype(np.int32)
            sides = _grown(kinds, small.mask, piece.fewest // 2, settle)
            if sides.max() > 1:
                yield "materials", sides, None
    calm = inner & (slope < np.quantile(slope[inner], 0.4))
    sides = _grown(calm.astype(np.int32), small.mask, max(piece.fewest // 4, 8), settle)
    if 1 < sides.max() <= 12:
        yield "basins", sides, None


def _grown(
    kinds: NDArray[np.int32],
    mask: NDArray[np.bool_],
    fewest: int,
    settle: NDArray[np.floating],
) -> NDArray[np.int32]:
    """Take the large components of every kind, and flood the rest of the mask from them."""
    import cc3d

    pieces, count = cc3d.connected_components(kinds, connectivity=6, return_N=True)
    sizes = np.bincount(pieces.reshape(-1), minlength=count + 1)
    large = sizes >= max(fewest, 1)
    large[0] = False
    seeds = np.where(large, np.cumsum(large), 0).astype(np.int32)[pieces]
    return flood(seeds, mask, (255 * settle).astype(np.uint8))
