"""TIFF stacks, with the voxel size that ImageJ or OME wrote into them."""

from __future__ import annotations

import html
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.file_sizes import check_size
from napari_unpack.geometry.axes import voxel_size
from napari_unpack.io.file_data import (
    NO_UNIT,
    NO_VOXEL_SIZE,
    UNNAMED,
    FileData,
    in_millimetres,
)
from napari_unpack.io.itk_header import check_beside
from napari_unpack.io.scan import Spacing

# Distances that image editors write without having measured anything, pixels an inch. Some write
# them in pixels a centimetre, with two decimals.
_SCREEN_RESOLUTIONS = (1.0, 72.0, 96.0, 300.0)
_ROUNDED = 2e-4

_NO_DISTANCE = "it gives no distance of slices: that of its rows was assumed"


def read_tiff(path: Path, large: bool = False) -> FileData:
    """Read a stack with its axes and voxel size.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError, ImportError
        As for `load_volume`.
    """
    import tifffile

    assumed: list[str] = []
    with tifffile.TiffFile(path) as file:
        _check_inside(file, path)
        image, count = file.series[0], len(file.series)
        slices = holds_single_slices(file)
        if count > 1 and not slices:
            assumed.append(f"it holds {count} images: the first was taken")
        needed, stored, packed = _size(image, path)
        check_size(path, needed * (count if slices else 1), stored, packed, large)
        if slices:
            array, axes = np.empty((count, *image.shape), image.dtype), "zyx"
            for plane, each in zip(array, file.series, strict=True):
                plane[...] = _voxels(each, path)
        else:
            array, axes = (
                _signed(_voxels(image, path), file.imagej_metadata or {}),
                _axes(image.axes),
            )
        # A picture has no distance of slices: this is a stack of one.
        if axes == "yx" and "spacing" in (file.imagej_metadata or {}):
            array, axes = array[None], "zyx"
        spacing = _imagej(file, assumed) or _ome(file, assumed) or _tags(file, assumed)
    return FileData(array, axes, voxel_size(spacing, path), assumed=tuple(assumed))


def holds_single_slices(file: Any) -> bool:
    """Tell whether an open TIFF was written slice by slice, each as an image of its own.

    Parameters
    ----------
    file : tifffile.TiffFile
    """
    # Of OME they are other places of a sample.
    if len(file.series) < 2 or file.is_ome:
        return False
    first = file.series[0]
    wanted = "YX", first.shape, first.dtype
    return all((each.axes, each.shape, each.dtype) == wanted for each in file.series)


def _voxels(image: Any, path: Path) -> NDArray[Any]:
    try:
        array: NDArray[Any] = image.asarray()
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        kind = image.keyframe.compression
        raise ImportError(
            f"{path} is compressed as {getattr(kind, 'name', kind)}, which needs imagecodecs; run: "
            "pip install imagecodecs"
        ) from error
    return array


def _signed(array: NDArray[Any], notes: dict[str, Any]) -> NDArray[Any]:
    """Return numbers as ImageJ means them: it keeps signed ones of 16 bits 32,768 too high."""
    # Its other calibrations give an image a second meaning: what is stored is read of those.
    shifted = (notes.get("cf"), notes.get("c0"), notes.get("c1")) == (0, -(2**15), 1)
    if array.dtype.kind != "u" or array.dtype.itemsize != 2 or not shifted:
        return array
    return (array.astype(np.uint16) ^ np.uint16(2**15)).view(np.int16)


def _axes(letters: str) -> str:
    # S: samples of a pixel, which are colours. Pages without a meaning (Q, I) are slices, those of
    # the last such axis, which runs fastest.
    named = letters.lower().replace("s", "c" if "C" not in letters else "s")
    pages = [number for number, axis in enumerate(named) if axis in f"{UNNAMED}i"]
    if "z" in named or not pages:
        return named
    return f"{named[: pages[-1]]}z{named[pages[-1] + 1 :]}"


def _check_inside(file: Any, path: Path) -> None:
    # OME spreads an image over files by their names, which tifffile opens wherever they lie.
    for name in re.findall(r'FileName="([^"]*)"', file.ome_metadata or ""):
        check_beside(html.unescape(name), path)


def _size(image: Any, path: Path) -> tuple[int, int, bool]:
    """Return the bytes of an image in memory and on the disk, and whether it is compressed."""
    page = image.keyframe
    files = {part.parent.filehandle.path for part in image.pages if part is not None} or {path}
    # Numbers of 12 bits become 16 without any compression.
    packed = page.compression != 1 or page.bitspersample != 8 * page.dtype.itemsize
    return image.nbytes, sum(Path(name).stat().st_size for name in files), packed


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
            # All of ImageJ's axes: of three, one that is 1 long would be taken for another.
            array[None, :, None, :, :, None],
            imagej=True,
            # TIFF counts pixels a unit, x first; the distance of slices is ImageJ's own field.
            resolution=(1 / spacing[2], 1 / spacing[1]),
            metadata={"axes": "TZCYXS", "spacing": spacing[0], "unit": "mm"},
        )


def _check_written(path: Path, array: NDArray[Any]) -> None:
    """Check the number of slices, and the first and the last, of a file."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        stack = file.series[0]
        # A single slice has no axis of slices in the file.
        shape = array.shape[1:] if len(array) == 1 else array.shape
        whole = stack.shape == shape and stack.dtype == array.dtype
        # ImageJ's stacks are one block behind one header: slices are cut from a map of it.
        found = tifffile.memmap(path, mode="r").reshape(array.shape) if whole else None
    ends = [0, -1]
    if found is None or not np.array_equal(
        found[ends], array[ends], equal_nan=array.dtype.kind == "f"
    ):
        raise OSError("it is not whole: is the disk full?")


def _imagej(file: Any, assumed: list[str]) -> Spacing | None:
    notes, tags = file.imagej_metadata or {}, file.pages[0].tags
    unit = notes.get("unit", "")
    unnamed = unit in ("pixel", "pixels", "")
    if unnamed:
        # TIFF's own unit is asked elsewhere.
        if "spacing" not in notes or _millimetres(tags):
            return None
        unit = "mm"
    # Rows and slices have units of their own where they differ from that of columns.
    scales = {
        axis: in_millimetres(_unescaped(notes.get(f"{axis}unit", unit)), "mm", assumed)
        for axis in "zyx"
    }
    sides = []
    for axis in "yx":
        name = f"{axis.upper()}Resolution"
        # What it leaves out is 1, the distance of slices too.
        pixels, units = tags[name].value if name in tags else (1, 1)
        sides.append(units / pixels * scales[axis] if pixels else scales[axis])
    # Negative where the stack was turned over.
    distance = abs(float(notes.get("spacing", 1.0)))
    size = distance * scales["z"], float(sides[0]), float(sides[1])
    if unnamed:
        # Of numbers without a unit the proportions count, unless they are of voxels or a screen.
        screen = any(side != 1.0 and _is_of_a_screen(1.0 / side) for side in sides if side)
        if screen or size == (1.0, 1.0, 1.0) or not all(0.0 < mm < math.inf for mm in size):
            return None
        assumed.append(NO_UNIT)
    return size


def _unescaped(unit: object) -> str:
    """Return a unit of ImageJ's, which writes the micro sign as its code."""
    return re.sub(r"\\u([0-9a-fA-F]{4})", lambda found: chr(int(found[1], 16)), str(unit))


def _ome(file: Any, assumed: list[str]) -> Spacing | None:
    text = file.ome_metadata or ""
    sizes = {axis: re.search(rf'PhysicalSize{axis}="([^"]+)"', text) for axis in "ZYX"}
    # Before any unit is told of: other fields are asked then.
    if sizes["Y"] is None or sizes["X"] is None:
        return None
    sides: dict[str, float] = {}
    for axis, size in sizes.items():
        unit = re.search(rf'PhysicalSize{axis}Unit="([^"]+)"', text)
        if size is not None:
            # OME's default unit is the micrometre.
            scale = in_millimetres(html.unescape(unit[1]) if unit else None, "µm", assumed)
            sides[axis] = float(size[1]) * scale
    if "Z" not in sides:
        assumed.append(_NO_DISTANCE)
    return sides.get("Z", sides["Y"]), sides["Y"], sides["X"]


def _tags(file: Any, assumed: list[str]) -> Spacing:
    """Return the voxel size by TIFF's own tags, which know no distance of slices."""
    tags = file.pages[0].tags
    unit = _millimetres(tags)
    sides = []
    for name in ("YResolution", "XResolution"):
        pixels, units = tags[name].value if name in tags else (0, 1)
        if unit and pixels and not _is_of_a_screen(pixels / units * 25.4 / unit):
            sides.append(unit * units / pixels)
    if len(sides) < 2:
        assumed.append(NO_VOXEL_SIZE)
        return 1.0, 1.0, 1.0
    assumed.append(_NO_DISTANCE)
    return sides[0], sides[0], sides[1]


def _millimetres(tags: Any) -> float | None:
    """Return the length of TIFF's own unit, mm; None where it says that its numbers have none."""
    unit = int(tags["ResolutionUnit"].value) if "ResolutionUnit" in tags else 1
    return {2: 25.4, 3: 10.0}.get(unit)


def _is_of_a_screen(resolution: float) -> bool:
    return any(math.isclose(resolution, known, rel_tol=_ROUNDED) for known in _SCREEN_RESOLUTIONS)
