"""Memory that pixels are read back into, used again once nobody holds the array in it."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Colour and depth of the image being made, and of the one before, which its maker still holds.
KEPT = 4
# Colour of a large screen's image; what is larger is seldom made in a row.
MOST_BYTES = 16 * 3840 * 2160


class HostMemory:
    """Gives out float arrays in memory of arrays that are gone.

    Notes
    -----
    The system hands out fresh memory page by page, zeroed, as it is first written. For an image
    of 1024 x 1024 that takes longer than the transfer from a card.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[NDArray[np.uint8], weakref.ref[Any]]] = []

    def array(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Return an array of any content, which shares memory with none that anybody holds.

        Parameters
        ----------
        shape : tuple of int
        """
        size = int(np.prod(shape)) * np.dtype(np.float32).itemsize
        if size > MOST_BYTES:
            return np.empty(shape, np.float32)
        for i, (block, holder) in enumerate(self._kept):
            if holder() is None and block.size == size:
                memory = self._kept.pop(i)[0]
                break
        else:
            memory = np.empty(size, np.uint8)
        # All views of it hold this very array: numpy leads their bases back no further than to
        # what lies in a buffer that is no array.
        flat = np.frombuffer(memory.data, np.float32)
        self._kept.append((memory, weakref.ref(flat)))
        del self._kept[:-KEPT]
        return flat.reshape(shape)
