"""DICOM series and DICOS files, made here slice by slice."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unpack.io import load_volume

pydicom = pytest.importorskip("pydicom")

# CT numbers with air, water and steel; stored as number + 1024.
NUMBERS = np.array([-1000, 0, 31500], np.int32)[:, None, None] + np.arange(20).reshape(4, 5)


def dataset(plane: np.ndarray, **tags: Any) -> Any:
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    data = Dataset()
    data.file_meta = FileMetaDataset()
    data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = generate_uid()
    data.Modality = "CT"
    data.SeriesInstanceUID = "1.2.3"
    data.Rows, data.Columns = plane.shape[-2:]
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
    data.PixelSpacing = [0.5, 0.75]
    data.RescaleSlope, data.RescaleIntercept = 1, -1024
    data.PixelData = (plane + 1024).astype("<u2").tobytes()
    for name, value in tags.items():
        setattr(data, name, value)
    return data


def write_series(folder: Path, numbers: np.ndarray = NUMBERS, **tags: Any) -> None:
    folder.mkdir(exist_ok=True)
    # The first slice is the lowest; files are named so that names mislead.
    for i, plane in enumerate(numbers):
        data = dataset(
            plane,
            ImagePositionPatient=[7, 8, 2.5 * i],
            ImageOrientationPatient=[1, 0, 0, 0, 1, 0],
            InstanceNumber=99 - i,
            **tags,
        )
        data.save_as(
            folder / f"{'cab'[i]}{tags.get('SeriesInstanceUID', '')}", enforce_file_format=True
        )


def test_a_series_is_sorted_by_position_and_rescaled(tmp_path: Path) -> None:
    write_series(tmp_path / "scan")
    (tmp_path / "scan" / "readme.txt").write_text("not an image")
    scan = load_volume(tmp_path / "scan")
    # The highest slice, steel, comes first; 31500 + 1000 and more is clipped to 32000.
    np.testing.assert_array_equal(scan.volume[0], np.full((4, 5), 32000))
    np.testing.assert_array_equal(scan.volume[1], 1000 + np.arange(20).reshape(4, 5))
    np.testing.assert_array_equal(scan.volume[2], np.arange(20).reshape(4, 5))
    assert scan.volume.dtype == np.uint16
    assert scan.spacing == (2.5, 0.5, 0.75)


def test_a_file_of_a_series_opens_its_series(tmp_path: Path) -> None:
    write_series(tmp_path)
    write_series(tmp_path, NUMBERS[:2], SeriesInstanceUID="1.2.4")
    (tmp_path / "a").rename(tmp_path / "slice.dcm")
    assert load_volume(tmp_path / "slice.dcm").volume.shape == (3, 4, 5)
    assert load_volume(tmp_path / "c1.2.4").volume.shape == (2, 4, 5)
    with pytest.warns(UserWarning, match="2 series"):
        assert load_volume(tmp_path).volume.shape == (3, 4, 5)


def test_a_missing_slice_is_told(tmp_path: Path) -> None:
    rows = np.concatenate([NUMBERS, NUMBERS[:1]])
    for i, z in enumerate([0.0, 1.0, 2.0, 4.0]):
        data = dataset(
            rows[i], ImagePositionPatient=[0, 0, z], ImageOrientationPatient=[1, 0, 0, 0, 1, 0]
        )
        data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)
    with pytest.warns(UserWarning, match="1 to 2 mm apart"):
        assert load_volume(tmp_path).spacing[0] == 1.0


def test_a_multi_frame_dicos_file_without_a_preamble(tmp_path: Path) -> None:
    data = dataset(NUMBERS, NumberOfFrames=3, SpacingBetweenSlices=1.25)
    data.save_as(
        tmp_path / "bag.dcs", implicit_vr=False, little_endian=True, enforce_file_format=False
    )
    raw = (tmp_path / "bag.dcs").read_bytes()
    (tmp_path / "bag.dcs").write_bytes(raw[132:] if raw[128:132] == b"DICM" else raw)
    scan = load_volume(tmp_path / "bag.dcs")
    np.testing.assert_array_equal(scan.volume[0], np.arange(20).reshape(4, 5))
    assert scan.volume.shape == (3, 4, 5)
    assert scan.spacing == (1.25, 0.5, 0.75)


def test_slices_of_different_sizes_are_refused(tmp_path: Path) -> None:
    write_series(tmp_path)
    data = dataset(np.zeros((2, 2), int), ImagePositionPatient=[0, 0, 9])
    data.save_as(tmp_path / "other.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match=r"one size, got \[\(2, 2\), \(4, 5\)\]"):
        load_volume(tmp_path)


def test_a_single_slice_is_no_volume(tmp_path: Path) -> None:
    dataset(NUMBERS[0]).save_as(tmp_path / "one.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match="single slice"):
        load_volume(tmp_path / "one.dcm")
