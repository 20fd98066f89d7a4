"""Masks of a bit a sample, and the labels of eight samples at once; see README.md.

The eight words of a brick of two objects are its eight planes of 64 voxels. They fit one register
of 512 bits: the word of every sample is picked by its plane and shifted to its voxel.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

# Samples that are looked up together.
EIGHT = 8


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


# eight_bits(words, place, k, step, pz, py, px, dz, dy, dx): bit i is that of sample k + i.
#
# The brick's eight words begin at `place` (uint64); k is a float. Samples outside the brick have
# some bit of it.
eight_bits: Any = intrinsic(_typed)


def _ones(typingctx: Any, bits: Any) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        return builder.ctpop(args[0])

    return types.uint64(bits), generate


# ones_of(bits): how many bits are set.
ones_of: Any = intrinsic(_ones)


def _lowest(typingctx: Any, bits: Any) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(bits), generate


# lowest_of(bits): which is the lowest bit set, of a mask that is not 0.
lowest_of: Any = intrinsic(_lowest)
