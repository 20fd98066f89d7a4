"""Levels of a multiscale layer: the finest that fits the memory, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from napari.layers import Layer

from napari_unpack.layers.placement import data_to_world

Factors = tuple[int, int, int]


def finest_fitting(shapes: Sequence[Sequence[int]], voxel: int, memory: float) -> int:
    """Return the first of some levels that fits the memory, the last where none does.

    Parameters
    ----------
    shapes : sequence of (int, int, int)
        Of the levels, the finest first.
    voxel : int
        Bytes that a voxel takes.
    memory : float
        Bytes there are.
    """
    # As floats: a product of three sizes of a made-up file may pass 2^63.
    needed = [voxel * float(np.prod([float(n) for n in shape])) for shape in shapes]
    return next((k for k, size in enumerate(needed) if size <= memory), len(shapes) - 1)


def factors_of(finest: Sequence[int], level: Sequence[int]) -> Factors:
    """Return how many voxels of the finest level are one of a coarser, along z, y and x.

    Parameters
    ----------
    finest, level : (int, int, int)
        Their shapes. Levels are made by whole factors; what is left over at the end may be
        kept or dropped.
    """
    z, y, x = (max(1, round(n / m)) for n, m in zip(finest, level, strict=True))
    return z, y, x


def place_of_level(layer: Layer, factors: Factors) -> dict[str, Any]:
    """Return where a level stands, as arguments of a 3D layer of its own.

    Parameters
    ----------
    layer : napari layer
        Of several levels; its own transform is that of the finest.
    factors : (int, int, int)
        See `factors_of`.

    Notes
    -----
    Voxel centres lie at integers: the centre of the first voxel of a level is the middle of the
    voxels that it stands for.
    """
    finest_from_level = np.diag([*map(float, factors), 1.0])
    finest_from_level[:3, 3] = (np.array(factors) - 1) / 2
    matrix = data_to_world(layer) @ finest_from_level
    return {"scale": np.ones(3), "affine": matrix, "units": layer.units[-3:]}
