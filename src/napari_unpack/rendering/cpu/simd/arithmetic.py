"""Vectors of voxels, colours and rows, in LLVM's own instructions; see README.md.

Arrays are flat, indices are uint64 and not checked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from napari_unpack.rendering.cpu.ray_sampling import BRICK

# Rays side by side, and samples of a chunk; at most 64.
LANES = 32
# Voxels along the edge of a cached brick: a voxel of its neighbours on either side.
EDGE = BRICK + 2

_FLOAT = ir.FloatType()
_MAY = ("contract", "reassoc", "nsz", "nnan")


class _Emitter:
    """Writes vector instructions for one call."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder

    def _pointer(self, array: Any, kind: Any, index: Any, count: int) -> Any:
        data = self.context.make_array(kind)(self.context, self.builder, array).data
        vector = ir.VectorType(self.context.get_value_type(kind.dtype), count)
        return self.builder.bitcast(self.builder.gep(data, [index]), vector.as_pointer())

    def _align(self, kind: Any) -> int:
        return int(self.context.get_abi_sizeof(self.context.get_value_type(kind.dtype)))

    def load(self, array: Any, kind: Any, index: Any, count: int) -> Any:
        """Load some numbers of an array."""
        return self.builder.load(self._pointer(array, kind, index, count), align=self._align(kind))

    def store(self, vector: Any, array: Any, kind: Any, index: Any) -> None:
        """Store a vector in an array."""
        place = self._pointer(array, kind, index, vector.type.count)
        self.builder.store(vector, place, align=self._align(kind))

    def plus(self, index: Any, more: int) -> Any:
        """Add a constant to an index."""
        return self.builder.add(index, ir.Constant(index.type, more))

    def fourfold(self, index: Any) -> Any:
        """Return where the four numbers of a voxel, colour or sample begin."""
        return self.builder.mul(index, ir.Constant(index.type, 4))

    def spread(self, number: Any, count: int) -> Any:
        """Repeat a number."""
        none = ir.Constant(ir.VectorType(number.type, count), ir.Undefined)
        one = self.builder.insert_element(none, number, ir.Constant(ir.IntType(32), 0))
        return self.pick(one, one, [0] * count)

    def pick(self, a: Any, b: Any, which: list[int]) -> Any:
        """Choose among the numbers of two vectors."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(which)), which)
        return self.builder.shuffle_vector(a, b, mask)

    def mix(self, a: Any, b: Any, part: Any) -> Any:
        """Interpolate from a to b."""
        way = self.builder.fsub(b, a, flags=_MAY)
        return self.builder.fadd(a, self.builder.fmul(part, way, flags=_MAY), flags=_MAY)


def _row_of_cells(
    typingctx: Any, flat: Any, at: Any, line: Any, plane: Any, cells: Any, to: Any
) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source, start, one_row, one_plane, target, slot = args
        kind, made = signature.args[0], signature.args[4]
        emit = _Emitter(context, builder)
        real = isinstance(made.dtype, types.Float)

        def row(index: Any) -> Any:
            vector = emit.load(source, kind, index, 16)
            if real and not isinstance(kind.dtype, types.Float):
                return builder.uitofp(vector, ir.VectorType(_FLOAT, 16))
            return vector

        def between(after: Any, before: Any) -> Any:
            minus = builder.fsub if real else builder.sub
            return minus(row(after), row(before))

        density = row(start)
        gz = between(builder.add(start, one_plane), builder.sub(start, one_plane))
        gy = between(builder.add(start, one_row), builder.sub(start, one_row))
        gx = between(emit.plus(start, 1), emit.plus(start, -1))
        turns = [n // 2 + 16 * (n % 2) for n in range(32)]
        ahead, behind = emit.pick(density, gz, turns), emit.pick(gy, gx, turns)
        for part in range(3):
            which = [8 * part + 2 * (n // 4) + n % 4 + 30 * (n % 4 > 1) for n in range(16)]
            index = emit.plus(emit.fourfold(slot), 16 * part)
            emit.store(emit.pick(ahead, behind, which), target, made, index)
        return context.get_dummy_value()

    return types.void(flat, at, line, plane, cells, to), generate


# gather_row(flat, at, line, plane, cells, to): density and its differences along z, y, x of the
# voxels flat[at : at + 12], to cells[4 to : 4 to + 48].
#
# Voxels are `line` and `plane` apart along y and z. Sixteen are read, so two too many on either
# side may be; of float32, or of uint16 into float32 or, if all differences fit, int16.
gather_row: Any = intrinsic(_row_of_cells)


def _row_of_eight(typingctx: Any, source: Any, at: Any, target: Any, to: Any) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        emit = _Emitter(context, builder)
        row = emit.load(args[0], signature.args[0], args[1], BRICK)
        emit.store(row, args[2], signature.args[2], args[3])
        return context.get_dummy_value()

    return types.void(source, at, target, to), generate


# copy_row(source, at, target, to): target[to : to + 8] = source[at : at + 8], of one dtype.
copy_row: Any = intrinsic(_row_of_eight)


def _blend(
    typingctx: Any, cells: Any, at: Any, fz: Any, fy: Any, fx: Any, out: Any, to: Any
) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source, start, part_z, part_y, part_x, target, slot = args
        kind, made = signature.args[0], signature.args[5]
        emit = _Emitter(context, builder)

        def row(more: int) -> Any:
            vector = emit.load(source, kind, emit.fourfold(emit.plus(start, more)), 8)
            if isinstance(kind.dtype, types.Float):
                return vector
            return builder.sitofp(vector, ir.VectorType(_FLOAT, 8))

        plane, part = EDGE * EDGE, emit.spread(part_y, 8)
        near = emit.mix(row(0), row(EDGE), part)
        far = emit.mix(row(plane), row(plane + EDGE), part)
        both = emit.mix(near, far, emit.spread(part_z, 8))
        low, high = emit.pick(both, both, [0, 1, 2, 3]), emit.pick(both, both, [4, 5, 6, 7])
        emit.store(emit.mix(low, high, emit.spread(part_x, 4)), target, made, emit.fourfold(slot))
        return context.get_dummy_value()

    return types.void(cells, at, fz, fy, fx, out, to), generate


# blend_cell(cells, at, fz, fy, fx, out, to): interpolate density and differences in the cell of a
# block whose first voxel is `at`, to out[4 to : 4 to + 4]; float32.
blend_cell: Any = intrinsic(_blend)


def _look_up(
    typingctx: Any, table: Any, row: Any, part: Any, tints: Any, label: Any, out: Any, to: Any
) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows, entry, way, by_label, name, target, slot = args
        kinds = signature.args
        emit = _Emitter(context, builder)
        low = emit.load(rows, kinds[0], emit.fourfold(entry), 4)
        high = emit.load(rows, kinds[0], emit.fourfold(emit.plus(entry, 1)), 4)
        tint = emit.load(by_label, kinds[3], emit.fourfold(name), 4)
        color = builder.fmul(emit.mix(low, high, emit.spread(way, 4)), tint, flags=_MAY)
        emit.store(color, target, kinds[5], emit.fourfold(slot))
        return context.get_dummy_value()

    return types.void(table, row, part, tints, label, out, to), generate


# look_up(table, row, part, tints, label, out, to): the colour and opacity `part` of the way from
# one row of the table to the next, times the tint, to out[4 to : 4 to + 4]; float32.
look_up: Any = intrinsic(_look_up)


def _lay_over(
    typingctx: Any,
    image: Any,
    pixel: Any,
    weight: Any,
    colors: Any,
    at: Any,
    light: Any,
    gloss: Any,
) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        picture, p, share, source, i, bright, glow = args
        kinds = signature.args
        emit = _Emitter(context, builder)
        color = emit.load(source, kinds[3], emit.fourfold(i), 4)
        lit = builder.fmul(color, emit.spread(bright, 4), flags=_MAY)
        lit = builder.fadd(lit, emit.spread(glow, 4), flags=_MAY)
        one = ir.Constant(lit.type, [ir.Constant(_FLOAT, 1.0)] * 4)
        lit = builder.select(builder.fcmp_ordered("<", lit, one, flags=_MAY), lit, one)
        lit = emit.pick(lit, one, [0, 1, 2, 4])
        index = emit.fourfold(p)
        share = builder.fmul(lit, emit.spread(share, 4), flags=_MAY)
        more = builder.fadd(emit.load(picture, kinds[0], index, 4), share, flags=_MAY)
        emit.store(more, picture, kinds[0], index)
        return context.get_dummy_value()

    return types.void(image, pixel, weight, colors, at, light, gloss), generate


# lay_over(image, pixel, weight, colors, at, light, gloss): add colour number `at`, lit, at most 1
# and weighted, to a pixel, and the weight itself to its alpha; float32.
lay_over: Any = intrinsic(_lay_over)


def _forward(typingctx: Any, rays: Any, k: Any, end: Any, places: Any, slot: Any) -> Any:
    del typingctx

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        lanes, row, last, integers, block = args
        kinds = signature.args
        emit = _Emitter(context, builder)
        at = emit.load(lanes, kinds[0], row, LANES)
        held = emit.load(integers, kinds[3], block, LANES)
        there = builder.icmp_signed(">=", held, ir.Constant(held.type, [0] * LANES))
        one, none = ir.Constant(at.type, [1.0] * LANES), ir.Constant(at.type, [0.0] * LANES)
        at = builder.fadd(at, builder.select(there, one, none))
        emit.store(at, lanes, kinds[0], row)
        over = builder.fcmp_ordered(">=", at, emit.load(lanes, kinds[0], last, LANES))
        bits = [builder.bitcast(mask, ir.IntType(LANES)) for mask in (there, over)]
        if LANES < 64:
            bits = [builder.zext(mask, ir.IntType(64)) for mask in bits]
        return context.make_tuple(builder, signature.return_type, bits)

    return types.UniTuple(types.uint64, 2)(rays, k, end, places, slot), generate


# forward(rays, k, end, places, slot): lanes whose number in row `slot` of `places` is not
# negative go on by a sample, 1 in row `k` of `rays`.
#
# Returns two masks, a bit a lane: those lanes, and those that have come to their end.
forward: Any = intrinsic(_forward)
