"""A picture of what segmentation does, stage by stage, on one slice of a simulated bag."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from gallery_pictures import captioned, save
from numpy.typing import NDArray
from PIL import Image, ImageOps
from scipy.ndimage import binary_dilation

from napari_unpack import segment
from napari_unpack.appearance import golden_hue, tints_of
from napari_unpack.rendering.slice_image import ALONG_Z, object_window, slice_image
from napari_unpack.segmentation.foreground.methods import find_foreground
from napari_unpack.segmentation.learned.method import oversegment, split_at_density_steps
from napari_unpack.segmentation.learned.part_merging import merge_parts
from napari_unpack.segmentation.learned.part_splitting import merge_pieces

WIDE, COLUMNS = 480, 3
"""Pixels of a panel, and how many stand side by side."""


def draw_segmentation(bag: Any, path: Path) -> None:
    """Write one slice of a scan, of every stage of its segmentation, and of what was packed.

    Parameters
    ----------
    bag : Bag
        Simulated.
    path : Path
        PNG.
    """
    volume, truth, nothing = bag.volume, bag.labels, np.zeros_like(bag.labels)
    dense, _ = find_foreground(volume, bag.spacing, "hysteresis", _silent)
    found = oversegment(volume, bag.spacing, _silent)
    merged = merge_parts(found.parts, deepcopy(found.measured))
    pieces, measured = split_at_density_steps(volume, bag.spacing, found)
    together = merge_pieces(pieces.copy(), measured)
    # The least affinity of a voxel with one beside it: dark where the network sees an end.
    near = binary_dilation(dense, iterations=2)
    affinity = np.where(near, found.prediction.next.min(axis=0), 0).astype(np.uint16)
    window = object_window(volume, truth)
    stages = [
        ("1  the scan", volume, nothing, window),
        ("2  foreground", volume, dense.astype(np.int32), window),
        ("3  affinities", affinity, nothing, (0.0, 255.0)),
        ("4  linked fragments: parts", volume, found.parts, window),
        ("5  parts merged", volume, merged, window),
        ("6  split at density steps", volume, pieces, window),
        ("7  pieces merged", volume, together, window),
        ("8  borders and cavities: found", volume, segment(volume, bag.spacing).labels, window),
        ("what was packed", volume, truth, window),
    ]
    panels = [
        captioned(_slice(values, labels, truth, levels), words)
        for words, values, labels, levels in stages
    ]
    rows = [np.hstack(panels[k : k + COLUMNS]) for k in range(0, len(panels), COLUMNS)]
    save(np.vstack(rows), path)


def _slice(
    values: NDArray[Any], labels: NDArray[Any], truth: NDArray[Any], levels: Any
) -> NDArray[np.float32]:
    image = slice_image(
        values, labels, _tints(labels, truth), ALONG_Z, values.shape[0] // 2, levels
    )
    high, wide = image.shape[:2]
    size = (WIDE, round(WIDE * high / wide))
    panel = Image.fromarray(image[..., :3]).resize(size, Image.Resampling.LANCZOS)
    framed = ImageOps.expand(panel, 3, fill=(14, 16, 20))
    return np.asarray(framed, np.float32) / 255


def _tints(labels: NDArray[Any], truth: NDArray[Any]) -> NDArray[np.float32]:
    """Return tints that follow the true objects, so that a split or a join shows as one."""
    last, things = max(int(labels.max()), 1), int(truth.max())
    shared = np.zeros((last + 1, things + 1), np.int64)
    np.add.at(shared, (labels.reshape(-1), truth.reshape(-1)), 1)
    shared[0], shared[:, 0] = 0, 0
    # The largest piece of a thing has its hue; others have hues that no thing has.
    hues = {i: golden_hue(things + i) for i in range(1, last + 1)}
    for thing in range(1, things + 1):
        largest = int(shared[:, thing].argmax())
        if shared[largest].argmax() == thing:
            hues[largest] = golden_hue(thing)
    tints = tints_of(hues, last).copy()
    tints[1:, 3] = 0.6
    return tints


def _silent(fraction: float, text: str = "") -> None:
    """Say nothing."""
