"""Deciding what a traveller packs, and how large each thing is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.catalogue import KINDS, Kind
from napari_unpack.simulation.rasterizing import silhouette
from napari_unpack.simulation.stacking import BLOCKED

AGAIN = 0.25
"""How much less often a kind is met once it is in the bag."""

FILLED = 0.40
"""Share of the bag's volume that things should take together."""

CLOTH_SOLIDITY = 0.045
"""Volume of a garment, as a share of the cube of its length."""


@dataclass(frozen=True)
class Order:
    """A thing to pack.

    Parameters
    ----------
    kind : Kind
        What it is.
    seed : int
        Of its own generator: the same seed builds the same thing at any length.
    length : float
        Longest extent, mm.
    inside : int
        How many separate things it holds.
    """

    kind: Kind
    seed: int
    length: float
    inside: int = 0


def plan(
    rng: np.random.Generator, count: int, shape: tuple[int, int, int], spacing: NDArray[np.float64]
) -> list[Order]:
    """Choose `count` things, contents of containers included, sized to fill a bag.

    Parameters
    ----------
    rng : numpy.random.Generator
        Chooses.
    count : int
        How many objects.
    shape : (int, int, int)
        Of the bag, voxels.
    spacing : (3,) ndarray of float64
        Voxel size, mm.

    Returns
    -------
    list of Order
        In the order of packing: large before small, with clothes between.
    """
    extent = float(np.max(np.array(shape) * spacing))
    orders = _choose(rng, count, extent)
    volumes = np.array([_volume(order) for order in orders])
    wanted = FILLED * float(np.prod(np.array(shape) * spacing))
    scale = float(np.clip((wanted / volumes.sum()) ** (1 / 3), 0.1, 1.35))
    longest = 0.64 * extent
    sized = [replace(o, length=min(o.length * scale, longest)) for o in orders]
    haste = volumes * np.exp(rng.normal(0.0, 0.6, len(orders)))
    return [sized[i] for i in np.argsort(-haste)]


def _choose(rng: np.random.Generator, count: int, extent: float) -> list[Order]:
    often = np.array([kind.often for kind in KINDS])
    orders: list[Order] = []
    left = count
    while left > 0:
        index = int(rng.choice(len(KINDS), p=often / often.sum()))
        often[index] *= AGAIN
        kind = KINDS[index]
        inside = 0
        if kind.name == "carton" and left > 3:
            inside = int(rng.integers(1, 4))
        if kind.name == "pouch" and left > 4:
            inside = int(rng.integers(2, 5))
        seed = int(rng.integers(2**62))
        orders.append(Order(kind, seed, extent * rng.uniform(*kind.lengths), inside))
        left -= 1 + inside
    return orders


def _volume(order: Order) -> float:
    # Cubic mm, the hollows of its columns included, seen at a thirtieth of the length.
    if order.kind.build is None:
        return CLOTH_SOLIDITY * order.length**3
    step = order.length / 30
    thing = order.kind.build(np.random.default_rng(order.seed), order.length, 0.3 * step)
    cube = np.full(3, step)
    profile = silhouette(thing.program, thing.lower, thing.upper, np.eye(3), cube, 1)
    deep = (profile.under - profile.over)[profile.under > BLOCKED]
    return float(deep.sum()) * step**3
