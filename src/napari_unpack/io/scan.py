"""A scan as a file holds it: density, voxel size, and labels where there are any."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, voxel_size
from napari_unpack.geometry.length_unit import assumed_besides_size
from napari_unpack.geometry.masks import unmasked
from napari_unpack.geometry.transforms import checked_place

Spacing = tuple[float, float, float]

# From axes z y x of the scan, as napari draws them, to x to the left, y to the back and z to the
# head of who lies on the table: what scanners and 3D Slicer count in, and no mirror image.
# Where the file does not say how its scan lies.
SCANNER_FROM_SCAN = np.array(
    [[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True, eq=False)
class Scan:
    """A volume from a file.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density, any real dtype. CT numbers from DICOM and DICOS are shifted to HU + 1000; the
        other formats do not say what their numbers mean and are left as they are.
    spacing : (float, float, float) of mm, z y x
    labels : (Z, Y, X) ndarray of int, optional
    name : str
        For titles.
    names : mapping of int to str, optional
        What objects are called, by ID; those without a name are left out.
    assumed : tuple of str
        A sentence for each thing that the file does not say and that was assumed.
    scanner_from_scan : (4, 4) ndarray of float64, optional
        From mm along the axes z, y, x to the scanner's mm x to the left, y to the back, z to the
        head, where the file says where the scan lies.
    turned : bool
        Its array is not in the order of its file, or not in the one in which other programs put a
        series of slices: axes were swapped or flipped to the scanner's.
    """

    volume: NDArray[Any]
    spacing: Spacing
    labels: NDArray[Any] | None = None
    name: str = "scan"
    names: Mapping[int, str] | None = None
    assumed: tuple[str, ...] = ()
    scanner_from_scan: Matrix | None = None
    turned: bool = False

    def with_labels(self, labels: NDArray[Any]) -> Scan:
        """Return the scan with other labels, without names.

        Raises
        ------
        ValueError
            If they are none, or of another shape than the volume.
        """
        labels = checked_label_array(labels, "labels")
        if labels.shape != self.volume.shape:
            raise ValueError(
                f"labels must have the volume's shape {self.volume.shape}, got {labels.shape}"
            )
        return replace(self, labels=labels, names=None)

    def with_spacing(self, spacing: Spacing) -> Scan:
        """Return the scan with the voxel size that a person says; nothing is said of another."""
        return replace(self, spacing=spacing, assumed=assumed_besides_size(self.assumed))


def checked_scan(scan: Scan) -> Scan:
    """Return a scan as it could be read from the file that it is written to.

    Raises
    ------
    ValueError
        If its volume or its labels are none, differ in shape, or the voxel size or the place in
        the scanner is none.
    """
    volume, labels = checked_volume_array(scan.volume, "the volume"), scan.labels
    if labels is not None:
        labels = checked_label_array(labels, "the labels")
        check_one_shape(volume, labels, "the scan")
    voxel_size(scan.spacing, "the scan")
    checked_place(scan.scanner_from_scan, "the scan")
    return replace(scan, volume=volume, labels=labels)


def check_one_shape(volume: NDArray[Any], labels: NDArray[Any], source: object) -> None:
    """Refuse labels of another shape than their volume's.

    Parameters
    ----------
    volume, labels : (Z, Y, X) ndarray
    source : object
        What holds them, for the message.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    if volume.shape != labels.shape:
        raise ValueError(
            f"'volume' and 'labels' of {source} must have one shape, "
            f"got {volume.shape} and {labels.shape}"
        )


def checked_volume_array(array: NDArray[Any], source: object) -> NDArray[Any]:
    """Return an array that is a volume, without axes of length 1 in front or behind.

    One of True and False is one of 0 and 1; what is masked was not measured, NaN.

    Parameters
    ----------
    array : ndarray
        What a file holds.
    source : object
        Its name, for messages.

    Raises
    ------
    ValueError
        If it is not 3D, is empty, or does not hold real numbers; `source` names it.
    """
    array = unmasked(array, np.nan)
    # Time and channel of length 1, which many tools write; a thin volume keeps its own axes.
    while array.ndim > 3 and 1 in array.shape:
        array = array.squeeze(axis=array.shape.index(1))
    if array.ndim != 3:
        more = array.ndim > 3
        advice = "save one time point and one channel of it" if more else "a volume has three axes"
        raise ValueError(
            f"{source} must hold a 3D volume (z, y, x), got an array of shape {array.shape}; "
            f"{advice}"
        )
    if array.size == 0:
        raise ValueError(f"{source} must not be empty, got shape {array.shape}")
    # Complex numbers, text and objects have no density.
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{source} must hold real numbers, got {array.dtype}")
    if array.dtype.kind == "b":
        return array.view(np.uint8)
    # numba compiles for the machine's byte order alone.
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def checked_label_array(array: NDArray[Any], source: object) -> NDArray[Any]:
    """Return an array that is a label volume, whole numbers in float accepted.

    Parameters
    ----------
    array, source : see `checked_volume_array`

    Raises
    ------
    ValueError
        If it is not a volume, or does not hold whole numbers from 0 on.
    """
    array = checked_volume_array(unmasked(array, 0), source)
    if array.dtype.kind == "f":
        # NaN and infinity fail the comparison below, with a better message.
        with np.errstate(invalid="ignore"):
            whole = array.astype(np.int64)
        if not np.array_equal(whole, array):
            raise ValueError(f"{source} must hold object IDs (whole numbers), got {array.dtype}")
        array = whole
    if array.min() < 0:
        raise ValueError(f"{source} must not hold negative IDs, got {array.min()}")
    return array


def spacing_from(value: Any, source: object) -> Spacing:
    """Return the voxel size that a person gives as "z y x" in mm, or as one number for all three.

    Parameters
    ----------
    value : str, float, or sequence of float
        Text may have commas, brackets or an x between its numbers.
    source : object
        What gives it, for messages.

    Raises
    ------
    ValueError
        If it is neither one positive finite number nor three of them.
    """
    parts = [value] if isinstance(value, int | float) else value
    if isinstance(value, str):
        parts = [part for part in re.split(r"[\s,;x()\[\]]+", value) if part]
    try:
        sides = [float(part) for part in parts]
    except (TypeError, ValueError):
        sides = []
    if len(sides) not in (1, 3) or not all(0 < side < math.inf for side in sides):
        raise ValueError(
            f"{source} must give the voxel size as 'z y x' in mm, or as one number for all three, "
            f"got {value!r}"
        )
    return voxel_size(sides * 3 if len(sides) == 1 else sides, source)
