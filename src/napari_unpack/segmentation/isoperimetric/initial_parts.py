"""The first parts of the paper's method: foreground split by density, then by recursive cuts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.density_regions import DensityScale, density_regions
from napari_unpack.segmentation.common.region import Oracle, Region
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.bag_shell import find_shell
from napari_unpack.segmentation.foreground.methods import ForegroundOptions, typical_knee
from napari_unpack.segmentation.foreground.scanner_table import find_supports, measured_section
from napari_unpack.segmentation.isoperimetric.cut_tree import split_recursively
from napari_unpack.tasks import Share


@dataclass(frozen=True)
class SplitRule:
    """When a region may be split.

    Parameters
    ----------
    smallest : float
        No part is smaller, mm^3.
    """

    smallest: float = 1000.0


def split_parts(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    oracle: Oracle,
    foreground: ForegroundOptions,
    smallest: float,
    step: float,
    rule: SplitRule,
) -> tuple[NDArray[np.int32], DensityScale]:
    """Split a volume: foreground, density regions, recursive cuts.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    share : Share
    oracle : callable
        Confidence in [0, 1] that a region is exactly one object.
    foreground : ForegroundOptions
    smallest : float
        Of an object, mm^3: a component below it is left out.
    step : float
        Log density step between two density regions.
    rule : SplitRule

    Returns
    -------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; usually more than there are objects.
    scale : DensityScale
        How densities were compared.
    """
    known = foreground.known
    mask, levels = foreground.find(density, spacing, share.part(0.0, 0.1))
    section = measured_section(density) if known is None else None
    if section is not None:
        # Beyond the scanner's circle nothing was measured, though the file has numbers there.
        mask = mask & section
    if foreground.supports:
        mask = mask & ~find_supports(mask, spacing)
    dividing = share.part(0.1, 0.25, "Finding density regions")
    fewest = max(int(rule.smallest / float(np.prod(spacing))), 1)
    knee = typical_knee(density, mask, levels.air) if known is None else known.knee
    scale = DensityScale(levels.air, knee, step)
    regions = density_regions(density, mask, scale, fewest, share=dividing)
    share(0.25, "Finding components")
    components = _components(regions, density, spacing, smallest)
    found = split_recursively(components, oracle, rule.smallest, share.part(0.3, 0.9))
    parts = _label(found, density.shape)
    if foreground.shell:
        # After the cuts: the shell touches most objects, and before them it is one with these.
        skin = find_shell(parts, spacing, share=share.part(0.9, 1.0, "Leaving out the bag"))
        parts[skin[parts]] = 0
    return parts, scale


def _components(
    parts: NDArray[np.int32], density: NDArray[np.generic], spacing: Spacing, smallest: float
) -> list[Region]:
    boxes = label_boxes(parts)
    large = boxes.counts * float(np.prod(spacing)) >= smallest
    regions = []
    for name in boxes.ids[large].tolist():
        box = boxes.slices(name)
        regions.append(Region.of(parts[box] == name, density, box, spacing))
    return regions


def _label(regions: list[Region], shape: tuple[int, ...]) -> NDArray[np.int32]:
    labels = np.zeros(shape, np.int32)
    for name, region in enumerate(regions, 1):
        labels[region.box][region.mask] = name
    return labels
