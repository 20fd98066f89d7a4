"""Pulling every object out of the label volume along a direction: whom it meets on the way."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from napari_unpack.raycasting.bricks import Bricks, strides
from napari_unpack.raycasting.lattice import BRICK
from napari_unpack.raycasting.threads import over_bands

MOST_IN_TABLE = 4096
STEPS = 4
"""Looks per voxel edge on the way."""


def met_when_pulled(
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    direction: ArrayLike,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
    pulled: NDArray[np.bool_] | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Find out who stands in whose way when objects are moved along D as they are.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    spacing : (3,) array_like
        Voxel size in mm, z y x.
    direction : (3,) array_like
        D in world, z y x; of any length.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False. Hidden objects are as air.
    bricks : Bricks, optional
        Of these labels; saves looking at what is uniform, changes nothing.
    pulled : (M,) ndarray of bool, optional
        Which of the visible objects to pull; by default all. The columns of others stay empty.
    threads : int, optional
        Workers, by default one a core.

    Returns
    -------
    (ids, blocks) or None
        The visible IDs, ascending, and (n, n) bool, row blocks column. None above 4096.

    Notes
    -----
    An object is moved by D s, rounded to whole voxels, for s in quarters of a voxel edge, and
    compared with what is there: its voxels stay voxels. Rays at the voxel pitch ask nearly the
    same and much faster, but off the axes they also cut the corners of voxels, and two things
    that merely touch hold each other by the steps of their surfaces (notes: readings 1, 3).

    Only voxels are moved from which one of the steps leaves the object. Who is met for the
    first time at some shift is met by such a voxel: had an inner one met it, the neighbour a
    step on, which is of the object too, would have met it one shift earlier. Cost: those voxels
    times the way.
    """
    ids = np.flatnonzero(visible)
    if len(ids) > MOST_IN_TABLE:
        return None
    slots = np.full(len(visible), -1, np.int32)
    slots[ids] = np.arange(len(ids))
    shifts = whole_shifts(np.asarray(direction, float) / np.asarray(spacing, float), labels.shape)
    steps = np.unique(np.diff(shifts, axis=0, prepend=np.zeros((1, 3), np.int64)), axis=0)
    blocks = np.zeros((len(ids), len(ids)), np.bool_)
    moving = visible if pulled is None else visible & pulled
    owners, distance = np.zeros((0, 0, 0), np.int32), np.zeros((0, 0, 0), np.uint8)
    if bricks is not None:
        owners = bricks.owners(visible)
        distance = strides(owners, (shifts[-1] >= 0).tolist())
    signs = np.sign(shifts[-1])

    def work(_: None, first: int, last: int) -> None:
        # Threads share `blocks`: all they ever write to it is True.
        _pull(labels, slots, moving, shifts, steps, signs, owners, distance, first, last, blocks)

    over_bands(labels.shape[0], work, lambda: None, threads)
    return ids, blocks


def whole_shifts(way: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the (n, 3) whole-voxel shifts on the way out of a volume, nearest first.

    Parameters
    ----------
    way : (3,) ndarray of float64
        D in voxels, of any length.
    shape : (3,) tuple of int
        Of the volume; shifts end where nothing of it can be left inside.
    """
    step = way / (STEPS * np.linalg.norm(way))
    used = np.abs(step) > 1e-12
    count = int(np.ceil(np.min(np.asarray(shape)[used] / np.abs(step[used])))) + 1
    shifts = np.rint(np.arange(1, count + 1)[:, None] * step).astype(np.int64)
    fresh = np.any(np.diff(shifts, axis=0, prepend=np.zeros((1, 3), np.int64)) != 0, axis=1)
    moved: NDArray[np.int64] = shifts[fresh]
    return moved


@njit(cache=True, nogil=True)
def _pull(  # type: ignore[no-untyped-def]
    labels, slots, moving, shifts, steps, signs, owners, distance, first, last, blocks
):
    depth, height, width = labels.shape
    skip = distance.size > 0
    for z in range(first, last):
        for y in range(height):
            for x in range(width):
                label = labels[z, y, x]
                mine = slots[label]
                if mine < 0 or not moving[label]:
                    continue
                outer = False
                for k in range(steps.shape[0]):
                    a, b, c = z + steps[k, 0], y + steps[k, 1], x + steps[k, 2]
                    inside = 0 <= a < depth and 0 <= b < height and 0 <= c < width
                    if not inside or labels[a, b, c] != label:
                        outer = True
                        break
                if not outer:
                    continue
                met = label
                k = 0
                while k < shifts.shape[0]:
                    a, b, c = z + shifts[k, 0], y + shifts[k, 1], x + shifts[k, 2]
                    if not (0 <= a < depth and 0 <= b < height and 0 <= c < width):
                        break
                    k += 1
                    away = distance[a // BRICK, b // BRICK, c // BRICK] if skip else 0
                    if away > 0:
                        # No shift is more than a voxel beyond the one before it.
                        there = owners[a // BRICK, b // BRICK, c // BRICK]
                        k += _room(a, b, c, away, signs)
                    else:
                        there = labels[a, b, c]
                    if there != met:
                        met = there
                        if there != label and slots[there] >= 0:
                            blocks[slots[there], mine] = True


@njit(cache=True, nogil=True, inline="always")
def _room(z, y, x, away, signs):  # type: ignore[no-untyped-def]
    """Return how many voxels one can go on and stay among bricks of one owner."""
    room = 1 << 30
    for axis, at in enumerate((z, y, x)):
        brick = at // BRICK
        if signs[axis] > 0:
            room = min(room, (brick + away) * BRICK - 1 - at)
        elif signs[axis] < 0:
            room = min(room, at - (brick - away + 1) * BRICK)
    return room
