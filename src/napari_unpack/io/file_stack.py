"""Several files that are opened as one: the time points of a series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.file_sizes import asked_size, check_size
from napari_unpack.io.file_data import SPACE, FileData, size_text
from napari_unpack.io.volumes import read_file

Named = tuple[FileData, Mapping[int, str]]
"""What a file holds, and what its objects are called."""

SAME_PLACE_MM = 1e-3
"""Files round where a scan lies."""


def check_stack_size(paths: Sequence[Path], large: bool) -> None:
    """Refuse files that would fill the memory together, before they are read.

    Parameters
    ----------
    paths : sequence of Path
        Taken to be as large as the first.
    large : bool
        As for `load_volume`.

    Raises
    ------
    TooLargeError, FileNotFoundError, ValueError, ImportError
        As for `load_volume`.
    """
    needed = len(paths) * (asked_size(lambda: read_file(paths[0])) or 0)
    # What each of them may become of its bytes is asked when it is read.
    check_size(f"the stack of {paths[0].name}", needed, needed, large=large)


def stacked(paths: Sequence[Path], read: Sequence[Named]) -> Named:
    """Return files as one, along a new first axis.

    Parameters
    ----------
    paths : sequence of Path
        For messages.
    read : sequence of (FileData, mapping of int to str)
        What each holds.

    Raises
    ------
    ValueError
        If they differ in more than their voxels, or hold labels beside several channels.
    """
    first = read[0][0]
    if first.volume is not None and first.labels is not None and first.axes != SPACE:
        raise ValueError(
            f"{paths[0].name} cannot be stacked: it holds labels beside the axes {first.axes}"
        )
    names: dict[int, str] = {}
    for path, (found, theirs) in zip(paths, read, strict=True):
        reason = _difference(first, found)
        clash = next((i for i in theirs if names.get(i, theirs[i]) != theirs[i]), None)
        if clash is not None:
            reason = f"its object {clash} is {theirs[clash]!r}, not {names[clash]!r}"
        if reason:
            raise ValueError(f"{path.name} cannot be stacked on {paths[0].name}: {reason}")
        names |= theirs
    files = [found for found, _ in read]
    one = replace(
        first,
        volume=_stack([file.volume for file in files]),
        labels=_stack([file.labels for file in files]),
        # Files that hold time points themselves are stacked along something else.
        axes=("n" if "t" in first.axes else "t") + first.axes,
        assumed=tuple(dict.fromkeys(words for file in files for words in file.assumed)),
    )
    return one, names


def _stack(arrays: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    there = [array for array in arrays if array is not None]
    if len({array.dtype for array in there}) > 1 and all(a.dtype.kind in "iu" for a in there):
        # Of signed and unsigned ones numpy would make floats, which are no labels.
        there = [array.astype(np.int64) for array in there]
    return np.stack(there) if there else None


def _difference(first: FileData, other: FileData) -> str:
    """Say in which of its facts a file is not as the first; nothing where it is."""
    for (what, ours), theirs in zip(_facts(first).items(), _facts(other).values(), strict=True):
        if ours != theirs:
            return f"its {what} is {theirs}, not {ours}"
    a, b = first.scanner_from_scan, other.scanner_from_scan
    alike = a is b if a is None or b is None else np.allclose(a, b, atol=SAME_PLACE_MM)
    return "" if alike else "it lies elsewhere in the scanner"


def _facts(file: FileData) -> dict[str, str]:
    return {
        "volume": _extent(file.volume),
        "label volume": _extent(file.labels),
        "order of axes": file.axes,
        "voxel size": size_text(file.spacing),
    }


def _extent(array: NDArray[Any] | None) -> str:
    return "none" if array is None else " x ".join(map(str, array.shape))
