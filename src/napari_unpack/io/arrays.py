"""numpy's own files: .npz with `volume`, `labels`, `spacing`, `names` ..., and bare .npy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.file_sizes import check_array, check_size, load_arrays
from napari_unpack.geometry.axes import Matrix, voxel_size
from napari_unpack.geometry.transforms import checked_place
from napari_unpack.io.file_data import NO_VOXEL_SIZE, SPACE, FileData
from napari_unpack.io.scan import (
    Scan,
    Spacing,
    check_one_shape,
    checked_label_array,
    checked_volume_array,
)
from napari_unpack.read_errors import read_errors_told

_TEXTS = ("names", "names_of_ids", "assumed")
"""Arrays of text, without which a volume is one all the same."""

LAST_ROW = 65_535
"""The largest ID up to which names have a row for every ID, as tables in memory do."""


def read_npz(path: Path, large: bool = False) -> FileData:
    """Read what an .npz archive holds; without a voxel size it is 1 mm.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError
        If the file is broken or holds neither key.
    """
    # The other keys for the message alone: who wrote `image` for `volume` sees it at once.
    wanted = ("volume", "labels", "spacing", "scanner_from_scan", *_TEXTS)
    arrays, keys = load_arrays(path, wanted, large, _TEXTS)
    if not {"volume", "labels"} & arrays.keys():
        raise ValueError(f"{path} must hold an array 'volume' or 'labels', got {keys}")
    volume, labels = arrays.get("volume"), arrays.get("labels")
    if volume is not None:
        volume = checked_volume_array(volume, f"'volume' of {path}")
    if labels is not None:
        labels = checked_label_array(labels, f"'labels' of {path}")
    if volume is not None and labels is not None:
        check_one_shape(volume, labels, path)
    assumed = _sentences(arrays.get("assumed")) if "spacing" in arrays else (NO_VOXEL_SIZE,)
    if "names" in keys and "names" not in arrays:
        assumed += ("its names are no plain text: they were left out",)
    spacing = voxel_size(arrays.get("spacing", np.ones(3)), path)
    place = checked_place(arrays.get("scanner_from_scan"), path)
    return FileData(volume, SPACE, spacing, labels, assumed, place, volume is not None)


def _sentences(told: NDArray[Any] | None) -> tuple[str, ...]:
    # As with names, another array of this name is none of ours.
    if told is None or told.dtype.kind != "U" or told.ndim != 1:
        return ()
    return tuple(str(sentence) for sentence in told)


def read_names(path: Path) -> dict[int, str] | None:
    """Read what the objects of a readable .npz archive are called.

    Returns
    -------
    dict of int to str, or None
        By ID, from an array `names` of text whose element k belongs to ID k, or from
        `names_of_ids` with the IDs beside it in `named_ids`; None where there is neither.
    """
    with read_errors_told(path):
        arrays, _ = load_arrays(path, (*_TEXTS, "named_ids"), texts=_TEXTS)
    names = arrays.get("names", arrays.get("names_of_ids"))
    # Other arrays of these names are none of ours, and no reason to refuse the volume.
    if names is None or names.dtype.kind != "U" or names.ndim != 1:
        return None
    ids = np.arange(len(names)) if "names" in arrays else arrays.get("named_ids")
    if ids is None or ids.dtype.kind not in "ui" or ids.shape != names.shape:
        return None
    return {int(i): str(name) for i, name in zip(ids, names, strict=True) if i and name}


def write_npz(path: Path, scan: Scan) -> None:
    """Write a scan as a compressed .npz archive.

    Parameters
    ----------
    path : Path
        The file, .npz.
    scan : Scan
        What to write.
    """
    arrays: dict[str, NDArray[Any]] = {"volume": scan.volume, "spacing": np.asarray(scan.spacing)}
    if scan.labels is not None:
        arrays["labels"] = scan.labels
    arrays |= _names_arrays(scan.names or {})
    if scan.assumed:
        arrays["assumed"] = np.array(scan.assumed, dtype=np.str_)
    if scan.scanner_from_scan is not None:
        arrays["scanner_from_scan"] = scan.scanner_from_scan
    # Into a stream: to a name that does not end in lower case numpy adds a suffix.
    with written_atomically(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def _names_arrays(names: Mapping[int, str]) -> dict[str, NDArray[Any]]:
    if not names:
        return {}
    if max(names) > LAST_ROW:
        ids = sorted(names)
        texts = np.array([names[i] for i in ids], dtype=np.str_)
        # Not called `names`, which older versions would give to IDs 0, 1, 2 ...
        return {"named_ids": np.array(ids, dtype=np.uint64), "names_of_ids": texts}
    # By position, so that a plain array of text needs no table of IDs beside it.
    rows = [names.get(i, "") for i in range(max(names) + 1)]
    return {"names": np.array(rows, dtype=np.str_)}


def write_labels_npz(
    path: Path,
    labels: NDArray[Any],
    spacing: Spacing,
    scanner_from_scan: Matrix | None = None,
) -> None:
    """Write labels alone as a compressed .npz archive, which `load_labels` reads.

    Parameters
    ----------
    path : Path
        The file, .npz.
    labels : (Z, Y, X) ndarray of int
    spacing : (float, float, float) of mm, z y x
    scanner_from_scan : (4, 4) ndarray of float64, optional
        As in a `Scan`.
    """
    arrays = {"labels": labels, "spacing": np.asarray(spacing)}
    if scanner_from_scan is not None:
        arrays["scanner_from_scan"] = scanner_from_scan
    with written_atomically(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_npy(path: Path, large: bool = False) -> FileData:
    """Read a bare array, which says nothing of its voxels: 1 mm.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError
        If the file is broken.
    """
    stored = path.stat().st_size
    with path.open("rb") as stream:
        check_size(path, check_array(stream, path, stored), stored, large=large)
    array: NDArray[Any] = np.load(path, allow_pickle=False)
    return FileData(checked_volume_array(array, path), assumed=(NO_VOXEL_SIZE,))
