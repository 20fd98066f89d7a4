"""Candidates that take sheets and other thin parts off what they touch."""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.workpiece import Proposals, Workpiece


def sheet_candidates(
    piece: Workpiece, shares: tuple[float, ...] = (0.35, 0.65), wide: float = 6.0
) -> Proposals:
    """Propose to take thin parts off thick ones.

    Parameters
    ----------
    piece : Workpiece
        What to cut.
    shares : tuple of float
        Half thickness that counts as thin, against the largest depth.
    wide : float
        A thin part's extent is at least this many times its half thickness.

    Yields
    ------
    Proposal
        "sheet".

    Notes
    -----
    Thin is what an opening takes away: no ball of the half thickness fits there. Under a thick
    thing that rests on it a flat sheet goes on: what lies between its two faces is its own.
    """
    small = piece.coarse
    deepest = float(small.depth.max())
    for share in shares:
        half = share * deepest
        core = small.mask & (small.depth > half)
        if not core.any():
            continue
        away = edt.edt(~core, anisotropy=small.spacing, black_border=False)
        thin = small.mask & (away > half + max(small.spacing))
        sides = _with_sheets(core, thin, small.mask, small.spacing, half, piece.fewest, wide)
        if sides is not None:
            yield "sheet", sides, None


def _with_sheets(
    core: NDArray[np.bool_],
    thin: NDArray[np.bool_],
    mask: NDArray[np.bool_],
    spacing: tuple[float, float, float],
    half: float,
    fewest: int,
    wide: float,
) -> NDArray[np.int32] | None:
    import cc3d

    from napari_unpack.segmentation.flooding import flood

    pieces, count = cc3d.connected_components(thin, connectivity=26, return_N=True)
    sizes = np.bincount(pieces.reshape(-1), minlength=count + 1)
    seeds = core.astype(np.int32)
    name = 1
    for k in np.flatnonzero(sizes[1:] >= fewest) + 1:
        points = np.argwhere(pieces == k) * np.array(spacing)
        if np.linalg.norm(np.ptp(points, axis=0)) < wide * half:
            continue
        name += 1
        seeds[pieces == k] = name
        seeds[_slab(points, mask, spacing, half)] = name
    return flood(seeds, mask) if name > 1 else None


def _slab(
    points: NDArray[np.float64],
    mask: NDArray[np.bool_],
    spacing: tuple[float, float, float],
    half: float,
) -> NDArray[np.bool_]:
    """Return the voxels of a mask between both faces of a flat sheet; none where it is bent."""
    center = points.mean(axis=0)
    axes = np.linalg.svd(np.cov((points - center).T))[0]
    local = (points - center) @ axes
    low, high = np.quantile(local, 0.01, axis=0), np.quantile(local, 0.99, axis=0)
    inside = np.zeros(mask.shape, np.bool_)
    if high[2] - low[2] > 3 * half:
        return inside
    edge = min(spacing) / 2
    places = np.argwhere(mask)
    heights = (places * np.array(spacing) - center) @ axes
    held = ((heights >= low - edge) & (heights <= high + edge)).all(axis=1)
    inside[tuple(places[held].T)] = True
    return inside
