"""Objects without the network: matter is taken apart by density and necks, and joined by pairs."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.density_regions import (
    MaterialScale,
    log_density,
    material_parts,
)
from napari_unpack.segmentation.common.merging import absorb_fringes
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.bag_shell import find_shell
from napari_unpack.segmentation.foreground.methods import find_matter, typical_knee
from napari_unpack.segmentation.foreground.scanner_table import find_supports, measured_section
from napari_unpack.segmentation.isoperimetric.cut_tree import split_recursively
from napari_unpack.segmentation.isoperimetric.splitting import Oracle, SplitRule, split
from napari_unpack.segmentation.learned.pair_classifier import (
    PairClassifier,
    agglomerate,
    measure_parts,
)
from napari_unpack.segmentation.postprocessing.containers import join_containers
from napari_unpack.segmentation.postprocessing.crumpled_cloth import bundle_folds
from napari_unpack.tasks import Progress

# Times the median density of matter.
LIGHT = 2.2


def split_parts(
    density: NDArray[np.generic],
    spacing: Spacing,
    tell: Progress,
    *,
    foreground: str | float = "hysteresis",
    supports: bool = True,
    shell: bool = True,
    step: float = 0.11,
    rule: SplitRule | None = None,
    oracle: Oracle | None = None,
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
    foreground, supports, shell, step, rule, oracle
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

    if oracle is None:
        found = split(regions, limits, told)
    else:
        found = split_recursively(regions, oracle, limits.smallest, told)
    parts = _label(found, density.shape)
    if shell:
        skin = find_shell(parts, spacing)
        parts[skin[parts]] = 0
    parts = bundle_folds(parts, density, spacing, levels.air + LIGHT * 4 * scale.knee)
    return absorb_fringes(parts, density, spacing), scale


def join_parts(
    parts: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    scale: MaterialScale,
    affinity: PairClassifier,
) -> NDArray[np.int32]:
    """Put parts together that are one object.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        Parts 1, 2, ...
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    scale : MaterialScale
        How densities are compared.
    affinity : PairClassifier
        The judge of pairs.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    measured = measure_parts(parts, log_density(density, parts > 0, scale), spacing)
    bottled = join_containers(measured, np.arange(len(measured.sums)))
    joined = agglomerate(measured, lambda one, two, row: float(affinity.probability(row[None])[0]))
    owner = join_containers(measured, joined[bottled])
    return owner.astype(np.int32)[parts]


@cache
def default_affinity() -> PairClassifier:
    """Return the judge of pairs that ships with the package."""
    return PairClassifier.load(Path(__file__).parents[1] / "weights" / "affinity.npz")


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
