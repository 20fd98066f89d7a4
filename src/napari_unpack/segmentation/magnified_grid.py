"""Magnified grids: cells between the voxels, where voxels are too coarse or too thick."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import prod
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum

from napari_unpack.segmentation.common.depths import label_depths
from napari_unpack.segmentation.common.joins import Steps
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.thresholds import NothingFoundError
from napari_unpack.segmentation.object_table import rank_labels
from napari_unpack.segmentation.working_grid import WORKING_VOXELS, Factors
from napari_unpack.tasks import Share

# Cells from the surface to the middle of an object. Where half of all objects are thinner, twice
# as many cells along each axis find more of them: of bags that win by it the median was 7.0 at
# most, of bags that lose by it 7.5 at least.
LEAST_DEPTH = 7.2
# Where they are thinner than that, hardly any are found without it.
LOST_DEPTH = 5.0
# Of a voxel, by which cells lie beside the places between voxels: half-way between air and matter
# a cell would be exactly at the height of an edge, and rounding would decide about it.
ASIDE = 1 / 1024

T = TypeVar("T", bound=np.generic)


class FindNoted(Protocol):
    """Find the objects of a grid, and note the steps on the way."""

    def __call__(
        self, density: NDArray[np.generic], spacing: Spacing, share: Share, *, noted: Steps
    ) -> NDArray[np.int32]:
        """Return labels, 0 is background.

        Parameters
        ----------
        density : (Z, Y, X) ndarray
        spacing : (float, float, float) of mm, z y x
        share : Share
        noted : Steps
        """
        ...


def find_magnified(
    density: NDArray[np.generic],
    spacing: Spacing,
    find: FindNoted,
    share: Share,
    noted: Steps,
    most: int = WORKING_VOXELS,
) -> NDArray[np.int32]:
    """Find objects on a grid of near cubes, and on a finer one where they are thin in it.

    The boundary network and the classifiers learned from cubes, and from objects some twenty of
    them wide.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    find : FindNoted
    share : Share
    noted : Steps
        Empty; filled for the voxels.
    most : int
        Cells at most.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        Of the voxels, from the largest object to the smallest; 0 is background.

    Raises
    ------
    NothingFoundError
        If nothing is found.
    """
    factors = _near_cubes(density.shape, spacing, most)
    z, y, x = (f if n == 1 else 2 * f for f, n in zip(factors, density.shape, strict=True))
    twice = z, y, x
    # The second look takes eight times as long as the first.
    wanted = _cells(density.shape, twice)
    room = wanted <= most
    if room:
        # Of one type at both looks: kernels are compiled by type.
        density = density.astype(np.float32, copy=False)
    labels, steps = _found(density, spacing, find, factors, share.part(0.0, 0.15 if room else 1.0))
    deep = LEAST_DEPTH if wanted <= most / 2 else LOST_DEPTH
    if room and typical_depth(labels) < deep:
        # Specks that are nothing on closer sight are what there is.
        with suppress(NothingFoundError):
            labels, steps = _found(density, spacing, find, twice, share.part(0.15, 1.0))
            factors = twice
    labels = rank_labels(at_voxels(labels, factors))
    noted.levels = [replace(level, names=at_voxels(level.names, factors)) for level in steps.levels]
    if steps.seen is not None:
        matter = at_voxels(steps.seen.matter, factors)
        noted.seen = replace(
            steps.seen, density=at_voxels(steps.seen.density, factors), matter=matter
        )
    if not labels.any():
        raise NothingFoundError("nothing found: every object is thinner than a voxel")
    return labels


def magnified(density: NDArray[np.generic], factors: Factors) -> NDArray[np.generic]:
    """Return a volume with cells between its voxels, linearly interpolated.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    factors : (int, int, int)
        Steps from one voxel to the next, z y x.

    Returns
    -------
    ndarray
        Of (n - 1) * factor + 1 cells along each axis, float32 unless nothing is between voxels:
        voxels are cells.
    """
    for axis, factor in enumerate(factors):
        count = density.shape[axis]
        if factor == 1 or count == 1:
            continue
        wide = np.moveaxis(density, axis, 0).astype(np.float32)
        finer = np.empty(((count - 1) * factor + 1, *wide.shape[1:]), np.float32)
        for step in range(factor):
            share = np.float32(max(step / factor - ASIDE, 0))
            finer[step:-1:factor] = wide[:-1] + (wide[1:] - wide[:-1]) * share
        finer[-1] = wide[-1]
        density = np.ascontiguousarray(np.moveaxis(finer, 0, axis))
    return density


def at_voxels(cells: NDArray[T], factors: Factors) -> NDArray[T]:
    """Return a magnified grid at the voxels.

    Parameters
    ----------
    cells : ndarray
    factors : (int, int, int)
        As given to `magnified`.
    """
    z, y, x = factors
    return np.ascontiguousarray(cells[::z, ::y, ::x])


def typical_depth(labels: NDArray[np.int32]) -> float:
    """Return how far the middle of the median object lies from its surface, cells.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background; there is one object at least. What goes on beyond the volume has no
        surface there.
    """
    depths = label_depths(labels, black_border=False)
    deepest = maximum(depths, labels, np.unique(labels[labels > 0]))
    return float(np.median(deepest))


def _found(
    density: NDArray[np.generic], spacing: Spacing, find: FindNoted, factors: Factors, share: Share
) -> tuple[NDArray[np.int32], Steps]:
    z, y, x = (s / f for s, f in zip(spacing, factors, strict=True))
    steps = Steps()
    return find(magnified(density, factors), (z, y, x), share, noted=steps), steps


def _near_cubes(shape: tuple[int, ...], spacing: Spacing, most: int) -> Factors:
    """Return how many cells a voxel is to have along each axis, so that cells are near cubes."""
    sides = [s for s, n in zip(spacing, shape, strict=True) if n > 1]
    finest = min(sides, default=1.0)
    wanted = [1 if n == 1 else round(s / finest) for s, n in zip(spacing, shape, strict=True)]
    while _cells(shape, wanted) > most and max(wanted) > 1:
        wanted[int(np.argmax(wanted))] -= 1
    z, y, x = wanted
    return z, y, x


def _cells(shape: tuple[int, ...], factors: Sequence[int]) -> int:
    return prod((n - 1) * f + 1 for n, f in zip(shape, factors, strict=True))
