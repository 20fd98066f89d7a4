"""Folders in which every slice of a volume is a TIFF of its own."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.file_data import SPACE, FileData
from napari_unpack.io.file_stack import check_stack_size
from napari_unpack.io.volumes import (
    TIFF_SUFFIXES,
    holds_dicom,
    read_file,
    suffix_of,
    without_labels,
)
from napari_unpack.read_errors import read_errors_told


def slices_in(folder: Path) -> list[Path]:
    """Return the slices of a folder in the order of the numbers in their names; none without two.

    They are its TIFFs, if the first two are grey pictures of one size: photographs and stacks are
    no slices. Pictures beside or above a DICOM series are not the scan.

    Parameters
    ----------
    folder : Path
    """
    try:
        files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
    except OSError:
        # Whoever reads it says why.
        return []
    tiffs = without_labels(p for p in files if suffix_of(p) in TIFF_SUFFIXES)
    slices = sorted(tiffs, key=_by_numbers)
    kinds = {_kind(path) for path in slices[:2]}
    if len(slices) < 2 or len(kinds) > 1 or None in kinds or holds_dicom(folder):
        return []
    return slices


def is_slice(path: Path) -> bool:
    """Tell whether a TIFF is a single grey picture, by its header."""
    return _kind(path) is not None


def _kind(path: Path) -> tuple[tuple[int, ...], str] | None:
    """Return size and type of a TIFF that is a single grey picture, None for any other."""
    import tifffile

    with suppress(OSError, ValueError), read_errors_told(path), tifffile.TiffFile(path) as file:
        # Not by its series: of OME they may be files of any place, which would be opened.
        if len(file.pages) == 1 and file.pages.first.axes == "YX":
            return file.pages.first.shape, str(file.pages.first.dtype)
    return None


def _doubts(paths: list[Path]) -> list[str]:
    """Return what the names of slices, which are in order, say against their being one scan."""
    kinds: dict[str, str] = {}
    for path in paths:
        kinds.setdefault(re.sub(r"[0-9]+", "0", path.name), path.name)
    if len(kinds) > 1:
        first, second = [*kinds.values()][:2]
        return [
            f"names such as {first} and {second} are of {len(kinds)} kinds: if these are several "
            "scans, give each a folder"
        ]
    numbers = [[int(part) for part in re.findall(r"[0-9]+", path.name)] for path in paths]
    varying = [column for column in zip(*numbers, strict=True) if len(set(column)) > 1]
    if len(varying) != 1:
        return []
    steps = np.diff(varying[0])
    # Every second slice alone has no gaps.
    usual = int(np.median(steps))
    wide = np.flatnonzero(steps > usual)
    if not usual or not wide.size:
        return []
    missing = int((steps[wide] // usual - 1).sum())
    return [
        f"going by the names, {missing} slices are missing, the first after "
        f"{paths[wide[0]].name}: what is beside a gap stands too close together"
    ]


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    # 10 after 9, whether or not there are zeros before it.
    parts = re.findall(r"[0-9]+|[^0-9]+", path.name.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


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
    assumed = (order, *_doubts(paths), *first.assumed)
    return replace(first, volume=np.stack(planes), axes=SPACE, assumed=assumed)


def _described(plane: NDArray[Any]) -> str:
    return f"{' x '.join(map(str, plane.shape))} of {plane.dtype}"
