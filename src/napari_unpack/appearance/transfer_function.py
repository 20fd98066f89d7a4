"""The master transfer function, density to colour and opacity, and the first one of a scan."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from napari_unpack.geometry.masks import unmasked

# Enough for quantiles to a thousandth; more only takes time.
MOST_SAMPLES = 1_000_000

# Of densities, in a volume that is not constant.
SMALLEST_RANGE = 1e-300

# Opacity per voxel that is hardly seen: through thirty voxels, half of the light passes.
FAINT = 0.02

# Opacity per voxel that a labelled object gets which would be faint: half in seven voxels.
LIFTED = 0.1

# Share of an object that has to be more than faint: the wall of a box full of air is less than a
# tenth of it, and enough to see the box.
SEEN_SHARE = 0.01


def foreground_ramp(volume: ArrayLike) -> tuple[float, float, float, float, float]:
    """Find the densities at which opacity turns, in a scan of any range.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Density; NaN and infinities are ignored. A million voxels of it are looked at.

    Returns
    -------
    lowest, foot, surface, body, highest : float
        The least density; where matter begins to show; where a surface stands, between background
        and matter; the typical density of matter; close to the densest there is.

    Raises
    ------
    ValueError
        If the volume is empty, constant or has no finite value.

    Notes
    -----
    Otsu's threshold (1979) on densities clipped to their 97th percentile, or a higher one where
    less than 3 % is matter: a percent of metal would pull it up until cloth and plastic vanish.
    """
    density = unmasked(volume, np.nan)
    samples = _samples(density)
    if samples.size == 0 or samples.min() == samples.max():
        samples = np.concatenate([samples, _extremes(density)])
    if samples.size == 0:
        raise ValueError("volume must hold finite densities, got none")
    lowest, highest = float(samples.min()), float(samples.max())
    # Across less, slopes overflow.
    if not highest - lowest > SMALLEST_RANGE:
        raise ValueError(f"volume must not be constant, got {lowest!r} everywhere")
    # From the lowest on: far from zero there are not enough floats for 256 bins in a small range.
    samples, highest = samples - lowest, highest - lowest
    # At least half of a scan is air around the bag.
    air, noise = _level(samples[samples <= np.median(samples)])
    # Metal raises Otsu's threshold up, so the densest are clipped, but never matter altogether.
    tops = np.percentile(samples, (97, 99, 99.5, 99.9, 100))
    top = float(next((t for t in tops if t > air + max(10 * noise, 0.0)), highest))
    clipped = np.minimum(samples, top)
    threshold = _otsu(clipped)
    matter = clipped[clipped > threshold]
    body = float(np.median(matter)) if matter.size else top
    air, noise = _level(clipped[clipped <= threshold])
    # Above four deviations of noise air stays clear, below 0.8 of the threshold cloth shows.
    foot = min(max(air + 4.0 * noise, air + 0.45 * (threshold - air)), 0.8 * threshold + 0.2 * air)
    surface = max(threshold, foot + 0.25 * (body - foot))
    body, highest = max(body, surface), max(top, (highest + top) / 2)
    return lowest, lowest + foot, lowest + surface, lowest + body, lowest + highest


def _samples(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    # In order, which the medians and percentiles of them find in a third of the time.
    values = np.sort(_thinned(volume), axis=None).astype(np.float64)
    return values[np.isfinite(values)]


def _thinned(volume: NDArray[Any]) -> NDArray[Any]:
    step = max(1, int(np.ceil((volume.size / MOST_SAMPLES) ** (1 / max(volume.ndim, 1)))))
    return volume[tuple(slice(None, None, step) for _ in range(volume.ndim))]


def _faintest(
    volume: NDArray[np.generic], labels: NDArray[np.integer], bound: float
) -> float | None:
    """Return the median density of the lightest object that has nothing denser than the bound.

    None where there is no such object.
    """
    import pandas as pd

    ids, densities = _thinned(labels).ravel(), _thinned(volume).ravel()
    known = (ids > 0) & np.isfinite(densities)
    ids, densities = ids[known], densities[known]
    if not ids.size:
        return None
    row, found = pd.factorize(ids)
    voxels = np.bincount(row)
    faint = np.bincount(row[densities > bound], minlength=len(found)) < SEEN_SHARE * voxels
    if not faint.any():
        return None
    chosen = faint[row]
    medians = ndimage.median(densities[chosen], row[chosen], np.flatnonzero(faint))
    return float(np.min(medians))


def _extremes(volume: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the least and greatest finite density of all voxels, where thinning missed them."""
    finite = volume[np.isfinite(volume)]
    return np.array([finite.min(), finite.max()] if finite.size else [], dtype=np.float64)


def _level(background: NDArray[np.float64]) -> tuple[float, float]:
    """Return the background's typical density and its noise."""
    air = float(np.median(background))
    # The factor turns the median deviation of a normal distribution into its standard deviation.
    return air, 1.4826 * float(np.median(np.abs(background - air)))


def _otsu(values: NDArray[np.float64]) -> float:
    counts, edges = np.histogram(values, bins=256)
    below = np.cumsum(counts).astype(np.float64)
    above = below[-1] - below
    # In bins, which are evenly spaced: squares of large densities would overflow.
    moment = np.cumsum(counts * np.arange(256.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Variance between the classes, Otsu 1979, eq. 18.
        spread = below * above * (moment / below - (moment[-1] - moment) / above) ** 2
    return float(edges[1:][np.nanargmax(spread[:-1])])


Point = tuple[float, float]
Color = tuple[float, tuple[float, float, float]]

# Opacity points for CT, density being CT number + 1000: everything, from foam on, cloth to water,
# water (-100 to 100 HU), plastics (-50 to 500 HU), solids, metal.
PRESETS: dict[str, tuple[Point, ...]] = {
    "all": ((0, 0.0), (150, 0.0), (550, 0.12), (1100, 0.35), (4000, 0.6)),
    "soft": ((0, 0.0), (150, 0.0), (450, 0.2), (1000, 0.45), (1300, 0.1), (4000, 0.05)),
    "air": ((0, 0.0), (20, 0.0), (80, 0.03), (300, 0.1), (1000, 0.3), (4000, 0.6)),
    "water": ((0, 0.0), (870, 0.0), (940, 0.3), (1060, 0.3), (1130, 0.03), (4000, 0.03)),
    "plastic": ((0, 0.0), (900, 0.0), (1020, 0.2), (1400, 0.35), (1650, 0.05), (4000, 0.05)),
    "dense": ((0, 0.0), (950, 0.0), (1400, 0.3), (4000, 0.7)),
    "metal": ((0, 0.0), (3000, 0.0), (4500, 0.6), (12000, 0.9)),
}


@dataclass(frozen=True)
class TransferFunction:
    """Piecewise linear opacity and colour over density.

    Parameters
    ----------
    points : sequence of (float, float)
        (density, opacity per voxel) with densities strictly increasing and opacities in
        [0, 1], at least two. Per voxel means per `min(spacing)` mm of ray.
    colors : sequence of (float, (float, float, float)), optional
        (density, (r, g, b)) with components in [0, 1], densities strictly increasing. Without
        them everything is white and the tints alone give colour.

    Raises
    ------
    ValueError
        If there are fewer than two points, densities do not increase, or a value is outside
        its range.

    Notes
    -----
    Li et al. 2012, section 4.1. Linear between points and constant beyond the ends, so opacity
    is C0, which is what hides the blockiness of the masks. Two points of one density, a jump,
    are refused for the same reason.
    """

    points: tuple[Point, ...]
    colors: tuple[Color, ...] | None = None

    def __init__(
        self,
        points: Iterable[Sequence[float]],
        colors: Iterable[tuple[float, Sequence[float]]] | None = None,
    ) -> None:
        object.__setattr__(self, "points", _checked_points(points))
        object.__setattr__(self, "colors", None if colors is None else _checked_colors(colors))

    @classmethod
    def preset(cls, name: str) -> TransferFunction:
        """Return a preset for CT: "all", "air", "soft", "water", "plastic", "dense" or "metal".

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name not in PRESETS:
            raise ValueError(f"name must be one of {', '.join(PRESETS)}, got {name!r}")
        points = PRESETS[name]
        return cls(points, _greys(points[1][0], points[-1][0]))

    @classmethod
    def default_for(
        cls, volume: ArrayLike, labels: NDArray[np.integer] | None = None
    ) -> TransferFunction:
        """Return a transfer function that shows a scan well before anyone has touched it.

        Transparent up to the foreground, a soft ramp to surfaces that read as solid yet let what is
        behind them shine through, denser still towards the densest. NaN is ignored.

        Parameters
        ----------
        volume : (Z, Y, X) array_like
            Density.
        labels : (Z, Y, X) ndarray of int, optional
            Objects that should be seen: where one is lighter than the foreground throughout, the
            ramp begins below it.

        Raises
        ------
        ValueError
            If the volume is empty, constant or has no finite value, or the labels have another
            shape.
        """
        lowest, foot, surface, body, highest = foreground_ramp(volume)
        ramp = [(foot, 0.0), (surface, 0.2), (body, 0.4), (highest, 0.65)]
        if labels is not None:
            if np.shape(volume) != labels.shape:
                raise ValueError(
                    f"labels must have the volume's shape {np.shape(volume)}, got {labels.shape}"
                )
            bound = foot + FAINT / 0.2 * (surface - foot)
            faintest = _faintest(np.asarray(volume), labels, bound)
            if faintest is not None:
                foot = min(foot, (lowest + faintest) / 2)
                ramp[:1] = [(foot, 0.0), (faintest, LIFTED)]
        kept = [(lowest, 0.0)]
        for density, opacity in ramp:
            # A scan with few values may have two points at one density.
            if density > kept[-1][0]:
                kept.append((density, opacity))
        return cls(kept, _greys(foot, highest))

    def shifted(self, by: float) -> TransferFunction:
        """Return it for densities that are larger by so much."""
        colors = self.colors
        return TransferFunction(
            [(density + by, opacity) for density, opacity in self.points],
            None if colors is None else [(density + by, rgb) for density, rgb in colors],
        )

    @property
    def domain(self) -> tuple[float, float]:
        """Densities of the first and last point; constant beyond."""
        return self.points[0][0], self.points[-1][0]

    def table(self, n: int = 1024) -> NDArray[np.float32]:
        """Sample it evenly over its domain: (n, 4) float32, straight RGB and opacity per voxel.

        Raises
        ------
        ValueError
            If there are fewer than two rows: the first and last are the ends of the domain.
        """
        if n < 2:
            raise ValueError(f"n must be at least 2 rows, got {n!r}")
        density = np.linspace(*self.domain, n)
        result = np.ones((n, 4), dtype=np.float32)
        result[:, 3] = self.opacity_at(density)
        if self.colors is not None:
            places = [place for place, _ in self.colors]
            for channel in range(3):
                values = [rgb[channel] for _, rgb in self.colors]
                result[:, channel] = np.interp(density, places, values)
        return result

    def opacity_at(self, density: ArrayLike) -> NDArray[np.float64]:
        """Return the opacity per voxel at densities of any shape."""
        places, opacities = zip(*self.points, strict=True)
        return np.asarray(np.interp(np.asarray(density, dtype=np.float64), places, opacities))


def _greys(low: float, high: float) -> list[Color] | None:
    if not high > low:
        return None
    return [(low, (0.82, 0.82, 0.82)), (high, (1.0, 1.0, 1.0))]


def _checked_points(points: Iterable[Sequence[float]]) -> tuple[Point, ...]:
    checked = []
    for point in points:
        if len(point) != 2:
            raise ValueError(f"points must be (density, opacity) pairs, got {point!r}")
        checked.append((float(point[0]), float(point[1])))
    if len(checked) < 2:
        raise ValueError(f"points must be at least two (density, opacity), got {len(checked)}")
    _check_increasing("points", [density for density, _ in checked])
    for density, opacity in checked:
        if not 0.0 <= opacity <= 1.0:
            raise ValueError(
                f"points must have opacities per voxel in [0, 1], got {opacity!r} at {density!r}"
            )
    return tuple(checked)


def _checked_colors(colors: Iterable[tuple[float, Sequence[float]]]) -> tuple[Color, ...]:
    checked: list[Color] = []
    for density, color in colors:
        rgb = tuple(float(c) for c in color)
        if len(rgb) != 3 or not all(0.0 <= c <= 1.0 for c in rgb):
            raise ValueError(
                f"colors must be (density, (r, g, b)) with components in [0, 1], got {color!r}"
            )
        checked.append((float(density), (rgb[0], rgb[1], rgb[2])))
    if not checked:
        raise ValueError("colors must hold at least one (density, (r, g, b)), or be None")
    _check_increasing("colors", [density for density, _ in checked])
    return tuple(checked)


def _check_increasing(name: str, densities: Sequence[float]) -> None:
    if not all(np.isfinite(densities)):
        raise ValueError(f"{name} must have finite densities, got {densities!r}")
    if any(b <= a for a, b in pairwise(densities)):
        raise ValueError(f"{name} must have strictly increasing densities, got {densities!r}")
