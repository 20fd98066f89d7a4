"""The merge pass: undo what splitting took apart but the world keeps together."""

from __future__ import annotations

from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.validation import Spacing


@dataclass(frozen=True, eq=False)
class Contacts:
    """Who touches whom, and over how much.

    Parameters
    ----------
    area : (M, M) ndarray of float64
        Area in mm^2 of the faces between labels, symmetric; row and column 0 are background,
        including the border of the volume. Labels must be few: memory is quadratic in them.
    volume : (M,) ndarray of float64
        mm^3.
    thickness : (M,) ndarray of float64
        Twice the mean depth of a label's voxels times 2: the thickness of a plate, mm.
    """

    area: NDArray[np.float64]
    volume: NDArray[np.float64]
    thickness: NDArray[np.float64]

    @property
    def surface(self) -> NDArray[np.float64]:
        """Return the whole surface of every label, mm^2."""
        return np.asarray(self.area.sum(axis=1))


def measure_contacts(labels: NDArray[np.int32], spacing: Spacing) -> Contacts:
    """Measure labels and their contacts.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Labels, 0 background.
    spacing : (float, float, float)
        Voxel size z y x, mm.

    Returns
    -------
    Contacts
    """
    found = find_neighbours(labels, spacing)
    count = len(found.voxels)
    area = np.zeros((count, count))
    area[np.repeat(np.arange(count), np.diff(found.start)), found.other] = found.area
    # What of a surface touches no label, background touches.
    area[0] = area[:, 0] = found.surface - area.sum(axis=1)
    deep = edt.edt(labels, anisotropy=spacing, black_border=True)
    depths = np.bincount(labels.reshape(-1), deep.reshape(-1), count)
    # A plate of thickness t has mean depth t / 4.
    thickness = np.asarray(4 * depths / np.maximum(found.voxels, 1), np.float64)
    return Contacts(area, found.voxels * np.float64(np.prod(spacing)), thickness)


def absorb_small(
    labels: NDArray[np.int32],
    spacing: Spacing,
    smallest: float,
    kept: NDArray[np.bool_] | None = None,
) -> NDArray[np.int32]:
    """Join labels below a volume to the neighbour they touch most; drop those with none.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects. Not changed.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    smallest : float
        mm^3.
    kept : (M,) ndarray of bool, optional
        Labels that stay although they are small, and take in nothing while they are.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    found = find_neighbours(labels, spacing)
    volume = found.voxels * float(np.prod(spacing))
    spared = np.zeros(len(volume), np.bool_) if kept is None else kept
    most = found.most_touched(spared & (volume < smallest))
    owner = np.arange(len(most))
    order = np.argsort(volume[1:], kind="stable") + 1
    for name in order[(volume[order] < smallest) & ~spared[order]].tolist():
        other = int(most[name])
        owner[name] = other if _root(owner, other) != name else 0
    return np.array([_root(owner, k) for k in range(len(owner))], np.int32)[labels]


def absorb_fringes(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    ragged: float = 2.4,
) -> NDArray[np.int32]:
    """Share labels that are all surface, around something denser, among their neighbours.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts. Not changed.
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    ragged : float
        Faces a voxel; a flat sheet of one layer has 2.

    Returns
    -------
    (Z, Y, X) ndarray of int32

    Notes
    -----
    The blurred edge of a dense thing, where noise carries some voxels over a density step and
    leaves others, is a lace of voxels around it.
    """
    found = find_neighbours(labels, spacing)
    face = float(np.prod(spacing)) ** (2 / 3)
    voxels, most = found.voxels, found.most_touched()
    lace = found.surface > ragged * face * np.maximum(voxels, 1)
    values = np.nan_to_num(density.reshape(-1).astype(np.float32))
    mean = np.bincount(labels.reshape(-1), values, len(lace)) / np.maximum(voxels, 1)
    # A thin wire in cloth is all surface too, but denser than what it lies in.
    lace &= (most > 0) & (mean[most] > 1.1 * mean)
    lace[0] = False
    if not lace.any():
        return labels
    rest = np.where(lace[labels], 0, labels).astype(np.int32, copy=False)
    grown = flood(rest, labels > 0)
    return np.where(grown > 0, grown, labels)


def _root(owner: NDArray[np.int64], k: int) -> int:
    seen = 0
    while owner[k] != k and seen < len(owner):
        k, seen = int(owner[k]), seen + 1
    return k
