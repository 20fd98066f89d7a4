"""Folders in which every slice of a volume is a TIFF of its own."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.file_data import SPACE, FileData
from napari_unpack.io.file_stack import check_stack_size
from napari_unpack.io.volumes import (
    DICOM_SUFFIXES,
    TIFF_SUFFIXES,
    has_dicom_preamble,
    read_file,
    suffix_of,
)


def slices_in(folder: Path) -> list[Path]:
    """Return the TIFFs of a folder by the numbers in their names; none where there is DICOM too."""
    files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
    slices = [p for p in files if suffix_of(p) in TIFF_SUFFIXES]
    if len(slices) < 2:
        return []
    # Pictures beside a series are not the scan.
    others = [p for p in files if suffix_of(p) not in TIFF_SUFFIXES]
    if any(suffix_of(p) in DICOM_SUFFIXES or has_dicom_preamble(p) for p in others):
        return []
    return sorted(slices, key=_by_numbers)


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    # 10 after 9, whether or not there are zeros before it.
    parts = re.findall(r"[0-9]+|[^0-9]+", path.name.lower())
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def read_slices(folder: Path, large: bool = False) -> FileData:
    """Read a folder of slices, see `slices_in`, as one volume with the voxel size of the first.

    Parameters
    ----------
    folder : Path
    large : bool
        As for `check_size`.

    Raises
    ------
    ValueError
        If one of them is no grey picture, or they differ in size or type.
    """
    paths = slices_in(folder)
    check_stack_size(paths, large)
    first = read_file(paths[0], large)
    planes: list[NDArray[Any]] = []
    for path in paths:
        volume = read_file(path, large).volume
        assert volume is not None, "a TIFF holds nothing else"
        # ImageJ's may say that it is a stack of one.
        plane = volume.squeeze()
        if plane.ndim != 2:
            raise ValueError(
                f"the TIFFs in {folder} must be slices, one grey picture each, and {path.name} has "
                f"the shape {volume.shape}: name a file instead of its folder"
            )
        if planes and (plane.shape, plane.dtype) != (planes[0].shape, planes[0].dtype):
            raise ValueError(
                f"the slices in {folder} must have one size and type: {path.name} is "
                f"{_described(plane)}, {paths[0].name} {_described(planes[0])}"
            )
        planes.append(plane)
    order = f"its {len(paths)} slices are in the order of the numbers in their names"
    return replace(first, volume=np.stack(planes), axes=SPACE, assumed=(order, *first.assumed))


def _described(plane: NDArray[Any]) -> str:
    return f"{' x '.join(map(str, plane.shape))} of {plane.dtype}"
