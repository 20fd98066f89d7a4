"""Segments to learn from, and false ones to test against: labelled volumes taken apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.affinity import Affinity, measure_parts
from napari_unpack.segmentation.agglomeration import agglomerate
from napari_unpack.segmentation.checks import Spacing
from napari_unpack.segmentation.evaluation import contingency
from napari_unpack.segmentation.materials import log_density
from napari_unpack.segmentation.merging import measure_contacts
from napari_unpack.segmentation.pipeline import split_parts
from napari_unpack.segmentation.region import Region, bounding_box


def true_objects(
    density: NDArray[np.generic], labels: NDArray[np.integer], spacing: Spacing, smallest: int = 64
) -> Iterator[Region]:
    """Yield every labelled object of at least so many voxels.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Density.
    labels : (Z, Y, X) ndarray of int
        True objects.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    smallest : int
        Voxels.

    Yields
    ------
    Region
    """
    boxes = label_boxes(labels)
    for name in boxes.ids[boxes.counts >= smallest].tolist():
        box = boxes.slices(name)
        yield _region(labels[box] == name, density, box, spacing)


def merged_pairs(
    density: NDArray[np.generic], labels: NDArray[np.integer], spacing: Spacing, least: float = 0.02
) -> Iterator[Region]:
    """Yield the union of every two objects that touch over a share of the smaller's surface.

    Parameters
    ----------
    density, labels, spacing
        As for `true_objects`.
    least : float
        Share of the surface of the one with less.

    Yields
    ------
    Region
    """
    names = label_boxes(labels).ids
    compact = np.searchsorted(names, labels).astype(np.int32) + 1
    compact[labels == 0] = 0
    contacts = measure_contacts(compact, spacing)
    surface = np.minimum.outer(contacts.surface, contacts.surface)
    touching = contacts.area > least * surface
    for one, two in np.argwhere(np.triu(touching[1:, 1:], 1)) + 1:
        both = (compact == one) | (compact == two)
        box = bounding_box(both)
        yield _region(both[box], density, box, spacing)


def halves(objects: list[Region], generator: np.random.Generator) -> Iterator[Region]:
    """Yield one half of every object, cut through its centre by a random plane."""
    for region in objects:
        points = np.stack(np.nonzero(region.mask), axis=1)
        side = (points - points.mean(axis=0)) @ generator.normal(size=3) > 0
        if 0 < side.sum() < len(side):
            mask = np.zeros_like(region.mask)
            mask[tuple(points[side].T)] = True
            yield region.part(mask)


def pair_examples(
    density: NDArray[np.generic],
    truth: NDArray[np.integer],
    spacing: Spacing,
    affinity: Affinity | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return pairs of parts to learn from: their features, and whether they are one object.

    Parameters
    ----------
    density, truth, spacing
        A labelled volume.
    affinity : Affinity, optional
        A judge to follow, so that it learns from the states its own mistakes lead to; without
        one the truth is followed.

    Returns
    -------
    rows : (N, F) ndarray of float64
    same : (N,) ndarray of bool
    """
    parts, scale = split_parts(density, spacing, lambda fraction, text: None)
    measured = measure_parts(parts, log_density(density, parts > 0, scale), spacing)
    table = contingency(parts, truth)
    compact = np.flatnonzero(np.bincount(parts.reshape(-1)))
    weight = np.zeros((len(measured.sums), table.shape[1]))
    weight[compact[compact > 0]] = table[1:]
    rows: list[NDArray[np.float64]] = []
    same: list[bool] = []

    def judge(one: int, two: int, row: NDArray[np.float64]) -> float:
        first, second = weight[one], weight[two]
        main = first.argmax(), second.argmax()
        agree = main[0] == main[1]
        # Matter without a label, such as the bag's shell, belongs to nothing else.
        if main[0] or main[1]:
            rows.append(row)
            same.append(bool(agree))
        if affinity is None:
            return float(agree and main[0] > 0)
        chance = float(affinity.probability(row[None])[0])
        # A wrong join would leave no right answer behind it: it is recorded, not made.
        return chance if agree else 0.0

    agglomerate(measured, judge)
    return np.array(rows), np.array(same)


def _region(
    mask: NDArray[np.bool_],
    density: NDArray[np.generic],
    box: tuple[slice, slice, slice],
    spacing: Spacing,
) -> Region:
    first = (box[0].start, box[1].start, box[2].start)
    return Region(np.ascontiguousarray(mask), density[box], first, spacing, density)
