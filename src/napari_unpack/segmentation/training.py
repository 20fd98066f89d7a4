"""Segments to learn from, and false ones to test against: labelled volumes taken apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.checks import Spacing
from napari_unpack.segmentation.merging import measure_contacts
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


def _region(
    mask: NDArray[np.bool_],
    density: NDArray[np.generic],
    box: tuple[slice, slice, slice],
    spacing: Spacing,
) -> Region:
    first = (box[0].start, box[1].start, box[2].start)
    return Region(mask, density[box], first, spacing)
