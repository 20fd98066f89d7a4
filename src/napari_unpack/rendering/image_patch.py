"""An image patch, one rectangle of an image with depths, and the composition of patches.

The packed bag, a flying object and a sprite are patches. Each is drawn on its own, kept while
nothing it depends on changes, and laid over the others by depth (Li et al. 2012, section 5.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Background
from napari_unpack.geometry.view import NEAREST, Camera
from napari_unpack.kernels import njit

Image = NDArray[np.float32]
# First row, first column, height and width.
Window = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class ImagePatch:
    """A rectangle of an image.

    Parameters
    ----------
    rgba : (h, w, 4) ndarray of float32
        Premultiplied colour.
    depth : (h, w) ndarray of float32
        t in mm where alpha first reached 0.5, growing away from the viewer; +inf elsewhere.
    row, col : int
        Pixel of the image where the patch's first pixel lies; may be negative.
    plane : float
        t of the middle of what is shown, mm. Stands in for the depth of translucent pixels.
    """

    rgba: Image
    depth: NDArray[np.float32]
    row: int
    col: int
    plane: float = 0.0

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.depth.shape[0], self.depth.shape[1]

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        return self.rgba.nbytes + self.depth.nbytes

    @property
    def is_empty(self) -> bool:
        """Whether it has no pixels, its object being out of the image."""
        return self.depth.size == 0

    def at(self, row: int, col: int, plane: float) -> ImagePatch:
        """Return the same patch elsewhere, its depths moved along with its plane.

        Parameters
        ----------
        row, col : int
            Pixel of the image where the patch's first pixel lies.
        plane : float
            mm.
        """
        moved = self.depth + np.float32(plane - self.plane)
        return ImagePatch(self.rgba, moved, row, col, plane)

    def trimmed(self) -> ImagePatch:
        """Return the smallest patch that keeps every pixel which is not fully transparent."""
        seen = self.rgba[..., 3] > 0
        rows, cols = np.flatnonzero(seen.any(1)), np.flatnonzero(seen.any(0))
        if not len(rows):
            return nothing(self.plane)
        window = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
        return ImagePatch(
            np.ascontiguousarray(self.rgba[window]),
            np.ascontiguousarray(self.depth[window]),
            self.row + int(rows[0]),
            self.col + int(cols[0]),
            self.plane,
        )


def nothing(plane: float = 0.0) -> ImagePatch:
    """Return a patch without pixels."""
    return ImagePatch(np.zeros((0, 0, 4), np.float32), np.zeros((0, 0), np.float32), 0, 0, plane)


def window_of(pivot_corners: ArrayLike, camera: Camera, size: tuple[int, int]) -> Window | None:
    """Find the window (row, col, height, width) that a box can touch; None where it is out.

    Parameters
    ----------
    pivot_corners : (8, 3) array_like
        Corners of the box in pivot space, mm; any rotation.
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.

    Notes
    -----
    A box that reaches behind the eye's plane projects to no rectangle: it gets the whole
    image.
    """
    corners = np.asarray(pivot_corners, dtype=np.float64)
    behind = corners[:, 0] >= camera.distance * (1 - NEAREST)
    # Nothing behind the eye is seen.
    if behind.all():
        return None
    if behind.any():
        return 0, 0, size[0], size[1]
    pixels = camera.pixels(corners, size)
    # Rounding must not drop a pixel whose centre lies on the edge.
    low = np.maximum(np.ceil(pixels.min(0) - 1e-9), 0).astype(int)
    high = np.minimum(np.floor(pixels.max(0) + 1e-9) + 1, size).astype(int)
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def overlap(one: Window, other: Window) -> Window | None:
    """Return what two windows have in common, None where that is nothing.

    Parameters
    ----------
    one, other : (int, int, int, int)
        First row, first column, height and width.
    """
    row, col = max(one[0], other[0]), max(one[1], other[1])
    height = min(one[0] + one[2], other[0] + other[2]) - row
    width = min(one[1] + one[3], other[1] + other[3]) - col
    return (row, col, height, width) if min(height, width) > 0 else None


def compose(
    size: tuple[int, int],
    patches: Iterable[ImagePatch],
    background: Background | Sequence[float] = (0.0, 0.0, 0.0, 0.0),
) -> Image:
    """Lay patches over each other by depth, pixel by pixel: (H, W, 4), premultiplied.

    Parameters
    ----------
    size : (int, int)
        Height and width of the image, pixels.
    patches : iterable of ImagePatch
        What lies outside the image is cut off.
    background : Background, or what `Background.of` takes
        Behind everything.

    Raises
    ------
    ValueError
        If the background is none.

    Notes
    -----
    On a pixel the patch with the smaller depth is in front; at equal depths the later one.
    Where alpha stays below 0.5 a patch stands at its `plane`. A pixel remembers one depth, the
    nearest so far, so what comes third goes before or behind both others, never between them.
    """
    ground = Background.of(background).paint(size)
    image = np.zeros((*size, 4), np.float32)
    nearest = np.full(size, np.inf, np.float32)
    for patch in patches:
        plane = np.float32(patch.plane)
        _lay(image, nearest, patch.rgba, patch.depth, patch.row, patch.col, plane)
    _fill(image, ground)
    return image


@njit(cache=True, nogil=True)
def _lay(image, nearest, rgba, depth, top, left, plane):  # type: ignore[no-untyped-def]
    height, width = nearest.shape
    for r in range(max(0, -top), min(depth.shape[0], height - top)):
        for c in range(max(0, -left), min(depth.shape[1], width - left)):
            alpha = rgba[r, c, 3]
            if alpha <= 0:
                continue
            # Translucent pixels have no depth of their own.
            t = depth[r, c] if depth[r, c] < np.inf else plane
            below, mine = image[top + r, left + c], rgba[r, c]
            if t <= nearest[top + r, left + c]:
                rest = np.float32(1) - alpha
                for i in range(4):
                    below[i] = mine[i] + rest * below[i]
                nearest[top + r, left + c] = t
            else:
                rest = np.float32(1) - below[3]
                for i in range(4):
                    below[i] += rest * mine[i]


@njit(cache=True, nogil=True)
def _fill(image, ground):  # type: ignore[no-untyped-def]
    for r in range(image.shape[0]):
        for c in range(image.shape[1]):
            rest = np.float32(1) - image[r, c, 3]
            for i in range(4):
                image[r, c, i] += rest * ground[r, c, i]
