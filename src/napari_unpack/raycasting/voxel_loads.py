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

    def typed(typingctx: Any, source: Any, at: Any, target: Any, slot: Any) -> Any:
        del typingctx
        return types.void(source, at, target, slot), generate

    return typed


copy_pair: Any = intrinsic(_copy(2))
"""copy_pair(source, at, target, slot): target[slot : slot + 2] = source[at : at + 2].

Flat arrays of one dtype; indices are not checked."""

copy_quad: Any = intrinsic(_copy(4))
"""As copy_pair, four voxels."""
