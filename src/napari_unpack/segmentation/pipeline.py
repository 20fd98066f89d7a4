"""From a density volume to labelled objects: the room's door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from napari_unpack.segmentation.common.array_source import source_of
from napari_unpack.segmentation.common.merging import absorb_fringes, absorb_small
from napari_unpack.segmentation.common.region import FEWEST, SMALLEST, Oracle, default_smallest
from napari_unpack.segmentation.common.validation import (
    Spacing,
    check_out,
    checked_spacing,
    checked_volume,
)
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.segmentation.foreground.denoising import cleared, looks_grainy, to_half_height
from napari_unpack.segmentation.foreground.methods import checked_way
from napari_unpack.segmentation.isoperimetric.initial_parts import SplitRule, split_parts
from napari_unpack.segmentation.isoperimetric.oracle_refinement import join_touching
from napari_unpack.segmentation.large_volumes import segment_large
from napari_unpack.segmentation.learned.method import seen_objects
from napari_unpack.segmentation.object_table import object_table, rank_labels
from napari_unpack.segmentation.postprocessing.cables import gather_wires
from napari_unpack.segmentation.postprocessing.cavities import fill_cavities, join_hanging
from napari_unpack.segmentation.postprocessing.crumpled_cloth import bundle_folds
from napari_unpack.segmentation.postprocessing.inclusions import take_out_inclusions
from napari_unpack.segmentation.working_grid import MOST
from napari_unpack.tasks import Progress, no_progress

METHODS = ("learned", "cuts")

FOLD_DENSITY = 2.2
"""Folds of cloth are at most this many times as dense as the median of the foreground."""


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
    """

    labels: Any
    objects: pd.DataFrame


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
    working: int = MOST,
    out: Any = None,
) -> Segmentation:
    """Find the objects of a packed volume.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Densities, any real type and scale; NaN is background. A zarr or dask array, or a memory
        map, is read block by block where it is larger than `working`.
    spacing : (3,) sequence of float
        Voxel size z y x, mm.
    oracle : callable, optional
        `oracle(region) -> confidence in [0, 1]` gives the table's confidence, by default the
        oracle that ships with the package; with method "cuts" it also decides about cuts.
    progress : callable, optional
        Called with (fraction, text) before every step; raising in it cancels.
    method : {"learned", "cuts"}
        "learned" merges what a boundary network predicts to belong together. "cuts" is the method
        of the paper (section 3), recursive cuts chosen by the oracle; it is slow and splits more.
    foreground : str or float
        How matter is told from air: one of `matter.WAYS`, or the density from which there is
        matter.
    smallest : float, optional
        Objects below this, or of fewer than 100 voxels, are dropped or joined to a neighbour,
        mm^3. By default 500 mm^3, but 500 voxels where that is more than a 2000th of
        the volume. With method "learned" metal is kept down to a quarter of it: coins are small.
    supports : bool
        Leave out the scanner's table.
    shell : bool
        Leave out the bag itself.
    grainy : bool, optional
        Noise or haze hide the objects, as under a microscope: they are taken away first, and
        there is no table and no bag. By default that is found out where `foreground` is a way.
    step : float
        Log density step that tells two materials apart; see `materials.MaterialScale`.
    rule : SplitRule, optional
        When to cut.
    judge : None
        Refused: it belonged to the method "affinity", which is gone.
    working : int
        Larger volumes are reduced to so many voxels at most, on which the objects are found;
        their labels are then refined to full resolution; see `large`.
    out : (Z, Y, X) array of int, optional
        Where labels are written and which is then `.labels`: an ndarray, memory map or zarr
        array. By default a new ndarray of int32.

    Returns
    -------
    Segmentation

    Raises
    ------
    TypeError
        If the volume does not hold real numbers, `out` no integers, or `judge` is given.
    ValueError
        If the volume, the spacing or `out` is not usable, or nothing is found.
    """
    if judge is not None:
        raise TypeError('judge= is gone with method="affinity"; pass oracle= with method="cuts"')
    source = source_of(volume)
    size = checked_spacing(spacing)
    way = checked_way(foreground)
    if method == "affinity":
        raise ValueError('method="affinity" is gone; use method="learned" or method="cuts"')
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    decides = (oracle or default_oracle()) if method == "cuts" else None
    if out is not None:
        check_out(out, source.shape)
    tell = progress or no_progress
    least = default_smallest(source.shape, size) if smallest is None else smallest
    find = partial(
        segment_grid,
        foreground=way,
        method=method,
        smallest=least,
        supports=supports,
        shell=shell,
        grainy=grainy,
        step=step,
        rule=rule,
        oracle=decides,
    )
    if source.size > working:
        fewest = int(max(least / float(np.prod(size)), FEWEST))
        labels, table = segment_large(
            source,
            size,
            find,
            tell,
            working=working,
            foreground=way,
            grainy=grainy,
            fewest=fewest,
            oracle=oracle,
            out=out,
        )
        tell(1.0, f"{len(table)} objects")
        return Segmentation(labels, table)
    density = checked_volume(np.asarray(source.array))
    labels = find(density, size, tell)
    tell(0.95, "Measuring objects")
    table = object_table(labels, density, size, oracle)
    if out is not None:
        out[...] = labels
        labels = out
    tell(1.0, f"{len(table)} objects")
    return Segmentation(labels, table)


def segment_grid(
    density: NDArray[np.generic],
    spacing: Spacing,
    tell: Progress,
    *,
    foreground: str | float = "hysteresis",
    method: str = "learned",
    smallest: float = SMALLEST,
    supports: bool = True,
    shell: bool = True,
    grainy: bool | None = None,
    step: float = 0.11,
    rule: SplitRule | None = None,
    oracle: Oracle | None = None,
) -> NDArray[np.int32]:
    """Find the objects of a volume that is small enough to be worked on whole.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Checked density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    tell : callable
        Progress.
    foreground, method, smallest, supports, shell, grainy, step, rule, oracle
        As for `segment`.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        1, 2, ... from the largest object to the smallest; 0 is background.

    Raises
    ------
    ValueError
        If nothing is found.
    """
    given, hidden = density, looks_grainy(density, foreground) if grainy is None else grainy
    if hidden:
        tell(0.0, "Taking noise and haze away")
        density, foreground = cleared(density, spacing, foreground), "hysteresis"
        supports = shell = False
    if method == "learned":
        labels = seen_objects(
            density,
            spacing,
            tell,
            foreground=foreground,
            supports=supports,
            shell=shell,
            smallest=smallest,
            # What haze is taken from has no densities to go by.
            steps=not hidden,
        )
        if not hidden:
            labels = gather_wires(labels, density)
            labels = take_out_inclusions(labels, density, spacing, smallest)
    else:
        decides = oracle or default_oracle()
        parts, scale = split_parts(
            density,
            spacing,
            tell,
            decides,
            foreground=foreground,
            supports=supports,
            shell=shell,
            step=step,
            rule=rule or SplitRule(smallest=2 * smallest),
        )
        # The knee is a quarter of the foreground's median density above air.
        light = scale.air + FOLD_DENSITY * 4 * scale.knee
        parts = absorb_fringes(bundle_folds(parts, density, spacing, light), density, spacing)
        parts = join_touching(parts, density, spacing, decides, tell=tell)
        labels = absorb_small(parts, spacing, max(smallest, FEWEST * float(np.prod(spacing))))
    if hidden:
        labels = to_half_height(labels, given, spacing)
    filled = fill_cavities(labels, spacing, leaky=not hidden)
    labels = rank_labels(filled if hidden else join_hanging(labels, filled, spacing))
    if not labels.any():
        raise ValueError(
            f"nothing found: no object has {smallest:g} mm^3; "
            "pass a smaller smallest= or a lower foreground="
        )
    return labels
