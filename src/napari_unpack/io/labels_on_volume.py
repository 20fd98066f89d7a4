"""Labels of one file on the volume of another, by where both files say that they lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.rays import world_from_voxel
from napari_unpack.io.file_data import FIRST_LABELS, NO_VOXEL_SIZE, FileData, size_text
from napari_unpack.io.scan import Scan
from napari_unpack.io.volumes import load_label_file, printable

_LARGEST_SHIFT = 0.5
"""Voxels between labels and the voxels they are of, at the corner where it is most: rounding."""

_BY_VOXEL = "they were laid over it voxel by voxel"


def scan_with_label_file(
    scan: Scan, path: Path, large: bool = False, at: Mapping[str, int] | None = None
) -> Scan:
    """Return a scan with the labels of a file, turned onto it where both say how they lie.

    Parameters
    ----------
    scan : Scan
    path : Path
        What `load_labels` reads.
    large : bool
        As for `load_volume`.
    at : mapping of str to int, optional
        As for `load_labels`.

    Returns
    -------
    Scan
        Without names. Where the labels do not lie on the volume, are of the first of several time
        points, or have a voxel size that it lacks, `assumed` says so.

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_labels` and `Scan.with_labels`.
    """
    whole = FileData(scan.volume, spacing=scan.spacing, scanner_from_scan=scan.scanner_from_scan)
    found = load_label_file(path, large, at)
    labels, said = laid_over(found, whole)
    labels = np.ascontiguousarray(labels)
    told = [words for words in found.assumed if words.startswith(FIRST_LABELS)]
    told += [f"its labels ({printable(path.name)}) {said}"] if said else []
    if NO_VOXEL_SIZE in scan.assumed and NO_VOXEL_SIZE not in found.assumed and not said:
        size = size_text(found.spacing)
        told.append(f"its labels ({printable(path.name)}) give {size} where 1 mm was assumed")
    return replace(scan.with_labels(labels), assumed=(*scan.assumed, *told))


def laid_over(labels: FileData, volume: FileData) -> tuple[NDArray[Any], str]:
    """Return labels as they lie over a volume, and what is to be told of it.

    Labels that another program saved with the axes of space in another order or direction are
    turned by swaps and flips, never by interpolation. Where a file does not say how it lies, or
    they lie otherwise, labels stay as they are.

    Parameters
    ----------
    labels : FileData
        With labels.
    volume : FileData
        With a volume, axes z, y, x.

    Returns
    -------
    labels : (Z, Y, X) ndarray of int
        The same array where it was not turned, else a view of it.
    told : str
        That they lie elsewhere, to follow what they are called; empty where they fit.
    """
    array = labels.labels
    assert array is not None, "callers have read them"
    assert volume.volume is not None, "callers have read it"
    theirs, ours = labels.scanner_from_scan, volume.scanner_from_scan
    if theirs is None or ours is None:
        return array, ""
    scanner_from_label = theirs @ world_from_voxel(labels.spacing)
    voxel_from_label = np.linalg.inv(ours @ world_from_voxel(volume.spacing)) @ scanner_from_label
    turned = _turned(array, voxel_from_label, volume.volume.shape)
    if turned is not None:
        return turned, ""
    size, wanted = size_text(labels.spacing), size_text(volume.spacing)
    if size != wanted:
        return array, f"have voxels of {size} and not of {wanted}: {_BY_VOXEL}"
    return array, f"lie elsewhere in the scanner than its volume: {_BY_VOXEL}"


def _turned(
    array: NDArray[Any], voxel_from_label: Matrix, shape: tuple[int, ...]
) -> NDArray[Any] | None:
    """Return labels by the voxels that they lie on, None where they lie on none."""
    signs = np.rint(voxel_from_label[:3, :3])
    if not np.array_equal(np.abs(signs) @ np.ones(3), np.ones(3)):
        return None
    # For each axis of the volume: which axis of the labels, and in which direction.
    order = np.abs(signs).argmax(axis=1)
    flips = tuple(slice(None, None, -1 if signs[k, n] < 0 else 1) for k, n in enumerate(order))
    if len(set(order.tolist())) < 3 or tuple(array.shape[n] for n in order) != shape:
        return None
    corners = np.array(list(product(*((0, n - 1) for n in array.shape))))
    there = corners @ voxel_from_label[:3, :3].T + voxel_from_label[:3, 3]
    starts = [n - 1 if flip.step < 0 else 0 for n, flip in zip(shape, flips, strict=True)]
    if np.abs(there - (corners @ signs.T + starts)).max() > _LARGEST_SHIFT:
        return None
    # As it is where nothing is to be done: callers see by that whether it was turned.
    straight = order.tolist() == [0, 1, 2] and not any(starts)
    return array if straight else array.transpose(order)[flips]
