"""From a density volume to labelled objects: the room's door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cc3d
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.checks import Spacing, checked_spacing, checked_volume
from napari_unpack.segmentation.foreground import find_levels, foreground
from napari_unpack.segmentation.object_table import object_table
from napari_unpack.segmentation.region import Region
from napari_unpack.segmentation.splitting import Oracle, Progress, SplitRule, split
from napari_unpack.segmentation.supports import find_supports


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The objects of a volume.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Object IDs 1, 2, ... from the largest object to the smallest; 0 is background.
    objects : pandas.DataFrame
        Indexed by id: voxels, volume_mm3, mean_density, z, y, x (centroid, mm),
        isoperimetric_ratio (surface over volume, 1/mm), confidence in [0, 1].
    """

    labels: NDArray[np.int32]
    objects: pd.DataFrame


def segment(
    volume: ArrayLike,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    oracle: Oracle | None = None,
    progress: Progress | None = None,
    *,
    threshold: float | None = None,
    smallest: float = 500.0,
    supports: bool = True,
    rule: SplitRule | None = None,
) -> Segmentation:
    """Find the objects of a packed volume.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Densities, any real type and scale; NaN is background.
    spacing : (3,) sequence of float
        Voxel size z y x, mm.
    oracle : callable, optional
        `oracle(region) -> confidence in [0, 1]` decides about cuts; see `splitting`.
    progress : callable, optional
        Called with (fraction, text) before every step; raising in it cancels.
    threshold : float, optional
        Density above which a voxel is matter; by default `foreground.find_levels` decides.
    smallest : float
        Objects below this are dropped or joined to a neighbour, mm^3.
    supports : bool
        Leave out the scanner's table.
    rule : SplitRule, optional
        When to cut.

    Returns
    -------
    Segmentation

    Raises
    ------
    TypeError
        If the volume does not hold real numbers.
    ValueError
        If the volume or the spacing is not usable, or nothing is found.
    """
    density = checked_volume(volume)
    size = checked_spacing(spacing)
    tell = progress or _silent
    tell(0.0, "Finding matter")
    matter = _matter(density, threshold)
    if supports:
        matter &= ~find_supports(matter, size)
    tell(0.1, "Finding components")
    regions = _components(matter, density, size, smallest)
    limits = replace(rule or SplitRule(), smallest=max(smallest, (rule or SplitRule()).smallest))
    found = split(regions, limits, oracle, lambda f, text: tell(0.15 + 0.75 * f, text))
    tell(0.95, "Measuring objects")
    labels = _label(found, density.shape)
    table = object_table(labels, density, size, oracle)
    tell(1.0, f"{len(table)} objects")
    return Segmentation(labels, table)


def _silent(fraction: float, text: str) -> None:
    """Report nothing."""


def _matter(density: NDArray[np.generic], threshold: float | None) -> NDArray[np.bool_]:
    levels = find_levels(density)
    if threshold is not None:
        levels = replace(levels, low=threshold, high=threshold)
    return foreground(density, levels)


def _components(
    matter: NDArray[np.bool_], density: NDArray[np.generic], spacing: Spacing, smallest: float
) -> list[Region]:
    components = cc3d.connected_components(matter, connectivity=6)
    boxes = label_boxes(components)
    large = boxes.counts * float(np.prod(spacing)) >= smallest
    if not large.any():
        raise ValueError(
            f"nothing found: no component of the foreground has {smallest:g} mm^3; "
            "pass a smaller smallest= or a lower threshold="
        )
    regions = []
    for name in boxes.ids[large].tolist():
        box = boxes.slices(name)
        first = (box[0].start, box[1].start, box[2].start)
        regions.append(Region(components[box] == name, density[box], first, spacing))
    return regions


def _label(regions: list[Region], shape: tuple[int, ...]) -> NDArray[np.int32]:
    labels = np.zeros(shape, np.int32)
    ranked = sorted(regions, key=lambda r: (-r.voxels, r.origin))
    for name, region in enumerate(ranked, 1):
        labels[region.box][region.mask] = name
    return labels
