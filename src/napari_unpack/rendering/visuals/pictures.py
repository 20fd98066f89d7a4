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
        # Textures made here may be written to again; those of a pass may not.
        self._own: dict[str, Texture2D] = {}
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
        self._color, self._depth = _checked(color, depth)

    def textures(self) -> tuple[Texture2D, Texture2D | None]:
        """Return the colour and depth textures, uploading what is new."""
        if not isinstance(self._color, Texture2D):
            self._color = self._uploaded("color", self._color)
        if self._depth is not None and not isinstance(self._depth, Texture2D):
            depth = np.where(self._depth < NO_DEPTH, self._depth, np.float32(NO_DEPTH))
            self._depth = self._uploaded("depth", depth)
        return self._color, self._depth

    def _uploaded(self, role: str, array: PictureArray) -> Texture2D:
        self.uploads += 1
        base = "rgba" if role == "color" else "r"
        internal = base + ("8" if array.dtype == np.uint8 else "32f")
        own = self._own.get(role)
        if own is not None and own.shape[:2] == array.shape[:2] and own.internalformat == internal:
            own.set_data(array)
        else:
            own = Texture2D(
                array,
                format="rgba" if role == "color" else "red",
                internalformat=internal,
                interpolation="linear" if role == "color" else "nearest",
            )
            self._own[role] = own
        return own


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
