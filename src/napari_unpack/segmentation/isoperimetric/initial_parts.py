"""The first parts of the paper's method: foreground split by density, then by recursive cuts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.density_regions import (
    MaterialScale,
    material_parts,
)
from napari_unpack.segmentation.common.region import Oracle, Region
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.bag_shell import find_shell
from napari_unpack.segmentation.foreground.methods import find_matter, typical_knee
from napari_unpack.segmentation.foreground.scanner_table import find_supports, measured_section
from napari_unpack.segmentation.isoperimetric.cut_tree import split_recursively
from napari_unpack.tasks import Progress


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
    tell: Progress,
    oracle: Oracle,
    *,
    foreground: str | float = "hysteresis",
    supports: bool = True,
    shell: bool = True,
    step: float = 0.11,
    rule: SplitRule | None = None,
) -> tuple[NDArray[np.int32], MaterialScale]:
    """Take a volume apart: matter, materials, necks.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Checked density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    tell : callable
        Progress.
    oracle, foreground, supports, shell, step, rule
        As for `segment`.

    Returns
    -------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; usually more than there are objects.
    scale : MaterialScale
        How densities were compared.
    """
    limits = rule or SplitRule()
    tell(0.0, "Finding matter")
    matter, levels = find_matter(density, spacing, foreground)
    section = measured_section(density)
    if section is not None:
        matter &= section
    if supports:
        matter &= ~find_supports(matter, spacing)
    tell(0.1, "Finding materials")
    fewest = max(int(limits.smallest / float(np.prod(spacing))), 1)
    scale = MaterialScale(levels.air, typical_knee(density, matter, levels.air), step)
    materials = material_parts(density, matter, scale, fewest)
    tell(0.25, "Finding components")
    regions = _components(materials, density, spacing, limits.smallest)

    def told(fraction: float, text: str) -> None:
        tell(0.3 + 0.5 * fraction, text)

    parts = _label(split_recursively(regions, oracle, limits.smallest, told), density.shape)
    if shell:
        skin = find_shell(parts, spacing)
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
