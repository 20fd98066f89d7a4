"""Pictures that cards show: arrays on their way to textures, or textures a pass has filled."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import NDArray
from vispy.gloo import Texture2D
from vispy.gloo.context import get_current_canvas

from napari_unpack.rendering.framebuffer import NO_DEPTH, namespace
from napari_unpack.rendering.ledger import PICTURES, ledger

PictureArray = NDArray[np.float32] | NDArray[np.uint8]


class Picture:
    """A premultiplied RGBA picture with or without depths, uploaded where it is drawn.

    Parameters
    ----------
    color : (h, w, 4) ndarray of float32 or uint8, or Texture2D
        Premultiplied RGBA, row 0 at the top; textures likewise, as the passes fill them.
    depth : (h, w) ndarray of float32, or Texture2D, optional
        t in mm where alpha first reached 1/2; +inf or `NO_DEPTH` where it never did.

    Attributes
    ----------
    uploads : int
        Arrays sent to the graphics card so far.

    Notes
    -----
    Arrays are kept, and sent once to every context the picture is drawn in: one that replaces a
    context that was lost gets them as well. Textures of a pass serve in their own context alone.
    """

    def __init__(
        self, color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None = None
    ) -> None:
        self.uploads = self._version = 0
        # By context: the version that is there, and its textures, which may be written to again.
        self._made: WeakKeyDictionary[Any, tuple[int, Texture2D, Texture2D | None]]
        self._made = WeakKeyDictionary()
        self.update(color, depth)

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
        self._version += 1
        self._home = None
        if isinstance(color, Texture2D) and get_current_canvas() is not None:
            self._home = ref(namespace())

    def textures(self) -> tuple[Texture2D, Texture2D | None] | None:
        """Return the colour and depth textures, uploading what is new.

        Returns
        -------
        (Texture2D, Texture2D or None) or None
            None in another context than that of the pass that filled them.
        """
        here = namespace()
        if isinstance(self._color, Texture2D):
            strange = self._home is not None and self._home() is not here
            return None if strange else (self._color, self._depth)
        version, color, depth = self._made.get(here, (0, None, None))
        if version != self._version:
            color = self._uploaded("rgba", self._color, color)
            if self._depth is None:
                depth = None
            else:
                known = np.where(self._depth < NO_DEPTH, self._depth, np.float32(NO_DEPTH))
                depth = self._uploaded("r", known, depth)
            self._made[here] = self._version, color, depth
        return color, depth

    def _uploaded(self, base: str, array: PictureArray, own: Texture2D | None) -> Texture2D:
        self.uploads += 1
        internal = base + ("8" if array.dtype == np.uint8 else "32f")
        if own is not None and own.shape[:2] == array.shape[:2] and own.internalformat == internal:
            own.set_data(array)
            return own
        made = Texture2D(
            array,
            format="rgba" if base == "rgba" else "red",
            internalformat=internal,
            interpolation="linear" if base == "rgba" else "nearest",
        )
        return ledger().enter(PICTURES, made)


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
