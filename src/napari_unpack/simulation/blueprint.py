"""A modelled object before it is packed, and the kind it is of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.clay import Clay, turned

Rotation = NDArray[np.float64]

FLAT = np.eye(3)
SIDE = turned("x", 90.0)
BACK = turned("x", 180.0)
UPRIGHT = turned("z", 90.0)


@dataclass(frozen=True, eq=False)
class Blueprint:
    """What an object is, and how it may lie.

    Parameters
    ----------
    kind, name, material : str
        For the table of objects; the material is the one it mostly is.
    clay : Clay
        Its shape and what it is painted with.
    rests : tuple of (3, 3) ndarray
        The ways it may lie (world from object), before it is turned about the vertical.
    square : bool
        Whether it is turned by quarters only.
    room : tuple of float, optional
        Half edges (mm) of the free box inside, for a container of separate things.
    """

    kind: str
    name: str
    material: str
    clay: Clay
    rests: tuple[Rotation, ...] = (FLAT,)
    square: bool = False
    room: tuple[float, float, float] | None = None


# Generator, longest extent and thinnest wall: a builder that drew from elsewhere could not be
# called again at a smaller size and give the same thing.
Builder = Callable[[np.random.Generator, float, float], Blueprint]


@dataclass(frozen=True)
class Kind:
    """A kind of object.

    Parameters
    ----------
    name : str
        As it stands in the table of objects.
    build : callable
        Models one from a random generator, its longest extent (mm) and the thinnest wall that
        the scanner resolves (mm). It lies along x, its face upwards (-y). None for cloth, which
        is draped.
    lengths : (float, float)
        Longest extent, as a share of the bag's.
    often : float
        How often it is met, against the others.
    """

    name: str
    build: Builder | None
    lengths: tuple[float, float]
    often: float
