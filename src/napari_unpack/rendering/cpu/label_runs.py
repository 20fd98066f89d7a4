"""Label runs: the objects along every ray with their lengths, and the counts made of them.

Casting is slow and counting is fast, and an object that leaves the bag becomes air. So the runs of
one cast along a direction give the occlusion counts of every later step of the unpacking.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.occlusion_counts import MOST_IN_TABLE, OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Bricks
from napari_unpack.rendering.cpu.object_ids import AHEAD, ground, read_compressed, read_labels
from napari_unpack.rendering.cpu.ray_sampling import (
    TILE,
    clipping_planes,
    enter_tile,
    octant_of,
    per_voxel,
    ray_numbers,
    ray_of,
)
from napari_unpack.rendering.cpu.simd import eight_bits, ones_of
from napari_unpack.rendering.cpu.thread_pool import over_bands

# isort: off
from napari_unpack.rendering.cpu.ray_packets import (
    AX, AY, AZ, BEYOND, BRICK, COUNT, CURRENT, DX, DY, DZ, END, ENDS, EVENT, FLOAT_ROWS, FOUND,
    GRID, INTEGER_ROWS, LANES, LENGTH, PX, PY, PZ, SEVERAL, SKIP, TURNS, K, go_on, look_ahead,
    looks_of, stretch,
)  # fmt: skip
# isort: on

# Samples of one run, at most; longer ones are written as several.
LONGEST = 0xFFFF
# Bits of a run below its object's ID.
ABOVE = np.uint32(16)

Counters = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class Runs:
    """The objects that every ray meets, in order.

    Parameters
    ----------
    parts : tuple of (n,) ndarray of uint32
        Of some rays each: a run is 65536 ID + samples, runs of more samples are several, and a
        ray ends with 0. What shows nothing is left out, rays that meet nothing too.
    rays : Rays
    visible : (M,) ndarray of bool
        By ID: who was visible.
    """

    parts: tuple[NDArray[np.uint32], ...]
    rays: Rays
    visible: NDArray[np.bool_]

    @property
    def nbytes(self) -> int:
        """Memory of the runs."""
        return sum(part.nbytes for part in self.parts)

    def serves(self, rays: Rays, visible: NDArray[np.bool_]) -> bool:
        """Tell whether these rays were cast, and no object is visible who was not.

        Parameters
        ----------
        rays : Rays
        visible : (M,) ndarray of bool
            By ID.
        """
        mine = self.rays
        same = (mine.size, mine.step, mine.near) == (rays.size, rays.step, rays.near)
        return same and np.array_equal(mine.table, rays.table) and self._saw(visible)

    def _saw(self, visible: NDArray[np.bool_]) -> bool:
        return len(visible) == len(self.visible) and not (visible & ~self.visible).any()

    def counts(self, visible: NDArray[np.bool_]) -> OcclusionCounts:
        """Count who hides whom, as if rays were cast with these objects visible.

        Parameters
        ----------
        visible : (M,) ndarray of bool
            By ID, such as `serves` holds for.

        Raises
        ------
        ValueError
            If an object is visible that was not.
        """
        if not self._saw(visible):
            raise ValueError("visible must hold only objects the rays saw: cast them anew")
        counter = RunCounter.of(visible)

        def work(own: Counters, first: int, last: int) -> None:
            for part in self.parts[first:last]:
                counter.add(part, own)

        return counter.sum(over_bands(len(self.parts), work, counter.counters, band=1))


@dataclass(frozen=True, eq=False)
class RunCounter:
    """The counting of runs for some visible objects.

    Parameters
    ----------
    visible : (M,) ndarray of bool
        By ID.
    slots : (M,) ndarray of int32
        Row of each visible object in the table.
    blocks : (n, n) ndarray of bool
        Row blocks column; shared by threads, which write nothing but True. Empty without a table.
    """

    visible: NDArray[np.bool_]
    slots: NDArray[np.int32]
    blocks: NDArray[np.bool_]

    @classmethod
    def of(cls, visible: NDArray[np.bool_]) -> RunCounter:
        """Begin to count."""
        candidates = np.flatnonzero(visible)
        tabled = len(candidates) if len(candidates) <= MOST_IN_TABLE else 0
        slots = np.full(len(visible), -1, np.int32)
        slots[candidates] = np.arange(len(candidates))
        return cls(visible, slots, np.zeros((tabled, tabled), np.bool_))

    def counters(self) -> Counters:
        """Make what one thread counts in."""
        size = len(self.visible)
        return (
            np.zeros((5, size), np.int64), np.zeros(size, np.int64), np.zeros(size, np.int64)
        )  # fmt: skip

    def add(self, runs: NDArray[np.uint32], own: Counters) -> None:
        """Count the runs of some rays.

        Parameters
        ----------
        runs : (n,) ndarray of uint32
            As in `Runs.parts`.
        own : tuple of ndarray
            From `counters`, of this thread alone.
        """
        counts, stamps, seen = own
        stamps.fill(-1)
        _count_runs(runs, self.visible, self.slots, counts, stamps, seen, self.blocks)

    def sum(self, parts: list[Counters]) -> OcclusionCounts:
        """Add up what the threads have counted."""
        counts = np.sum([counts for counts, _, _ in parts], axis=0)
        ids = np.flatnonzero(counts[0])
        met = self.slots[ids]
        tabled = np.count_nonzero(self.visible) <= MOST_IN_TABLE
        table = self.blocks[np.ix_(met, met)] if tabled else None
        return OcclusionCounts(ids, counts[0], counts[1], counts[2], counts[3], counts[4], table)


@njit(cache=True, nogil=True, error_model="numpy")
def _count_runs(runs, visible, slots, counts, stamps, seen, blocks):  # type: ignore[no-untyped-def]
    tabulate = blocks.size > 0
    # `stamps` holds the last ray that met each object: no list has to be cleared between rays.
    ray, number, foremost = 0, 0, np.int64(0)
    for i in range(runs.size):
        label = np.int64(runs[i] >> ABOVE)
        length = np.int64(runs[i] & np.uint32(LONGEST))
        # A run of no samples ends a ray.
        if length == 0:
            number = 0
        if not visible[label]:
            continue
        if number == 0:
            ray, foremost = i, label
        if stamps[label] != ray:
            stamps[label] = ray
            seen[number] = label
            number += 1
            counts[1, label] += 1
            counts[2, label] += number > 1
        counts[0, label] += length
        # All objects seen before on this ray stand in front of this one.
        if number > 1:
            counts[4, label] += length
            if label != foremost:
                counts[3, label] += length
            if tabulate:
                for earlier in range(number):
                    if seen[earlier] != label:
                        blocks[slots[seen[earlier]], slots[label]] = True


# The look of rays without bricks: labels have to be read.
UNKNOWN = np.int32(-(2**31))

# Runs that are kept, at least, before they are handed over.
ROOM = 1 << 18

Scratch = tuple[NDArray[np.uint32], NDArray[np.uint32]]


@dataclass(frozen=True, eq=False)
class Tracing:
    """The casting of one image, a band at a time; threads share it.

    Parameters
    ----------
    over : tuple
        What `_trace` takes before the band.
    width : int
        Of the image, pixels.
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
        """Prepare to cast; see `occlusion_counts`.

        Parameters
        ----------
        labels, rays, visible, bricks
            As for `occlusion_counts`.
        """
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

        Parameters
        ----------
        first, last : int
            Rows of the band, half-open.
        scratch : tuple of ndarray
            From `scratch`, of this thread alone.

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

    Parameters
    ----------
    rays : Rays
    shape : (int, int, int)
        Of the volume, voxels.

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
    # Scratch: labels of a mixed brick, lanes that need them, rays' quantities, runs begun.
    flat, (_, high, wide) = labels.reshape(-1), labels.shape
    ahead, mixed = np.zeros(AHEAD, np.int64), np.zeros(LANES + 1, np.uint64)
    f, n = np.zeros(FLOAT_ROWS * LANES), np.zeros(INTEGER_ROWS * LANES, np.int32)
    number = np.zeros(LANES, np.int64)
    for lane in range(LANES):
        n[CURRENT + lane] = -1
    queue = np.zeros(((last - first) * TILE, 4), np.int64)
    used = 0
    # A tile is begun only if the longest runs of all its rays would fit.
    while column < width and used + len(queue) * runs.shape[1] <= out.size:
        right = min(column + TILE, width)
        waiting = enter_tile(box, planes, table, step, near, first, last, column, right, queue)
        column = right
        # The first rays of the tile fill the lanes; the others wait for one to end.
        begun = min(waiting, LANES)
        walking = begun
        for lane in range(begun):
            _begin_ray(queue, lane, lane, table, step, octants, f, n, number)
        while walking > 0:
            # How far each ray may go: over uniform bricks, or to the end of a mixed one.
            if skip:
                look_ahead(looks, rows, columns, axis, step, f, n)
            else:
                for lane in range(LANES):
                    n[SKIP + lane], f[BEYOND + lane] = UNKNOWN, f[END + lane]
            stretch(f, n)
            # In a mixed brick two objects are told apart sample by sample, eight bits at once.
            many = np.uint64(0)
            for lane in range(LANES):
                mixed[many] = lane
                many += np.uint64((n[SKIP + lane] < 0) & (n[COUNT + lane] > 0))
            for j in range(many):
                lane = mixed[j]
                brick = np.uint64(~n[np.uint64(SKIP) + lane])
                # More than two objects: labels are read one by one below.
                if brick >= pairs.size:
                    n[np.uint64(FOUND) + lane] = SEVERAL
                    continue
                place = brick << np.uint64(3)
                mask = _eight_labels(words, place, f, lane, 0.0, step)
                count = n[np.uint64(COUNT) + lane]
                if count > 8:
                    mask |= _eight_labels(words, place, f, lane, 8.0, step) << np.uint64(8)
                mask &= (np.uint64(1) << np.uint64(count)) - np.uint64(1)
                ones = np.int32(ones_of(mask))
                pair = pairs[brick]
                none, one = np.int32(pair & np.uint32(0xFFFF)), np.int32(pair >> np.uint32(16))
                n[np.uint64(FOUND) + lane] = SEVERAL if (none != 0) & (one != 0) else none + one
                rest = ones if none == 0 else count - ones
                n[np.uint64(COUNT) + lane] = count if (none != 0) & (one != 0) else rest
            # All rays advance; only changes of object and ends of rays need a branch.
            go_on(f, n)
            for lane in range(LANES):
                event = n[EVENT + lane]
                if event == 0:
                    continue
                if event & TURNS and n[FOUND + lane] != SEVERAL:
                    _write_run(runs, lane, n, number, n[FOUND + lane], n[COUNT + lane])
                elif event & TURNS:
                    stop = int(f[K + lane])
                    k = stop - n[COUNT + lane]
                    pz, py, px = f[PZ + lane], f[PY + lane], f[PX + lane]
                    dz, dy, dx = f[DZ + lane], f[DY + lane], f[DX + lane]
                    if skip:
                        b = np.uint64(n[BRICK + lane])
                        place, start = np.uint64(firsts[b]), np.uint64(starts[b])
                        read_compressed(
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
                            _write_run(runs, lane, n, number, found, 1)
                if event & ENDS:
                    _write_run(runs, lane, n, number, 0, 0)
                    if number[lane] > 0:
                        for i in range(number[lane]):
                            out[used + i] = runs[lane, i]
                        used += number[lane]
                        out[used] = 0
                        used += 1
                    if begun < waiting:
                        _begin_ray(queue, begun, lane, table, step, octants, f, n, number)
                        begun += 1
                    else:
                        # A lane without a ray is still computed, so it stands inside the volume.
                        f[K + lane] -= 1.0
                        f[END + lane] = f[K + lane]
                        n[CURRENT + lane] = -1
                        walking -= 1
    return column, used


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _begin_ray(queue, i, lane, table, step, octants, f, n, number):  # type: ignore[no-untyped-def]
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
def _write_run(runs, lane, n, number, found, count):  # type: ignore[no-untyped-def]
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
def _eight_labels(words, place, f, lane, more, step):  # type: ignore[no-untyped-def]
    # Indices without a sign: numba does not ask whether they count from the end.
    pz, py, px = np.uint64(PZ) + lane, np.uint64(PY) + lane, np.uint64(PX) + lane
    dz, dy, dx = np.uint64(DZ) + lane, np.uint64(DY) + lane, np.uint64(DX) + lane
    k = f[np.uint64(K) + lane] + more
    return eight_bits(words, place, k, step, f[pz], f[py], f[px], f[dz], f[dy], f[dx])
