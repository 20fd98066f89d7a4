"""The blur around solid metal, taken off it: it may hold as many voxels as the metal itself.

A coin is one voxel and a half thick and thirty times as dense as the cloth it lies in, so that
what the scanner blurs beside it is still as dense as plastic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import generate_binary_structure, maximum_filter

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.array_source import grown
from napari_unpack.segmentation.common.density_regions import SOLID_METAL
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.postprocessing.cables import scale_of

BLURRED = 2
"""Voxels that scanners blur metal over: its surface is moved so far at most, and it is as dense as
it gets within so many."""


def without_blur(labels: NDArray[np.int32], density: NDArray[np.generic]) -> NDArray[np.int32]:
    """Move the surface of solid metal to half its density.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    density : (Z, Y, X) ndarray
        NaN stays with its object.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        The same, but for the outermost voxels of objects most of which is solid metal: those with
        less than half of their object's peak nearby, above air, belong to the object across their
        face, or to the background. Insulated cables and tins are not mostly metal, and keep their
        plastic and their contents; so does metal of which less than the least object would be left.
    """
    scale = scale_of(labels, density)
    if scale is None:
        return labels
    solid = labels[density > scale.air + np.expm1(SOLID_METAL) * scale.knee]
    sizes = np.bincount(labels.reshape(-1))
    metal = np.flatnonzero(2 * np.bincount(solid, minlength=len(sizes)) > sizes)
    metal = metal[metal > 0]
    if not len(metal):
        return labels
    boxes = label_boxes(labels)
    across = generate_binary_structure(3, 1)
    result = labels.copy()
    for name in metal.tolist():
        box = grown(boxes.slices(name), 1, labels.shape)
        own = labels[box] == name
        above = np.where(own, density[box].astype(np.float32) - np.float32(scale.air), 0)
        faint = own & (above < maximum_filter(np.nan_to_num(above), 2 * BLURRED + 1) / 2)
        if np.count_nonzero(own & ~faint) < MIN_OBJECT_VOXELS:
            continue
        around = result[box]
        for _ in range(BLURRED):
            other = maximum_filter(np.where(around == name, -1, around), footprint=across)
            moved = faint & (around == name) & (other >= 0)
            around[moved] = other[moved]
    return result
