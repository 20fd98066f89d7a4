"""How objects look: the master transfer function, interference, hues and tints."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_unpack.appearance.background import Background
    from napari_unpack.appearance.coloring import color_classes
    from napari_unpack.appearance.contacts import interference
    from napari_unpack.appearance.decorations import Surroundings
    from napari_unpack.appearance.hues import arc_hues, assign_hues
    from napari_unpack.appearance.safe_ring import safe_to_rgb
    from napari_unpack.appearance.steady import golden_hue, hue_distance, hues_between
    from napari_unpack.appearance.tints import hsv_to_rgb, perceptual_to_rgb, tints_of
    from napari_unpack.appearance.transfer_function import PRESETS, TransferFunction

# Imported on first use, so that a plugin starts without loading networkx and numba.
_HOMES = {
    "Background": "background",
    "PRESETS": "transfer_function",
    "Surroundings": "decorations",
    "TransferFunction": "transfer_function",
    "arc_hues": "hues",
    "assign_hues": "hues",
    "color_classes": "coloring",
    "golden_hue": "steady",
    "hsv_to_rgb": "tints",
    "hue_distance": "steady",
    "hues_between": "steady",
    "interference": "contacts",
    "perceptual_to_rgb": "tints",
    "safe_to_rgb": "safe_ring",
    "tints_of": "tints",
}

__all__ = [
    "PRESETS",
    "Background",
    "Surroundings",
    "TransferFunction",
    "arc_hues",
    "assign_hues",
    "color_classes",
    "golden_hue",
    "hsv_to_rgb",
    "hue_distance",
    "hues_between",
    "interference",
    "perceptual_to_rgb",
    "safe_to_rgb",
    "tints_of",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
