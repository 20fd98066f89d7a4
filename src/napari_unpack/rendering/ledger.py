"""What our textures and buffers take on the graphics card, counted by ourselves.

Drivers do not say. Whoever keeps GL objects has a `bytes_held`; their sum is what a picture costs.
"""

from __future__ import annotations

from vispy import gloo

TEXEL = {"r8": 1, "r16": 2, "r32f": 4, "rgba8": 4, "rgba32f": 16}
"""Bytes of a texel of the formats that we use."""


def texture_bytes(texture: gloo.Texture2D | gloo.Texture3D) -> int:
    """Return the bytes of a texture: its texels, without what a driver pads them with.

    Raises
    ------
    KeyError
        If its format is none of ours.
    """
    texels = 1
    for n in texture.shape[:-1]:
        texels *= int(n)
    return texels * TEXEL[texture.internalformat]
