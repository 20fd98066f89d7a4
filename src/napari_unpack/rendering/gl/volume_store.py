"""One pair of volumes, density and labels, and its textures in every GL context."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from napari_unpack.rendering.gl.framebuffer import namespace
from napari_unpack.rendering.gl.textures import Box, Density, VolumeTextures


class VolumeStore:
    """Labels and density on their way to the GPU; what the three layers share.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs. Not to be changed in place; see `set_labels`.
    volume : (Z, Y, X) ndarray of uint16 or float32, optional
    largest : int, optional
        Longest side of a texture, for tests; by default the driver's.
    most : int, optional
        The largest label, where it is known.

    Attributes
    ----------
    version : int
        Grows when the volumes change, so that casters know.
    """

    def __init__(
        self,
        labels: NDArray[np.uint16],
        volume: Density | None = None,
        largest: int | None = None,
        most: int | None = None,
    ) -> None:
        self.version = 0
        self._labels, self._volume, self._largest, self._most = labels, volume, largest, most
        self._made: WeakKeyDictionary[Any, VolumeTextures] = WeakKeyDictionary()

    @property
    def uploads(self) -> int:
        """Textures begun, and boxes of labels, so far, in all contexts."""
        return sum(textures.uploads for textures in self._made.values())

    @property
    def bytes_sent(self) -> int:
        """Of all texels so far, in all contexts."""
        return sum(textures.bytes_sent for textures in self._made.values())

    @property
    def notice(self) -> str | None:
        """What to tell the user, if the volume is drawn coarser than it is somewhere."""
        return next((t.notice for t in self._made.values() if t.notice), None)

    def here(self) -> VolumeTextures:
        """Return the textures of the current context, sending all of them that waits."""
        textures = self._textures()
        textures.send()
        return textures

    def send(self, most_bytes: int) -> bool:
        """Send some of what waits to the current context; return whether all is there."""
        return self._textures().send(most_bytes)

    def _textures(self) -> VolumeTextures:
        here = namespace()
        if here not in self._made:
            self._made[here] = VolumeTextures(self._labels, self._volume, self._largest, self._most)
        return self._made[here]

    def delete(self) -> None:
        """Free the textures in every context; they are sent again where they are asked for."""
        for textures in self._made.values():
            textures.delete()
        self._made.clear()

    def set_labels(
        self, labels: NDArray[np.uint16], box: Box | None = None, most: int | None = None
    ) -> None:
        """Take over other labels of the same shape; the density stays where it is.

        They are sent when they are asked for in their context.

        Parameters
        ----------
        labels, box, most
            As for `VolumeTextures.set_labels`.

        Raises
        ------
        ValueError
            If the shape is another.
        """
        if labels.shape != self._labels.shape:
            raise ValueError(f"labels must be {self._labels.shape} as before, got {labels.shape}")
        self._labels, self._most = labels, most
        self.version += 1
        for textures in self._made.values():
            textures.set_labels(labels, box, most)
