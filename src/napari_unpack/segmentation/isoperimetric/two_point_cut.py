"""Cut an object between two of its voxels: what a person asks for with two clicks."""

from __future__ import annotations

from collections.abc import Sequence

import cc3d
import edt
import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import voxel_size
from napari_unpack.geometry.boxes import bounding_box
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.isoperimetric.distance_tree import isoperimetric_ratio, two_sides
from napari_unpack.segmentation.isoperimetric.lattice import Lattice
from napari_unpack.segmentation.isoperimetric.multiresolution import carried_back, coarsened

# Of the lattice that is solved: its time grows with the power 4/3 of them.
MOST_NODES = 40_000


def cut_between(
    mask: ArrayLike,
    density: ArrayLike | None,
    spacing: Sequence[float],
    a: Sequence[int],
    b: Sequence[int],
) -> NDArray[np.bool_]:
    """Cut a shape in two: return the part that holds voxel `b`, the rest holds voxel `a`.

    Parameters
    ----------
    mask : (Z, Y, X) array_like of bool
        The object.
    density : (Z, Y, X) array_like, optional
        Density; the cut prefers steps of it. NaN counts as 0.
    spacing : (3,) sequence of float, mm z y x
    a, b : (3,) sequence of int
        Two different voxels of the mask.

    Raises
    ------
    ValueError
        If a voxel is not in the mask, both are the same, or the shapes differ.
    """
    # The potential between both voxels (0 at a, 1 at b, harmonic elsewhere: the random walker's)
    # is swept for the smallest isoperimetric ratio, which puts the cut at a neck, at a density
    # step, or half-way where there is neither. Shapes above 40,000 voxels are solved in blocks and
    # the cut is settled at full resolution. Where a and b do not hang together, the part is b's
    # component.
    shape, size = np.asarray(mask, np.bool_), voxel_size(spacing)
    one, two = _checked(shape, "a", a), _checked(shape, "b", b)
    if one == two:
        raise ValueError(f"a and b must be two different voxels, got {one} twice")
    pieces = cc3d.connected_components(shape, connectivity=6)
    if pieces[one] != pieces[two]:
        return np.asarray(pieces == pieces[two])
    piece = pieces == pieces[one]
    box = bounding_box(piece)
    inner = np.ascontiguousarray(piece[box])
    if density is None:
        values = inner.astype(np.float32)
    else:
        given = np.asarray(density)
        if given.shape != shape.shape:
            raise ValueError(f"density must have the mask's shape {shape.shape}, got {given.shape}")
        values = np.nan_to_num(given[box].astype(np.float32))
    start = tuple(int(o - s.start) for o, s in zip(one, box, strict=True))
    end = tuple(int(o - s.start) for o, s in zip(two, box, strict=True))
    cut = np.zeros(shape.shape, np.bool_)
    cut[box] = _sides(inner, values, size, start, end) == 2
    return cut


def _checked(mask: NDArray[np.bool_], name: str, at: Sequence[int]) -> tuple[int, ...]:
    """Return a voxel of a mask, or say what is wrong with it."""
    voxel = tuple(int(v) for v in at)
    inside = len(voxel) == mask.ndim == 3 and all(
        0 <= v < n for v, n in zip(voxel, mask.shape, strict=True)
    )
    if not inside or not mask[voxel]:
        raise ValueError(f"{name} must be a voxel of the object, got {voxel}")
    return voxel


def _sides(
    mask: NDArray[np.bool_],
    values: NDArray[np.float32],
    spacing: Spacing,
    start: tuple[int, ...],
    end: tuple[int, ...],
) -> NDArray[np.int32]:
    """Return 1 for the voxels of the start's part, 2 for those of the end's, 0 outside."""
    depth = edt.edt(mask, anisotropy=spacing, black_border=True)
    small = coarsened(mask, depth, values, spacing, MOST_NODES)
    near = tuple(v // small.factor for v in start)
    far = tuple(v // small.factor for v in end)
    seeds = np.zeros(mask.shape, np.int32)
    seeds[start], seeds[end] = 1, 2
    # In one block, or in a speck that the blocks lost: steps from both voxels must do.
    if near == far or not (small.mask[near] and small.mask[far]):
        return flood(seeds, mask)
    lattice = Lattice.of(small.mask, small.spacing, small.density)
    flat = [int(np.ravel_multi_index(at, small.mask.shape)) for at in (near, far)]
    nodes = np.searchsorted(lattice.where, flat)
    potential = lattice.potential(nodes, np.array([0.0, 1.0]), 0.0)
    # Rounding must not carry a seed to the wrong side of its own level.
    potential[nodes] = -np.inf, np.inf
    order, cut = lattice.sweep(potential, weighted=True)
    k = int(np.argmin(isoperimetric_ratio(cut, lattice.voxel)[:-1]))
    blocks = two_sides(lattice.where[order], k, small.mask.shape)
    sides = carried_back(blocks, small.factor, mask, depth)
    # Whatever the flood made of them: each clicked voxel is on its own side.
    sides[start], sides[end] = 1, 2
    return _connected(sides, start, end)


def _connected(
    sides: NDArray[np.int32], start: tuple[int, ...], end: tuple[int, ...]
) -> NDArray[np.int32]:
    """Give fragments that do not hang on their own seed to the other side."""
    pieces = cc3d.connected_components(sides, connectivity=6)
    own = (pieces == pieces[start]) | (pieces == pieces[end])
    seeds = np.where(own, sides, 0).astype(np.int32, copy=False)
    return flood(seeds, sides > 0)
