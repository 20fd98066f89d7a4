"""Denoising: volumes in which noise or haze hide the objects, as under a microscope."""

from __future__ import annotations

from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, uniform_filter

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.thresholds import (
    NothingFoundError,
    find_levels,
    noise_of_steps,
)
from napari_unpack.tasks import SILENT, Share

# Of neighbouring voxels, below which a volume is mostly noise. Measured: 0.83 and above on scans
# of bags, also by few photons; 0.44 on nuclei.
LEAST_CORRELATION = 0.7
# Deviations of the noise by which foreground stands above the air that no noise hides. Measured: 66
# of one small thing in much air, 3 of nuclei.
CLEAR = 10.0
# Of neighbours that are correlated; the result is then good to a few thousandths.
MOST_PAIRS = 500_000
# Standard deviation, in voxels of the finest axis, of the Gaussian that removes noise.
NOISE_WIDTH = 1.0
# Voxels of the finest axis: what is wider is haze. About as far as the network sees.
HAZE_WIDTH = 30.0
# Voxels of the finest axis by which borders may be wrong once noise and haze are gone.
BORDER_ERROR = 4.0


def needs_denoising(density: NDArray[np.generic], foreground: str | float) -> bool:
    """Return whether noise is to be removed: not where the foreground's density is given.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        NaN is left out.
    foreground : str or float
        See `methods.checked_foreground`.
    """
    return isinstance(foreground, str) and is_noisy(density)


def is_noisy(density: NDArray[np.generic]) -> bool:
    """Return whether neighbours correlate so little that noise hides the objects."""
    return -1.0 < _neighbour_correlation(density) < LEAST_CORRELATION and not _is_clear(density)


def _is_clear(density: NDArray[Any]) -> bool:
    """Return whether the foreground stands far above the noise, little as it may be of all."""
    try:
        levels = find_levels(density)
    except NothingFoundError:
        return False
    # Levels within the noise tell too little of it.
    thin = max(1, density.shape[0] // 64)
    noise = max(levels.noise, noise_of_steps(density[::thin]))
    foreground = density[density >= levels.high].astype(np.float64)
    if not (noise > 0 and len(foreground)):
        return False
    return float(np.median(foreground)) > levels.air + CLEAR * noise


def _neighbour_correlation(density: NDArray[np.generic]) -> float:
    """Return the correlation of log density along the axis where it is largest, or -1."""
    # White noise of variance n on anything of variance s lowers it to s / (n + s). The knee of the
    # logarithm lies at a quarter of the mean density, weighted by density.
    sample = density[:: max(1, density.shape[0] // 64)].astype(np.float64)
    sample = sample[np.isfinite(sample)]
    if not len(sample):
        return -1.0
    air, high = np.quantile(sample, [0.02, 0.9995]).tolist()
    rise = np.clip(sample - air, 0, high - air)
    if not rise.sum() > 0:
        return -1.0
    knee = float((rise**2).sum() / rise.sum()) / 4
    best = -1.0
    for axis in range(3):
        lines = np.moveaxis(density, axis, 2)
        skip = max(1, int(np.ceil(np.sqrt(density.size / MOST_PAIRS))))
        some = lines[::skip, ::skip].astype(np.float64)
        lifted = np.log1p(np.clip(some - air, 0, None) / knee)
        one, two = lifted[..., :-1].reshape(-1), lifted[..., 1:].reshape(-1)
        known = np.isfinite(one) & np.isfinite(two)
        one, two = one[known], two[known]
        if len(one) > 1 and one.std() > 0 and two.std() > 0:
            best = max(best, float(np.corrcoef(one, two)[0, 1]))
    return best


def denoised(
    density: NDArray[np.generic], spacing: Spacing, foreground: str | float, share: Share = SILENT
) -> NDArray[np.float32]:
    """Remove noise and haze, and what lies below a foreground that is a density.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    foreground : str or float
        See `methods.checked_foreground`.
    share : Share
    """
    clear = without_noise_and_haze(density, spacing, share)
    if not isinstance(foreground, str):
        clear[~(_smooth(density, NOISE_WIDTH, spacing) >= foreground)] = 0
    return clear


def without_noise_and_haze(
    density: NDArray[np.generic], spacing: Spacing, share: Share = SILENT
) -> NDArray[np.float32]:
    """Remove noise and haze.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        NaN counts as the median.
    spacing : (float, float, float)
        Voxel size z y x, mm; its proportions count.
    share : Share

    Returns
    -------
    (Z, Y, X) ndarray of float32
        How far the smoothed density rises above the mean around it, less half a deviation of
        what lies below that mean; 0 where it does not.
    """
    # Linear in the voxels. Haze is the result of three running means.
    values = _smooth(density, NOISE_WIDTH, spacing)
    haze = values
    for _ in share.part(0.4, 1.0).over(range(3)):
        # Three running means of width w have the variance w^2 / 4.
        widths = [max(1, round(2 * HAZE_WIDTH * min(spacing) / s)) for s in spacing]
        haze = uniform_filter(haze, widths)
    values -= haze
    below = values[values < 0]
    deviation = float(np.sqrt(np.mean(below.astype(np.float64) ** 2))) if below.size else 0.0
    return np.maximum(values - np.float32(0.5 * deviation), 0)


def grow_to_half_height(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Move every object's border to half its height above ground, by four voxels at most.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    density : (Z, Y, X) ndarray
        With its noise and haze.
    spacing : (float, float, float) of mm, z y x
    share : Share
    """
    # A blurred edge lies at half of its height, and staining differs from object to object.
    found = np.zeros_like(labels)
    if not labels.any():
        return found
    values = _smooth(density, BORDER_ERROR / 2, spacing)
    share(0.1)
    low, high = float(values.min()), float(values.max())
    cost = ((high - values) * (255 / max(high - low, 1e-6))).astype(np.uint8)
    near = distance_transform_edt(labels == 0, sampling=spacing) <= BORDER_ERROR * min(spacing)
    basins = flood(labels, near, cost, share.part(0.4, 0.5))
    boxes = label_boxes(basins)
    for name in share.part(0.5, 1.0).over(boxes.ids.tolist()):
        box = boxes.slices(name)
        mine, here, inside = basins[box] == name, values[box], labels[box] == name
        around = here[mine & ~inside]
        ground = float(np.quantile(around, 0.2)) if len(around) else low
        bright = mine & (here >= (float(np.median(here[inside])) + ground) / 2)
        found[box][cc3d.largest_k(bright, k=1, connectivity=6) > 0] = name
    return found


def _smooth(density: NDArray[np.generic], width: float, spacing: Spacing) -> NDArray[np.float32]:
    values = density.astype(np.float32)
    finite = np.isfinite(values)
    if not finite.all():
        values[~finite] = np.float32(np.median(values[finite]))
    return np.asarray(gaussian_filter(values, [width * min(spacing) / s for s in spacing]))
