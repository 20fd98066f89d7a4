"""Volumes too large to be segmented whole: on a reduced grid, then refined block by block."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod
from typing import Any

import cc3d
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from napari_unpack.memory import check_memory, free_memory
from napari_unpack.segmentation.common.array_source import Box, Source, blocks, grown, within
from napari_unpack.segmentation.common.block_jobs import BlockJob, RunBlocks, run_on_threads
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS, Oracle
from napari_unpack.segmentation.common.validation import Spacing, check_room, padding_of
from napari_unpack.segmentation.finer_grid import finer_grid
from napari_unpack.segmentation.foreground.denoising import needs_denoising
from napari_unpack.segmentation.foreground.methods import find_foreground, foreground_levels
from napari_unpack.segmentation.foreground.scanner_table import measured_section
from napari_unpack.segmentation.label_upsampling import (
    GridLabels,
    grid_labels,
    named_things,
    refined,
    write_things,
)
from napari_unpack.segmentation.object_table import ObjectSums, confidences, ranks
from napari_unpack.segmentation.working_grid import (
    BLOCK,
    WORKING_VOXELS,
    Find,
    WorkingGrid,
    reduced,
    reduction,
)
from napari_unpack.tasks import Progress, Share

# Of this process for each cell of a grid whose objects are found in blocks, measured: densities,
# labels, masks and what is left over.
GRID_BYTES = 45


def segment_large(
    source: Source,
    spacing: Spacing,
    find: Find,
    progress: Progress,
    *,
    working: int,
    finest: int,
    foreground: str | float,
    fewest: int,
    grainy: bool | None = None,
    oracle: Oracle | None = None,
    out: Any = None,
    run: RunBlocks = run_on_threads,
) -> tuple[Any, pd.DataFrame]:
    """Find the objects of a volume that is never in memory as a whole.

    Parameters
    ----------
    source : Source
    spacing : (float, float, float) of mm, z y x
    find : Find
        Finds the objects of the working grid.
    progress : callable
        Called from this thread only.
    working : int
        Cells of the working grid at most.
    finest : int
        Cells at most of a finer one, for objects that are too small for the first; see
        `finer_grid`.
    foreground : str or float
        See `methods.checked_foreground`.
    fewest : int
        Voxels of an object.
    grainy : bool, optional
        The volume is mostly noise or haze, so that what the grid does not show is no object.
    oracle : callable, optional
        Confidence of the objects, as they are on the grid.
    out : array, optional
        Where labels are written; by default a new ndarray.
    run : RunBlocks
        What works on blocks. The result does not depend on it.

    Returns
    -------
    labels : (Z, Y, X) array of int
        `out`, or an ndarray of int32.
    objects : pandas.DataFrame
        See `pipeline.Segmentation`.

    Raises
    ------
    ValueError
        If the working grid does not fit into memory, or nothing is found.
    """
    # The volume is read three times, see `read_once`, and the labels are written once, thin things
    # and the last numbering apart. Memory: the labels, unless `out` is a store, the working grid
    # and what its objects are found with, and about 20 bytes for every voxel of the blocks in work.
    # Single bright voxels so many that every cell has a neighbour with one are a haze on the grid,
    # and may come out as an object.
    share = Share(progress)
    begun = share.part(0.0, 0.03, "Reducing the volume")
    grid, source = _working_grid(source, spacing, working, begun, run)
    levels = foreground_levels(grid.sample, foreground)
    labels = find(grid.density, grid.spacing, share.part(0.03, 0.55, "Looking at the volume"))
    # Half of it: several may be at work.
    most = min(finest, free_memory() // (2 * GRID_BYTES))
    if most > working:
        closer = share.part(0.55, 0.58, "Looking closer at a part")
        finer = finer_grid(source, spacing, labels, grid.factors, find, most, closer)
        if finer is not None:
            again = share.part(0.58, 0.6, "Reducing the volume less")
            grid, source = _working_grid(source, spacing, finer, again, run)
            seen = share.part(0.6, 0.7, "Looking closer at the volume")
            labels = find(grid.density, grid.spacing, seen)
    refining = share.part(0.7, 0.9, "Refining the borders")
    hidden = needs_denoising(grid.density, foreground) if grainy is None else grainy
    looking = refining.part(0.0, 0.1)
    left_out = labels == 0 if hidden else _left_out(grid, labels, foreground, looking)
    rough = grid_labels(labels, grid.density, left_out, grid.factors, levels)
    if out is None:
        out = np.zeros(source.shape, np.int32)
    # Before the long work, and again when thin things have added labels.
    check_room(out, int(labels.max()))
    places = list(blocks(source.shape, grid.factors, BLOCK))
    unexplained = np.zeros(labels.shape, np.int32)
    # A generator: only the blocks in work are in memory.
    jobs = (
        BlockJob(refined, grown(box, 2, source.shape), (rough.around(cells), box, cells))
        for box, cells in places
    )
    done = run(source, jobs, len(places), refining.part(0.1, 0.9))
    for (box, cells), (found, rest) in zip(places, done, strict=True):
        with source.lock:
            out[box] = found
        unexplained[cells] = rest
    refining(0.9)
    things = named_things(unexplained, labels, fewest)
    check_room(out, int(things.max(initial=0)))
    _recover(source, rough, things, places, out, refining.part(0.95, 1.0))
    measuring = share.part(0.9, 1.0, "Measuring objects")
    labels = np.where(things > 0, things, labels)
    top = int(labels.max())
    sums = _measured(source, out, places, top, spacing, measuring.part(0.0, 0.5), run)
    rating = measuring.part(0.5, 0.8)
    confidence = confidences(labels, grid.density, grid.spacing, oracle, rating)
    names = ranks(sums.totals[:, 0])
    # Another pass over a store, which is often needless.
    if (names != np.arange(len(names))).any():
        for box, _ in measuring.part(0.8, 1.0).over(places):
            with source.lock:
                out[box] = names[np.asarray(out[box])]
    table = sums.table(spacing, confidence)
    table.index = pd.Index(names[table.index.to_numpy()].astype(np.int64), name="id")
    return out, table.sort_index()


def _working_grid(
    source: Source, spacing: Spacing, working: int, share: Share, run: RunBlocks
) -> tuple[WorkingGrid, Source]:
    """Return the reduced volume, and the source that knows its padding."""
    factors = reduction(source.shape, spacing, working)
    count = prod(-(-n // f) for n, f in zip(source.shape, factors, strict=True))
    if count > WORKING_VOXELS:
        remedy = "pass a smaller working"
        check_memory(f"finding objects in {count:,} cells", GRID_BYTES * count, remedy)
    grid = reduced(source, spacing, factors, BLOCK, share.part(0.0, 0.67), run)
    padding = padding_of(grid.sample)
    if padding is not None:
        source = replace(source, padding=padding)
        grid = reduced(source, spacing, factors, BLOCK, share.part(0.67, 1.0), run)
    return grid, source


def measured_objects(
    source: Source,
    labels: Any,
    ids: NDArray[np.integer[Any]],
    spacing: Spacing,
    progress: Progress,
) -> pd.DataFrame:
    """Measure objects whose labels are never in memory as a whole.

    Parameters
    ----------
    source : Source
        Densities.
    labels : (Z, Y, X) array of int
        Of its shape; read block by block.
    ids : (N,) ndarray of int
        The objects, ascending, without 0; what else is labelled is left out.
    spacing : (float, float, float) of mm, z y x
    progress : callable
        Raising in it cancels.

    Returns
    -------
    pandas.DataFrame
        Indexed by id: voxels, volume_mm3, mean_density, z, y, x (centroid, mm) and
        isoperimetric_ratio, as in `pipeline.Segmentation`. Objects without a voxel are left out.
    """
    places, named = list(blocks(source.shape, (1, 1, 1), BLOCK)), _Renamed(labels, ids)
    sums = _measured(source, named, places, len(ids), spacing, Share(progress), run_on_threads)
    table = sums.table(spacing)
    table.index = pd.Index(ids[table.index.to_numpy() - 1].astype(np.int64), name="id")
    return table


@dataclass(frozen=True, eq=False)
class _Renamed:
    """Labels in which the objects of some ascending IDs are 1, 2, ...; all else is 0."""

    labels: Any
    ids: NDArray[np.integer[Any]]

    def __getitem__(self, box: Box) -> NDArray[np.int32]:
        found = np.asarray(self.labels[box])
        if not len(self.ids):
            return np.zeros(found.shape, np.int32)
        place = np.minimum(np.searchsorted(self.ids, found), len(self.ids) - 1)
        return np.where(self.ids[place] == found, place + 1, 0).astype(np.int32)


def _left_out(
    grid: WorkingGrid, labels: NDArray[np.int32], foreground: str | float, share: Share
) -> NDArray[np.bool_]:
    """Return the foreground cells that are deliberately no object: tables, shells, the rim."""
    mask, _ = find_foreground(grid.density, grid.spacing, foreground, share)
    mask &= labels == 0
    # What is in too few cells to show a shape may be an object at full resolution.
    # As bytes: see `mask_components`.
    specks = mask.view(np.uint8)
    left_out = np.asarray(cc3d.dust(specks, threshold=MIN_OBJECT_VOXELS, connectivity=26), np.bool_)
    section = measured_section(grid.density)
    if section is not None:
        left_out |= (labels == 0) & ~section
    return left_out


def _recover(
    source: Source,
    rough: GridLabels,
    things: NDArray[np.int32],
    places: list[tuple[Box, Box]],
    out: Any,
    share: Share,
) -> None:
    """Write the labels of things that the grid did not show, block by block."""
    for box, cells in share.over(places):
        if things[cells].any():
            with source.lock:
                found = np.array(out[box], np.int32)
            write_things(source, rough, things, found, box, cells)
            with source.lock:
                out[box] = found


def _measured(
    source: Source,
    out: Any,
    places: list[tuple[Box, Box]],
    top: int,
    spacing: Spacing,
    share: Share,
    run: RunBlocks,
) -> ObjectSums:
    """Add up all objects; every block has sums of its own, added in order."""

    def job(box: Box) -> BlockJob:
        outer = grown(box, 1, source.shape)
        with source.lock:
            found = np.asarray(out[outer]).astype(np.int32, copy=False)
        return BlockJob(_block_sums, outer, (found, box, outer, spacing, top))

    total = ObjectSums.empty(top)
    jobs = (job(box) for box, _ in places)
    for sums in run(source, jobs, len(places), share):
        # In the order of blocks: sums of floats depend on it, and must not on threads.
        total.totals[:] += sums.totals
        total.area[:] += sums.area
    return total


def _block_sums(
    source: Source,
    found: NDArray[np.int32],
    box: Box,
    outer: Box,
    spacing: Spacing,
    top: int,
    share: Share,
) -> ObjectSums:
    sums = ObjectSums.empty(top)
    start = (outer[0].start, outer[1].start, outer[2].start)
    sums.add(found, source.read(outer), spacing, start, within(box, outer), share)
    return sums
