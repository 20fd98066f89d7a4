"""Objects of a grid too large to be looked at at once: found in overlapping blocks, matched there.

Each block is segmented as a volume of its own. Two blocks see what lies in their overlap alike, or
nearly so: labels that cover the same voxels there are one object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from napari_unpack.geometry.relabeling import numbered
from napari_unpack.segmentation.common.array_source import Box, Source, source_of, within
from napari_unpack.segmentation.common.block_jobs import BlockJob, RunBlocks, run_in_turn
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.working_grid import WORKING_VOXELS
from napari_unpack.tasks import Share

FindInBlock = Callable[[NDArray[Any], Spacing, Share], NDArray[np.int32]]

# Cells that two blocks share: the network sees thirty around each, and what the end of a block cuts
# off is no longer seen as what it is.
OVERLAP = 64
# Of the cells of two labels in the overlap those that have both: more than half is the only match.
LEAST_MATCH = 0.5


@dataclass(frozen=True)
class OverlappingBlock:
    """A block, and the part of it in which its labels count.

    Parameters
    ----------
    place : (int, int, int)
        Which block it is along each axis.
    box : tuple of slice
        What is looked at.
    own : tuple of slice
        Up to the middle of what it shares with its neighbours; all blocks' own parts fill the grid.
    """

    place: tuple[int, int, int]
    box: Box
    own: Box


def overlapping_blocks(
    shape: tuple[int, int, int], most: int = WORKING_VOXELS, overlap: int = OVERLAP
) -> list[OverlappingBlock]:
    """Cut a grid into blocks of nearly one size that overlap, longer axes more often.

    Parameters
    ----------
    shape : (int, int, int)
    most : int
        Cells of a block: it is cut until it has no more, or until no side is longer than twice the
        overlap.
    overlap : int
        Cells that two neighbours share along an axis, or more.

    Returns
    -------
    list of OverlappingBlock
        In C order.
    """
    counts = [1, 1, 1]

    def length(axis: int) -> int:
        return -(-(shape[axis] + (counts[axis] - 1) * overlap) // counts[axis])

    while length(0) * length(1) * length(2) > most:
        longest = max(range(3), key=length)
        if length(longest) <= 2 * overlap:
            break
        counts[longest] += 1
    sides = [_cut(n, length(axis), counts[axis]) for axis, n in enumerate(shape)]
    return [
        OverlappingBlock((z, y, x), *zip(sides[0][z], sides[1][y], sides[2][x], strict=True))  # type: ignore[arg-type]
        for z, y, x in product(*(range(len(side)) for side in sides))
    ]


def _cut(whole: int, length: int, count: int) -> list[tuple[slice, slice]]:
    """Return where each block of an axis lies, and its own part."""
    starts = np.round(np.linspace(0, whole - length, count)).astype(int).tolist()
    middles = [(b + a + length) // 2 for a, b in pairwise(starts)]
    ends = [0, *middles, whole]
    return [
        (slice(start, start + length), slice(*ends[k : k + 2])) for k, start in enumerate(starts)
    ]


def find_in_blocks(
    density: NDArray[np.generic],
    spacing: Spacing,
    find: FindInBlock,
    share: Share,
    run: RunBlocks = run_in_turn,
    *,
    most: int = WORKING_VOXELS,
    overlap: int = OVERLAP,
) -> NDArray[np.int32]:
    """Find the objects of a large grid block by block.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    find : callable
        `find(density, spacing, share) -> labels` finds the objects of a block, 1, 2, ...; it may
        find none.
    share : Share
    run : RunBlocks
        By default one block after the other.
    most, overlap : int
        See `overlapping_blocks`.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        1, 2, ... without gaps; 0 is background.

    Notes
    -----
    The result does not depend on `run`, but on where blocks are cut: a block has its own
    surroundings only. What two blocks see differently ends where their own parts meet: an object
    that is whole in one block and in two pieces in the other, neither of which has more than half
    of it in the overlap, is cut there.
    """
    places = overlapping_blocks(density.shape, most, overlap)  # type: ignore[arg-type]
    labels = np.zeros(density.shape, np.int32)
    jobs = (BlockJob(_found, place.box, (place.box, spacing, find)) for place in places)
    found = run(source_of(density), jobs, len(places), share.part(0.0, 0.95))
    bands = _Bands()
    for place, part in zip(places, found, strict=True):
        named = np.where(part > 0, part + bands.named, 0)
        bands.named += int(part.max(initial=0))
        labels[place.own] = named[within(place.own, place.box)]
        bands.match(place, named)
    names = bands.names()
    for a, b in share.part(0.95, 1.0).slabs(labels.shape):
        labels[a:b] = names[labels[a:b]]
    return _without_crumbs(labels)


def _found(
    source: Source, box: Box, spacing: Spacing, find: FindInBlock, share: Share
) -> NDArray[np.int32]:
    return find(source.read(box), spacing, share)


class _Bands:
    """What neighbouring blocks find on both sides of where their own parts meet.

    Of the overlap its inner half: further out one of the two blocks ends.
    """

    def __init__(self) -> None:
        self.named = 0
        self._waiting: dict[tuple[tuple[int, int, int], int], tuple[Box, NDArray[np.int32]]] = {}
        self._pairs: list[NDArray[np.int64]] = []

    def match(self, place: OverlappingBlock, labels: NDArray[np.int32]) -> None:
        """Compare a block with those before it, and keep what those after it need."""
        for axis in range(3):
            before = self._waiting.pop((place.place, axis), None)
            if before is not None:
                box, theirs = before
                self._pairs.append(matches(theirs, labels[within(box, place.box)]))
            own, end = place.own[axis], place.box[axis].stop
            if own.stop < end:
                reach = (end - own.stop) // 2
                band = list(place.own)
                band[axis] = slice(own.stop - reach, own.stop + reach)
                after = list(place.place)
                after[axis] += 1
                box = (band[0], band[1], band[2])
                kept = labels[within(box, place.box)].copy()
                self._waiting[(after[0], after[1], after[2]), axis] = (box, kept)

    def names(self) -> NDArray[np.int32]:
        """Return the object of every label, 0 for 0."""
        pairs = np.concatenate([np.empty((0, 2), np.int64), *self._pairs])
        size = self.named + 1
        graph = coo_array((np.ones(len(pairs), np.bool_), tuple(pairs.T)), (size, size))
        # Background, node 0, is matched with nothing and comes first.
        return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def matches(one: NDArray[np.int32], two: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the labels of two views of the same cells that are one object.

    Parameters
    ----------
    one, two : ndarray of int32
        Of one shape; 0 is background.

    Returns
    -------
    (N, 2) ndarray of int64
        Pairs whose intersection is more than `LEAST_MATCH` of their union, so that none has two.
    """
    flat = [view.reshape(-1) for view in (one, two)]
    first, second = (side[(flat[0] > 0) & (flat[1] > 0)].astype(np.int64) for side in flat)
    # A number for each pair: they are sorted much faster than pairs are.
    width = second.max(initial=0) + 1
    keys, common = np.unique(first * width + second, return_counts=True)
    pairs = np.stack(np.divmod(keys, width))
    sizes = [np.bincount(side) for side in flat]
    union = sizes[0][pairs[0]] + sizes[1][pairs[1]] - common
    return pairs[:, common > LEAST_MATCH * union].T


def _without_crumbs(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Drop what is left of an object where the block beside did not see it; close the gaps."""
    counts = np.bincount(labels.reshape(-1))
    kept = counts >= MIN_OBJECT_VOXELS
    kept[0] = False
    return numbered(kept)[labels]
