"""A picture of what segmentation does, step by step, on one slice of a simulated bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from gallery_pictures import SIDE, captioned, save
from numpy.typing import NDArray
from PIL import Image

from napari_unpack import segment
from napari_unpack.appearance import golden_hue, tints_of
from napari_unpack.rendering.slice_image import ALONG_Z, object_window, slice_image
from napari_unpack.segmentation.foreground.methods import find_foreground
from napari_unpack.segmentation.learned.method import oversegment


def draw_segmentation(bag: Any, path: Path) -> None:
    """Write the scan, its foreground, fragments, found and true objects, side by side.

    Parameters
    ----------
    bag : Bag
        Simulated.
    path : Path
        PNG.
    """
    dense, _ = find_foreground(bag.volume, bag.spacing, "hysteresis", _silent)
    steps = (
        ("scan", np.zeros_like(bag.labels)),
        ("matter", dense.astype(np.int32)),
        ("fragments", oversegment(bag.volume, bag.spacing, _silent).parts),
        ("found", segment(bag.volume, bag.spacing).labels),
        ("packed", bag.labels),
    )
    window = object_window(bag.volume, bag.labels)
    panels = [captioned(_slice(bag.volume, labels, window), words) for words, labels in steps]
    save(np.hstack(panels), path)


def _slice(volume: Any, labels: Any, window: Any) -> NDArray[np.float32]:
    last = max(int(labels.max()), 1)
    tints = tints_of({i: golden_hue(i) for i in range(1, last + 1)}, last).copy()
    tints[1:, 3] = 0.6
    image = slice_image(volume, labels, tints, ALONG_Z, volume.shape[0] // 2, window)
    high, wide = image.shape[:2]
    scale = SIDE / max(high, wide)
    small = Image.fromarray(image[..., :3]).resize((round(wide * scale), round(high * scale)))
    square = Image.new("RGB", (SIDE, SIDE), (14, 16, 20))
    square.paste(small, ((SIDE - small.width) // 2, (SIDE - small.height) // 2))
    return np.asarray(square, np.float32) / 255


def _silent(fraction: float, text: str = "") -> None:
    """Say nothing."""
