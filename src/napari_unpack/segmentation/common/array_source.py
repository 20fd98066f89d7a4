"""Volumes that may be larger than memory: anything with a shape, a dtype and slicing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from napari_unpack.geometry.boxes import Box as Box
from napari_unpack.geometry.masks import unmasked
from napari_unpack.segmentation.common.validation import (
    block_dtype,
    checked_form,
    unpadded_dtype,
    without_infinities,
    without_padding,
)

# Cells; what is read twice, at the faces of a slab, is little beside them.
THINNEST_SLAB = 8


@dataclass(frozen=True, eq=False)
class Source:
    """A density volume that is read block by block.

    Parameters
    ----------
    array : array
        An ndarray, memory map, zarr or dask array: `shape`, `dtype` and slices are asked of it.
    shape : (int, int, int)
        Voxels z y x.
    lock : threading.Lock
        Held while reading: not every store may be read by two threads at once.
    padding : float, optional
        The value that is read as NaN; see `padding_of`.
    """

    array: Any
    shape: tuple[int, int, int]
    lock: Lock
    padding: float | None = None

    @property
    def size(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type in which blocks are read: the array's, in the machine's byte order."""
        given = block_dtype(np.dtype(self.array.dtype))
        return given if self.padding is None else unpadded_dtype(given)

    def read(self, box: Box) -> NDArray[Any]:
        """Return the densities in a box, not copied where the array is an ndarray."""
        with self.lock:
            block = np.asarray(self.array[box])
        block = block.astype(block_dtype(block.dtype), copy=False)
        return without_padding(without_infinities(block), self.padding)


def source_of(volume: ArrayLike | Any) -> Source:
    """Wrap a (Z, Y, X) volume, without reading it if it is lazy.

    What has no `shape`, `dtype` and slicing becomes an ndarray.

    Raises
    ------
    TypeError
        If the values are not real numbers.
    ValueError
        If it is not 3D, or empty.
    """
    if isinstance(volume, np.ma.MaskedArray):
        volume = unmasked(volume, np.nan)
    lazy = all(hasattr(volume, name) for name in ("shape", "dtype", "__getitem__"))
    array: Any = volume if lazy else np.asarray(volume)
    shape = checked_form(tuple(int(n) for n in array.shape), np.dtype(array.dtype))
    return Source(array, shape, Lock())


def blocks(
    shape: tuple[int, int, int], factors: tuple[int, int, int], most: int
) -> Iterator[tuple[Box, Box]]:
    """Cut a volume into blocks whose edges fall between the voxels of a reduced grid.

    Parameters
    ----------
    shape : (int, int, int)
        Of the volume.
    factors : (int, int, int)
        Voxels of the volume to one of the reduced grid, z y x.
    most : int
        Voxels a block has at most; one voxel of the reduced grid in any case.

    Yields
    ------
    box, reduced : tuple of slice
        The block in the volume and in the reduced grid, in C order.
    """
    # Rounded up: the last cell may stick out of the volume.
    grid = [-(-n // f) for n, f in zip(shape, factors, strict=True)]
    size, cell = list(grid), int(np.prod(factors))
    while cell * int(np.prod(size, dtype=np.int64)) > most and max(size) > 1:
        # Slabs first, of whole planes, which most stores read best; then across.
        axis = 0 if size[0] > THINNEST_SLAB else int(np.argmax(size))
        size[axis] = -(-size[axis] // 2)
    for z in range(0, grid[0], size[0]):
        for y in range(0, grid[1], size[1]):
            for x in range(0, grid[2], size[2]):
                first = (z, y, x)
                last = [min(a + s, g) for a, s, g in zip(first, size, grid, strict=True)]
                reduced = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
                box = tuple(
                    slice(a * f, min(b * f, n))
                    for a, b, f, n in zip(first, last, factors, shape, strict=True)
                )
                yield box, reduced  # type: ignore[misc]


def grown(box: Box, by: int, shape: tuple[int, int, int]) -> Box:
    """Return a box widened on every side, within the volume.

    Parameters
    ----------
    box : (slice, slice, slice)
    by : int
        Voxels.
    shape : (int, int, int)
        Of the volume.
    """
    a, b, c = (
        slice(max(s.start - by, 0), min(s.stop + by, n)) for s, n in zip(box, shape, strict=True)
    )
    return a, b, c


def within(box: Box, outer: Box) -> Box:
    """Return where a box lies in an array that holds an outer box.

    Parameters
    ----------
    box, outer : (slice, slice, slice)
        In the volume.
    """
    a, b, c = (slice(s.start - o.start, s.stop - o.start) for s, o in zip(box, outer, strict=True))
    return a, b, c


def framed(
    array: NDArray[np.generic], box: Box, by: int, dtype: DTypeLike, beyond: int = 0
) -> NDArray[Any]:
    """Return a copy of a box of an array, wider on every side.

    Parameters
    ----------
    array : (Z, Y, X) ndarray
    box : (slice, slice, slice)
    by : int
        Voxels on every side.
    dtype : dtype
        Of the copy.
    beyond : int
        Its value beyond the array.
    """
    depth, height, width = array.shape
    known = grown(box, by, (depth, height, width))
    out = np.full([s.stop - s.start + 2 * by for s in box], beyond, dtype)
    pairs = zip(known, box, strict=True)
    a, b, c = (slice(k.start - s.start + by, k.stop - s.start + by) for k, s in pairs)
    out[a, b, c] = array[known]
    return out


def strides_of(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return how many places the next voxel along z, y and x is away in a flat array, (3,)."""
    return np.array([shape[1] * shape[2], shape[2], 1], np.int64)


def face_steps(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the same to both sides, (6,): before and after along z, y and x."""
    strides = strides_of(shape)
    return np.stack([-strides, strides], axis=1).reshape(-1)
