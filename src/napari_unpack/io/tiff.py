"""TIFF stacks, with the voxel size that ImageJ or OME wrote into them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.io.scan import Spacing, checked_spacing, checked_volume_array

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "micron": 1e-3, "nm": 1e-6}
# ImageJ writes the micro sign escaped.
_MM |= {"\\u00b5m": 1e-3, "inch": 25.4, "in": 25.4}


def read_tiff(path: Path) -> tuple[NDArray[Any], Spacing]:
    """Read a stack and its voxel size.

    Parameters
    ----------
    path : Path
        .tif or .tiff.

    Returns
    -------
    volume : (Z, Y, X) ndarray
    spacing : (float, float, float)
        mm, z y x; 1 where the file gives no unit.

    Raises
    ------
    ValueError
        If the file is broken or not a 3D volume.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            array = file.asarray()
            spacing = _imagej(file) or _ome(file) or (1.0, 1.0, 1.0)
    except (tifffile.TiffFileError, OSError, ValueError, IndexError, KeyError) as error:
        raise ValueError(f"{path} is not a readable TIFF stack: {error}") from error
    return checked_volume_array(array, path), checked_spacing(spacing, path)


def write_tiff(path: Path, array: NDArray[Any], spacing: Spacing) -> None:
    """Write a stack that ImageJ reads with its voxel size.

    Parameters
    ----------
    path : Path
        The file, .tif or .tiff.
    array : (Z, Y, X) ndarray
        Densities or labels.
    spacing : (float, float, float) of mm, z y x

    Raises
    ------
    ValueError
        If ImageJ knows no such dtype: it takes uint8, uint16 and float32.
    """
    import tifffile

    # Before anything is written: tifffile would say it in terms of ImageJ's header.
    if array.dtype not in (np.uint8, np.uint16, np.float32):
        raise ValueError(
            f"a TIFF stack must be uint8, uint16 or float32, got {array.dtype}; write .npz or .mha"
        )
    with written_atomically(path, lambda file: _check_written(file, array)) as temporary:
        tifffile.imwrite(
            temporary,
            array,
            imagej=True,
            # TIFF counts pixels a unit, x first; the distance of slices is ImageJ's own field.
            resolution=(1 / spacing[2], 1 / spacing[1]),
            metadata={"axes": "ZYX", "spacing": spacing[0], "unit": "mm"},
        )


def _check_written(path: Path, array: NDArray[Any]) -> None:
    """Check the number of slices, and the first and the last, of a file."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        stack = file.series[0]
        whole = stack.shape == array.shape and stack.dtype == array.dtype
        # ImageJ's stacks are one block behind one header: slices are cut from a map of it.
        found = tifffile.memmap(path, mode="r") if whole else None
    ends = [0, -1]
    if found is None or not np.array_equal(
        found[ends], array[ends], equal_nan=array.dtype.kind == "f"
    ):
        raise OSError("it is not whole: is the disk full?")


def _imagej(file: Any) -> Spacing | None:
    # Without a unit the numbers mean nothing: ImageJ writes 1 pixel then.
    notes = file.imagej_metadata
    scale = _MM.get((notes or {}).get("unit", ""))
    if notes is None or scale is None:
        return None
    tags = file.pages[0].tags
    sides = []
    for name in ("YResolution", "XResolution"):
        pixels, units = tags[name].value if name in tags else (1, 1)
        sides.append(units / pixels * scale if pixels else scale)
    return float(notes.get("spacing", 1.0)) * scale, float(sides[0]), float(sides[1])


def _ome(file: Any) -> Spacing | None:
    text = file.ome_metadata or ""
    sides = []
    for axis in "ZYX":
        size = re.search(rf'PhysicalSize{axis}="([^"]+)"', text)
        unit = re.search(rf'PhysicalSize{axis}Unit="([^"]+)"', text)
        if size is None:
            return None
        # OME's default unit is the micrometre.
        sides.append(float(size[1]) * _MM.get(unit[1] if unit else "µm", 1.0))
    return sides[0], sides[1], sides[2]
