"""Small lookup tables on the GPU: one texel an object, or one an entry of a transfer function."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

# Texels a row of an ID table; the twin of table_row in shaders/lib/label_lookup.glsl.
WIDTH = 256


class IdTable:
    """RGBA by object ID in a texture 256 wide, of which only changed rows are uploaded.

    Attributes
    ----------
    rows_uploaded : int
        Texture rows sent so far. Hiding one object sends one.
    """

    def __init__(self) -> None:
        self.rows_uploaded = 0
        self.texture: gloo.Texture2D | None = None
        self._held = np.zeros((0, WIDTH, 4), np.float32)

    @property
    def rows(self) -> int:
        """Height of the texture."""
        return len(self._held)

    def update(self, values: NDArray[np.float32]) -> gloo.Texture2D:
        """Take over new (M, 4) float32 values by ID; the texture stays while their number does."""
        rows = -(-len(values) // WIDTH)
        padded = np.zeros((rows * WIDTH, 4), np.float32)
        padded[: len(values)] = values
        wanted = padded.reshape(rows, WIDTH, 4)
        if self.texture is None or rows != self.rows:
            self.texture = _table(wanted)
            self.rows_uploaded += rows
        else:
            changed = np.flatnonzero((wanted != self._held).any(axis=(1, 2)))
            for run in np.split(changed, np.flatnonzero(np.diff(changed) > 1) + 1):
                if run.size:
                    first, last = int(run[0]), int(run[-1]) + 1
                    self.texture.set_data(wanted[first:last], offset=(first, 0), copy=True)
                    self.rows_uploaded += last - first
        self._held = wanted
        return self.texture


class TransferTable:
    """The transfer function's table in a texture one texel high."""

    def __init__(self) -> None:
        self.texture: gloo.Texture2D | None = None
        self._held: NDArray[np.float32] | None = None

    def update(self, table: NDArray[np.float32]) -> gloo.Texture2D:
        """Take over a (K, 4) float32 table; uploads only if it differs."""
        wanted = np.ascontiguousarray(table, np.float32)[None]
        if self.texture is None or self._held is None or self._held.shape != wanted.shape:
            self.texture = _table(wanted)
        elif not np.array_equal(self._held, wanted):
            self.texture.set_data(wanted, copy=True)
        self._held = wanted.copy()
        return self.texture


def _table(values: NDArray[np.float32]) -> gloo.Texture2D:
    return gloo.Texture2D(values, format="rgba", internalformat="rgba32f", interpolation="nearest")
