"""A volume full of things, made in a second: boxes, balls and cylinders in a grid of cells.

Timings need known numbers of objects and voxels, not the looks of a bag; accuracy is measured
on the simulator's bags.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

AIR = 20
"""Density between the objects; with noise it stays below 100."""


@dataclass(frozen=True, eq=False)
class Packing:
    """A packed volume.

    Parameters
    ----------
    volume, labels : (Z, Y, X) ndarray of uint16
        Density and IDs.
    count : int
        Objects.
    """

    volume: NDArray[np.uint16]
    labels: NDArray[np.uint16]
    count: int


def pack(shape: tuple[int, int, int], cells: tuple[int, int, int], seed: int = 0) -> Packing:
    """Fill a volume with one object a cell, about 36 % of the voxels, neighbours touching.

    Parameters
    ----------
    shape : (int, int, int)
        Voxels.
    cells : (int, int, int)
        Objects along each axis.
    seed : int
        For shapes, densities and noise.

    Returns
    -------
    Packing
    """
    rng = np.random.default_rng(seed)
    labels = np.zeros(shape, np.uint16)
    density = np.full(int(np.prod(cells)) + 1, AIR, np.float32)
    for number, cell in enumerate(np.ndindex(*cells), start=1):
        low = [i * n // c for i, n, c in zip(cell, shape, cells, strict=True)]
        high = [(i + 1) * n // c for i, n, c in zip(cell, shape, cells, strict=True)]
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        labels[box][_shape(number, [b - a for a, b in zip(low, high, strict=True)], rng)] = number
        density[number] = rng.uniform(700, 2400)
    noise = rng.standard_normal(2**20, dtype=np.float32) * 12
    volume = density[labels]
    volume += np.resize(noise, shape)
    return Packing(np.clip(volume, 0, 4000).astype(np.uint16), labels, int(np.prod(cells)))


def _shape(number: int, size: list[int], rng: Any) -> NDArray[np.bool_]:
    axes = [np.linspace(-1, 1, n, dtype=np.float32) for n in size]
    z, y, x = np.meshgrid(*axes, indexing="ij", sparse=True)
    kind = number % 3
    if kind == 0:
        mask = z**2 + y**2 + x**2 <= 1
    elif kind == 1:
        mask = (z**2 + y**2 <= 0.75) & (abs(x) <= rng.uniform(0.6, 0.95))
    else:
        a, b, c = rng.uniform(0.55, 0.75, 3)
        mask = (abs(z) <= a) & (abs(y) <= b) & (abs(x) <= c)
    return np.asarray(mask)
