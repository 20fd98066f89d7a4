"""What the rays of a picture meet, from end to end, as runs (tallies.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.raycasting.bricks import Bricks
from napari_unpack.raycasting.entering import enter_tile
from napari_unpack.raycasting.lattice import (
    TILE,
    clipping_planes,
    octant_of,
    per_voxel,
    ray_numbers,
    ray_of,
)
from napari_unpack.raycasting.packets import (
    AX,
    AY,
    AZ,
    BRICK,
    COUNT,
    CURRENT,
    DX,
    DY,
    DZ,
    END,
    ENDS,
    EVENT,
    FLOAT_ROWS,
    FOUND,
    FREE,
    GRID,
    INTEGER_ROWS,
    LANES,
    LENGTH,
    LOOK,
    PX,
    PY,
    PZ,
    SEVERAL,
    TURNS,
    K,
    go_on,
    look_ahead,
    looks_of,
    stretch,
)
from napari_unpack.raycasting.sampled_bits import eight_bits, ones_of
from napari_unpack.raycasting.tallies import ABOVE, LONGEST
from napari_unpack.raycasting.walking import AHEAD, ground, read_labels, read_packed

UNKNOWN = np.int32(-(2**31))
"""The look of rays without bricks: labels have to be read."""

ROOM = 1 << 18
"""Runs that are kept, at least, before they are handed over."""

Scratch = tuple[NDArray[np.uint32], NDArray[np.uint32]]


@dataclass(frozen=True, eq=False)
class Tracing:
    """The casting of one picture, a band at a time; threads share it.

    Parameters
    ----------
    over : tuple
        What `_trace` takes before the band.
    width : int
        Of the picture, pixels.
    most : int
        No ray has more samples.
    """

    over: tuple[Any, ...]
    width: int
    most: int

    @classmethod
    def of(
        cls,
        labels: NDArray[np.uint16],
        rays: Rays,
        visible: NDArray[np.bool_],
        bricks: Bricks | None = None,
    ) -> Tracing:
        """Prepare to cast; see `occlusion_counts`."""
        _, owners, reach, octants, axis, *voxels = ground(labels, bricks, visible, rays)
        looks, pairs = np.zeros(0, np.int32), np.zeros(0, np.uint32)
        if bricks is not None:
            packed = bricks.packed(labels)
            looks = looks_of(owners, reach, packed.number).reshape(-1)
            both = bricks.starts[packed.pairs]
            names = np.stack([bricks.ids[both], bricks.ids[both + 1]]).astype(np.uint32)
            names[~visible[names]] = 0
            pairs = names[0] | (names[1] << ABOVE)
        over = (
            labels, looks, *owners.shape[1:], octants * owners.size, axis, *voxels, pairs,
            *ray_numbers(rays), clipping_planes(None), visible,
        )  # fmt: skip
        return cls(over, rays.size[1], longest_ray(rays, labels.shape))

    def scratch(self) -> Scratch:
        """Make what one thread writes to: runs of whole rays, and those of the rays under way."""
        # A tile more than has to fit, so that few parts are handed over.
        room = max(2 * TILE * TILE * (self.most + 1), ROOM)
        return np.empty(room, np.uint32), np.empty((LANES, self.most + 1), np.uint32)

    def runs(self, first: int, last: int, scratch: Scratch) -> Iterator[NDArray[np.uint32]]:
        """Cast a band of at most TILE rows.

        Yields
        ------
        (n,) ndarray of uint32
            Some rays' runs, as in `Runs`, until the next are asked for.
        """
        column = 0
        while column < self.width:
            column, used = _trace(  # type: ignore[call-arg]
                *self.over, first, last, column, self.width, *scratch
            )
            yield scratch[0][:used]


def longest_ray(rays: Rays, shape: tuple[int, ...]) -> int:
    """Return a number of samples that no ray has more of in a volume.

    Notes
    -----
    t is affine in the voxel, in perspective too: alike all over a plane, 1 mm more a direction.
    """
    across = np.stack([rays.table[3], rays.table[1], rays.table[2]])
    slope = np.linalg.solve(across, [1.0, 0.0, 0.0])
    return int(np.abs(slope) @ shape / rays.step) + 4


@njit(cache=True, nogil=True, error_model="numpy")
def _trace(  # type: ignore[no-untyped-def]
    labels, looks, rows, columns, octants, axis, starts, ids, words, firsts, bits, pairs,
    table, step, near, planes, visible, first, last, column, width, out, runs,
):  # fmt: skip
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    skip = looks.size > 0
    flat, (_, high, wide) = labels.reshape(-1), labels.shape
    ahead, mixed = np.zeros(AHEAD, np.int64), np.zeros(LANES + 1, np.uint64)
    f, n = np.zeros(FLOAT_ROWS * LANES), np.zeros(INTEGER_ROWS * LANES, np.int32)
    number = np.zeros(LANES, np.int64)
    for lane in range(LANES):
        n[CURRENT + lane] = -1
    queue = np.zeros(((last - first) * TILE, 4), np.int64)
    used = 0
    while column < width and used + len(queue) * runs.shape[1] <= out.size:
        right = min(column + TILE, width)
        waiting = enter_tile(box, planes, table, step, near, first, last, column, right, queue)
        column = right
        begun = min(waiting, LANES)
        walking = begun
        for lane in range(begun):
            _begin(queue, lane, lane, table, step, octants, f, n, number)
        while walking > 0:
            if skip:
                look_ahead(looks, rows, columns, axis, step, f, n)
            else:
                for lane in range(LANES):
                    n[LOOK + lane], f[FREE + lane] = UNKNOWN, f[END + lane]
            stretch(f, n)
            # Where a brick is mixed, two objects in it are told apart sample by sample.
            many = np.uint64(0)
            for lane in range(LANES):
                mixed[many] = lane
                many += np.uint64((n[LOOK + lane] < 0) & (n[COUNT + lane] > 0))
            for j in range(many):
                lane = mixed[j]
                brick = np.uint64(~n[np.uint64(LOOK) + lane])
                if brick >= pairs.size:
                    n[np.uint64(FOUND) + lane] = SEVERAL
                    continue
                place = brick << np.uint64(3)
                mask = _eight(words, place, f, lane, 0.0, step)
                count = n[np.uint64(COUNT) + lane]
                if count > 8:
                    mask |= _eight(words, place, f, lane, 8.0, step) << np.uint64(8)
                mask &= (np.uint64(1) << np.uint64(count)) - np.uint64(1)
                ones = np.int32(ones_of(mask))
                pair = pairs[brick]
                none, one = np.int32(pair & np.uint32(0xFFFF)), np.int32(pair >> np.uint32(16))
                n[np.uint64(FOUND) + lane] = SEVERAL if (none != 0) & (one != 0) else none + one
                rest = ones if none == 0 else count - ones
                n[np.uint64(COUNT) + lane] = count if (none != 0) & (one != 0) else rest
            go_on(f, n)
            for lane in range(LANES):
                event = n[EVENT + lane]
                if event == 0:
                    continue
                if event & TURNS and n[FOUND + lane] != SEVERAL:
                    _turn(runs, lane, n, number, n[FOUND + lane], n[COUNT + lane])
                elif event & TURNS:
                    stop = int(f[K + lane])
                    k = stop - n[COUNT + lane]
                    pz, py, px = f[PZ + lane], f[PY + lane], f[PX + lane]
                    dz, dy, dx = f[DZ + lane], f[DY + lane], f[DX + lane]
                    if skip:
                        b = np.uint64(n[BRICK + lane])
                        place, start = np.uint64(firsts[b]), np.uint64(starts[b])
                        read_packed(
                            words, place, np.int64(bits[b]), ids, start,
                            k, stop, step, pz, py, px, dz, dy, dx, ahead,
                        )  # fmt: skip
                    else:
                        read_labels(flat, high, wide, k, stop, step, pz, py, px, dz, dy, dx, ahead)
                    for i in range(stop - k):
                        found = ahead[i]
                        if not visible[found]:
                            continue
                        if found == n[CURRENT + lane]:
                            n[LENGTH + lane] += 1
                        else:
                            _turn(runs, lane, n, number, found, 1)
                if event & ENDS:
                    _turn(runs, lane, n, number, 0, 0)
                    if number[lane] > 0:
                        for i in range(number[lane]):
                            out[used + i] = runs[lane, i]
                        used += number[lane]
                        out[used] = 0
                        used += 1
                    if begun < waiting:
                        _begin(queue, begun, lane, table, step, octants, f, n, number)
                        begun += 1
                    else:
                        # It goes on being looked at: let it stand inside.
                        f[K + lane] -= 1.0
                        f[END + lane] = f[K + lane]
                        n[CURRENT + lane] = -1
                        walking -= 1
    return column, used


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _begin(queue, i, lane, table, step, octants, f, n, number):  # type: ignore[no-untyped-def]
    """Have a lane walk the ray that is next in the queue."""
    pz, py, px, dz, dy, dx = ray_of(table, queue[i, 0], queue[i, 1])
    az, ay, ax = per_voxel(dz, step), per_voxel(dy, step), per_voxel(dx, step)
    f[PZ + lane], f[PY + lane], f[PX + lane] = pz, py, px
    f[DZ + lane], f[DY + lane], f[DX + lane] = dz, dy, dx
    f[AZ + lane], f[AY + lane], f[AX + lane] = az, ay, ax
    f[K + lane], f[END + lane] = queue[i, 2], queue[i, 3]
    n[GRID + lane] = octants[octant_of(az, ay, ax)]
    n[CURRENT + lane] = n[LENGTH + lane] = number[lane] = 0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turn(runs, lane, n, number, found, count):  # type: ignore[no-untyped-def]
    """Write down the run that is over and begin another object's."""
    rest, i = n[LENGTH + lane], number[lane]
    while rest > 0:
        part = min(rest, LONGEST)
        runs[lane, i] = (np.uint32(n[CURRENT + lane]) << ABOVE) | np.uint32(part)
        rest -= part
        i += 1
    number[lane] = i
    n[CURRENT + lane], n[LENGTH + lane] = found, count


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _eight(words, place, f, lane, more, step):  # type: ignore[no-untyped-def]
    # Indices without a sign: numba does not ask whether they count from the end.
    pz, py, px = np.uint64(PZ) + lane, np.uint64(PY) + lane, np.uint64(PX) + lane
    dz, dy, dx = np.uint64(DZ) + lane, np.uint64(DY) + lane, np.uint64(DX) + lane
    k = f[np.uint64(K) + lane] + more
    return eight_bits(words, place, k, step, f[pz], f[py], f[px], f[dz], f[dy], f[dx])
