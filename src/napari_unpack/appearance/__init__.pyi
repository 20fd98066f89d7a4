from .background import Background
from .decorations import Decorations
from .hues import arc_hues, assign_hues, color_classes, golden_hue, hue_distance, hues_between
from .interference_graph import interference
from .tints import hsv_to_rgb, perceptual_to_rgb, safe_to_rgb, tints_of
from .transfer_function import PRESETS, TransferFunction

__all__ = [
    "PRESETS",
    "Background",
    "Decorations",
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
