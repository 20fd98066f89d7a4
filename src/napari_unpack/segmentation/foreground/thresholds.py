"""Foreground by robust Otsu thresholds with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

# Of histograms: a pair of thresholds is sought among all 131,000 pairs of bins.
BINS = 512
# Voxels, evenly spread, that levels are found from: their quantiles are good to a thousandth.
MOST_SAMPLES = 4_000_000
# Of them, those that may be broken: far below all others, they say nothing of air.
BROKEN = 0.0005

# Of the height of `high` above air, that of `low`.
LOW_HEIGHT = 0.65

# Of all voxels. With less, and a lower threshold within the noise, 5 to 83 objects were found about
# a single thing; from 0.7 % on it was right. Nuclei fill 46 % above the upper threshold.
LITTLE_FOREGROUND = 0.01

# Deviations of the noise from one voxel to the next above air where there is plainly matter; six of
# the background's own, which has twice that.
PLAIN = 12.0
# Least share of what is plainly matter that lies above the level: of forty volumes of all kinds it
# was 0.5 to 1.5, of those that were mostly lost 0.1.
MOSTLY_DENSE = 0.3

# Voxels of a blurred fringe that are taken off at most.
FRINGE = 2
# A blurred edge lies at half of its height.
EDGE_HEIGHT = 0.5


class NothingFoundError(ValueError):
    """There is no object in the volume, as far as could be told."""


@dataclass(frozen=True)
class Levels:
    """The density levels that tell foreground from air.

    Parameters
    ----------
    air : float
        Density of the background: its mode.
    noise : float
        Standard deviation of the background about it; from its upper side, since scanners clip
        the lower.
    low, high : float
        A voxel is foreground at `low` where it is connected to a voxel at `high`.
    """

    air: float
    noise: float
    low: float
    high: float


def find_levels(volume: NDArray[np.generic]) -> Levels:
    """Find the levels of air and foreground in a volume of any scale; NaN is ignored.

    Raises
    ------
    NothingFoundError
        If nothing rises above the background's noise.
    """
    # Otsu on raw CT numbers puts its threshold between metal and everything else. Here densities
    # above air are compressed by asinh, with its knee at a quarter of the median of what Otsu
    # calls dense, which gives cloth and metal comparable weight; the lower of two Otsu thresholds
    # is `high`, unless thin cloth needs less and six deviations of the background's noise allow
    # it. At most 4 million voxels, evenly spread, are looked at.
    grid = _thinned(volume)
    sample = _finite(grid)
    if len(sample) < 2 or sample.min() == sample.max():
        sample = _finite(volume.astype(np.float64))
    top = float(np.quantile(sample, 0.9995))
    if not top > sample.min():
        top = float(sample.max())
    levels, white = _levels(sample, top, 0), noise_of_steps(grid)
    if _parts_matter(sample, levels, white):
        return _levels_of(levels.air, 2 * white, levels.air + PLAIN * white)
    # Of hardly any foreground the lower threshold parts the noise.
    if levels.high - levels.air < 3 * white:
        # All of it may lie above the quantile.
        upper = _levels(sample, float(sample.max()), 1)
        if (sample > upper.low).mean() < LITTLE_FOREGROUND:
            return upper
    return levels


def _parts_matter(sample: NDArray[np.float64], levels: Levels, white: float) -> bool:
    """Return whether the level parts what is light from what is dense, and not air from both."""
    plain = levels.air + PLAIN * white
    missed = (sample > levels.high).mean() < MOSTLY_DENSE * (sample > plain).mean()
    # Where a scanner clips most of the air, hardly any two neighbours differ: that is no noise.
    return bool(missed and _spread(sample, levels.air, levels.high, 3 * white) >= white > 0)


def _levels(sample: NDArray[np.float64], top: float, which: int) -> Levels:
    """Return the levels by the lower (0) or the upper (1) of Otsu's two thresholds, up to `top`."""
    air = _background(sample, _bottom(sample, top), top)
    dense = _two_thresholds(*_histogram(np.clip(sample, air, top)))[which]
    foreground = sample[sample > dense]
    if not len(foreground) or not dense > air:
        raise NothingFoundError(
            "nothing found in the foreground: no density rises above the background at "
            f"{air:g}; pass foreground= with a density to choose it yourself"
        )
    knee = (float(np.median(foreground)) - air) / 4
    lifted = np.arcsinh(np.clip(sample - air, 0, top - air) / knee)
    high = air + knee * float(np.sinh(_two_thresholds(*_histogram(lifted))[which]))
    noise = _spread(sample, air, high, high - air)
    faint = sample[sample > air + 6 * noise]
    enough = max(6 * noise, 0.1 * (float(np.median(faint)) - air) if len(faint) else 0.0)
    high = min(high, air + enough)
    return _levels_of(air, noise, high)


def _levels_of(air: float, noise: float, high: float) -> Levels:
    return Levels(air, noise, air + LOW_HEIGHT * (high - air), high)


def _bottom(sample: NDArray[np.float64], top: float) -> float:
    """Return where the range of air and matter begins: at the smallest value but broken ones."""
    least, bottom = float(sample.min()), float(np.quantile(sample, BROKEN))
    # Beyond, air would be in the upper half of the range, where no background is sought.
    return bottom if bottom - least > (top - bottom) / 2 else least


def noise_of_steps(grid: NDArray[Any]) -> float:
    """Return the deviation of noise between neighbours along x, or less where much is clipped.

    Parameters
    ----------
    grid : (Z, Y, X) ndarray
        Densities; what is not finite is left out.
    """
    # Half of the differences of two normal values lie below 0.95 of one's deviation.
    return median_step(grid) / 0.95


def median_step(grid: NDArray[Any]) -> float:
    """Return the median difference of neighbours along the last axis; 0 where there is none.

    What is not finite is left out. White noise of deviation 1 has one of 0.954.
    """
    with np.errstate(invalid="ignore"):
        steps = _finite(np.abs(np.diff(grid.astype(np.float64, copy=False), axis=-1)))
    return float(np.median(steps)) if len(steps) else 0.0


def _spread(sample: NDArray[np.float64], air: float, high: float, noise: float) -> float:
    """Return the background's standard deviation, foreground above it clipped away in rounds."""
    # Where a quarter of all is matter they may end too early.
    for _ in range(6):
        inside = sample[sample <= min(air + 3 * noise, high)]
        if not len(inside):
            break
        # 84 % of a normal distribution lie below its mean and one deviation.
        noise = max(float(np.quantile(inside, 0.84)) - air, 0.0)
    return noise


def above_levels(volume: NDArray[Any], levels: Levels) -> NDArray[np.bool_]:
    """Return the voxels above the levels, with hysteresis.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Densities; NaN is background.
    levels : Levels
        See `find_levels`.

    Raises
    ------
    NothingFoundError
        If no voxel is.
    """
    import cc3d

    # A level that float32 cannot hold is infinite there, and right.
    with np.errstate(over="ignore"):
        weak, dense = volume >= levels.low, volume >= levels.high
    if levels.high > levels.low:
        components, count = cc3d.connected_components(weak, connectivity=6, return_N=True)
        strong = np.zeros(count + 1, np.bool_)
        strong[components[dense]] = True
        strong[0] = False
        weak = strong[components]
    if not weak.any():
        raise NothingFoundError(
            f"nothing found in the foreground above a density of {levels.high:g}; "
            "pass a lower foreground="
        )
    return weak


def peel(
    foreground: NDArray[np.bool_], density: NDArray[np.generic], air: float
) -> NDArray[np.bool_]:
    """Take off the blurred fringe of foreground that is denser than the threshold asks.

    Parameters
    ----------
    foreground : (Z, Y, X) ndarray of bool
        Foreground by one threshold for the whole volume. Not changed.
    density : (Z, Y, X) ndarray
    air : float
        Density of the background.
    """
    # A voxel beside the background goes where its density above air is below half of the largest
    # among its 26 neighbours. One low threshold makes steel a voxel or two too thick and gives it
    # a shell of every density between air's and its own. Thin foreground is safe: its densest
    # voxels have no denser neighbour.
    for _ in range(FRINGE):
        inner = foreground.copy()
        _peel(foreground, density, air, EDGE_HEIGHT, inner)
        foreground = inner
    return foreground


@njit(cache=True, nogil=True)
def _peel(foreground, density, air, fraction, inner):  # type: ignore[no-untyped-def]
    """Take one layer off `inner`, a copy of the foreground."""
    depth, height, width = foreground.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                if not foreground[z, y, x]:
                    continue
                rim = (
                    (z > 0 and not foreground[z - 1, y, x])
                    or (z + 1 < depth and not foreground[z + 1, y, x])
                    or (y > 0 and not foreground[z, y - 1, x])
                    or (y + 1 < height and not foreground[z, y + 1, x])
                    or (x > 0 and not foreground[z, y, x - 1])
                    or (x + 1 < width and not foreground[z, y, x + 1])
                )
                if not rim:
                    continue
                limit = air + (np.float64(density[z, y, x]) - air) / fraction
                denser = False
                for k in range(max(z - 1, 0), min(z + 2, depth)):
                    for j in range(max(y - 1, 0), min(y + 2, height)):
                        for i in range(max(x - 1, 0), min(x + 2, width)):
                            denser |= density[k, j, i] > limit
                inner[z, y, x] = not denser


def _thinned(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    step = max(1, int(np.ceil((volume.size / MOST_SAMPLES) ** (1 / 3))))
    return volume[::step, ::step, ::step].astype(np.float64)


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[np.isfinite(values)]


def _background(sample: NDArray[np.float64], bottom: float, top: float) -> float:
    """Return the mode of the darker half of the range."""
    counts, edges = np.histogram(sample, bins=BINS, range=(bottom, top))
    mode = int(np.argmax(counts[: BINS // 2]))
    inside = sample[(sample >= edges[mode]) & (sample <= edges[mode + 1])]
    return float(np.median(inside)) if len(inside) else bottom


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
