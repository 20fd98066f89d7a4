"""Labels of mixed bricks in as few bits as they need: what the ID passes read.

A ray runs across the rows of a volume, and so nearly every label it reads comes from another
line of memory. A brick in which two objects meet needs one bit a voxel, 64 bytes, which are one
line; bricks of one object need none at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.ray_sampling import BRICK
from napari_unpack.rendering.cpu.thread_pool import over_bands

# A word has 2^6 bits.
WORD = 6
# Words of a line of the cache.
LINE = 8


@dataclass(frozen=True, eq=False)
class CompressedLabels:
    """Numbers of objects, by brick and voxel.

    Parameters
    ----------
    words : (W,) ndarray of uint64
        Every mixed brick's voxels, z y x, each as the number of its object within
        `Bricks.ids` of the brick, in 2^b bits, lowest first.
    first : (B,) ndarray of int64
        Where each brick's words begin.
    bits : (B,) ndarray of uint8
        b of each brick, 0 to 4.
    number : (B,) ndarray of int32
        Of each mixed brick, those of two objects first, whose words begin at 8 times their
        number; -1 elsewhere.
    pairs : (n,) ndarray of int64
        The bricks of two objects, by number.
    """

    words: NDArray[np.uint64]
    first: NDArray[np.int64]
    bits: NDArray[np.uint8]
    number: NDArray[np.int32]
    pairs: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        labels: NDArray[np.uint16],
        starts: NDArray[np.int64],
        ids: NDArray[np.uint16],
        threads: int | None = None,
    ) -> CompressedLabels:
        """Pack the labels of the bricks that hold more than one.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of uint16
            Object IDs, C-contiguous.
        starts, ids
            Of `Bricks`.
        threads : int, optional
            Workers, by default one a core.

        Returns
        -------
        CompressedLabels
            64 bytes for a brick of two objects, 128 of up to four, 256 of up to sixteen.
        """
        counts = np.diff(starts)
        bits = np.select([counts <= 2, counts <= 4, counts <= 16], [0, 1, 2], 4).astype(np.uint8)
        sizes = np.where(counts > 1, (BRICK**3 >> WORD) << bits.astype(np.int64), 0)
        pairs = np.flatnonzero(counts == 2)
        mixed = np.concatenate([pairs, np.flatnonzero(counts > 2)])
        first, number = np.zeros(len(counts), np.int64), np.full(len(counts), -1, np.int32)
        first[mixed] = np.cumsum(sizes[mixed]) - sizes[mixed]
        number[mixed] = np.arange(len(mixed))
        words = _on_lines(int(sizes.sum()))
        grid = tuple(-(-n // BRICK) for n in labels.shape)

        def work(_: None, low: int, high: int) -> None:
            _pack(labels, starts, ids, first, bits, low, high, grid[1], grid[2], words)

        over_bands(grid[0], work, lambda: None, threads, band=1)
        return cls(words, first, bits, number, pairs)


def _on_lines(count: int) -> NDArray[np.uint64]:
    """Return zeros that begin with a line of the cache, so that eight of them are one."""
    padded = np.zeros(count + LINE, np.uint64)
    begin = -(padded.ctypes.data // padded.itemsize) % LINE
    return padded[begin : begin + count]


@njit(cache=True, nogil=True, error_model="numpy")
def _pack(  # type: ignore[no-untyped-def]
    labels, starts, ids, first, bits, low, high, rows, columns, words
):
    depth, height, width = labels.shape
    for bz in range(low, high):
        for by in range(rows):
            for bx in range(columns):
                b = (bz * rows + by) * columns + bx
                start, end = starts[b], starts[b + 1]
                if end - start < 2:
                    continue
                shift = np.uint64(bits[b])
                if end - start == 2 and (bx + 1) * BRICK <= width:
                    # A bit a voxel: rows are compared at once, without asking each whose it is.
                    first_of = ids[start]
                    for z in range(bz * BRICK, min(bz * BRICK + BRICK, depth)):
                        word = np.uint64(0)
                        for y in range(by * BRICK, min(by * BRICK + BRICK, height)):
                            row = np.uint64(0)
                            for x in range(BRICK):
                                other = np.uint64(labels[z, y, bx * BRICK + x] != first_of)
                                row |= other << np.uint64(x)
                            word |= row << np.uint64((y & 7) * BRICK)
                        words[np.uint64(first[b]) + np.uint64(z & 7)] = word
                    continue
                number = np.uint64(0)
                for z in range(bz * BRICK, min(bz * BRICK + BRICK, depth)):
                    for y in range(by * BRICK, min(by * BRICK + BRICK, height)):
                        place = np.uint64(((z & 7) * BRICK + (y & 7)) * BRICK)
                        for x in range(bx * BRICK, min(bx * BRICK + BRICK, width)):
                            label = labels[z, y, x]
                            if ids[start + np.int64(number)] != label:
                                number = np.uint64(0)
                                while ids[start + np.int64(number)] != label:
                                    number += np.uint64(1)
                            bit = (place + np.uint64(x & 7)) << shift
                            word = np.uint64(first[b]) + (bit >> np.uint64(WORD))
                            words[word] |= number << (bit & np.uint64(63))
