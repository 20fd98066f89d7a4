"""NIfTI, MetaImage and NRRD through SimpleITK."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.file_sizes import check_size
from napari_unpack.geometry.axes import Matrix, voxel_size
from napari_unpack.io.file_data import SPACE, FileData
from napari_unpack.io.itk_fields import HeaderFields, fields_of
from napari_unpack.io.itk_header import stored_as
from napari_unpack.io.label_names import is_segmentation
from napari_unpack.io.nifti import check_nifti, planes_not_finite, refuse_nifti_2
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import (
    SCANNER_FROM_SCAN,
    Spacing,
    checked_volume_array,
)
from napari_unpack.io.volumes import suffix_of

ORIENTATION = "LPI"
"""x to the left, y to the back, z to the feet: with z towards the viewer, y down and x right,
as napari draws, nothing is mirrored, and the table is below."""


def read_itk(path: Path, large: bool = False) -> FileData:
    """Read a volume and its voxel size from .nii, .nii.gz, .mha, .mhd, .nrrd or .nhdr.

    The volume is as stored where the file gives no axis directions (the identity); else its axes
    are turned to `ORIENTATION` by flips and swaps, never by interpolation.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError
        If the file is broken, in several units, not a 3D volume of real numbers, or keeps its
        voxels in a file outside its folder.
    ImportError
        If SimpleITK is missing.
    """
    sitk = needed("SimpleITK", f"reading {suffix_of(path)} files")
    # ITK prints to the terminal what the error below says in a sentence.
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    # Before ITK sees it: a name that leads into a network would be opened by asking for it.
    kind, stored, packed = stored_as(path)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        # ITK would end the process.
        raise ValueError(f"{path} has a name that is not UTF-8: rename it") from None
    nifti = kind == "NiftiImageIO"
    if nifti:
        refuse_nifti_2(path)
    reader = sitk.ImageFileReader()
    # By name: of all that ITK knows, some formats follow links to other files.
    reader.SetImageIO(kind)
    try:
        with _apart(path) as named:
            reader.SetFileName(str(named))
            reader.ReadImageInformation()
            if nifti and not packed:
                # First, or a file cut short would be taken for a large one.
                check_nifti(path)
            # What NIfTI rescales takes more in memory than on the disk.
            check_size(path, _needed(sitk, reader), stored, packed or nifti, large)
            fields = HeaderFields(assumed=check_nifti(path)) if nifti else fields_of(path)
            image = reader.Execute()
    except RuntimeError as error:
        raise ValueError(f"{path} is not a readable volume: {_last_line(error)}") from error
    count = image.GetNumberOfComponentsPerPixel()
    if count != 1 and is_segmentation(path):
        raise ValueError(
            f"{path} holds segments that overlap, in {count} layers: collapse them in 3D Slicer, "
            "or export a labelmap"
        )
    if count != 1:
        raise ValueError(f"{path} must hold one number a voxel, got {count}")
    if nifti:
        image = _put_back(sitk, image, path)
    # A fourth axis of length 1 is a time series of one, which many tools write. Where axes are
    # named, the name says which to drop.
    while fields.axes is None and image.GetDimension() > 3 and image.GetSize()[-1] == 1:
        image = image[..., 0]
    unit = fields.millimetres
    letters = fields.axes or "tzyx"
    if image.GetDimension() == 4 or fields.axes is not None:
        if len(letters) != image.GetDimension():
            raise ValueError(f"{path} must name {image.GetDimension()} axes, got {letters}")
        sides = dict(zip(letters[::-1], image.GetSpacing(), strict=True))
        spacing = voxel_size([sides.get(axis, 1.0) * unit for axis in SPACE], path)
        array = sitk.GetArrayFromImage(image)
        if letters != "tzyx":
            return FileData(array, letters, spacing, None, fields.assumed)
        # Of space alone; a file whose time axis leans into it says nothing of use.
        turned = np.reshape(image.GetDirection(), (4, 4))[:3, :3]
        there = _place(turned, image.GetOrigin()[:3], unit) if _at_right_angles(turned) else None
        return FileData(array, letters, spacing, None, fields.assumed, there)
    if image.GetDimension() != 3:
        # It refuses what is not 3D in the words that all formats share.
        checked_volume_array(sitk.GetArrayFromImage(image), path)
    assumed = fields.assumed
    # Flips and swaps leave it so.
    upright = _at_right_angles(np.reshape(image.GetDirection(), (3, 3)))
    if not upright:
        assumed += ("its axes are not at right angles: it is shown as if they were",)
    given = image.GetDirection()
    # Plain arrays, as this package wrote them once, say nothing of a patient: they are not turned.
    if not np.allclose(given, np.eye(3).ravel()):
        image = sitk.DICOMOrient(image, ORIENTATION)
    was_turned = not np.allclose(given, image.GetDirection())
    array = checked_volume_array(sitk.GetArrayFromImage(image), path)
    turned = np.reshape(image.GetDirection(), (3, 3))
    place = _place(turned, image.GetOrigin(), unit) if upright else None
    spacing = voxel_size([mm * unit for mm in image.GetSpacing()[::-1]], path)
    return FileData(
        array, spacing=spacing, assumed=assumed, scanner_from_scan=place, turned=was_turned
    )


def _put_back(sitk: Any, image: Any, path: Path) -> Any:
    """Return an image in which NaN and infinity of its NIfTI file are as they are there."""
    array = None
    for k, stored in planes_not_finite(path, image.GetSize()):
        if array is None:
            array = sitk.GetArrayFromImage(image)
            planes = array.reshape(-1, *stored.shape)
        lost = ~np.isfinite(stored)
        planes[k][lost] = stored[lost]
    if array is None:
        return image
    # By itself it takes the last of four axes for the parts of a vector.
    whole = sitk.GetImageFromArray(array, isVector=False)
    whole.CopyInformation(image)
    return whole


def _at_right_angles(turned: Matrix) -> bool:
    return np.allclose(turned @ turned.T, np.eye(3), atol=1e-4)


def _place(turned: Matrix, origin: Sequence[float], unit: float) -> Matrix:
    place = np.eye(4)
    # ITK counts x y z.
    place[:3, :3], place[:3, 3] = turned[:, ::-1], np.multiply(origin, unit)
    return place


def write_itk(
    path: Path, array: NDArray[Any], spacing: Spacing, scanner_from_scan: Matrix | None = None
) -> None:
    """Write a volume.

    Parameters
    ----------
    path : Path
        The file; its suffix chooses the format.
    array : (Z, Y, X) ndarray
        Densities or labels.
    spacing : (float, float, float) of mm, z y x
    scanner_from_scan : (4, 4) ndarray of float64, optional
        As in a `Scan`; without it the scan lies as napari draws it, as its surfaces do.

    Raises
    ------
    ImportError
        If SimpleITK is missing.
    ValueError
        If the format knows no such numbers.
    OSError
        If it could not be written whole.
    """
    sitk = needed("SimpleITK", f"writing {suffix_of(path)} files")
    # ITK prints to the terminal what the errors below say in a sentence.
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        image = sitk.GetImageFromArray(array)
    except (TypeError, KeyError) as error:
        raise ValueError(f"{path.name} cannot hold {array.dtype} numbers; write .npz") from error
    image.SetSpacing(spacing[::-1])
    # No directions would be those of another, mirrored scan.
    place = SCANNER_FROM_SCAN if scanner_from_scan is None else scanner_from_scan
    image.SetOrigin(place[:3, 3].tolist())
    image.SetDirection(place[:3, 2::-1].ravel().tolist())
    with written_atomically(path, lambda file: _check_written(sitk, file, array)) as temporary:
        try:
            sitk.WriteImage(image, str(temporary), useCompression=True)
        except RuntimeError as error:
            raise OSError(_last_line(error)) from error


def _check_written(sitk: Any, path: Path, array: NDArray[Any]) -> None:
    """Check size, type, and the first and last slice of a file: ITK reports no full disk."""
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    planes, rows, columns = array.shape
    try:
        reader.ReadImageInformation()
        whole = reader.GetSize() == (columns, rows, planes)
        for plane in (0, planes - 1) if whole else ():
            reader.SetExtractIndex((0, 0, plane))
            reader.SetExtractSize((columns, rows, 1))
            found = sitk.GetArrayFromImage(reader.Execute())[0]
            # ITK reads NaN and infinity of NIfTI as 0.
            known = np.isfinite(array[plane])
            equal = np.array_equal(found[known], array[plane][known])
            whole = whole and found.dtype == array.dtype and equal
    except RuntimeError as error:
        raise OSError("it cannot be read back: is the disk full?") from error
    if not whole:
        raise OSError("it is not whole: is the disk full?")


@contextmanager
def _apart(path: Path) -> Iterator[Path]:
    """Give a name under which ITK reads a packed NIfTI file, and not one of that name unpacked."""
    if path.suffix.lower() != ".gz" or not path.with_suffix("").exists():
        yield path
        return
    with TemporaryDirectory() as folder:
        alone = Path(folder) / path.name
        try:
            alone.symlink_to(path.absolute())
        except OSError:
            # Windows lets not everybody make links.
            shutil.copyfile(path, alone)
        yield alone


def _needed(sitk: Any, reader: Any) -> int:
    """Return the bytes that the voxels of a file take in memory, by its header."""
    one = sitk.Image([1, 1], reader.GetPixelID(), reader.GetNumberOfComponents())
    voxels = math.prod(reader.GetSize())
    return int(voxels * one.GetNumberOfComponentsPerPixel() * one.GetSizeOfPixelComponent())


def _last_line(error: RuntimeError) -> str:
    # Only the last line says what is wrong; those before name ITK's sources, and the last of all
    # may be what the system says of nothing: `Reason: Success`.
    lines = [line for line in str(error).splitlines() if line.strip() and "Reason:" not in line]
    return re.sub(r"^.*\(0x[0-9a-f]+\): ", "", (lines or ["no reason is given"])[-1])
