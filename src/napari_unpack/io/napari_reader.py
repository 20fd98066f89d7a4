"""napari's reader: File > Open and drag and drop."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from napari_unpack.file_sizes import TooLargeError
from napari_unpack.io.file_data import SPACE, FileData
from napari_unpack.io.scan import Scan

LayerData = tuple[Any, dict[str, Any], str]


def get_reader(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """Return a reader for what napari was asked to open, None where it is not ours.

    Of several files the first is looked at. Names count, so that napari stays quick: broken files
    are reported when read. An .npz is ours if it holds an array `volume` or `labels`, a TIFF if it
    holds slices, a folder if it holds DICOM or slices in TIFF: photographs are left to napari.
    """
    from napari_unpack.io.slice_folder import slices_in
    from napari_unpack.io.volumes import READABLE, TIFF_SUFFIXES, suffix_of

    first = Path(path if isinstance(path, str) else path[0])
    # Not Path's: a name that is too long is an error there.
    if os.path.isdir(first):
        return read_layers if _is_dicom_or_zarr(first) or slices_in(first) else None
    suffix = suffix_of(first)
    # .npz is anyone's format: only ours are taken, so that other plugins may read the rest.
    if suffix not in READABLE or (suffix == ".npz" and not _is_ours(first)):
        return None
    if suffix in TIFF_SUFFIXES and not _has_slices(first):
        return None
    return read_layers


def read_layers(path: str | Sequence[str], large: bool = False) -> list[LayerData]:
    """Read a file or a stack of them into napari layers: an Image, and Labels where there are any.

    With `scale` and `units` in mm. An OME-Zarr label image of whole numbers becomes Labels alone. A
    multiscale OME-Zarr whose finest level does not fit into memory becomes layers of all its
    levels, which are not read; of those the panel unpacks the finest that does. Several channels or
    time points stay axes in front of z, y, x, from which the panel lets one be chosen. Names of
    objects become the labels' `features`. What had to be assumed of the file is a warning, which
    napari shows, and in `metadata["assumed"]`; `metadata["scanner_from_scan"]` and
    `metadata["turned"]` are as in a `Scan`.

    Several files become time points, along a new first axis. Of DICOM files, the slices of a
    series, the first is enough.

    Parameters
    ----------
    path : str or sequence of str
    large : bool
        As for `load_volume`.

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_volume`, and if the files of a stack differ in more than their voxels.
    """
    from napari_unpack.io.file_stack import check_stack_size, stacked
    from napari_unpack.io.volumes import DICOM_SUFFIXES, printable, stem_of, suffix_of

    paths = [Path(each) for each in ([path] if isinstance(path, str) else path)]
    first = paths[0]
    name = printable(stem_of(first))
    if len(paths) > 1 and suffix_of(first) not in DICOM_SUFFIXES:
        check_stack_size(paths, large)
        found, names = stacked(paths, [_read(each, large) for each in paths])
    else:
        try:
            found, names = _read(first, large)
        except TooLargeError:
            stored = _stored_layers(first, name)
            if not stored:
                raise
            return stored
    layers: list[LayerData] = []
    if found.volume is not None:
        layers.append((found.volume, _attributes(found, name) | {"colormap": "gray"}, "image"))
    if found.labels is not None:
        found = _labels_of_all_axes(found)
        named = {"features": label_features(names)} if names else {}
        about = _label_attributes(found, name, bool(layers))
        layers.append((found.labels, about | named, "labels"))
    return layers


def _read(path: Path, large: bool) -> tuple[FileData, Mapping[int, str]]:
    """Return what a file holds, labels as labels, and what its objects are called."""
    from napari_unpack.io.arrays import read_names
    from napari_unpack.io.label_names import is_segmentation, segment_names
    from napari_unpack.io.ome_zarr import holds_ids, is_label_image
    from napari_unpack.io.volumes import is_zarr, read_file, suffix_of

    found = read_file(path, large).space_last()
    _tell_assumed(path, found)
    names = read_names(path) if found.volume is not None and suffix_of(path) == ".npz" else None
    # What says that it holds labels may hold shares or a mask of fractions.
    ids = found.volume is not None and holds_ids(found.volume)
    if ids and is_segmentation(path):
        # Voxels of 3D Slicer's segmentations are labels, which the header names.
        found = replace(found, volume=None, labels=found.volume)
        names = segment_names(path)
    elif ids and is_zarr(path) and is_label_image(path):
        found = replace(found, volume=None, labels=found.volume)
    return found, names or {}


def _stored_layers(path: Path, name: str) -> list[LayerData]:
    """Return the layers of a multiscale OME-Zarr, which is not read; none of anything else."""
    from napari_unpack.io.ome_zarr import stored_levels
    from napari_unpack.io.volumes import is_zarr
    from napari_unpack.read_errors import read_errors_told

    if not is_zarr(path):
        return []
    with read_errors_told(path, "a Zarr image"):
        stored = stored_levels(path)
    if stored is None:
        return []
    _tell_assumed(path, stored.described)
    layers: list[LayerData] = []
    if stored.image:
        about = _attributes(stored.described, name) | {"multiscale": True}
        layers.append((stored.image, about | {"colormap": "gray"}, "image"))
    if stored.labels:
        about = _label_attributes(stored.described, name, bool(layers)) | {"multiscale": True}
        layers.append((stored.labels, about, "labels"))
    return layers


def _tell_assumed(path: Path, found: FileData) -> None:
    if found.assumed:
        warnings.warn(f"{path.name}: {'; '.join(found.assumed)}", stacklevel=3)


def _attributes(found: FileData, name: str) -> dict[str, Any]:
    others = len(found.axes) - len(SPACE)
    return {
        "scale": (1.0,) * others + found.spacing,
        "units": ("pixel",) * others + ("mm",) * len(SPACE),
        "axis_labels": tuple(found.axes),
        "name": name,
        "metadata": layer_metadata(found),
    }


def layer_metadata(found: FileData | Scan) -> dict[str, Any]:
    """Return what a layer keeps of the file that it was read from."""
    return {
        "assumed": found.assumed,
        "scanner_from_scan": found.scanner_from_scan,
        "turned": found.turned,
    }


def _label_attributes(found: FileData, name: str, beside_image: bool) -> dict[str, Any]:
    if beside_image:
        # Labels of a volume have no other axes, whatever the volume has, but that of a stack.
        axes = SPACE if found.labels is None else found.axes[-found.labels.ndim :]
        return _attributes(replace(found, axes=axes), f"{name} labels")
    # Labels alone are a file too, such as corrected ones.
    return _attributes(found, name)


def _labels_of_all_axes(found: FileData) -> FileData:
    """Return data whose labels of several time points have the channels of its volume too.

    napari counts axes from the last: time would be taken for channels.
    """
    labels, volume = found.labels, found.volume
    if labels is None or labels.ndim == len(SPACE) or volume is None or volume.ndim == labels.ndim:
        return found
    there = tuple(slice(None) if axis in f"t{SPACE}" else None for axis in found.axes)
    return replace(found, labels=np.broadcast_to(labels[there], volume.shape).copy())


def label_features(names: Mapping[int, str]) -> dict[str, list[Any]]:
    """Return names as napari shows them when the mouse is on a label."""
    from napari_unpack.session.labels import one_line

    # The status bar has one line.
    return {"index": list(names), "name": [one_line(name) for name in names.values()]}


def _keys(path: Path) -> set[str]:
    import zipfile

    # A pipe would be waited for.
    if not os.path.isfile(path):
        return set()
    try:
        with zipfile.ZipFile(path) as archive:
            # The archive's table of contents: no array is read.
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return set()


def _is_ours(path: Path) -> bool:
    keys = _keys(path)
    # A broken archive is ours too: the reader says what is wrong with it.
    return not keys or bool(keys & {"volume", "labels"})


def _has_slices(path: Path) -> bool:
    """Return whether a TIFF holds a volume, by its header."""
    # A pipe would be waited for.
    if not os.path.isfile(path):
        return True
    import tifffile

    from napari_unpack.io.tiff import holds_single_slices
    from napari_unpack.read_errors import read_errors_told

    try:
        with read_errors_told(path), tifffile.TiffFile(path) as file:
            if file.is_ome:
                # Not by its series: its parts may be files of any place, which would be opened.
                counts = re.findall(r'SizeZ="(\d+)"', file.ome_metadata or "")
                return any(int(count) > 1 for count in counts)
            axes = file.series[0].axes
            # As `read_tiff` has it: a picture with a distance of slices is a stack of one, and
            # pages without a meaning (I, Q) are slices.
            alone = axes == "YX" and "spacing" in (file.imagej_metadata or {})
            return alone or bool(set(axes) & set("ZIQ")) or holds_single_slices(file)
    except (OSError, ValueError):
        # Ours too: the reader says what is wrong with it.
        return True


def _is_dicom_or_zarr(folder: Path) -> bool:
    from napari_unpack.io.volumes import holds_dicom, is_zarr

    # Where it may not be read the reader says so.
    readable = os.access(folder, os.R_OK | os.X_OK)
    return not readable or is_zarr(folder) or holds_dicom(folder)
