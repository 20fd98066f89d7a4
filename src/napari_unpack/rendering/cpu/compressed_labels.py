"""Labels of mixed bricks in as few bits as they need: what the ID passes read.

A ray runs across the rows of a volume, and so nearly every label it reads comes from another
line of memory. A brick in which two objects meet needs one bit a voxel, 64 bytes, which are one
line; bricks of one object need none at all.

The labels of eight samples at once, where a brick holds two objects: one bit each.

The eight words of such a brick are its eight planes, which fit one register of 512 bits: the word
of every sample is picked by its plane and shifted to its voxel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from napari_unpack.rendering.cpu.ray_sampling import BRICK
from napari_unpack.rendering.cpu.thread_pool import over_bands

WORD = 6
"""A word has 2^6 bits."""

LINE = 8
"""Words of a line of the cache."""


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


EIGHT = 8
"""Samples that are looked up together."""


def _eight_bits(typingctx: Any, words: Any, place: Any, k: Any, step: Any, *ray: Any) -> Any:
    del typingctx
    double, whole, word = ir.DoubleType(), ir.IntType(32), ir.IntType(64)

    def of(kind: Any) -> Any:
        return ir.VectorType(kind, EIGHT)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def constant(kind: Any, values: Any) -> Any:
            every = values if isinstance(values, list) else [values] * EIGHT
            return ir.Constant(of(kind), every)

        def spread(number: Any) -> Any:
            one = builder.insert_element(
                ir.Constant(of(number.type), ir.Undefined), number, ir.Constant(whole, 0)
            )
            return builder.shuffle_vector(one, one, constant(whole, 0))

        def voxel(origin: Any, slope: Any) -> Any:
            at = builder.fadd(spread(origin), builder.fmul(t, spread(slope)))
            nearest = builder.fptosi(builder.fadd(at, constant(double, 0.5)), of(whole))
            return builder.and_(nearest, constant(whole, 7))

        numbers = [float(i) for i in range(EIGHT)]
        at = builder.fadd(spread(args[2]), constant(double, numbers))
        t = builder.fmul(builder.fadd(at, constant(double, 0.5)), spread(args[3]))
        z, y, x = (voxel(args[4 + i], args[7 + i]) for i in range(3))
        bit = builder.or_(builder.shl(y, constant(whole, 3)), x)
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(data, [args[1]]), of(word).as_pointer())
        planes = builder.load(pointer, align=8)
        picked: Any = ir.Constant(of(word), ir.Undefined)
        for i in range(EIGHT):
            lane = ir.Constant(whole, i)
            chosen = builder.extract_element(planes, builder.extract_element(z, lane))
            picked = builder.insert_element(picked, chosen, lane)
        shifted = builder.lshr(picked, builder.zext(bit, of(word)))
        found = builder.trunc(shifted, of(ir.IntType(1)))
        return builder.zext(builder.bitcast(found, ir.IntType(EIGHT)), word)

    return types.uint64(words, place, k, step, *ray), generate


def _typed(
    typingctx: Any, words: Any, place: Any, k: Any, step: Any,
    pz: Any, py: Any, px: Any, dz: Any, dy: Any, dx: Any,
) -> Any:  # fmt: skip
    return _eight_bits(typingctx, words, place, k, step, pz, py, px, dz, dy, dx)


eight_bits: Any = intrinsic(_typed)
"""eight_bits(words, place, k, step, pz, py, px, dz, dy, dx): bit i is that of sample k + i.

The brick's eight words begin at `place` (uint64); k is a float. Samples outside the brick have
some bit of it."""


def _ones(typingctx: Any, bits: Any) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        return builder.ctpop(args[0])

    return types.uint64(bits), generate


ones_of: Any = intrinsic(_ones)
"""ones_of(bits): how many bits are set."""
