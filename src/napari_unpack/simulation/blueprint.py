"""A modelled object before it is packed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.clay import Clay, turned

Rotation = NDArray[np.float64]

FLAT = np.eye(3)
SIDE = turned("x", 90.0)
BACK = turned("x", 180.0)
UPRIGHT = turned("z", 90.0)
HEAD_DOWN = turned("z", -90.0)


@dataclass(frozen=True, eq=False)
class Blueprint:
    """What an object is, and how it may lie.

    Parameters
    ----------
    kind, name, material : str
        For the table of objects; the material is the one it mostly is.
    program : (N, ROW) ndarray of float64
        How it is painted, see `Clay`.
    lower, upper : (3,) ndarray of float64
        Its box in its own frame, mm, z y x.
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
    program: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    rests: tuple[Rotation, ...] = (FLAT,)
    square: bool = False
    room: tuple[float, float, float] | None = None


def blueprint(
    kind: str,
    name: str,
    material: str,
    clay: Clay,
    rests: tuple[Rotation, ...] = (FLAT,),
    square: bool = False,
    room: tuple[float, float, float] | None = None,
) -> Blueprint:
    """Make a blueprint of what was modelled."""
    return Blueprint(
        kind, name, material, clay.program(), clay.lower, clay.upper, rests, square, room
    )
