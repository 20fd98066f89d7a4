"""Copies of two or four neighbouring voxels in one load and one store.

numba reads arrays element by element; rays read little else than rows of voxels.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _copy(count: int) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source, at, target, slot = args
        voxel = context.get_value_type(signature.args[0].dtype)
        row = ir.VectorType(voxel, count).as_pointer()
        size = context.get_abi_sizeof(voxel)

        def place(array: Any, kind: Any, index: Any) -> Any:
            data = context.make_array(kind)(context, builder, array).data
            return builder.bitcast(builder.gep(data, [index]), row)

        loaded = builder.load(place(source, signature.args[0], at), align=size)
        builder.store(loaded, place(target, signature.args[2], slot), align=size)
        return context.get_dummy_value()

    def typed(typing: Any, source: Any, at: Any, target: Any, slot: Any) -> Any:
        del typing
        return types.void(source, at, target, slot), generate

    return typed


@intrinsic
def copy_pair(typing, source, at, target, slot):  # type: ignore[no-untyped-def]
    """Copy source[at : at + 2] to target[slot : slot + 2], flat arrays of one dtype, unchecked."""
    return _copy(2)(typing, source, at, target, slot)


@intrinsic
def copy_quad(typing, source, at, target, slot):  # type: ignore[no-untyped-def]
    """Copy source[at : at + 4] to target[slot : slot + 4], flat arrays of one dtype, unchecked."""
    return _copy(4)(typing, source, at, target, slot)
