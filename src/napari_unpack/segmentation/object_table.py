"""The table of objects: what a person reads about each of them."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.checks import Spacing
from napari_unpack.segmentation.region import Region
from napari_unpack.segmentation.splitting import Oracle


def object_table(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle | None = None,
) -> pd.DataFrame:
    """Measure every object.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Object IDs.
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    oracle : callable, optional
        Judges each object; without one the confidence is that of `plain_confidence`.

    Returns
    -------
    pandas.DataFrame
        Indexed by id, columns as in `pipeline.Segmentation`.
    """
    boxes = label_boxes(labels)
    top = int(boxes.ids[-1]) if len(boxes.ids) else 0
    sums, area = _measure(labels, density, top, np.prod(spacing) / np.array(spacing))
    sums, area = sums[boxes.ids], area[boxes.ids]
    counts = boxes.counts.astype(np.float64)
    volume = counts * float(np.prod(spacing))
    centers = sums[:, :3] / counts[:, None] * np.array(spacing)
    judge = oracle or plain_confidence
    confidence = []
    for name in boxes.ids.tolist():
        box = boxes.slices(name)
        first = (box[0].start, box[1].start, box[2].start)
        region = Region(labels[box] == name, density[box], first, spacing)
        confidence.append(float(judge(region)))
    return pd.DataFrame(
        {
            "voxels": boxes.counts,
            "volume_mm3": volume,
            "mean_density": sums[:, 3] / counts,
            "z": centers[:, 0],
            "y": centers[:, 1],
            "x": centers[:, 2],
            "isoperimetric_ratio": area / volume,
            "confidence": np.array(confidence, np.float64),
        },
        index=pd.Index(boxes.ids, name="id"),
    )


def plain_confidence(region: Region) -> float:
    """Return how evenly dense a region is, in (0, 1]: a stand-in where no oracle is given.

    Notes
    -----
    1 / (1 + (s / m)^2) with m the median density of the region and s its interquartile range.
    """
    low, middle, high = np.quantile(region.values, [0.25, 0.5, 0.75])
    spread = (high - low) / max(abs(float(middle)), 1e-6)
    return float(1 / (1 + spread**2))


@njit(cache=True, nogil=True)
def _measure(labels, density, top, faces):  # type: ignore[no-untyped-def]
    sums = np.zeros((top + 1, 4), np.float64)
    area = np.zeros(top + 1, np.float64)
    depth, height, width = labels.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                label = labels[z, y, x]
                if label == 0:
                    continue
                sums[label, 0] += z
                sums[label, 1] += y
                sums[label, 2] += x
                value = np.float64(density[z, y, x])
                if value == value:
                    sums[label, 3] += value
                if z == 0 or labels[z - 1, y, x] != label:
                    area[label] += faces[0]
                if z == depth - 1 or labels[z + 1, y, x] != label:
                    area[label] += faces[0]
                if y == 0 or labels[z, y - 1, x] != label:
                    area[label] += faces[1]
                if y == height - 1 or labels[z, y + 1, x] != label:
                    area[label] += faces[1]
                if x == 0 or labels[z, y, x - 1] != label:
                    area[label] += faces[2]
                if x == width - 1 or labels[z, y, x + 1] != label:
                    area[label] += faces[2]
    return sums, area
