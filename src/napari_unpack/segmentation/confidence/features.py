"""What a confidence oracle looks at: geometry, density, gradient and boundary of one region.

After the features of Kohlberger et al. (MICCAI 2012) and Grady et al. (ECCV 2012).
Every feature is invariant to translation, to quarter turns and mirrors exactly (of regions that
are not thinned, see `MOST_VOXELS`) and to other turns up to the voxel grid; and, but for the volume
itself, to the object's size and to the unit of density: lengths are measured against the radius of
the ball of equal volume, densities against the median m. Heavy tails are log-compressed.
"""

from __future__ import annotations

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.convex_hull import hull_volume, mask_corners
from napari_unpack.segmentation.common.measures import (
    Measurements,
    Neighbourhood,
    chamfer_depth,
    level_area,
    measure_region,
    quantiles,
)
from napari_unpack.segmentation.common.region import Region

FEATURES = (
    # Geometry.
    "log_volume",
    "compactness",
    "solidity",
    "box_fill",
    "ellipsoid_fill",
    "elongation",
    "flatness",
    "thickness",
    "depth_ratio",
    "shell_share",
    "total_curvature",
    "roughness",
    "lobes_30",
    "lobes_60",
    # Weighted geometry.
    "weighted_volume",
    "weighted_cut",
    "low_to_high_cut",
    "high_to_low_cut",
    "weighted_curvature",
    "weak_boundary",
    "dense_boundary",
    "weak_plane",
    "step_spread",
    # Density.
    "skew",
    "quartiles",
    "spread",
    "deviation",
    "lowest",
    "highest",
    "core_quartiles",
    "core_over_rim",
    "two_materials",
    "material_cut",
    # Gradient.
    "l1_mean",
    "l1_median",
    "l1_deviation",
    "l2_mean",
    "l2_median",
    "l2_quartiles",
    "l2_high",
    "core_l2_high",
    # Ratios.
    "cut_over_volume",
    "rayleigh",
    "blur_index",
    "contrast",
)
# Larger regions are thinned before they are measured, which then takes about 0.1 s at most.
MOST_VOXELS = 400_000


def features(region: Region) -> NDArray[np.float64]:
    """Measure a region.

    Parameters
    ----------
    region : Region
        With at least one voxel; thinned to every second, third ... voxel along each axis first
        where it has more than 400,000.

    Returns
    -------
    (45,) ndarray of float64
        In the order of `FEATURES`. V volume, S surface, r = (3 V / 4 pi)^(1/3), D depth (chamfer
        distance to the outside), d density, m its median, g its gradient inside, b its step from
        inside to outside across the boundary, taken three voxels apart; q quantiles, all in mm.

        *Geometry*: log_volume = ln V; compactness = ln(S^3 / 36 pi V^2), 0 for a ball; solidity =
        V / convex hull; box_fill = V / box along the principal axes; ellipsoid_fill = V over the
        ellipsoid of the same moments; elongation, flatness = ln of the ratios of successive
        principal deviations; thickness = ln(max D / r); depth_ratio = mean D / max D;
        shell_share = share of V with D < r / 5; total_curvature, roughness = mean of c and |c|
        over S, c = 1 - occupied / 18 of the 27 voxels around a boundary voxel, 0 on a plane;
        lobes_30, lobes_60 = share of {D > 0.3 (0.6) max D} outside its largest component.

        *Weighted geometry*: weighted_volume = ln(mean d / m); weighted_cut = ln(1 + mean |b| /
        m); low_to_high_cut, high_to_low_cut = the same of -b and b where positive;
        weighted_curvature = mean of c weighted by |b|; weak_boundary = share of S with |b| < 0.2
        m; dense_boundary = with b < -0.2 m; weak_plane = |vector area| of both over S, large
        where an object was cut across; step_spread = ln(1 + (q75 - q25 of b) / m).

        *Density*: skew = (mean - m) / (q95 - q05); quartiles, spread, deviation = ln(1 + x / m)
        of q75 - q25, q95 - q05 and the standard deviation; lowest = q01 / m; highest = ln(q99 /
        m); core_quartiles = quartiles of the voxels deeper than the median depth; core_over_rim
        = (median of those - median of the others) / m; two_materials = the share of the core's
        variance that Otsu's threshold explains, times ln(1 + step / m); material_cut = ln(1 + A r
        / v), A the area of that threshold's level set inside, v the volume of its smaller side.

        *Gradient*: ln(1 + x / m) of the mean, median and standard deviation of |g|_1, the mean,
        median, q75 - q25 and q95 of |g|_2, and q95 of |g|_2 in the core.

        *Ratios*: cut_over_volume = ln(r sum |b| dS / sum d dV); rayleigh = ln of the Rayleigh
        quotient sum (d_i - d_j)^2 / sum (d_i - mean)^2 over inner faces and voxels; blur_index =
        mean step between the two voxels at the boundary over mean |b|; contrast = ln(1 + median
        |g|_2 1 mm / mean |b|).
    """
    # S counts faces projected onto the surface by a normal from the 27 voxels around. About 0.2 us
    # a voxel of the bounding box.
    region = _thinned(region)
    spacing = np.array(region.spacing)
    depth = chamfer_depth(region.mask, region.spacing)
    around = Neighbourhood.of(region.mask, *region.field, region.air)
    values = around.density[around.voxels].astype(np.float32)
    middle = max(abs(float(quantiles(values, [0.5])[0])), 1e-6)
    found = measure_region(around, depth[region.mask], spacing, middle)
    volume = region.volume
    radius = float(np.cbrt(3 * volume / (4 * np.pi)))
    surface = max(float(found.edge[0]), 1e-9)
    return np.array(
        [
            *_geometry(region, found, depth, volume, surface, radius),
            *_boundary(found, surface, middle),
            *_density(region, around, found, middle, volume, radius),
            *_gradient(found, middle),
            *_ratios(found, middle, radius, region.voxel_volume),
        ],
        np.float64,
    )


def _thinned(region: Region) -> Region:
    step = 1
    while region.voxels / step**3 > MOST_VOXELS:
        step += 1
    if step == 1:
        return region
    every = (slice(None, None, step),) * 3
    a, b, c = region.spacing
    thin = (a * step, b * step, c * step)
    return Region(region.mask[every], region.density[every], (0, 0, 0), thin, air=region.air)


def _geometry(
    region: Region,
    found: Measurements,
    depth: NDArray[np.float32],
    volume: float,
    surface: float,
    radius: float,
) -> list[float]:
    size = len(found.values)
    z, y, x, zz, yy, xx, zy, zx, yx = found.moments / size
    scatter = np.array(
        [
            [zz - z * z, zy - z * y, zx - z * x],
            [zy - z * y, yy - y * y, yx - y * x],
            [zx - z * x, yx - y * x, xx - x * x],
        ]
    )
    # A voxel has a spread of its own, without which a sheet of one layer would be infinitely flat.
    scatter += np.diag(np.array(region.spacing) ** 2 / 12)
    variances, axes = np.linalg.eigh(scatter)
    spread = np.sqrt(np.maximum(variances, 1e-12))[::-1]
    corners = mask_corners(region.mask, np.zeros(3), region.spacing)
    extents = np.ptp(corners @ axes, axis=0)
    deepest = float(found.deep.max())
    ellipsoid = 4 / 3 * np.pi * 5**1.5 * float(np.prod(spread))
    return [
        np.log(volume),
        np.log(surface**3 / (36 * np.pi * volume**2)),
        min(volume / hull_volume(corners), 1.0),
        volume / float(np.prod(extents)),
        volume / ellipsoid,
        np.log(spread[0] / spread[1]),
        np.log(spread[1] / spread[2]),
        np.log(deepest / radius),
        float(found.deep.mean(dtype=np.float64)) / deepest,
        float((found.deep < radius / 5).mean()),
        float(found.edge[1]) / surface,
        float(found.edge[2]) / surface,
        _lobes(depth, 0.3 * deepest),
        _lobes(depth, 0.6 * deepest),
    ]


def _lobes(depth: NDArray[np.float32], level: float) -> float:
    core = depth > level
    pieces, count = cc3d.connected_components(core, connectivity=6, return_N=True)
    if count < 2:
        return 0.0
    sizes = np.bincount(pieces[core])[1:]
    return float(1 - sizes.max() / sizes.sum())


def _boundary(found: Measurements, surface: float, middle: float) -> list[float]:
    edge = found.edge
    met = max(float(edge[3]), 1e-9)
    low, high = (0.0, 0.0) if not len(found.steps) else quantiles(found.steps, [0.25, 0.75])
    mean = float(found.values.mean(dtype=np.float64))
    return [
        np.log(max(abs(mean), 1e-6) / middle),
        np.log1p(edge[4] / met / middle),
        np.log1p(edge[5] / met / middle),
        np.log1p(edge[6] / met / middle),
        float(edge[7] / max(float(edge[4]), 1e-9)),
        float(edge[8] / met),
        float(edge[9] / met),
        float(np.linalg.norm(found.weak)) / surface,
        np.log1p((high - low) / middle),
    ]


def _density(
    region: Region,
    around: Neighbourhood,
    found: Measurements,
    middle: float,
    volume: float,
    radius: float,
) -> list[float]:
    values = found.values
    q01, q05, q25, q50, q75, q95, q99 = quantiles(values, [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99])
    within = found.deep >= np.float32(quantiles(found.deep, [0.5])[0])
    core, rim = values[within], values[~within]
    low, center, high = quantiles(core, [0.25, 0.5, 0.75])
    outer = float(quantiles(rim, [0.5])[0]) if len(rim) else float(center)
    level, explained, step = _otsu(core)
    cut = 0.0
    if step > 0:
        area = level_area(around, np.array(region.spacing), level)
        share = min((values > level).mean(), (values <= level).mean())
        cut = float(np.log1p(area * radius / max(share * volume, region.voxel_volume)))
    return [
        float((values.mean(dtype=np.float64) - q50) / max(q95 - q05, 1e-6)),
        np.log1p((q75 - q25) / middle),
        np.log1p((q95 - q05) / middle),
        np.log1p(float(values.std(dtype=np.float64)) / middle),
        float(q01 / middle),
        float(np.log(max(q99 / middle, 1e-3))),
        np.log1p((high - low) / middle),
        float((center - outer) / middle),
        explained * float(np.log1p(step / middle)),
        cut,
    ]


def _otsu(values: NDArray[np.float32]) -> tuple[float, float, float]:
    """Return Otsu's threshold, the share of variance it explains, and its step."""
    # Slow to import, and not needed where no object is rated.
    from skimage.filters import threshold_otsu

    low, high = quantiles(values, [0.01, 0.99])
    if high <= low:
        return float(low), 0.0, 0.0
    clipped = np.clip(values, low, high).astype(np.float64)
    counts, edges = np.histogram(clipped, bins=64, range=(low, high))
    centers = (edges[1:] + edges[:-1]) / 2
    best = int(np.searchsorted(centers, threshold_otsu(hist=(counts, centers))))
    moment = np.cumsum(counts * centers)
    weight = counts[: best + 1].sum()
    rest = len(values) - weight
    lower, upper = moment[best] / max(weight, 1), (moment[-1] - moment[best]) / max(rest, 1)
    between = weight * rest * (upper - lower) ** 2 / len(values) ** 2
    explained = float(between / max(float(clipped.var()), 1e-12))
    return float(edges[best + 1]), min(explained, 1.0), float(upper - lower)


def _gradient(found: Measurements, middle: float) -> list[float]:
    l1, l2 = found.l1, found.l2
    median = quantiles(l1, [0.5])[0]
    q25, q50, q75, q95 = quantiles(l2, [0.25, 0.5, 0.75, 0.95])
    core = l2[found.deep >= np.float32(quantiles(found.deep, [0.5])[0])]
    amounts = [
        l1.mean(dtype=np.float64),
        median,
        l1.std(dtype=np.float64),
        l2.mean(dtype=np.float64),
        q50,
        q75 - q25,
        q95,
        quantiles(core, [0.95])[0],
    ]
    return [float(np.log1p(amount / middle)) for amount in amounts]


def _ratios(found: Measurements, middle: float, radius: float, voxel: float) -> list[float]:
    values, edge = found.values.astype(np.float64), found.edge
    met = max(float(edge[3]), 1e-9)
    mass = max(abs(float(values.sum())) * voxel, 1e-9)
    scatter = float(np.square(values - values.mean()).sum())
    step = float(edge[4]) / met
    even = scatter <= 1e-9 * middle**2 * len(values)
    return [
        float(np.log(max(radius * edge[4] / mass, 1e-3))),
        0.0 if even else float(np.log(max(found.inner / scatter, 1e-3))),
        float(found.near / max(float(edge[4]), 1e-9)),
        float(np.log1p(quantiles(found.l2, [0.5])[0] / max(step, 0.01 * middle))),
    ]
