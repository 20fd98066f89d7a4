"""The only code written in LLVM's own instructions; README.md says why and what it wins."""

from napari_unpack.rendering.cpu.simd.arithmetic import (
    EDGE,
    LANES,
    blend_cell,
    copy_row,
    forward,
    gather_row,
    lay_over,
    look_up,
)
from napari_unpack.rendering.cpu.simd.masks import EIGHT, eight_bits, lowest_of, ones_of

__all__ = [
    "EDGE",
    "EIGHT",
    "LANES",
    "blend_cell",
    "copy_row",
    "eight_bits",
    "forward",
    "gather_row",
    "lay_over",
    "look_up",
    "lowest_of",
    "ones_of",
]
