"""Foreground: where there is matter, by robust Otsu thresholds with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BINS = 512
SAMPLES = 4_000_000


@dataclass(frozen=True)
class Levels:
    """The density levels that tell matter from air.

    Parameters
    ----------
    air : float
        Density of the background: its mode.
    noise : float
        Standard deviation of the background about it.
    low, high : float
        A voxel is matter at `low` where it is connected to a voxel at `high`.
    """

    air: float
    noise: float
    low: float
    high: float


def find_levels(volume: NDArray[np.generic]) -> Levels:
    """Find the levels of air and matter in a volume of any scale.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Densities; NaN is ignored.

    Returns
    -------
    Levels

    Raises
    ------
    ValueError
        If nothing rises above the background's noise.

    Notes
    -----
    Otsu on raw CT numbers puts its threshold between metal and everything else. Here densities
    above air are compressed by asinh, with its knee at a quarter of the median of what Otsu calls
    dense, which gives cloth and metal comparable weight, and the lowest of two Otsu thresholds is `high`.
    `low` is where a blurred edge of matter of the weakest class crosses half its height. At most
    4 million voxels, evenly spread, are looked at.
    """
    sample = _sample(volume)
    bottom, top = (float(q) for q in np.quantile(sample, [0.0, 0.9995]))
    if not top > bottom:
        top = float(sample.max())
    air, noise = _background(sample, bottom, top)
    dense = _two_thresholds(*_histogram(np.clip(sample, air, top)))[0]
    matter = sample[sample > dense]
    if top <= air + 6 * noise or not len(matter):
        raise ValueError(
            "nothing found in the foreground: no density rises above the background's noise "
            f"({noise:g} about {air:g}); pass threshold= to choose it yourself"
        )
    knee = (float(np.median(matter)) - air) / 4
    lifted = np.arcsinh(np.clip(sample - air, 0, top - air) / knee)
    first = _two_thresholds(*_histogram(lifted))[0]
    high = air + knee * float(np.sinh(first))
    weak = sample[sample > high]
    typical = float(np.quantile(weak, 0.25)) if len(weak) else high
    low = air + 0.5 * (min(typical, 2 * high - air) - air)
    low = max(min(low, high), air + 4 * noise)
    return Levels(air, noise, low, max(high, low))


def foreground(volume: NDArray[np.generic], levels: Levels) -> NDArray[np.bool_]:
    """Return the voxels of matter.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Densities; NaN is background.
    levels : Levels
        See `find_levels`.

    Returns
    -------
    (Z, Y, X) ndarray of bool

    Raises
    ------
    ValueError
        If no voxel is.
    """
    import cc3d

    weak = volume >= levels.low
    if levels.high > levels.low:
        components, count = cc3d.connected_components(weak, connectivity=6, return_N=True)
        strong = np.zeros(count + 1, np.bool_)
        strong[components[volume >= levels.high]] = True
        strong[0] = False
        weak = strong[components]
    if not weak.any():
        raise ValueError(
            f"nothing found in the foreground above a density of {levels.high:g}; "
            "pass a lower threshold="
        )
    return weak


def _sample(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    step = max(1, int(np.ceil((volume.size / SAMPLES) ** (1 / 3))))
    sample = volume[::step, ::step, ::step].astype(np.float64).reshape(-1)
    sample = sample[np.isfinite(sample)]
    if len(sample) < 2 or sample.min() == sample.max():
        sample = volume.astype(np.float64).reshape(-1)
        sample = sample[np.isfinite(sample)]
    return sample


def _background(sample: NDArray[np.float64], bottom: float, top: float) -> tuple[float, float]:
    """Return the mode of the darker half of the range and the spread below it."""
    counts, edges = np.histogram(sample, bins=BINS, range=(bottom, top))
    half = counts[: BINS // 2]
    mode = int(np.argmax(half))
    inside = sample[(sample >= edges[mode]) & (sample <= edges[mode + 1])]
    air = float(np.median(inside)) if len(inside) else bottom
    below = air - sample[sample <= air]
    noise = 1.4826 * float(np.median(below)) if len(below) else 0.0
    return air, noise


def _histogram(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    counts, edges = np.histogram(values, bins=BINS)
    return counts.astype(np.float64), (edges[1:] + edges[:-1]) / 2


def _two_thresholds(
    counts: NDArray[np.float64], centers: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the two Otsu thresholds of a histogram (Otsu 1979, three classes)."""
    weight = np.concatenate([[0.0], np.cumsum(counts)])
    moment = np.concatenate([[0.0], np.cumsum(counts * centers)])

    def between(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.float64]:
        w = weight[b] - weight[a]
        m = moment[b] - moment[a]
        return np.where(w > 0, m * m / np.maximum(w, 1), 0.0)

    n = len(counts)
    i = np.arange(1, n)[:, None]
    j = np.arange(1, n)[None, :]
    zero, end = np.zeros_like(i), np.full_like(j, n)
    value = between(zero, i) + between(i, np.maximum(i, j)) + between(j, end)
    value = np.where(j > i, value, -np.inf)
    best = int(np.argmax(value))
    a, b = divmod(best, n - 1)
    return float((centers[a] + centers[a + 1]) / 2), float(
        (centers[b] + centers[min(b + 1, n - 1)]) / 2
    )
