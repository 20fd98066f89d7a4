"""What a confidence oracle looks at: shape, density and boundary of one region, free of scale.

Every feature is invariant to translation, to quarter turns exactly and to other turns up to the
voxel grid, and, but for the volume itself, to the size of the object and the unit of density.
"""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.convexity import solidity
from napari_unpack.segmentation.region import Region

FEATURES = (
    "log_volume",
    "log_compactness",
    "solidity",
    "elongation",
    "flatness",
    "thickness",
    "depth_ratio",
    "spread",
    "tail",
    "skew",
    "core_spread",
    "two_materials",
    "roughness",
    "roughness_tail",
    "weak_boundary",
    "dense_boundary",
)
LARGEST = 150_000


def features(region: Region) -> NDArray[np.float64]:
    """Measure a region.

    Parameters
    ----------
    region : Region
        With at least one voxel; thinned to about 150,000 voxels first where it has more.

    Returns
    -------
    (16,) ndarray of float64
        In the order of `FEATURES`:

        log_volume = log V, V in mm^3; log_compactness = log(S^3 / 36 pi V^2), 0 for a ball;
        solidity = V / V of the convex hull; elongation, flatness = log ratios of the first to
        second and second to third principal standard deviations; thickness = log of largest
        depth over (3 V / 4 pi)^(1/3); depth_ratio = mean over largest depth. Densities d of the
        region, median m: spread = IQR(d) / |m|; tail = (q95 - q05) / |m|; skew = (mean - m) /
        (q95 - q05); core_spread = spread of the voxels deeper than the median depth;
        two_materials = the share of the core's variance that Otsu's threshold explains, times
        log1p of the step over |m|. Differences g between face neighbours inside: roughness =
        median |g| / |m|; roughness_tail = q95 |g| / |m|. Differences b from inside to outside
        across the boundary: weak_boundary = share with |b| < 0.2 |m|; dense_boundary = share
        with b < -0.2 |m|, that is, where something denser begins.

    Notes
    -----
    notes 3.3 of the design; heavy tails are log-compressed. The surface S is the total variation
    of the mask blurred by one voxel, since counting faces favours boxes along the axes.
    """
    region = _thinned(region)
    values = region.values
    depth = edt.edt(region.mask, anisotropy=region.spacing, black_border=True)[region.mask]
    shape = _shape(region, depth)
    middle = max(abs(float(np.median(values))), 1e-6)
    inside = _density(values, depth, middle)
    inner, outer = _steps(region)
    inner, outer = inner / middle, outer / middle
    rough = np.abs(inner) if len(inner) else np.zeros(1)
    edge = outer if len(outer) else np.ones(1)
    boundary = [
        np.log1p(np.median(rough)),
        np.log1p(np.quantile(rough, 0.95)),
        (np.abs(edge) < 0.2).mean(),
        (edge < -0.2).mean(),
    ]
    return np.array([*shape, *inside, *boundary], np.float64)


def _thinned(region: Region) -> Region:
    step = 1
    while region.voxels / step**3 > LARGEST:
        step += 1
    if step == 1:
        return region
    every = (slice(None, None, step),) * 3
    mask = region.mask[every]
    a, b, c = region.spacing
    return Region(mask, region.density[every], region.origin, (a * step, b * step, c * step))


def _shape(region: Region, depth: NDArray[np.float32]) -> list[float]:
    volume = region.volume
    surface = _surface(region)
    points = np.stack(np.nonzero(region.mask), axis=1) * np.array(region.spacing)
    # A voxel has a spread of its own, without which a sheet of one layer would be infinitely flat.
    scatter = np.cov(points.T) if len(points) > 1 else np.zeros((3, 3))
    scatter = scatter + np.diag(np.array(region.spacing) ** 2 / 12)
    spread = np.sqrt(np.sort(np.linalg.eigvalsh(scatter))[::-1])
    deepest = float(depth.max())
    return [
        np.log(volume),
        np.log(surface**3 / (36 * np.pi * volume**2)),
        solidity(region.mask, region.spacing),
        np.log(spread[0] / spread[1]),
        np.log(spread[1] / spread[2]),
        np.log(deepest / (3 * volume / (4 * np.pi)) ** (1 / 3)),
        float(depth.mean()) / deepest,
    ]


def _surface(region: Region) -> float:
    """Return the area in mm^2 as the total variation of the mask blurred by one voxel."""
    from scipy.ndimage import gaussian_filter

    sigma = max(region.spacing) / np.array(region.spacing)
    pad = [(int(np.ceil(3 * s)) + 1,) * 2 for s in sigma]
    blurred = gaussian_filter(np.pad(region.mask.astype(np.float32), pad), sigma, truncate=3)
    slopes = np.gradient(blurred, *region.spacing)
    total = np.sqrt(slopes[0] ** 2 + slopes[1] ** 2 + slopes[2] ** 2).sum(dtype=np.float64)
    return float(total) * region.voxel_volume


def _density(values: NDArray[np.float32], depth: NDArray[np.float32], middle: float) -> list[float]:
    low, first, third, high = np.quantile(values, [0.05, 0.25, 0.75, 0.95])
    core = values[depth >= np.median(depth)]
    core_low, core_high = np.quantile(core, [0.25, 0.75])
    return [
        np.log1p((third - first) / middle),
        np.log1p((high - low) / middle),
        float((values.mean() - np.median(values)) / max(high - low, 1e-6)),
        np.log1p((core_high - core_low) / middle),
        _two_materials(core, middle),
    ]


def _two_materials(values: NDArray[np.float32], middle: float) -> float:
    low, high = np.quantile(values, [0.01, 0.99])
    counts, edges = np.histogram(np.clip(values, low, high), bins=64)
    centers = (edges[1:] + edges[:-1]) / 2
    weight = np.cumsum(counts)[:-1]
    rest = len(values) - weight
    moment = np.cumsum(counts * centers)
    lower = moment[:-1] / np.maximum(weight, 1)
    upper = (moment[-1] - moment[:-1]) / np.maximum(rest, 1)
    between = weight * rest * (upper - lower) ** 2 / len(values) ** 2
    best = int(np.argmax(between))
    total = float(np.clip(values, low, high).var())
    if total <= 0:
        return 0.0
    return float(between[best] / total * np.log1p((upper[best] - lower[best]) / middle))


def _steps(region: Region) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return density differences across faces inside, and from inside to outside."""
    density = np.nan_to_num(region.density.astype(np.float64))
    inner, outer = [], []
    for axis in range(3):
        mask = np.moveaxis(region.mask, axis, 0)
        values = np.moveaxis(density, axis, 0)
        step = values[:-1] - values[1:]
        one, two = mask[:-1], mask[1:]
        inner.append(step[one & two])
        outer.append(step[one & ~two])
        outer.append(-step[two & ~one])
    return np.concatenate(inner), np.concatenate(outer)
