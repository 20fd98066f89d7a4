"""Sweep test: move an object's voxels along a direction and find the objects they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.occlusion_counts import MOST_IN_TABLE
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Bricks, strides
from napari_unpack.rendering.cpu.ray_sampling import BRICK
from napari_unpack.rendering.cpu.thread_pool import over_bands

# Positions tested per voxel edge on the way: rounded to voxels, none is passed over.
STEPS = 4


def sweep_blockers(
    labels: NDArray[np.uint16],
    spacing: ArrayLike,
    direction: ArrayLike,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
    moved: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Find out who stands in whose way when objects are moved along D as they are.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    spacing : (3,) array_like, mm z y x
    direction : (3,) array_like
        D in world, z y x; of any length.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False. Hidden objects are as air.
    bricks : Bricks, optional
        Of these labels; saves looking at what is uniform, changes nothing.
    moved : (M,) ndarray of bool, optional
        Which of the visible objects to pull; by default all. The columns of others stay empty.

    Returns
    -------
    (ids, blocks) or None
        The visible IDs, ascending, and (n, n) bool, row blocks column. None above 4096.

    Notes
    -----
    An object is moved by D s, rounded to whole voxels, for s in quarters of a voxel edge, and
    compared with what is there: its voxels stay voxels. Rays at the voxel pitch ask nearly the
    same and much faster, but off the axes they also cut the corners of voxels, and two things
    that merely touch hold each other by the steps of their surfaces (docs/paper.md, R1, R3).

    Only voxels are moved from which one of the steps leaves the object. Who is met for the
    first time at some shift is met by such a voxel: had an inner one met it, the neighbour a
    step on, which is of the object too, would have met it one shift earlier. Cost: those voxels
    times the way.
    """
    if np.count_nonzero(visible) > MOST_IN_TABLE:
        return None
    sweep = SweepTest.of(labels, spacing, direction, visible, bricks)
    moving = visible if moved is None else visible & moved
    columns = np.where(moving, sweep.rows, -1).astype(np.int32)
    blocks = np.zeros((len(sweep.ids), len(sweep.ids)), np.bool_)

    def work(_: None, first: int, last: int) -> None:
        # Threads share `blocks`: all they ever write to it is True.
        sweep.into(blocks, columns, (slice(first, last), slice(None), slice(None)))

    over_bands(labels.shape[0], work, lambda: None)
    return sweep.ids, blocks


@dataclass(frozen=True, eq=False)
class SweepTest:
    """What moving objects along one direction takes, made once for all of them.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    ids : (n,) ndarray of int64
        The visible IDs, ascending.
    rows : (M,) ndarray of int32
        By ID, its place in `ids`; -1 for what is not visible.
    shifts, steps : (k, 3), (m, 3) ndarray of int64
        Whole-voxel shifts on the way out, and the different steps between them.
    owners, distance : (Bz, By, Bx) ndarray of int32 and uint8
        See `Bricks.owners` and `strides`; empty where every voxel is looked at.
    """

    labels: NDArray[np.uint16]
    ids: NDArray[np.int64]
    rows: NDArray[np.int32]
    shifts: NDArray[np.int64]
    steps: NDArray[np.int64]
    owners: NDArray[np.int32]
    distance: NDArray[np.uint8]

    @classmethod
    def of(
        cls,
        labels: NDArray[np.uint16],
        spacing: ArrayLike,
        direction: ArrayLike,
        visible: NDArray[np.bool_],
        bricks: Bricks | None = None,
    ) -> SweepTest:
        """Make ready; arguments as for `sweep_blockers`.

        Parameters
        ----------
        labels, spacing, direction, visible, bricks
            As for `sweep_blockers`.
        """
        ids = np.flatnonzero(visible)
        rows = np.full(len(visible), -1, np.int32)
        rows[ids] = np.arange(len(ids))
        way = np.asarray(direction, float) / np.asarray(spacing, float)
        shifts = whole_shifts(way, labels.shape)
        steps = np.unique(np.diff(shifts, axis=0, prepend=np.zeros((1, 3), np.int64)), axis=0)
        owners, distance = np.zeros((0, 0, 0), np.int32), np.zeros((0, 0, 0), np.uint8)
        if bricks is not None:
            owners = bricks.owners(visible)
            distance = strides(owners, (shifts[-1] >= 0).tolist())
        return cls(labels, ids, rows, shifts, steps, owners, distance)

    def blockers(self, object_id: int, box: tuple[slice, ...], most: int) -> frozenset[int]:
        """Move one object and return whom it meets.

        Parameters
        ----------
        object_id : int
            A visible one.
        box : (3,) tuple of slice
            Where its voxels are.
        most : int
            Found more than so many, it looks no further: the answer then holds more than
            `most`, and not all.
        """
        blocks = np.zeros((len(self.ids), 1), np.bool_)
        columns = np.full(len(self.rows), -1, np.int32)
        columns[object_id] = 0
        start = box[0].start

        def work(_: None, first: int, last: int) -> None:
            if np.count_nonzero(blocks) <= most:
                part = slice(start + first, start + last)
                self.into(blocks, columns, (part, *box[1:]), most)

        over_bands(box[0].stop - start, work, lambda: None)
        return frozenset(int(i) for i in self.ids[blocks[:, 0]])

    def into(
        self,
        blocks: NDArray[np.bool_],
        columns: NDArray[np.int32],
        box: tuple[slice, ...],
        most: int = MOST_IN_TABLE**2,
    ) -> None:
        """Move what lies in a box and write down who is met.

        Parameters
        ----------
        blocks : (n, m) ndarray of bool
            Row blocks column; written to.
        columns : (M,) ndarray of int32
            By ID, the column of who is to be moved; -1 for others.
        box : (3,) tuple of slice
            Of voxels.
        most : int
            After so many new entries it stops.
        """
        parts = zip(box, self.labels.shape, strict=True)
        (z0, z1, _), (y0, y1, _), (x0, x1, _) = (part.indices(n) for part, n in parts)
        _sweep(
            self.labels, self.rows, columns, self.shifts, self.steps, np.sign(self.shifts[-1]),
            self.owners, self.distance, (z0, y0, x0), (z1, y1, x1), most, blocks,
        )  # fmt: skip


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
def _sweep(  # type: ignore[no-untyped-def]
    labels, rows, columns, shifts, steps, signs, owners, distance, lower, upper, most, blocks
):
    depth, height, width = labels.shape
    skip = distance.size > 0
    found = 0
    for z in range(lower[0], upper[0]):
        for y in range(lower[1], upper[1]):
            for x in range(lower[2], upper[2]):
                label = labels[z, y, x]
                mine = columns[label]
                if mine < 0:
                    continue
                # Only voxels on the outside towards one of the steps can be the first to meet
                # another object; see `sweep_blockers`.
                outer = False
                for k in range(steps.shape[0]):
                    a, b, c = z + steps[k, 0], y + steps[k, 1], x + steps[k, 2]
                    inside = 0 <= a < depth and 0 <= b < height and 0 <= c < width
                    if not inside or labels[a, b, c] != label:
                        outer = True
                        break
                if not outer:
                    continue
                # Follow the voxel out of the volume, and note each object it comes to.
                met = label
                k = 0
                while k < shifts.shape[0]:
                    a, b, c = z + shifts[k, 0], y + shifts[k, 1], x + shifts[k, 2]
                    # Outside the volume it meets nothing more: the volume is convex.
                    if not (0 <= a < depth and 0 <= b < height and 0 <= c < width):
                        break
                    k += 1
                    # Uniform bricks are crossed at once.
                    away = distance[a // BRICK, b // BRICK, c // BRICK] if skip else 0
                    if away > 0:
                        # No shift is more than a voxel beyond the one before it.
                        there = owners[a // BRICK, b // BRICK, c // BRICK]
                        k += _room(a, b, c, away, signs)
                    else:
                        there = labels[a, b, c]
                    if there != met:
                        met = there
                        if there != label and rows[there] >= 0 and not blocks[rows[there], mine]:
                            blocks[rows[there], mine] = True
                            found += 1
                            if found > most:
                                return


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
