"""Deciding what a traveller packs, and how large each thing is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.blueprint import Kind
from napari_unpack.simulation.catalogue import KINDS
from napari_unpack.simulation.rasterizing import silhouette
from napari_unpack.simulation.stacking import BLOCKED

AGAIN = 0.08
"""How much less often a kind is met once it is in the bag."""

FILLED = 0.62
"""Share of the bag's volume that things should take together."""

LONGEST = 0.64
"""Length of the largest things, as a share of the bag's extent."""

MOST_GROWN = 1.5
"""How much larger than usual things get where there are few."""

HOLDERS = ("carton", "pouch")
"""Kinds that hold separate things."""

EARLY_CLOTH = 2.0
"""How much larger clothes count in the order of packing: what lies on them lies well."""

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
    """Choose `count` things, contents included, to fill a bag; large first, clothes between.

    Parameters
    ----------
    rng : numpy.random.Generator
    count : int
        How many objects.
    shape : (int, int, int)
        Of the bag, voxels.
    spacing : (3,) ndarray of float64, mm z y x
    """
    extent = float(np.max(np.array(shape) * spacing))
    orders = _choose(rng, count, extent)
    # Sizes follow the bag, so that few things fill it as well as many.
    volumes = np.array([_volume(order) for order in orders])
    wanted = FILLED * float(np.prod(np.array(shape) * spacing))
    # Each thing's own limit, in shares of its length.
    limits = LONGEST * extent / np.array([order.length for order in orders])
    scale = _scale(volumes, limits, wanted)
    sized = [
        replace(order, length=order.length * min(scale, float(limit)))
        for order, limit in zip(orders, limits, strict=True)
    ]
    early = np.array([EARLY_CLOTH if order.kind.build is None else 1.0 for order in orders])
    # Large things first, but not strictly: a book may lie on top of socks.
    haste = early * volumes * np.exp(rng.normal(0.0, 0.45, len(orders)))
    return [sized[i] for i in np.argsort(-haste)]


def trifle(
    rng: np.random.Generator, shape: tuple[int, int, int], spacing: NDArray[np.float64]
) -> Order:
    """Return one more small thing, for where a container holds fewer than was planned.

    Parameters
    ----------
    rng : numpy.random.Generator
    shape, spacing : see `plan`
        Of the bag.
    """
    # Up to 0.34 of the bag: what is left is gaps, and a container would want contents again.
    small = [kind for kind in KINDS if kind.lengths[1] <= 0.34 and kind.name not in HOLDERS]
    kind = small[int(rng.integers(len(small)))]
    extent = float(np.max(np.array(shape) * spacing))
    length = 0.7 * extent * kind.lengths[0]
    return Order(kind, int(rng.integers(2**62)), length)


def _scale(volumes: NDArray[np.float64], limits: NDArray[np.float64], wanted: float) -> float:
    # Things grow together until they fill the bag or are as large as a thing may be.
    # Bisection: the volume grows with the scale, but not as its cube once limits are reached.
    low, high = 0.05, MOST_GROWN
    for _ in range(30):
        scale = (low + high) / 2
        if float((volumes * np.minimum(scale, limits) ** 3).sum()) < wanted:
            low = scale
        else:
            high = scale
    return low


def _choose(rng: np.random.Generator, count: int, extent: float) -> list[Order]:
    often = np.array([kind.often for kind in KINDS])
    orders: list[Order] = []
    left = count
    while left > 0:
        index = int(rng.choice(len(KINDS), p=often / often.sum()))
        often[index] *= AGAIN
        kind = KINDS[index]
        inside = 0
        # Only with enough left that the contents do not use up the count.
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
    # A thirtieth of the length is fine enough to share out the room, and takes milliseconds.
    step = order.length / 30
    thing = order.kind.build(np.random.default_rng(order.seed), order.length, 0.3 * step)
    cube = np.full(3, step)
    profile = silhouette(thing.clay, np.eye(3), cube, 1)
    deep = (profile.under - profile.over)[profile.under > BLOCKED]
    return float(deep.sum()) * step**3
