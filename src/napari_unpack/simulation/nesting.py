"""Separate things inside a container."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.blueprint import Blueprint, Builder
from napari_unpack.simulation.catalogue import BUILDERS
from napari_unpack.simulation.stacking import BLOCKED, Stack

KEPT_IN_CARTONS = (
    ("duck", 0.5),
    ("soap", 0.5),
    ("candle", 0.75),
    ("cable", 0.55),
    ("toy car", 0.62),
    ("ball", 0.45),
    ("torch", 0.75),
    ("top", 0.5),
    ("tin", 0.42),
)
"""Kinds, with their length as a share of the room's."""


@dataclass(frozen=True)
class Content:
    """A thing to be put into a container.

    Parameters
    ----------
    build : callable
        Models it, see `Kind`.
    length : float
        Longest extent, mm.
    seed : int
        Of its own generator, so that a smaller try is the same thing.
    """

    build: Builder
    length: float
    seed: int

    def model(self, share: float, wall: float) -> Blueprint:
        """Model it at a share of its length.

        Parameters
        ----------
        share : float
            Of the planned length.
        wall : float
            The thinnest wall that is resolved, mm.
        """
        return self.build(np.random.default_rng(self.seed), self.length * share, wall)


def contents(rng: np.random.Generator, container: Blueprint, count: int) -> list[Content]:
    """Choose what a container holds: coins in a pouch, small things in a carton.

    Parameters
    ----------
    rng : numpy.random.Generator
    container : Blueprint
        With room.
    count : int
        How many things.
    """
    if container.room is None:
        return []
    hz, hy, hx = container.room
    if container.kind == "pouch":
        # Less than half as wide as the pouch, so that several lie flat beside each other.
        lengths = min(0.9 * hz, 0.55 * hx) * rng.uniform(0.85, 1.0, count)
        builders = [BUILDERS["coin"]] * count
    else:
        chosen = rng.choice(len(KEPT_IN_CARTONS), size=count, replace=count > len(KEPT_IN_CARTONS))
        # Beyond two or three things, the cube root of the crowd shrinks each, so that all fit.
        crowd = min(1.0, (2.5 / count) ** (1 / 3))
        lengths = np.array([KEPT_IN_CARTONS[i][1] for i in chosen]) * 2 * hx * crowd
        # Things up to 0.6 as high as long fit under the lid, which is 2 hy high.
        lengths = np.minimum(lengths, 3.2 * hy)
        builders = [BUILDERS[KEPT_IN_CARTONS[i][0]] for i in chosen]
    return [
        Content(build, float(length), int(rng.integers(2**62)))
        for build, length in zip(builders, lengths, strict=True)
    ]


def room_of(
    container: Blueprint,
    rotation: NDArray[np.float64],
    shape: tuple[int, ...],
    middle: NDArray[np.float64],
    spacing: NDArray[np.float64],
) -> Stack:
    """Return the empty room inside a container's own box of voxels.

    Parameters
    ----------
    container : Blueprint
        With room.
    rotation : (3, 3) ndarray
        World from object, by quarters.
    shape : (Z, Y, X)
        Of the box.
    middle : (3,) ndarray
        Voxel of the object's origin.
    spacing : (3,) ndarray, mm z y x
    """
    half = np.abs(rotation) @ np.array(container.room) / spacing
    # Whole voxels inside the room, or antialiased edges of both would meet.
    low = np.ceil(middle - half).astype(int) + 1
    high = np.floor(middle + half).astype(int)
    height = np.full((shape[0], shape[2]), BLOCKED, np.int32)
    height[low[0] : high[0], low[2] : high[2]] = high[1]
    return Stack(height, np.full_like(height, max(low[1], 0)))
