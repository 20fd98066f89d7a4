"""From a density volume to labelled objects: what `segment` does, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import voxel_size
from napari_unpack.segmentation.block_workers import BlockWorkers
from napari_unpack.segmentation.common.array_source import Source, source_of
from napari_unpack.segmentation.common.block_jobs import RunBlocks, run_in_turn, run_on_threads
from napari_unpack.segmentation.common.density_regions import air_offset
from napari_unpack.segmentation.common.joins import Steps
from napari_unpack.segmentation.common.merging import absorb_fringes, absorb_small
from napari_unpack.segmentation.common.morphology import dilate
from napari_unpack.segmentation.common.region import (
    MIN_OBJECT_VOXELS,
    Oracle,
    default_smallest_object,
)
from napari_unpack.segmentation.common.remote_volumes import read_once
from napari_unpack.segmentation.common.validation import (
    Spacing,
    check_out,
    check_room,
    check_smallest,
    checked_volume,
    in_common_range,
    padding_of,
    without_infinities,
    without_padding,
)
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.segmentation.foreground.denoising import (
    denoised,
    grow_to_half_height,
    needs_denoising,
)
from napari_unpack.segmentation.foreground.methods import (
    ForegroundOptions,
    KnownScale,
    checked_foreground,
    find_foreground,
    typical_knee,
)
from napari_unpack.segmentation.foreground.scanner_table import (
    SUPPORT_RIM,
    find_supports,
    measured_section,
)
from napari_unpack.segmentation.foreground.thresholds import NothingFoundError
from napari_unpack.segmentation.isoperimetric.initial_parts import SplitRule, split_parts
from napari_unpack.segmentation.isoperimetric.oracle_refinement import join_touching
from napari_unpack.segmentation.large_volumes import segment_large
from napari_unpack.segmentation.learned.boundary_network import BoundaryNetwork
from napari_unpack.segmentation.learned.method import find_objects
from napari_unpack.segmentation.magnified_grid import find_magnified
from napari_unpack.segmentation.object_table import object_table, rank_labels
from napari_unpack.segmentation.overlapping_blocks import find_in_blocks
from napari_unpack.segmentation.postprocessing.cables import gather_cables
from napari_unpack.segmentation.postprocessing.cavities import fill_cavities, join_suspended
from napari_unpack.segmentation.postprocessing.crumpled_cloth import bundle_folds
from napari_unpack.segmentation.postprocessing.inclusions import separate_inclusions
from napari_unpack.segmentation.postprocessing.metal_blur import without_blur
from napari_unpack.segmentation.review.evidence import Evidence, gather
from napari_unpack.segmentation.working_grid import WORKING_VOXELS
from napari_unpack.tasks import Progress, Share, beside, relayed

METHODS = ("learned", "cuts")
# Folds of cloth are at most this many times as dense as the median of the foreground.
FOLD_DENSITY = 2.2
# Times the usual working grid, for small objects: as many voxels as 512 in each direction, which
# take ten times as long.
FINEST = 8


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The objects of a volume.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Object IDs 1, 2, ... from the largest object to the smallest; 0 is background. The array
        given as `out`, where one was.
    objects : pandas.DataFrame
        Indexed by id: voxels, volume_mm3, mean_density, z, y, x (centroid, mm),
        isoperimetric_ratio (surface over volume, 1/mm), confidence in [0, 1].
    evidence : Evidence, optional
        What a person's review starts from; None for method "cuts", and where the volume was
        larger than `working` or 16 million voxels.
    """

    labels: Any
    objects: pd.DataFrame
    evidence: Evidence | None = None

    def __repr__(self) -> str:
        """Say in a line what was found; arrays fill screens of a notebook."""
        count, size = len(self.objects), tuple(self.labels.shape)
        return f"Segmentation({count} object{'s' * (count != 1)} in {size} voxels)"


@dataclass(frozen=True)
class SegmentOptions:
    """The arguments of `segment` that decide about objects; see there.

    Parameters
    ----------
    method : {"learned", "cuts"}
    foreground : ForegroundOptions
    smallest : float
        mm^3.
    grainy : bool, optional
    step : float
        Of log density.
    rule : SplitRule, optional
    oracle : callable, optional
    network : BoundaryNetwork, optional
        Of method "learned".
    by_default : bool
        Nobody has asked for `smallest`.
    """

    method: str
    foreground: ForegroundOptions
    smallest: float
    grainy: bool | None = None
    step: float = 0.11
    rule: SplitRule | None = None
    oracle: Oracle | None = None
    network: BoundaryNetwork | None = None
    by_default: bool = False


def segment(
    volume: ArrayLike,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    oracle: Oracle | None = None,
    progress: Progress | None = None,
    *,
    method: str = "learned",
    foreground: str | float = "hysteresis",
    smallest: float | None = None,
    supports: bool = True,
    shell: bool = True,
    grainy: bool | None = None,
    step: float = 0.11,
    rule: SplitRule | None = None,
    judge: None = None,
    working: int | None = None,
    out: Any = None,
    client: Any = None,
) -> Segmentation:
    """Find the objects of a packed volume.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Densities, any real type and scale; NaN is background, and so is a smallest value far below
        air's CT number and all others, as -2000 outside a round field of view. A zarr or dask
        array, or a memory map, is read block by block where it is larger than `working`.
    spacing : (3,) sequence of float, mm z y x
    oracle : callable, optional
        `oracle(region) -> confidence in [0, 1]` gives the table's confidence, by default the
        oracle that ships with the package; with method "cuts" it also decides about cuts.
    progress : callable, optional
        Called with (fraction, text) twice a second or more often; raising in it cancels. What is
        being done then may go on for a second on a thread, and write to `out` once more.
    method : {"learned", "cuts"}
        "learned" merges what a boundary network predicts to belong together. "cuts" is the method
        of the paper (section 3), recursive cuts chosen by the oracle; it is slow and splits more.
    foreground : str or float
        How foreground is told from air: one of `methods.FOREGROUND_METHODS`, or the density from
        which there is foreground.
    smallest : float, optional
        Objects below this, or of fewer than 100 voxels, are dropped or joined to a neighbour,
        mm^3. By default 500 mm^3, but 500 voxels where that is more than a 2000th of the volume.
        With method "learned" it is 100 voxels by default where a tenth of all matter is in smaller
        objects, such as the beads in a jar, and metal is kept down to a quarter of it: coins are
        small.
    supports : bool
        Leave out the scanner's table.
    shell : bool
        Leave out the bag itself, and a hard case around everything.
    grainy : bool, optional
        Noise or haze hide the objects, as under a microscope: they are removed first, and there is
        no table and no bag. By default that is measured where `foreground` is the name of a method.
    step : float
        Of log density, between two regions of method "cuts"; see `DensityScale`.
    rule : SplitRule, optional
        When method "cuts" may split.
    judge : None
        Refused: it belonged to the method "affinity", which is gone.
    working : int, optional
        Larger volumes are reduced to so many voxels at most, on which the objects are found;
        their labels are then refined to full resolution; see `large_volumes`. By default 16
        million, but up to 128 million for objects too small to be told apart on these, such as the
        beads of a large jar, with method "learned"; see `finer_grid`. More than 16 million are
        looked at in blocks that overlap; see `overlapping_blocks`. By default thick slices, and
        small volumes of thin objects, are looked at between their voxels too; see `magnified_grid`.
    out : (Z, Y, X) array of int, optional
        Where labels are written and which is then `.labels`: an ndarray, memory map or zarr
        array. By default a new ndarray of int32.
    client : distributed.Client, optional
        Of a Dask cluster, whose workers run the network and, where the volume is larger than
        `working`, read and label its blocks; objects that are found in blocks are found there. The
        result is the same without it.

    Raises
    ------
    TypeError
        If the volume does not hold real numbers, `out` no integers, `oracle` cannot be called, or
        `judge` is given.
    ValueError
        If the volume, the spacing or `out` is not usable, or nothing is found.
    """
    if judge is not None:
        raise TypeError('judge= is gone with method="affinity"; pass oracle= with method="cuts"')
    if oracle is not None and not callable(oracle):
        raise TypeError(
            f"oracle must be None or a function of a region, as Oracle.load gives, got {oracle!r}"
        )
    source = source_of(volume)
    size = voxel_size(spacing)
    level = checked_foreground(foreground)
    if method == "affinity":
        raise ValueError('method="affinity" is gone; use method="learned" or method="cuts"')
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if out is not None:
        check_out(out, source.array, source.shape)
    _check_sizes(smallest, step, working)
    least = default_smallest_object(source.shape, size) if smallest is None else smallest
    workers = None if client is None else BlockWorkers(client)
    given = ForegroundOptions(level, supports, shell)
    network = None if workers is None else workers.network()
    wanted = SegmentOptions(
        method, given, least, grainy, step, rule, oracle, network, smallest is None
    )

    def work(report: Progress) -> Segmentation:
        return _segmented(source, size, wanted, Share(report), working, out, workers)

    return relayed(work, progress)


def _check_sizes(smallest: float | None, step: float, working: int | None) -> None:
    check_smallest(smallest)
    if not 0 < step < np.inf:
        raise ValueError(f"step must be a positive difference of log density, got {step!r}")
    # Fewer voxels hold no objects of 100 voxels.
    if working is not None and not working >= MIN_OBJECT_VOXELS:
        raise ValueError(
            f"working must be a number of voxels, {MIN_OBJECT_VOXELS} or more, got {working!r}"
        )


def _segmented(
    source: Source,
    size: Spacing,
    wanted: SegmentOptions,
    share: Share,
    working: int | None,
    out: Any,
    workers: BlockWorkers | None,
) -> Segmentation:
    oracle = wanted.oracle
    most = WORKING_VOXELS if working is None else working
    if source.size > min(most, WORKING_VOXELS):
        reading = workers.run if workers else run_on_threads
        looking = workers.run if workers else run_in_turn
        find = partial(_segment_grid, options=wanted, run=looking)
        # Nobody waits for "cuts" on so many.
        closer = working is None and wanted.method != "cuts"
        finest = FINEST * WORKING_VOXELS if closer else most
        fewest = int(max(wanted.smallest / float(np.prod(size)), MIN_OBJECT_VOXELS))
        with read_once(source) as near:
            labels, table = segment_large(
                near,
                size,
                find,
                share,
                working=most,
                finest=finest,
                foreground=wanted.foreground.method,
                grainy=wanted.grainy,
                fewest=fewest,
                oracle=oracle,
                out=out,
                run=reading,
            )
        share(1.0, f"{len(table)} objects")
        return Segmentation(labels, table)
    density = without_infinities(checked_volume(np.asarray(source.array)))
    density = without_padding(density, padding_of(density))
    noted = Steps()
    finding = share.part(0.0, 0.95, "Reading the volume")
    common, settled = _settled(density, wanted)
    find = partial(_segment_cells, options=settled)
    # The paper's method takes minutes as it is; single grains of noise are no objects.
    if working is None and settled.method != "cuts" and not settled.grainy:
        labels = find_magnified(common, size, find, finding, noted)
    else:
        labels = find(common, size, finding, noted=noted)
    if out is not None:
        check_room(out, int(labels.max()))
    measuring = share.part(0.95, 1.0, "Measuring objects")
    with beside(partial(gather, labels, noted)) as gathered:
        table = object_table(labels, density, size, oracle, measuring)
    if out is not None:
        out[...] = labels
        labels = out
    share(1.0, f"{len(table)} objects")
    return Segmentation(labels, table, gathered.result())


def _segment_grid(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    options: SegmentOptions,
    run: RunBlocks = run_in_turn,
) -> NDArray[np.int32]:
    """Find the objects of a reduced volume, named by size."""
    common, settled = _settled(density, options)
    return _segment_cells(common, spacing, share, settled, run=run)


def _settled(
    density: NDArray[np.generic], options: SegmentOptions
) -> tuple[NDArray[np.generic], SegmentOptions]:
    """Return densities that float32 can work with, and options that say whether they are grainy."""
    density, level = in_common_range(density, options.foreground.method)
    grainy = options.grainy
    if grainy is None:
        grainy = needs_denoising(density, level)
    return density, replace(
        options, foreground=replace(options.foreground, method=level), grainy=grainy
    )


def _segment_cells(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    options: SegmentOptions,
    noted: Steps | None = None,
    run: RunBlocks = run_in_turn,
) -> NDArray[np.int32]:
    """Find the objects of densities and options that are settled, named by size."""
    given, foreground = density, options.foreground
    noisy = bool(options.grainy)
    if noisy:
        clearing = share.part(0.0, 0.05, "Removing noise and haze")
        density = denoised(density, spacing, foreground.method, clearing)
        # Under a microscope there is neither a table nor a bag.
        foreground = ForegroundOptions(supports=False, shell=False)
    else:
        begun = share.part(0.0, 0.05, "Finding the foreground")
        found = find_foreground(density, spacing, foreground.method, begun)
        foreground = replace(foreground, found=found)
    cleared = replace(options, foreground=foreground)
    looking = share.part(0.05, 0.9 if noisy else 0.95)
    if density.size > WORKING_VOXELS:
        labels = _objects_in_blocks(density, spacing, looking, cleared, run)
    else:
        labels = _objects(density, spacing, looking, cleared, noted)
    if noisy:
        growing = share.part(0.9, 0.95, "Drawing borders")
        labels = grow_to_half_height(labels, given, spacing, growing)
    closing = share.part(0.95, 0.99, "Filling cavities")
    # Haze is foreground too, so that it makes no walls.
    walls = None if foreground.found is None else foreground.found[0]
    filled = fill_cavities(labels, spacing, walls, closing)
    closing(1.0)
    labels = filled if noisy else join_suspended(labels, filled, spacing)
    if not noisy and options.method != "cuts":
        # Last: what it leaves empty is no cavity of the metal.
        labels = without_blur(labels, density)
    share(1.0)
    labels = rank_labels(labels)
    if not labels.any():
        raise NothingFoundError(
            f"nothing found: no object has {options.smallest:g} mm^3 and {MIN_OBJECT_VOXELS} "
            "voxels; pass a smaller smallest= or a lower foreground=; shell=False and "
            "supports=False keep what was taken for the bag or the scanner's table"
        )
    return labels


def _objects(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    options: SegmentOptions,
    noted: Steps | None = None,
) -> NDArray[np.int32]:
    """Find the objects of a volume or of a block of one, whose haze is gone where it is grainy."""
    if options.method == "cuts":
        return _cut_objects(density, spacing, share, options)
    # Haze removal leaves no densities to compare.
    clear = not options.grainy
    labels = find_objects(
        density,
        spacing,
        share.part(0.0, 0.94),
        options.foreground,
        smallest=options.smallest,
        by_default=options.by_default,
        steps=clear,
        noted=noted,
        network=options.network,
    )
    if not clear:
        return labels
    apart = share.part(0.94, 1.0, "Telling apart what lies in each other")
    labels = gather_cables(labels, density, share=apart.part(0.0, 0.4))
    return separate_inclusions(
        labels, density, spacing, options.smallest, share=apart.part(0.4, 1.0)
    )


def _objects_in_blocks(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    options: SegmentOptions,
    run: RunBlocks,
) -> NDArray[np.int32]:
    """Find objects block by block, all of whose densities are compared on the volume's scale."""
    given = options.foreground
    mask, levels = given.find(density, spacing, share.part(0.0, 0.02))
    known = KnownScale(levels, typical_knee(density, mask, levels.air))
    # Cut off by the end of a block, a box looks like a table.
    aside = _no_objects(density, mask, spacing, given.supports)
    if aside.any():
        density = np.where(aside, density.dtype.type(levels.air), density)
    blockwise = replace(given, supports=False, known=known, found=None)
    # A worker has the network; it asks no others.
    alone = replace(options, foreground=blockwise, network=None)
    find = partial(_objects_of_block, options=alone)
    finding = share.part(0.02, 1.0, "Finding objects block by block")
    return find_in_blocks(density, spacing, find, finding, run)


def _no_objects(
    density: NDArray[np.generic], mask: NDArray[np.bool_], spacing: Spacing, supports: bool
) -> NDArray[np.bool_]:
    """Return the scanner's table with its blur, and what lies beyond its field of view."""
    section = measured_section(density)
    aside = np.zeros(mask.shape, np.bool_)
    if section is not None:
        aside |= ~section
        mask = mask & section
    held = find_supports(mask, spacing) if supports else np.zeros_like(mask)
    if held.any():
        aside |= dilate(held, iterations=SUPPORT_RIM) & (held | ~mask)
    return aside


def _objects_of_block(
    density: NDArray[np.generic], spacing: Spacing, share: Share, options: SegmentOptions
) -> NDArray[np.int32]:
    try:
        return _objects(density, spacing, share, options)
    except NothingFoundError:
        return np.zeros(density.shape, np.int32)


def _cut_objects(
    density: NDArray[np.generic],
    spacing: Spacing,
    share: Share,
    options: SegmentOptions,
) -> NDArray[np.int32]:
    """Find objects by the paper's method: recursive cuts, then merges that the oracle prefers."""
    oracle, foreground = options.oracle or default_oracle(), options.foreground
    if foreground.found is not None and (air := air_offset(density, foreground.found[0])):
        mask, at = foreground.found
        at = replace(at, air=at.air - air, low=at.low - air, high=at.high - air)
        foreground = replace(foreground, found=(mask, at))
        density = density.astype(np.float32) - np.float32(air)
    # Parts are cut down to twice the least object, since every cut may halve the last one.
    rule = options.rule or SplitRule(smallest=2 * options.smallest)
    first = share.part(0.0, 0.9)
    parts, scale = split_parts(
        density, spacing, first, oracle, foreground, options.smallest, options.step, rule
    )
    # The knee is a quarter of the foreground's median density above air.
    light = scale.air + FOLD_DENSITY * 4 * scale.knee
    parts = absorb_fringes(bundle_folds(parts, density, spacing, light), density, spacing)
    joining = share.part(0.92, 1.0, "Merging parts")
    parts = join_touching(parts, density, spacing, oracle, share=joining)
    voxel = float(np.prod(spacing))
    return absorb_small(parts, spacing, max(options.smallest, MIN_OBJECT_VOXELS * voxel))
