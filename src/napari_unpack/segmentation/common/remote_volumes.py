"""Volumes on another computer, read once: what was read is kept on a disk of this one."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import check_space
from napari_unpack.segmentation.common.array_source import Box, Source


class KeptChunks:
    """An array whose chunks are read when they are first asked for, and kept in a file.

    One thread at a time may read it, as `Source` sees to.

    Parameters
    ----------
    array : zarr.Array
        (Z, Y, X).
    file : Path
        Of no more bytes than the chunks that were read, where the file system leaves out holes.
    """

    def __init__(self, array: Any, file: Path) -> None:
        self.shape, self.dtype = array.shape, array.dtype
        self._array, self._chunk = array, array.shards or array.chunks
        self._kept = np.memmap(file, self.dtype, "w+", shape=self.shape)
        grid = tuple(-(-n // c) for n, c in zip(self.shape, self._chunk, strict=True))
        self._is_kept = np.zeros(grid, np.bool_)

    def __getitem__(self, box: Box) -> NDArray[Any]:
        """Return the voxels in a box."""
        first = [s.start // c for s, c in zip(box, self._chunk, strict=True)]
        last = [-(-s.stop // c) for s, c in zip(box, self._chunk, strict=True)]
        touched = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        if not self._is_kept[touched].any():
            # One request for all, as most boxes are: a store fetches the chunks of it together.
            self._fetch(first, last)
        for offset in np.argwhere(~self._is_kept[touched]):
            chunk = (np.array(first) + offset).tolist()
            self._fetch(chunk, [n + 1 for n in chunk])
        return np.array(self._kept[box])

    def _fetch(self, first: list[int], last: list[int]) -> None:
        box = tuple(
            slice(a * c, min(b * c, n))
            for a, b, c, n in zip(first, last, self._chunk, self.shape, strict=True)
        )
        self._kept[box] = self._array[box]
        self._is_kept[tuple(slice(a, b) for a, b in zip(first, last, strict=True))] = True


@contextmanager
def read_once(source: Source) -> Iterator[Source]:
    """Give a source that asks another computer for every chunk once.

    Parameters
    ----------
    source : Source
        Given back as it is unless its array is a Zarr array whose store is neither a folder, a zip
        file nor memory.

    Raises
    ------
    OSError
        If the folder for temporary files has too little space for the volume.
    """
    if not _is_remote(source.array):
        yield source
        return
    with TemporaryDirectory(prefix="napari-unpack-", ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "volume"
        check_space(file, source.size * source.array.dtype.itemsize)
        yield replace(source, array=KeptChunks(source.array, file))


def _is_remote(array: Any) -> bool:
    # Nobody has a Zarr array without having imported zarr.
    zarr = sys.modules.get("zarr")
    if zarr is None or not isinstance(array, zarr.Array):
        return False
    here = (zarr.storage.LocalStore, zarr.storage.ZipStore, zarr.storage.MemoryStore)
    return not isinstance(array.store, here)
