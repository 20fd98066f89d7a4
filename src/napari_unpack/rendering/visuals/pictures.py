"""Pictures that cards show: arrays on their way to textures, or textures a pass has filled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vispy.gloo import Texture2D

from napari_unpack.rendering.framebuffer import NO_DEPTH

PictureArray = NDArray[np.float32] | NDArray[np.uint8]


class Picture:
    """A premultiplied RGBA picture with or without depths, uploaded when it is first drawn.

    Parameters
    ----------
    color : (h, w, 4) ndarray of float32 or uint8, or Texture2D
        Premultiplied RGBA, row 0 at the top; textures likewise, as the passes fill them.
    depth : (h, w) ndarray of float32, or Texture2D, optional
        t in mm where alpha first reached 1/2; +inf or `NO_DEPTH` where it never did.

    Notes
    -----
    A picture belongs to the first canvas it is drawn on. Arrays are kept until then only.
    """

    def __init__(
        self, color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None = None
    ) -> None:
        self.uploads = 0
        self._color: PictureArray | Texture2D
        self._depth: NDArray[np.float32] | Texture2D | None
        self._old: tuple[Texture2D | None, Texture2D | None] = (None, None)
        self._color, self._depth = _checked(color, depth)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return int(self._color.shape[0]), int(self._color.shape[1])

    @property
    def has_depth(self) -> bool:
        """Whether there are depths."""
        return self._depth is not None

    def update(
        self, color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None = None
    ) -> None:
        """Replace the contents, in place where size and type stay."""
        old = tuple(
            t if isinstance(t, Texture2D) else o
            for t, o in zip((self._color, self._depth), self._old, strict=True)
        )
        self._color, self._depth = _checked(color, depth)
        self._old = (old[0], old[1])

    def textures(self) -> tuple[Texture2D, Texture2D | None]:
        """Return the colour and depth textures, uploading what is new."""
        if not isinstance(self._color, Texture2D):
            self._color = self._uploaded(self._color, self._old[0], "linear")
        if self._depth is not None and not isinstance(self._depth, Texture2D):
            depth = np.where(self._depth < NO_DEPTH, self._depth, np.float32(NO_DEPTH))
            self._depth = self._uploaded(depth, self._old[1], "nearest")
        return self._color, self._depth

    def _uploaded(
        self, array: PictureArray, old: Texture2D | None, interpolation: str
    ) -> Texture2D:
        self.uploads += 1
        channels = 1 if array.ndim == 2 else array.shape[2]
        suffix = "8" if array.dtype == np.uint8 else "32f"
        internal = ("r" if channels == 1 else "rgba") + suffix
        if old is not None and old.shape[:2] == array.shape[:2] and old.internalformat == internal:
            old.set_data(array)
            return old
        return Texture2D(
            array,
            format="red" if channels == 1 else "rgba",
            internalformat=internal,
            interpolation=interpolation,
        )


def _checked(
    color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None
) -> tuple[PictureArray | Texture2D, NDArray[np.float32] | Texture2D | None]:
    if len(color.shape) != 3 or color.shape[2] != 4 or 0 in color.shape:
        raise ValueError(f"color must be (h, w, 4) premultiplied RGBA, got shape {color.shape}")
    if not isinstance(color, Texture2D) and color.dtype not in (np.float32, np.uint8):
        raise TypeError(f"color must be float32 or uint8, got {color.dtype}")
    if depth is not None and tuple(depth.shape[:2]) != tuple(color.shape[:2]):
        raise ValueError(f"depth must be {color.shape[:2]} like color, got {depth.shape[:2]}")
    return color, depth
