"""DICOM series and DICOS files through pydicom."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.optional import needed
from napari_unpack.io.scan import Spacing, checked_spacing, checked_volume_array

HIGHEST = 32000
"""CT density is clipped to [0, 32000]; see CONVENTIONS.md."""


def read_dicom(path: Path) -> tuple[NDArray[Any], Spacing]:
    """Read a CT volume from a folder of slices, one of its slices, or a multi-frame file.

    Parameters
    ----------
    path : Path
        A folder (the series with the most slices in it is taken), any file of a series, or an
        enhanced CT or DICOS file with all frames.

    Returns
    -------
    volume : (Z, Y, X) ndarray of uint16, or float32
        CT number (HU) + 1000, clipped to [0, 32000]. What is not CT: rescaled as the file says.
    spacing : (float, float, float) of mm, z y x

    Raises
    ------
    ValueError
        If there is no readable series.
    ImportError
        If pydicom, or the codec of a compressed file, is missing.

    Notes
    -----
    Slices are put in order of position along their normal, so that with z towards the viewer,
    y down and x right, as napari draws, nothing is mirrored. Files without a preamble, as some
    DICOS writers make them, are read all the same.
    """
    pydicom = needed("pydicom", "pydicom", "reading DICOM and DICOS")
    if path.is_dir():
        headers = _series(pydicom, sorted(p for p in path.rglob("*") if p.is_file()), path)
    else:
        # Forced: some DICOS files have no preamble, and this one was named by the user.
        alone = _header(pydicom, path, force=True)
        if alone is None or "Rows" not in alone:
            raise ValueError(f"{path} is not a readable DICOM or DICOS image")
        headers = [(path, alone)]
        if int(alone.get("NumberOfFrames", 1) or 1) == 1:
            headers = _series(
                pydicom,
                sorted(p for p in path.parent.iterdir() if p.is_file()),
                path,
                alone.get("SeriesInstanceUID"),
            )
    if len(headers) == 1 and int(headers[0][1].get("NumberOfFrames", 1) or 1) > 1:
        return _multi_frame(pydicom, headers[0][0])
    return _slices(pydicom, headers, path)


def _header(pydicom: Any, path: Path, force: bool = False) -> Any:
    try:
        return pydicom.dcmread(path, stop_before_pixels=True, force=force)
    except (pydicom.errors.InvalidDicomError, OSError, ValueError, EOFError, KeyError):
        return None


def _series(
    pydicom: Any, files: list[Path], source: Path, wanted: Any = None
) -> list[tuple[Path, Any]]:
    found: dict[Any, list[tuple[Path, Any]]] = {}
    for file in files:
        # Not forced: a folder also holds text files and thumbnails.
        header = _header(pydicom, file)
        if header is not None and "Rows" in header:
            found.setdefault(header.get("SeriesInstanceUID"), []).append((file, header))
    if not found:
        raise ValueError(f"{source} holds no DICOM images")
    # The user named a file: its series is meant, even if another has more slices.
    if wanted in found:
        return found[wanted]
    if len(found) > 1:
        sizes = sorted(map(len, found.values()), reverse=True)
        warnings.warn(
            f"{source} holds {len(found)} series of {sizes} images; the largest is taken",
            stacklevel=4,
        )
    return max(found.values(), key=len)


def _slices(
    pydicom: Any, headers: list[tuple[Path, Any]], source: Path
) -> tuple[NDArray[Any], Spacing]:
    if len(headers) < 2:
        raise ValueError(f"{source} must hold a series of slices, got a single slice")
    # Scouts are often stored with a series and have another size.
    shapes = {(int(h.Rows), int(h.Columns)) for _, h in headers}
    if len(shapes) > 1:
        raise ValueError(f"the slices of {source} must have one size, got {sorted(shapes)}")
    heights = _heights([h for _, h in headers])
    order = np.argsort(heights, kind="stable")[::-1]
    gaps = -np.diff(heights[order])
    # The median: one missing slice may not stretch all others.
    gap = float(np.median(gaps))
    first = headers[0][1]
    if gap <= 0 or "ImagePositionPatient" not in first:
        gap = float(first.get("SpacingBetweenSlices") or first.get("SliceThickness") or 1.0)
    # A tenth of a gap is rounding of positions; more is a missing or doubled slice.
    elif np.abs(gaps - gap).max() > 0.1 * gap:
        warnings.warn(
            f"the slices of {source} are {gaps.min():.3g} to {gaps.max():.3g} mm apart; "
            f"{gap:.3g} mm is taken for all, so lengths along z may be off",
            stacklevel=4,
        )
    # Every slice by its own slope: scanners may change it from slice to slice.
    planes = [_pixels(pydicom, headers[i][0]) for i in order]
    rows, cols = (float(v) for v in first.get("PixelSpacing") or (1.0, 1.0))
    volume = checked_volume_array(np.stack(planes), source)
    return volume, checked_spacing((gap, rows, cols), source)


def _heights(headers: list[Any]) -> NDArray[np.float64]:
    # Positions along the common normal; instance numbers, reversed, where there are none.
    if all("ImagePositionPatient" in h for h in headers):
        along = [float(v) for v in headers[0].get("ImageOrientationPatient") or (1, 0, 0, 0, 1, 0)]
        normal = np.cross(along[:3], along[3:])
        return np.array([normal @ np.asarray(h.ImagePositionPatient, float) for h in headers])
    return np.array([-float(h.get("InstanceNumber") or 0) for h in headers])


def _pixels(pydicom: Any, path: Path) -> NDArray[Any]:
    data = pydicom.dcmread(path, force=True)
    try:
        raw: NDArray[Any] = data.pixel_array
    except (AttributeError, ValueError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"the pixels of {path} cannot be read: {error}") from error
    return _density(raw, data)


def _density(raw: NDArray[Any], data: Any) -> NDArray[Any]:
    slope, intercept = _rescale(data)
    if data.get("Modality") == "CT":
        # In float32, which holds the 16 bits of CT exactly, at half the memory of float64.
        number = np.rint(raw * np.float32(slope) + np.float32(intercept + 1000))
        return np.clip(number, 0, HIGHEST).astype(np.uint16)
    # Nothing to do: labels and images of other kinds keep their whole numbers.
    if (slope, intercept) == (1.0, 0.0):
        return raw
    return raw.astype(np.float32) * np.float32(slope) + np.float32(intercept)


def _rescale(data: Any) -> tuple[float, float]:
    source = data
    shared = data.get("SharedFunctionalGroupsSequence")
    # Enhanced CT keeps it in the groups that all frames share.
    if "RescaleSlope" not in data and shared and "PixelValueTransformationSequence" in shared[0]:
        source = shared[0].PixelValueTransformationSequence[0]
    return float(source.get("RescaleSlope", 1.0)), float(source.get("RescaleIntercept", 0.0))


def _multi_frame(pydicom: Any, path: Path) -> tuple[NDArray[Any], Spacing]:
    data = pydicom.dcmread(path, force=True)
    measures = data
    shared = data.get("SharedFunctionalGroupsSequence")
    if shared and "PixelMeasuresSequence" in shared[0]:
        measures = shared[0].PixelMeasuresSequence[0]
    rows, cols = (float(v) for v in measures.get("PixelSpacing") or (1.0, 1.0))
    gap = measures.get("SpacingBetweenSlices") or measures.get("SliceThickness") or 1.0
    volume = checked_volume_array(_pixels(pydicom, path), path)
    heights = _frame_heights(data)
    # Frames without positions stay in the order of the file: there is nothing better to go by.
    if len(heights) == len(volume) and len(volume) > 1:
        order = np.argsort(heights, kind="stable")[::-1]
        volume = np.ascontiguousarray(volume[order])
        gap = float(np.median(-np.diff(heights[order]))) or gap
    return volume, checked_spacing((float(gap), rows, cols), path)


def _frame_heights(data: Any) -> NDArray[np.float64]:
    frames = data.get("PerFrameFunctionalGroupsSequence") or []
    shared = (data.get("SharedFunctionalGroupsSequence") or [{}])[0]
    heights = []
    for frame in frames:
        turn = frame if "PlaneOrientationSequence" in frame else shared
        if "PlanePositionSequence" not in frame or "PlaneOrientationSequence" not in turn:
            # One frame without a place, and no order can be told for any.
            return np.zeros(0)
        along = turn.PlaneOrientationSequence[0].ImageOrientationPatient
        normal = np.cross([float(v) for v in along[:3]], [float(v) for v in along[3:]])
        place = frame.PlanePositionSequence[0].ImagePositionPatient
        heights.append(float(normal @ np.asarray(place, float)))
    return np.array(heights)
