"""DICOM series, enhanced CT and DICOS files through pydicom."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.file_sizes import check_size
from napari_unpack.geometry.axes import Matrix, voxel_size
from napari_unpack.io.file_data import NO_VOXEL_SIZE, SPACE, FileData
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import Spacing
from napari_unpack.io.slice_stack import SliceStack
from napari_unpack.read_errors import read_errors_told

HIGHEST = 32000
"""CT density is clipped to [0, 32000]; see CONVENTIONS.md."""

# Where enhanced files keep, in groups for each frame or for all, what others have at the top.
_GROUPS = {
    "ImagePositionPatient": "PlanePositionSequence",
    "ImageOrientationPatient": "PlaneOrientationSequence",
    "PixelSpacing": "PixelMeasuresSequence",
    "SpacingBetweenSlices": "PixelMeasuresSequence",
    "SliceThickness": "PixelMeasuresSequence",
    "RescaleSlope": "PixelValueTransformationSequence",
    "RescaleIntercept": "PixelValueTransformationSequence",
    "TemporalPositionIndex": "FrameContentSequence",
    "FrameAcquisitionNumber": "FrameContentSequence",
}

# SOP classes of files that hold the voxels of segments (binary, fractional, as labels), no scan.
_SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")

# So many images in a folder are no scan where others lie in the folders below it.
_MOST_SCOUTS = 2

# The groups 0002 and 0008, which files without a preamble begin with, in either byte order.
_FIRST_GROUPS = (b"\2\0", b"\0\2", b"\10\0", b"\0\10")

# What tells scans of one place apart, the surest first.
_PHASES = (
    "TemporalPositionIndex",
    "TemporalPositionIdentifier",
    "AcquisitionNumber",
    "TriggerTime",
)

# Two slices are in one place where they are nearer than this, mm; positions have two decimals.
_SAME_PLACE = 0.01

# How far from 1 the square of a direction's length may be, and from 0 the cosine of a right angle:
# some writers keep two decimals.
_CROOKED = 0.02


# Of many slices the damaged one is named: a header is taken apart only when it is asked.
_named = partial(read_errors_told, wanted="a readable DICOM file")


@dataclass(frozen=True, eq=False)
class _Slice:
    """One image of a file."""

    path: Path
    frame: int
    header: Any

    def value(self, keyword: str) -> Any:
        """Return a value of this frame, of all frames of its file, or of the file; or None."""
        group = _GROUPS.get(keyword)
        frames = self.header.get("PerFrameFunctionalGroupsSequence") or ()
        shared = self.header.get("SharedFunctionalGroupsSequence") or ()
        for place in (*frames[self.frame : self.frame + 1], *shared[:1]):
            items = place.get(group) if group else None
            if items and items[0].get(keyword) is not None:
                return items[0].get(keyword)
        found = self.header.get(keyword)
        return None if found == "" else found

    def numbers(self, keyword: str, count: int) -> tuple[float, ...] | None:
        """Return a value of so many numbers, or None where the file does not give it."""
        with _named(self.path):
            found = self.value(keyword)
            values = () if found is None else np.atleast_1d(found)
            numbers = tuple(float(v) for v in values)
        if numbers and (len(numbers) != count or not np.isfinite(numbers).all()):
            wanted = "a number" if count == 1 else f"{count} numbers"
            given = ", ".join(f"{number:g}" for number in numbers)
            raise ValueError(f"{self.path} must give {wanted} as its {keyword}, got {given}")
        return numbers or None

    @property
    def directions(self) -> NDArray[np.float64] | None:
        """(2, 3) unit vectors along which column and row number grow, x y z; None if not given."""
        given = self.numbers("ImageOrientationPatient", 6)
        if given is None:
            return None
        along = np.reshape(given, (2, 3))
        if not np.allclose(along @ along.T, np.eye(2), atol=_CROOKED):
            raise ValueError(
                f"{self.path} must give directions of length 1 at right angles, got {list(given)}"
            )
        unit: NDArray[np.float64] = along / np.linalg.norm(along, axis=1, keepdims=True)
        return unit

    @property
    def form(self) -> tuple[Any, ...]:
        """What all slices of a volume have in common: size, directions, pixels."""
        turned = self.numbers("ImageOrientationPatient", 6) or ()
        with _named(self.path):
            shape = int(self.header.Rows), int(self.header.Columns)
        # Hundredths: directions are rounded, and a scout differs by a right angle.
        return (
            shape,
            tuple(np.round(turned, 2).tolist()),
            tuple(np.round(self.numbers("PixelSpacing", 2) or (), 3).tolist()),
        )


def read_dicom(path: Path, large: bool = False) -> FileData:
    """Read a CT volume from a folder of slices, one of its slices, or a multi-frame file.

    Of a folder with several series, or a series with images of several kinds, the one with the
    most slices is taken. Folders below it are looked into where it has no scan itself. Of a series
    with several scans of one place all are, as axis t. The volume holds CT number (HU) + 1000,
    clipped to [0, 32000], as uint16; what is not CT is rescaled as the file says.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError
        If there is no readable series, or its slices make no volume.
    ImportError
        If pydicom, or the codec of a compressed file, is missing.

    Notes
    -----
    Slices are put in order of position along their normal, so that with z towards the viewer,
    y down and x right, as napari draws, nothing is mirrored. Slices that are shifted or unequally
    far apart are resampled, see `SliceStack.volume`. Files without a preamble, as some DICOS
    writers make them, are read all the same.
    """
    pydicom = needed("pydicom", "reading DICOM and DICOS")
    assumed: list[str] = []
    headers = _headers(pydicom, path, assumed)
    # Before a list of all images is made: their number may be made up too.
    check_size(path, *_sizes(headers), large)
    slices = [
        _Slice(file, frame, header)
        for file, header in headers
        for frame in range(int(header.get("NumberOfFrames") or 1))
    ]
    slices = _of_one_form(slices, path, assumed)
    if len(slices) < 2:
        raise ValueError(f"{path} must hold a series of slices, got a single slice")
    pixels = _Pixels(pydicom)
    scans = _scans(slices, pixels, path, assumed)
    volumes = [_volume(scan, pixels, path, assumed) for scan in scans]
    volume, spacing, place = volumes[0]
    if len({v.shape for v, _, _ in volumes}) > 1:
        raise ValueError(
            f"{path} holds {len(volumes)} scans of one place that differ in their slices: save "
            "each in a series of its own"
        )
    # Other programs put the lowest slice first.
    turned = place is not None
    if len(volumes) == 1:
        return FileData(volume, SPACE, spacing, None, tuple(assumed), place, turned=turned)
    return FileData(
        np.stack([v for v, _, _ in volumes]),
        "tzyx",
        spacing,
        assumed=tuple(dict.fromkeys(assumed)),
        scanner_from_scan=place,
        turned=turned,
    )


def _headers(pydicom: Any, path: Path, assumed: list[str]) -> list[tuple[Path, Any]]:
    if path.is_dir():
        return _in_folder(pydicom, path, assumed)
    alone = _header(pydicom, path)
    # Forced: some DICOS files have no preamble, and this one was named by the user.
    forced = alone is None
    alone = _header(pydicom, path, force=True) if forced else alone
    if alone is None or "Rows" not in alone:
        raise ValueError(f"{path} is not a readable DICOM or DICOS image")
    if _is_segmentation(alone):
        raise _segmentation_error(path)
    if _is_coloured(alone):
        raise _colour_error(path)
    if int(alone.get("NumberOfFrames") or 1) > 1:
        return [(path, alone)]
    beside = sorted(p for p in path.parent.iterdir() if p.is_file())
    return _series(pydicom, beside, path, assumed, alone, forced)


def _in_folder(pydicom: Any, folder: Path, assumed: list[str]) -> list[tuple[Path, Any]]:
    own, told = sorted(p for p in folder.iterdir() if p.is_file()), list[str]()
    with suppress(ValueError):
        headers = _series(pydicom, own, folder, told)
        frames = sum(int(header.get("NumberOfFrames") or 1) for _, header in headers)
        if frames > _MOST_SCOUTS:
            below = any(p.is_dir() for p in folder.iterdir())
            assumed += [*told, *["folders in it were left out"] * below]
            return headers
    return _series(pydicom, sorted(p for p in folder.rglob("*") if p.is_file()), folder, assumed)


def _begins_as_dicom(file: Path) -> bool:
    # Anything else, such as gigabytes of zeros, would be taken apart to its end.
    try:
        with file.open("rb") as stream:
            return stream.read(2) in _FIRST_GROUPS
    except OSError:
        return False


def _header(pydicom: Any, path: Path, force: bool = False) -> Any:
    try:
        return pydicom.dcmread(path, stop_before_pixels=True, force=force)
    except (pydicom.errors.InvalidDicomError, OSError, ValueError, EOFError, KeyError):
        return None


def _series(
    pydicom: Any,
    files: list[Path],
    source: Path,
    assumed: list[str],
    named: Any = None,
    forced: bool = False,
) -> list[tuple[Path, Any]]:
    found: dict[Any, list[tuple[Path, Any]]] = {}
    segmentations, coloured = [], []
    for file in files:
        # Forced only as the named one was: a folder also holds text files and thumbnails.
        header = _header(pydicom, file, forced and _begins_as_dicom(file))
        if header is None or "Rows" not in header:
            continue
        if _is_segmentation(header):
            segmentations.append(file)
        elif _is_coloured(header):
            coloured.append(file)
        else:
            found.setdefault(header.get("SeriesInstanceUID"), []).append((file, header))
    for what, others, error in (
        ("segmentation(s)", segmentations, _segmentation_error),
        ("image(s) in colours", coloured, _colour_error),
    ):
        if others and not found:
            raise error(others[0])
        if others:
            names = ", ".join(file.name for file in others[:3])
            assumed.append(f"it holds {len(others)} {what} ({names}): left out")
    if not found:
        raise ValueError(
            f"{source} holds no DICOM images, nor slices in TIFF: save other pictures as one TIFF "
            "stack"
        )
    # The user named a file: its series is meant, even if another has more slices.
    if named is not None:
        return found[named.get("SeriesInstanceUID")]
    if len(found) > 1:
        sizes = sorted(map(len, found.values()), reverse=True)
        assumed.append(
            f"it holds {len(found)} series of {sizes} images: the largest was taken; "
            "open a file of another to have that"
        )
    return max(found.values(), key=len)


def _is_segmentation(header: Any) -> bool:
    return header.get("SOPClassUID") in _SEGMENTATIONS


def _is_coloured(header: Any) -> bool:
    # Screenshots and reports; the numbers of a palette are no densities either.
    palette = header.get("PhotometricInterpretation") == "PALETTE COLOR"
    return palette or int(header.get("SamplesPerPixel") or 1) > 1


def _colour_error(path: Path) -> ValueError:
    return ValueError(
        f"{path} is an image in colours, as of a screen, not a scan: open the series that it was "
        "made from"
    )


def _segmentation_error(path: Path) -> ValueError:
    # Not read: its frames lie where its segments do, seldom where the scan's slices do.
    return ValueError(
        f"{path} is a DICOM segmentation, not a scan: save it as a label volume (NIfTI or NRRD, "
        "as 3D Slicer and dcmqi do), and open that as labels"
    )


def _sizes(headers: list[tuple[Path, Any]]) -> tuple[int, int, bool]:
    """Return the bytes of all pixels and of all files, and whether any are compressed."""
    needed, stored, packed = 0, 0, False
    for file, header in headers:
        with _named(file):
            pixels = int(header.Rows) * int(header.Columns) * int(header.get("NumberOfFrames") or 1)
            bits = int(header.get("BitsAllocated") or 16) * int(header.get("SamplesPerPixel") or 1)
            needed, stored = needed + pixels * bits // 8, stored + file.stat().st_size
            syntax = header.file_meta.get("TransferSyntaxUID")
            packed = packed or (syntax is not None and (syntax.is_compressed or syntax.is_deflated))
    return needed, stored, packed


def _of_one_form(slices: list[_Slice], source: Path, assumed: list[str]) -> list[_Slice]:
    """Return the slices that fit together, leaving out scouts and the like."""
    forms = Counter(part.form for part in slices)
    if len(forms) == 1:
        return slices
    (form, most), (_, next_most) = forms.most_common(2)
    # The file that was named says which is meant.
    named = {part.form for part in slices if part.path == source}
    if len(named) == 1:
        (form,) = named
    elif most == next_most:
        raise ValueError(
            f"{source} holds {len(forms)} kinds of slices, as many of each: they differ in size, "
            f"direction or pixel size, {[kind for kind, _ in forms.most_common(2)]}"
        )
    others = sum(forms.values()) - forms[form]
    assumed.append(
        f"{others} of its {len(slices)} images have another size, direction or pixel size: "
        "they were left out"
    )
    return [part for part in slices if part.form == form]


def _scans(
    slices: list[_Slice], pixels: _Pixels, source: Path, assumed: list[str]
) -> list[list[_Slice]]:
    """Return the slices of each scan, where several of one place are in a series."""
    heights = _heights(slices)
    if heights is None or np.ptp(heights) == 0:
        return [slices]
    places: dict[int, list[_Slice]] = defaultdict(list)
    for part, height in zip(slices, heights, strict=True):
        places[round(height / _SAME_PLACE)].append(part)
    most = max(map(len, places.values()))
    if most == 1:
        assumed += _interleaved(slices, heights)
        return [slices]
    for keyword in _PHASES:
        phases: dict[Any, list[_Slice]] = defaultdict(list)
        for part in slices:
            phases[str(part.value(keyword))].append(part)
        if len(phases) == most and {len(p) for p in phases.values()} == {len(places)}:
            return [phases[key] for key in sorted(phases, key=_as_number)]
    if all(len(parts) == most for parts in places.values()):
        assumed.append(f"it holds {most} scans of one place: told apart by their images' numbers")
        ordered = [sorted(parts, key=_number) for parts in places.values()]
        return [[parts[k] for parts in ordered] for k in range(most)]
    # The same image twice is no harm.
    once = []
    for parts in places.values():
        first = pixels.density(parts[0])
        if any(not np.array_equal(first, pixels.density(other)) for other in parts[1:]):
            height = heights[slices.index(parts[0])]
            raise ValueError(
                f"{source} holds {len(parts)} different slices at {height:.4g} mm, but not "
                "everywhere: save one scan in a series"
            )
        once.append(parts[0])
    assumed.append(f"{len(slices) - len(once)} of its images are there twice: taken once")
    return [once]


def _interleaved(slices: list[_Slice], heights: NDArray[np.float64]) -> list[str]:
    """Return a sentence where acquisitions of one stretch of the body make one stack.

    Some scanners take every second slice first, so that it may be right: no other reader parts
    them either.
    """
    for keyword in _PHASES:
        groups: dict[str, list[float]] = defaultdict(list)
        for part, height in zip(slices, heights, strict=True):
            groups[str(part.value(keyword))].append(float(height))
        # From low to high. Those of a body in several stretches overlap by a few slices at most.
        ends = sorted((min(g), max(g)) for g in groups.values() if len(g) > 1)
        if any(
            min(high, top) - low > max(high - bottom, top - low) / 2
            for (bottom, high), (low, top) in combinations(ends, 2)
        ):
            return [
                f"it holds {len(groups)} acquisitions ({keyword}) whose slices lie between each "
                "other: all were taken as one scan"
            ]
    return []


def _volume(
    slices: list[_Slice], pixels: _Pixels, source: Path, assumed: list[str]
) -> tuple[NDArray[Any], Spacing, Matrix | None]:
    first = slices[0]
    distances = first.numbers("PixelSpacing", 2)
    if distances is None:
        assumed.append("it gives no pixel size: 1 mm was assumed")
    rows, columns = distances or (1.0, 1.0)
    voxel_size((rows, rows, columns), source)
    silent = sum(part.value("RescaleIntercept") is None for part in slices)
    if first.header.get("Modality") == "CT" and silent:
        all_do = silent == len(slices)
        who = "it does" if all_do else f"{silent} of its {len(slices)} images do"
        whose = "its" if all_do else "their"
        assumed.append(f"{who} not say what {whose} numbers mean: CT numbers were assumed")
    positions = [part.numbers("ImagePositionPatient", 3) for part in slices]
    heights = _heights(slices)
    # Read in their order, so that the volume needs no second copy to be turned.
    if heights is None or np.ptp(heights) == 0:
        gap = first.numbers("SpacingBetweenSlices", 1) or first.numbers("SliceThickness", 1)
        thickness = "it gives no distance of slices: their thickness was assumed"
        ordered = slices if len({p.path for p in slices}) == 1 else sorted(slices, key=_number)
        assumed.append("it gives no positions of its slices: their order was assumed")
        assumed.append(NO_VOXEL_SIZE if gap is None else thickness)
        volume = np.stack([pixels.density(part) for part in ordered])
        return volume, voxel_size(((gap or (1.0,))[0], rows, columns), source), None
    if first.directions is None:
        assumed.append("it gives no direction of its slices: axial ones were assumed")
    columns_grow, rows_grow = _directions(first)
    ordered = [slices[i] for i in np.argsort(heights, kind="stable")[::-1]]
    places = {id(part): place for part, place in zip(slices, positions, strict=True)}
    stack = SliceStack(
        np.stack([pixels.density(part) for part in ordered]),
        np.array([places[id(part)] for part in ordered], dtype=np.float64),
        rows=rows_grow,
        columns=columns_grow,
        spacing=(rows, columns),
    )
    # Air is 0 in CT; elsewhere the least there is.
    air = 0.0 if first.header.get("Modality") == "CT" else float(stack.planes.min())
    volume, spacing, place, done = stack.volume(air, source)
    assumed += done
    return volume, voxel_size(spacing, source), place


def _heights(slices: Sequence[_Slice]) -> NDArray[np.float64] | None:
    """Return positions along the common normal, mm; None where one slice has none."""
    positions = [part.numbers("ImagePositionPatient", 3) for part in slices]
    if any(place is None for place in positions):
        return None
    return np.array(positions, dtype=np.float64) @ np.cross(*_directions(slices[0]))


def _directions(part: _Slice) -> NDArray[np.float64]:
    """Return the directions of a slice, of an axial one where none are given."""
    given = part.directions
    return np.eye(3)[:2] if given is None else given


def _number(part: _Slice) -> tuple[int, int]:
    return int(part.header.get("InstanceNumber") or 0), part.frame


def _as_number(text: str) -> tuple[bool, float, str]:
    # Numbers by size, before what is none.
    try:
        return False, float(text), text
    except ValueError:
        return True, 0.0, text


class _Pixels:
    """Reads the pixels of slices; keeps those of the last file, which may hold many frames."""

    def __init__(self, pydicom: Any) -> None:
        self._pydicom = pydicom
        self._path: Path | None = None
        self._planes: NDArray[Any] = np.zeros((0, 0, 0))

    def density(self, part: _Slice) -> NDArray[Any]:
        """Return the (R, C) densities of a slice."""
        if self._path != part.path:
            self._planes, self._path = self._read(part.path), part.path
        if part.frame >= len(self._planes):
            raise ValueError(
                f"{part.path} must hold {part.frame + 1} images or more, got {len(self._planes)}"
            )
        # Every slice by its own slope: scanners may change it from slice to slice.
        (slope,) = part.numbers("RescaleSlope", 1) or (1.0,)
        (intercept,) = part.numbers("RescaleIntercept", 1) or (0.0,)
        if slope == 0:
            raise ValueError(f"{part.path} has a RescaleSlope of 0, which leaves no densities")
        return _density(
            self._planes[part.frame],
            slope,
            intercept,
            part.header.get("Modality") == "CT",
        )

    def _read(self, path: Path) -> NDArray[Any]:
        with _named(path):
            data = self._pydicom.dcmread(path, force=True)
            _check_codec(self._pydicom, data.file_meta.get("TransferSyntaxUID"), path)
        try:
            raw: NDArray[Any] = data.pixel_array
        except (AttributeError, ValueError, NotImplementedError, RuntimeError) as error:
            raise ValueError(f"the pixels of {path} cannot be read: {error}") from error
        return raw.reshape(-1, *raw.shape[-2:])


def _check_codec(pydicom: Any, syntax: Any, path: Path) -> None:
    """Say what to install where the codec of a compressed file is missing."""
    if syntax is None or not syntax.is_compressed:
        return
    try:
        decoder = pydicom.pixels.get_decoder(syntax)
    except NotImplementedError:
        raise ValueError(
            f"{path} is compressed as {syntax.name}, which is no way to store a CT: save it "
            "uncompressed, or as JPEG Lossless"
        ) from None
    if not decoder.is_available:
        raise ImportError(
            f"{path} is compressed as {syntax.name}, which needs python-gdcm; run: pip install "
            "python-gdcm (or 'napari-unpack[dicom]')"
        )


def _density(raw: NDArray[Any], slope: float, intercept: float, is_ct: bool) -> NDArray[Any]:
    if is_ct:
        # In float32, which holds the 16 bits of CT exactly, at half the memory of float64.
        number = np.rint(raw * np.float32(slope) + np.float32(intercept + 1000))
        return np.clip(number, 0, HIGHEST).astype(np.uint16)
    # Nothing to do: labels and images of other kinds keep their whole numbers.
    if (slope, intercept) == (1.0, 0.0):
        return raw
    return raw.astype(np.float32) * np.float32(slope) + np.float32(intercept)
