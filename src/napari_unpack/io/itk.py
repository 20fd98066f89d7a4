"""NIfTI, MetaImage and NRRD through SimpleITK."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.file_sizes import check_size
from napari_unpack.geometry.axes import Matrix
from napari_unpack.io.file_data import FileData
from napari_unpack.io.itk_header import stored_as
from napari_unpack.io.nifti import check_nifti
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import Spacing, checked_spacing, checked_volume_array

ORIENTATION = "LPI"
"""x to the left, y to the back, z to the feet: with z towards the viewer, y down and x right,
as napari draws, nothing is mirrored, and the table is below."""


def read_itk(path: Path, large: bool = False) -> FileData:
    """Read a volume and its voxel size from .nii, .nii.gz, .mha, .mhd, .nrrd or .nhdr.

    The volume is as stored where the file gives no axis directions (the identity); else its axes
    are turned to `ORIENTATION` by flips and swaps, never by interpolation.

    Parameters
    ----------
    path : Path
    large : bool
        As for `check_size`.

    Raises
    ------
    ValueError
        If the file is broken, not a 3D volume of real numbers, or keeps its voxels in a file
        outside its folder.
    ImportError
        If SimpleITK is missing.
    """
    sitk = needed("SimpleITK", "SimpleITK", f"reading {path.suffix} files")
    # ITK prints to the terminal what the error below says in a sentence.
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    # Before ITK sees it: a name that leads into a network would be opened by asking for it.
    kind, stored, packed = stored_as(path)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        # ITK would end the process.
        raise ValueError(f"{path} has a name that is not UTF-8: rename it") from None
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    # By name: of all that ITK knows, some formats follow links to other files.
    reader.SetImageIO(kind)
    try:
        reader.ReadImageInformation()
        check_size(path, _needed(sitk, reader), stored, packed, large)
        assumed = check_nifti(path) if kind == "NiftiImageIO" else ()
        image = reader.Execute()
    except RuntimeError as error:
        raise ValueError(f"{path} is not a readable volume: {_last_line(error)}") from error
    if image.GetNumberOfComponentsPerPixel() != 1:
        raise ValueError(
            f"{path} must hold one number a voxel, got {image.GetNumberOfComponentsPerPixel()}"
        )
    # A fourth axis of length 1 is a time series of one, which many tools write.
    while image.GetDimension() > 3 and image.GetSize()[-1] == 1:
        image = image[..., 0]
    if image.GetDimension() == 4:
        spacing = checked_spacing(image.GetSpacing()[2::-1], path)
        # Of space alone; a file whose time axis leans into it says nothing of use.
        turned = np.reshape(image.GetDirection(), (4, 4))[:3, :3]
        there = _place(turned, image.GetOrigin()[:3])
        upright = np.allclose(turned @ turned.T, np.eye(3), atol=1e-4)
        array = sitk.GetArrayFromImage(image)
        return FileData(array, "tzyx", spacing, None, assumed, there if upright else None)
    if image.GetDimension() != 3:
        # It refuses what is not 3D in the words that all formats share.
        checked_volume_array(sitk.GetArrayFromImage(image), path)
    # Plain arrays, as of this package, say nothing of a patient: they are not turned.
    if not np.allclose(image.GetDirection(), np.eye(3).ravel()):
        image = sitk.DICOMOrient(image, ORIENTATION)
    array = checked_volume_array(sitk.GetArrayFromImage(image), path)
    place = _place(np.reshape(image.GetDirection(), (3, 3)), image.GetOrigin())
    spacing = checked_spacing(image.GetSpacing()[::-1], path)
    return FileData(array, spacing=spacing, assumed=assumed, scanner_from_scan=place)


def _place(turned: Matrix, origin: Sequence[float]) -> Matrix:
    place = np.eye(4)
    # ITK counts x y z.
    place[:3, :3], place[:3, 3] = turned[:, ::-1], origin
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
        As in a `Scan`; without it the file says nothing of a patient.

    Raises
    ------
    ImportError
        If SimpleITK is missing.
    ValueError
        If the format knows no such numbers.
    OSError
        If it could not be written whole.
    """
    sitk = needed("SimpleITK", "SimpleITK", f"writing {path.suffix} files")
    # ITK prints to the terminal what the errors below say in a sentence.
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        image = sitk.GetImageFromArray(array)
    except (TypeError, KeyError) as error:
        raise ValueError(f"{path.name} cannot hold {array.dtype} numbers; write .npz") from error
    image.SetSpacing(spacing[::-1])
    if scanner_from_scan is not None:
        image.SetOrigin(scanner_from_scan[:3, 3].tolist())
        image.SetDirection(scanner_from_scan[:3, 2::-1].ravel().tolist())
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
            equal = np.array_equal(found, array[plane], equal_nan=array.dtype.kind == "f")
            whole = whole and found.dtype == array.dtype and equal
    except RuntimeError as error:
        raise OSError("it cannot be read back: is the disk full?") from error
    if not whole:
        raise OSError("it is not whole: is the disk full?")


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
