"""What stands on every ray of a picture, by run lengths, and what is counted of it.

Casting is dear and counting is cheap, and what leaves the bag becomes air: whoever keeps the runs
of one look along a direction has the counts of every step of the unpacking that follows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.raycasting.threads import over_bands

MOST_IN_TABLE = 4096
"""Above this many objects there is no table of who blocks whom: it grows with their square."""

LONGEST = 0xFFFF
"""Samples of one run, at most; longer ones are written as several."""

ABOVE = np.uint32(16)
"""Bits of a run below its object's ID."""

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
        Of the picture.
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
        """Tell whether these rays were cast, and nobody is visible who was not."""
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

        Returns
        -------
        OcclusionCounts

        Raises
        ------
        ValueError
            If somebody is visible who was not.
        """
        if not self._saw(visible):
            raise ValueError("visible must hold nobody whom the rays did not see: cast them anew")
        tally = Tally.of(visible)

        def work(own: Counters, first: int, last: int) -> None:
            for part in self.parts[first:last]:
                tally.add(part, own)

        return tally.sum(over_bands(len(self.parts), work, tally.counters, band=1))


@dataclass(frozen=True, eq=False)
class Tally:
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
    def of(cls, visible: NDArray[np.bool_]) -> Tally:
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
        """Count the runs of some rays."""
        counts, stamps, seen = own
        stamps.fill(-1)
        _tally(runs, self.visible, self.slots, counts, stamps, seen, self.blocks)

    def sum(self, parts: list[Counters]) -> OcclusionCounts:
        """Add up what the threads have counted."""
        counts = np.sum([counts for counts, _, _ in parts], axis=0)
        ids = np.flatnonzero(counts[0])
        met = self.slots[ids]
        tabled = np.count_nonzero(self.visible) <= MOST_IN_TABLE
        table = self.blocks[np.ix_(met, met)] if tabled else None
        return OcclusionCounts(ids, counts[0], counts[1], counts[2], counts[3], counts[4], table)


@njit(cache=True, nogil=True, error_model="numpy")
def _tally(runs, visible, slots, counts, stamps, seen, blocks):  # type: ignore[no-untyped-def]
    tabulate = blocks.size > 0
    ray, number, foremost = 0, 0, np.int64(0)
    for i in range(runs.size):
        label = np.int64(runs[i] >> ABOVE)
        length = np.int64(runs[i] & np.uint32(LONGEST))
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
        if number > 1:
            counts[4, label] += length
            if label != foremost:
                counts[3, label] += length
            if tabulate:
                for earlier in range(number):
                    if seen[earlier] != label:
                        blocks[slots[seen[earlier]], slots[label]] = True
