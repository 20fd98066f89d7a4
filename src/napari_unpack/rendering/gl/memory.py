"""GPU memory, counted by ourselves, since no driver says what it holds.

Every texture and buffer is counted where it is made, and no longer where it is deleted or
collected, as gloo then deletes it.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

# Bytes of a texel in the formats that we use.
TEXEL = {"r8": 1, "r16": 2, "r32f": 4, "rgba8": 4, "rgba32f": 16}

# What the bytes are for: the two volumes, frame buffers, images sent as arrays, all the rest.
DENSITY, LABELS, TARGETS, PICTURES, TABLES = "density", "labels", "targets", "pictures", "tables"


class MemoryCounter:
    """The textures and buffers of a process, in all its contexts."""

    def __init__(self) -> None:
        self._kept: WeakKeyDictionary[Any, tuple[str, int]] = WeakKeyDictionary()

    def enter(self, purpose: str, thing: Any) -> Any:
        """Enter a texture, or a buffer, and return it.

        Parameters
        ----------
        purpose : str
            One of the constants of this module.
        thing : Texture or buffer

        Raises
        ------
        KeyError
            If a texture's format is none of ours.
        """
        self._kept[thing] = purpose, size_of(thing)
        return thing

    def strike(self, *things: Any) -> None:
        """Strike out what is deleted."""
        for thing in things:
            self._kept.pop(thing, None)

    def bytes_held(self) -> Counter[str]:
        """Return the bytes by purpose."""
        held: Counter[str] = Counter()
        for purpose, size in list(self._kept.values()):
            held[purpose] += size
        return held


def size_of(thing: Any) -> int:
    """Return the bytes of a texture or a buffer, without what a driver pads them with."""
    if hasattr(thing, "nbytes"):
        return int(thing.nbytes)
    texels = 1
    for n in thing.shape[:-1]:
        texels *= int(n)
    return texels * TEXEL[thing.internalformat]


@cache
def memory_counter() -> MemoryCounter:
    """Return the memory counter of the process."""
    return MemoryCounter()
