"""Where a scan's matter begins: the densities a first transfer function hangs on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class Ramp:
    """Densities at which opacity turns.

    Parameters
    ----------
    lowest : float
        Least density of the scan.
    foot : float
        Where matter begins to show.
    surface : float
        Where a surface stands, between background and matter.
    body : float
        The typical density of matter.
    highest : float
        Close to the densest there is.
    """

    lowest: float
    foot: float
    surface: float
    body: float
    highest: float


def foreground_ramp(volume: ArrayLike) -> Ramp:
    """Find where matter begins in a scan of any range.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Density; NaN and infinities are ignored. A million voxels of it are looked at.

    Returns
    -------
    Ramp

    Raises
    ------
    ValueError
        If the volume is empty, constant or has no finite value.

    Notes
    -----
    Otsu's threshold (1979) on densities clipped to their 97th percentile, or a higher one where
    less than 3 % is matter: a percent of metal would pull it up until cloth and plastic vanish.
    """
    samples = _samples(np.asarray(volume))
    if samples.size == 0 or samples.min() == samples.max():
        samples = np.concatenate([samples, _extremes(np.asarray(volume))])
    if samples.size == 0:
        raise ValueError("volume must hold finite densities, got none")
    lowest, highest = float(samples.min()), float(samples.max())
    if not highest > lowest:
        raise ValueError(f"volume must not be constant, got {lowest!r} everywhere")
    air, noise = _level(samples[samples <= np.median(samples)])
    # Metal pulls Otsu's threshold up, so the densest are clipped, but never matter altogether.
    tops = np.percentile(samples, (97, 99, 99.5, 99.9, 100))
    top = float(next((t for t in tops if t > air + max(10 * noise, 0.0)), highest))
    clipped = np.minimum(samples, top)
    threshold = _otsu(clipped)
    matter = clipped[clipped > threshold]
    body = float(np.median(matter)) if matter.size else top
    air, noise = _level(clipped[clipped <= threshold])
    foot = min(max(air + 4.0 * noise, air + 0.45 * (threshold - air)), 0.8 * threshold + 0.2 * air)
    surface = max(threshold, foot + 0.25 * (body - foot))
    return Ramp(lowest, foot, surface, max(body, surface), max(top, (highest + top) / 2))


def _samples(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    step = max(1, int(np.ceil((volume.size / MOST_SAMPLES) ** (1 / max(volume.ndim, 1)))))
    thinned = volume[tuple(slice(None, None, step) for _ in range(volume.ndim))]
    values = thinned.astype(np.float64).ravel()
    return values[np.isfinite(values)]


def _extremes(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the least and greatest finite density of all voxels, where thinning missed them."""
    finite = volume[np.isfinite(volume)]
    return np.array([finite.min(), finite.max()] if finite.size else [], dtype=np.float64)


def _level(background: NDArray[np.float64]) -> tuple[float, float]:
    """Return the background's typical density and its noise."""
    air = float(np.median(background))
    return air, 1.4826 * float(np.median(np.abs(background - air)))


def _otsu(values: NDArray[np.float64]) -> float:
    counts, edges = np.histogram(values, bins=256)
    middles = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts).astype(np.float64)
    above = below[-1] - below
    moment = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = below * above * (moment / below - (moment[-1] - moment) / above) ** 2
    return float(edges[1:][np.nanargmax(spread[:-1])])
