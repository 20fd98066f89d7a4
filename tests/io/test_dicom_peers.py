"""Series read as two other readers of DICOM have them: dcm2niix and highdicom."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import dcm2niix
import numpy as np
import pytest
import SimpleITK as sitk
from highdicom.legacy import LegacyConvertedEnhancedCTImage
from pydicom.uid import generate_uid
from test_dicom import dataset

from napari_unpack.geometry.axes import transform_points
from napari_unpack.io import Scan, load_volume

SHAPE = (6, 9, 8)
DISTANCE = 2.5
COS, SIN = np.cos(0.3), np.sin(0.3)
ORIENTATIONS = {
    "axial": [1, 0, 0, 0, 1, 0],
    "coronal": [1, 0, 0, 0, 0, -1],
    "oblique": [COS, SIN, 0, -SIN * COS, COS * COS, SIN],
}


def write(folder: Path, orientation: list[float], reverse: bool, **tags: Any) -> list[Any]:
    """Write a series of random CT numbers; return its slices."""
    folder.mkdir()
    numbers = np.random.default_rng(0).integers(-900, 3000, SHAPE)
    normal = np.cross(orientation[:3], orientation[3:])
    slices = []
    for k, plane in enumerate(numbers):
        place = np.array([-31.0, 12.5, 140.0]) + DISTANCE * k * normal
        slices.append(
            dataset(
                plane,
                ImagePositionPatient=[round(v, 6) for v in place.tolist()],
                ImageOrientationPatient=[round(v, 8) for v in orientation],
                InstanceNumber=len(numbers) - k if reverse else k + 1,
                SliceThickness=DISTANCE,
                StudyInstanceUID="1.2",
                FrameOfReferenceUID="1.4",
                Manufacturer="none",
                SeriesNumber=1,
                PatientPosition="HFS",
                **tags,
            )
        )
        slices[-1].save_as(folder / f"{k}.dcm", enforce_file_format=True)
    return slices


def assert_same_scan(ours: Scan, peer: sitk.Image) -> None:
    """Compare every voxel with the peer's at the same place of the scanner, in CT numbers."""
    assert ours.volume.size == np.prod(SHAPE) == np.prod(peer.GetSize())
    assert ours.scanner_from_scan is not None
    voxels = np.argwhere(np.ones(ours.volume.shape, bool))
    places = transform_points(ours.scanner_from_scan, voxels * np.array(ours.spacing))
    for voxel, place in zip(voxels, places, strict=True):
        index = peer.TransformPhysicalPointToContinuousIndex(place.tolist())
        there = [round(i) for i in index]
        np.testing.assert_allclose(index, there, atol=2e-3)
        # Ours are 1000 above, so that air is 0.
        assert ours.volume[tuple(voxel)] == peer.GetPixel(there) + 1000


@pytest.mark.parametrize("reverse", [False, True], ids=["", "reversed"])
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_a_series_is_as_dcm2niix_converts_it(
    tmp_path: Path, orientation: str, reverse: bool
) -> None:
    write(tmp_path / "scan", ORIENTATIONS[orientation], reverse)
    (tmp_path / "out").mkdir()
    command = [dcm2niix.bin, "-z", "n", "-f", "peer", "-o", tmp_path / "out", tmp_path / "scan"]
    subprocess.run(command, check=True, capture_output=True)
    (converted,) = (tmp_path / "out").glob("*.nii")
    assert_same_scan(
        load_volume(tmp_path / "scan"), sitk.ReadImage(str(converted), sitk.sitkFloat64)
    )


def test_an_enhanced_file_that_highdicom_makes_of_a_series_is_that_series(tmp_path: Path) -> None:
    slices = write(tmp_path / "scan", ORIENTATIONS["oblique"], reverse=False)
    enhanced = LegacyConvertedEnhancedCTImage(
        slices,
        series_instance_uid=generate_uid(),
        series_number=2,
        sop_instance_uid=generate_uid(),
        instance_number=1,
    )
    enhanced.save_as(tmp_path / "enhanced.dcm")
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames([str(tmp_path / "scan" / f"{k}.dcm") for k in range(SHAPE[0])])
    assert_same_scan(load_volume(tmp_path / "enhanced.dcm"), reader.Execute())
