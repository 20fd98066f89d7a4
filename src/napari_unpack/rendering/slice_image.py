"""The image of one slice: grey densities, and over them the tints of the objects."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Window = tuple[float, float]
"""Densities shown black and white."""

# Of a window: narrower ones would divide by nothing.
LEAST_WIDTH = 1e-30

# Voxels looked at for a window: a million show the shape of any histogram.
SAMPLES = 1 << 20

# Percent of the voxels left out at either end: metal and streaks would make the rest one grey.
LEFT_OUT = 0.5

# Of the voxels of objects, percent that are darker than white.
DARKER = 98

# White is at most so many times the median of the objects' densities: in a bag of water, plastic
# and much metal, more would leave the first two nearly black.
BRIGHTEST = 3.0


@dataclass(frozen=True)
class Plane:
    """A family of parallel slices, by the axes of their images.

    Parameters
    ----------
    rows, cols : int
        Axes of the volume that run down and to the right in the image.
    """

    rows: int
    cols: int

    @property
    def normal(self) -> int:
        """The axis that counts the slices."""
        return 3 - self.rows - self.cols

    def cut(self, volume: Any, index: int) -> NDArray[Any]:
        """Read one slice, and nothing else.

        Parameters
        ----------
        volume : (Z, Y, X) array
            In memory or not.
        index : int
            Along the normal.
        """
        place: list[slice | int] = [slice(None)] * 3
        place[self.normal] = index
        found = np.asarray(volume[tuple(place)])
        # In one piece: all that follows goes over it many times.
        return np.ascontiguousarray(found if self.rows < self.cols else found.T)


# Their images side by side share y, and one above the other x, in both of which gravity is down.
ALONG_Z, ALONG_X, ALONG_Y = Plane(1, 2), Plane(1, 0), Plane(0, 2)
PLANES = (ALONG_Z, ALONG_X, ALONG_Y)


def slice_image(
    volume: Any,
    labels: Any,
    tints: NDArray[np.float32],
    plane: Plane,
    index: int,
    window: Window,
    outlined: Collection[int] = (),
) -> NDArray[np.uint8]:
    """Draw one slice.

    Parameters
    ----------
    volume, labels : (Z, Y, X) array
        Densities and object IDs; only the slice is read.
    tints : (M, 4) ndarray of float32
        Straight RGBA by ID; alpha is the share of the tint in the colour.
    plane : Plane
    index : int
        Along its normal.
    window : (float, float)
        Densities shown black and white.
    outlined : collection of int
        Objects with a white edge.

    Returns
    -------
    (H, W, 4) ndarray of uint8
        RGBA, opaque. Densities that are not finite are black where not known, else as the
        nearest end of the window.
    """
    density, ids = plane.cut(volume, index), plane.cut(labels, index)
    low, high = window
    grey = density.astype(np.float32)
    grey -= np.float32(low)
    grey *= np.float32(255.0 / max(high - low, LEAST_WIDTH))
    if density.dtype.kind == "f":
        np.nan_to_num(grey, copy=False, nan=0.0)
    np.clip(grey, 0.0, 255.0, out=grey)
    kept = 1.0 - tints[:, 3]
    # Half a grey value, since bytes are cut off and not rounded.
    added = np.float32(255.0) * tints[:, :3] * tints[:, 3:] + np.float32(0.5)
    # Once: NumPy would make indices of their kind anew for every table that they look into.
    rows = ids.astype(np.intp)
    grey *= kept.take(rows)
    image = np.full((*grey.shape, 4), 255, np.uint8)
    for channel in range(3):
        image[..., channel] = grey + added[:, channel].take(rows)
    for object_id in outlined:
        image[edge_of(ids == object_id), :3] = 255
    return image


def edge_of(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels of a region that have a neighbour outside, (H, W)."""
    padded = np.pad(inside, 1)
    within = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    edge: NDArray[np.bool_] = inside & ~within
    return edge


def window_for(volume: Any) -> Window:
    """Return the window that shows most of a volume's densities.

    Parameters
    ----------
    volume : (Z, Y, X) array
        In memory or not; a million voxels are read at most.
    """
    some = np.asarray(volume[_few(volume.shape)])
    values = some[np.isfinite(some)]
    if not values.size:
        return 0.0, 1.0
    low, high = (float(v) for v in np.percentile(values, (LEFT_OUT, 100.0 - LEFT_OUT)))
    # A volume of one density is still to be seen.
    return (low, high) if high > low else (low - 1.0, low + 1.0)


def object_window(volume: Any, labels: Any) -> Window:
    """Return the window that shows what most objects are of, whatever is between or within them.

    Parameters
    ----------
    volume, labels : (Z, Y, X) array
        Densities and object IDs; a million voxels of each are read at most.
    """
    # The same voxels of both, whatever their order in memory.
    few = _few(labels.shape)
    seen, objects = np.asarray(volume[few]), np.asarray(labels[few]) != 0
    finite = np.isfinite(seen)
    of_objects = seen[finite & objects]
    if not of_objects.size:
        return 0.0, 1.0
    low = float(seen[finite].min())
    middle, high = (float(v) for v in np.percentile(of_objects, (50, DARKER)))
    # Where most is as dark as the darkest there is no telling what is metal.
    if middle > low:
        high = min(high, low + BRIGHTEST * (middle - low))
    return low, high if high > low else low + 1.0


def _few(shape: tuple[int, ...]) -> tuple[slice, slice, slice]:
    """Return the index of every few voxels along all axes."""
    step = slice(None, None, max(1, math.ceil((math.prod(shape) / SAMPLES) ** (1 / 3))))
    return step, step, step
