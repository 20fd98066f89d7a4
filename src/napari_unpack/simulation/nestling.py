"""The last move of a thing that has come to rest: against its neighbours, and down again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from napari_unpack.kernels import njit
from napari_unpack.simulation.stacking import Rest, Stack

WALL = 65535
"""The label of what is not room: the last of uint16, which no bag of 2000 objects reaches."""

REACH = 7
"""Voxels that a thing is pushed at most: further off it has no neighbour to lean on."""

ROUNDS = 4
"""Pushes at most: two neighbours could push a thing to and fro for ever."""


def walled(labels: NDArray[np.uint16], room: Stack) -> None:
    """Mark what is not room as `WALL`, in place.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Changed.
    room : Stack
        The room of an empty bag.
    """
    rows = np.arange(labels.shape[1])[None, :, None]
    height, ceiling = room.height[:, None, :], room.ceiling[:, None, :]
    labels[(rows >= height) | (rows < ceiling)] = WALL


def surface(inside: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the voxels of a thing that have a neighbour outside it, (N, 3) int32."""
    # Only the skin can meet anything, and it is a small part of the voxels.
    return np.argwhere(inside & ~binary_erosion(inside)).astype(np.int32)


def nestle(labels: NDArray[np.uint16], skin: NDArray[np.int32], rest: Rest) -> Rest:
    """Push a thing sideways against the nearest others, letting it fall after every push.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        What is taken, without the thing.
    skin : (N, 3) ndarray of int32
        The surface of the thing, voxels of its box.
    rest : Rest
        Where it lies.
    """
    z, y, x = rest.z, rest.y, rest.x
    for _ in range(ROUNDS):
        # Down before sideways: a thing that hangs would lean on what it later falls below.
        y = _fall(labels, skin, z, y, x)
        free = _gaps(labels, skin, z, y, x)
        # Gaps of 0 touch already; REACH means no neighbour, and the bag's wall is none to lean on.
        ways = [(steps, way) for way, steps in enumerate(free) if 0 < steps < REACH]
        if not ways:
            break
        steps, way = min(ways)
        z += int(steps) * (0, 0, 1, -1)[way]
        x += int(steps) * (1, -1, 0, 0)[way]
    return replace(rest, z=z, y=_fall(labels, skin, z, y, x), x=x)


@njit(cache=True, nogil=True)
def _met(labels, skin, z, y, x):  # type: ignore[no-untyped-def]
    # 0 where it is free, 1 where it meets a wall first, 2 where another thing.
    for n in range(skin.shape[0]):
        a, b, c = z + skin[n, 0], y + skin[n, 1], x + skin[n, 2]
        if a < 0 or b < 0 or c < 0:
            return 1
        if a >= labels.shape[0] or b >= labels.shape[1] or c >= labels.shape[2]:
            return 1
        # Only things attract: pushed against the shell, all would crowd at the rim.
        if labels[a, b, c]:
            return 1 if labels[a, b, c] == WALL else 2
    return 0


@njit(cache=True, nogil=True)
def _fall(labels, skin, z, y, x):  # type: ignore[no-untyped-def]
    while _met(labels, skin, z, y + 1, x) == 0:
        y += 1
    return y


@njit(cache=True, nogil=True)
def _gaps(labels, skin, z, y, x):  # type: ignore[no-untyped-def]
    # Free steps along +x, -x, +z, -z to another thing; REACH where there is none so near.
    found = np.full(4, REACH)
    for way in range(4):
        dz = (0, 0, 1, -1)[way]
        dx = (1, -1, 0, 0)[way]
        for step in range(1, REACH + 1):
            met = _met(labels, skin, z + step * dz, y, x + step * dx)
            if met:
                if met == 2:
                    found[way] = step - 1
                break
    return found
