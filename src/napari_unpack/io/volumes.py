"""Open and save volumes in any known format."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import check_space, check_writable, checked_target, given_path
from napari_unpack.file_sizes import check_plain_file
from napari_unpack.io.arrays import read_names, read_npy, read_npz, write_npz
from napari_unpack.io.file_data import FIRST_LABELS, FileData, checked_element
from napari_unpack.io.scan import Scan, Spacing, checked_label_array, checked_scan
from napari_unpack.read_errors import read_errors_told

LABELS = ".labels"
"""Ends the stem of a file with the labels of the volume beside it, as `save_scan` writes them."""

# Headers of two-file formats (.mhd, .nhdr) are read but not written: one volume, one file.
ITK_SUFFIXES = (".nii", ".nii.gz", ".mha", ".mhd", ".nrrd", ".nhdr")
TIFF_SUFFIXES = (".tif", ".tiff")
DICOM_SUFFIXES = (".dcm", ".dicom", ".dcs", ".dicos", ".ima")
READABLE = (".npz", ".npy", *ITK_SUFFIXES, *TIFF_SUFFIXES, *DICOM_SUFFIXES, ".zarr")
WRITABLE = (".npz", ".nii", ".nii.gz", ".mha", ".nrrd", *TIFF_SUFFIXES)


def suffix_of(path: Path) -> str:
    """Return the format's suffix in lower case, `.nii.gz` being one."""
    name = path.name.lower()
    return ".nii.gz" if name.endswith(".nii.gz") else Path(name).suffix


def stem_of(path: Path) -> str:
    """Return the file's name without the format's suffix."""
    return path.name[: len(path.name) - len(suffix_of(path))]


def printable(text: str) -> str:
    """Return a text that files and terminals take: names of files may hold what is no UTF-8."""
    return text.encode("utf-8", "replace").decode()


def load_volume(path: str | Path, at: Mapping[str, int] | None = None, large: bool = False) -> Scan:
    """Open a volume.

    Where NIfTI, NRRD or MetaImage gives axis directions, the array is turned by flips and swaps,
    never by interpolation: z to the feet, y to the back, x to the left. Slices of DICOM begin with
    the highest along their normal, which of axial ones is that at the head. `Scan.turned` says that
    an array is not in the order of its file, `Scan.scanner_from_scan` how it lies.

    Parameters
    ----------
    path : str or Path
        .npz (`volume`, and optionally `labels`, `spacing` and `names`), .npy, NIfTI, MetaImage,
        NRRD, TIFF stack or a folder of slices in TIFF, DICOM (a folder, or a file of the series),
        DICOS, OME-Zarr folder.
    at : mapping of str to int, optional
        Which channel or time point, such as ``{"c": 1, "t": 0}``, where a file has several.
    large : bool
        Read it even where it asks for more memory than is free, or for far more than it holds.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the format is unknown, the file is broken, what it holds is not a volume, or it holds
        several and none is chosen. A `TooLargeError` where it is refused without `large`.
    ImportError
        If the format needs a package that is not installed; the message says which.
    """
    found = read_file(path, large).one_volume(at or {}, path)
    if found.volume is None:
        raise ValueError(f"{path} holds labels without a volume; open it with load_labels")
    file = given_path(path)
    names = read_names(file) if found.labels is not None and suffix_of(file) == ".npz" else None
    return Scan(
        found.volume,
        found.spacing,
        found.labels,
        printable(stem_of(file)),
        names,
        found.assumed,
        found.scanner_from_scan,
        found.turned,
    )


def load_labels(
    path: str | Path, large: bool = False, at: Mapping[str, int] | None = None
) -> tuple[NDArray[Any], Spacing]:
    """Open a (Z, Y, X) label volume and its voxel size, mm z y x.

    They are as their file has them, which may be along other axes than a volume's:
    `labels_on_volume.scan_with_label_file` lays them over one.

    Parameters
    ----------
    path : str or Path
        As for `load_volume`. Of an .npz or OME-Zarr with both, the labels are taken; those of the
        first time point where each has its own and none is chosen.
    large : bool
        As for `load_volume`.
    at : mapping of str to int, optional
        Which channel or time point, where a file has several; axes that it lacks are passed over.

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_volume`, if it holds no whole numbers, if it is an .npz of a volume without
        labels, and if its labels are of another shape than its volume. An OME-Zarr image without
        labels is taken for labels: many programs write theirs without saying so.
    """
    found = load_label_file(path, large, at)
    assert found.labels is not None, "it was checked"
    return found.labels, found.spacing


def load_label_file(
    path: str | Path, large: bool = False, at: Mapping[str, int] | None = None
) -> FileData:
    """Open a label volume with all that its file says of it.

    Parameters
    ----------
    path, large, at : see `load_labels`

    Returns
    -------
    FileData
        Without a volume; `axes` are those of the file, before one of its volumes was chosen.

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_labels`.
    """
    found = read_file(path, large)
    if found.labels is None and found.is_density:
        raise ValueError(f"{path} holds a volume without labels that fit it: name a file of labels")
    chosen = {axis: element for axis, element in (at or {}).items() if axis in found.axes}
    array = found.labels if found.labels is not None else found.one_volume(chosen, path).volume
    assert array is not None, "every reader gives one of them"
    assumed = found.assumed
    if found.labels is not None and "t" in found.axes and array.ndim == 4:
        if "t" not in chosen:
            assumed += (f"{FIRST_LABELS} {len(array)} time points",)
        array = array[checked_element("t", chosen.get("t", 0), len(array), path)]
    labels = checked_label_array(array, path)
    return replace(found, volume=None, labels=labels, assumed=assumed)


def save_scan(scan: Scan, path: str | Path) -> list[Path]:
    """Save a scan.

    Parameters
    ----------
    scan : Scan
        What to save.
    path : str or Path
        .npz holds all of it; .nii, .nii.gz, .mha, .nrrd and .tif hold the volume, and the
        labels go into a file of their own beside it, `NAME.labels.SUFFIX`. IDs up to 65,535 are
        written as uint16, or uint8 where they are such.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    ValueError
        If the format cannot be written, or the scan is none that `load_volume` would read.
    ImportError
        If the format needs a package that is not installed.
    """
    scan = checked_scan(scan)
    scan = scan if scan.labels is None else replace(scan, labels=_narrow(scan.labels))
    file = checked_target(path)
    suffix = suffix_of(file)
    if suffix == ".npz":
        write_npz(file, scan)
        return saved_files(file)
    if suffix not in WRITABLE:
        raise ValueError(f"{path}: can write {', '.join(WRITABLE)}, not {suffix or 'no suffix'!r}")
    if scan.labels is None:
        _write(file, scan.volume, scan)
        return [file]
    file, beside = saved_files(file)
    # Before the volume takes the place of one that has labels.
    _try(beside, scan.labels)
    _write(file, scan.volume, scan)
    _write(beside, scan.labels, scan)
    return [file, beside]


def _narrow(labels: NDArray[Any]) -> NDArray[Any]:
    # TIFF takes no wider ones, and every format takes these.
    fits = np.can_cast(labels.dtype, np.uint16) or labels.max() >= 2**16
    return labels if fits else labels.astype(np.uint16)


def _try(file: Path, array: NDArray[Any]) -> None:
    """Write eight voxels elsewhere: no list of types can fall behind what the writers take."""
    with TemporaryDirectory() as folder:
        corner = np.resize(array[:1, :1, :1], (2, 2, 2))
        save_scan(Scan(corner, (1.0, 1.0, 1.0)), Path(folder) / file.name)


def saved_files(path: Path) -> list[Path]:
    """Return the files that `save_scan` writes of a scan with labels."""
    suffix = suffix_of(path)
    # All formats but this hold one volume a file.
    beside = path.with_name(f"{stem_of(path)}{LABELS}{suffix}")
    return [path] if suffix == ".npz" else [path, beside]


def lost_place(scan: Scan, path: Path) -> str:
    """Return a note where a turned scan goes into a format that says nothing of how it lies.

    Parameters
    ----------
    scan : Scan
    path : Path
        Where it goes.
    """
    if not scan.turned or suffix_of(path) not in TIFF_SUFFIXES:
        return ""
    return (
        "the volume was turned when it was read, and TIFF does not say how it lies: written as "
        "shown, not in the order of the input; .nii.gz, .nrrd, .mha and .npz say it"
    )


def check_savable(path: str | Path, volume: NDArray[Any]) -> None:
    """Refuse what `save_scan` could not save, before the work that makes its labels.

    Parameters
    ----------
    path : str or Path
        Where the scan goes.
    volume : (Z, Y, X) ndarray

    Raises
    ------
    FileNotFoundError, PermissionError
        If nothing can be written there.
    ValueError
        If the format is unknown, or cannot hold numbers of this type.
    OSError
        If the disk has too little space.
    """
    file = checked_target(path)
    check_writable(file)
    _try(file, volume)
    # TIFF is not compressed, and has labels of two bytes beside it. CT deflates to a half or a
    # third; an eighth is refused to nobody who might have enough.
    needed = volume.nbytes + 2 * volume.size
    check_space(file, needed if suffix_of(file) in TIFF_SUFFIXES else needed // 8)


def read_file(path: str | Path, large: bool = False) -> FileData:
    """Read all that a file holds, whatever its axes.

    Parameters
    ----------
    path, large : see `load_volume`

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_volume`.
    """
    file = given_path(path)
    with read_errors_told(file, f"a readable {suffix_of(file) or 'DICOM'} file"):
        if not file.is_dir():
            check_plain_file(file)
        return _reader(file)(file, large)


def is_zarr(folder: Path) -> bool:
    """Tell whether a folder is a Zarr image, by its name or what lies in it."""
    marks = ("zarr.json", ".zgroup", ".zarray")
    # Not Path's own, which raises where nobody may look into the folder.
    return suffix_of(folder) == ".zarr" or any(os.path.exists(folder / mark) for mark in marks)


def holds_dicom(folder: Path) -> bool:
    """Tell whether DICOM lies in a folder or below it, by the first files that are no TIFF."""
    files = (p for p in sorted(folder.rglob("*")) if suffix_of(p) not in TIFF_SUFFIXES)
    # A series has its slices together: twenty files tell, thousands would take seconds.
    return any(map(is_dicom, islice((p for p in files if p.is_file()), 20)))


def is_dicom(file: Path) -> bool:
    """Tell whether a file is DICOM, by its name or its mark; not where it may not be read."""
    with suppress(OSError):
        return suffix_of(file) in DICOM_SUFFIXES or has_dicom_preamble(file)
    return False


def without_labels(paths: Iterable[Path]) -> list[Path]:
    """Return paths without the files that hold the labels of another of them."""
    known = dict.fromkeys(paths)

    def is_labels(path: Path) -> bool:
        stem = stem_of(path)
        volume = path.with_name(stem.removesuffix(LABELS) + suffix_of(path))
        return stem.endswith(LABELS) and volume in known

    return [path for path in known if not is_labels(path)]


def _reader(file: Path) -> Callable[[Path, bool], FileData]:
    # Imported late: each loads a package that other formats do not need.
    suffix = suffix_of(file)
    if file.is_dir() and is_zarr(file):
        from napari_unpack.io.ome_zarr import read_zarr

        return read_zarr
    if file.is_dir() and suffix in set(READABLE) - set(DICOM_SUFFIXES):
        raise ValueError(f"{file} is a folder, and a {suffix} file is wanted")
    if suffix == ".npz":
        return read_npz
    if suffix == ".npy":
        return read_npy
    if suffix in ITK_SUFFIXES:
        from napari_unpack.io.itk import read_itk

        return read_itk
    if suffix in TIFF_SUFFIXES:
        from napari_unpack.io.tiff import read_tiff

        return read_tiff
    if file.is_dir():
        from napari_unpack.io.slice_folder import read_slices, slices_in

        if slices_in(file):
            return read_slices
    # Scanners write files without a suffix; the mark tells them.
    if file.is_dir() or suffix in DICOM_SUFFIXES or has_dicom_preamble(file):
        from napari_unpack.io.dicom import read_dicom

        return read_dicom
    raise ValueError(f"{file} is of no known format; can read {', '.join(READABLE)}")


def has_dicom_preamble(file: Path) -> bool:
    """Tell whether a file has the mark of DICOM, after 128 bytes."""
    with file.open("rb") as stream:
        return stream.read(132)[128:] == b"DICM"


def _write(file: Path, array: NDArray[Any], scan: Scan) -> None:
    if suffix_of(file) in TIFF_SUFFIXES:
        from napari_unpack.io.tiff import write_tiff

        write_tiff(file, array, scan.spacing)
    else:
        from napari_unpack.io.itk import write_itk

        write_itk(file, array, scan.spacing, scan.scanner_from_scan)
