"""Compressed DICOM: each transfer syntax against the same series uncompressed, and SimpleITK."""

from pathlib import Path
from typing import Any

import gdcm
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from test_dicom import AXIAL, dataset

from napari_unpack.io import load_volume

# 12 bits, as most scanners store: signed in CT would be 16, which JPEG with loss cannot hold.
PLANES = np.random.default_rng(0).integers(0, 3000, (4, 24, 32)) - 1000
PLANES.sort(axis=2)

LOSSLESS = {
    "JPEG Lossless": gdcm.TransferSyntax.JPEGLosslessProcess14,
    "JPEG Lossless, first-order prediction": gdcm.TransferSyntax.JPEGLosslessProcess14_1,
    "JPEG-LS Lossless": gdcm.TransferSyntax.JPEGLSLossless,
    "JPEG 2000 Lossless": gdcm.TransferSyntax.JPEG2000Lossless,
}
LOSSY = {
    "JPEG-LS Near-lossless": gdcm.TransferSyntax.JPEGLSNearLossless,
    "JPEG 2000": gdcm.TransferSyntax.JPEG2000,
}


def series(folder: Path, **tags: Any) -> list[Path]:
    """Write uncompressed slices, 12 bits of 16."""
    files = []
    for k, plane in enumerate(PLANES):
        place = [0, 0, 2.5 * k]
        data = dataset(plane, ImagePositionPatient=place, ImageOrientationPatient=AXIAL, **tags)
        data.BitsStored, data.HighBit, data.StudyInstanceUID = 12, 11, "1.2"
        data.FrameOfReferenceUID, data.InstanceNumber = "1.2.9", k
        files.append(folder / f"{k}.dcm")
        data.save_as(files[-1], enforce_file_format=True)
    return files


def compress(file: Path, syntax: Any) -> None:
    """Encode a file's pixels by GDCM."""
    reader = gdcm.ImageReader()
    reader.SetFileName(str(file))
    assert reader.Read()
    change = gdcm.ImageChangeTransferSyntax()
    change.SetTransferSyntax(gdcm.TransferSyntax(syntax))
    change.SetInput(reader.GetImage())
    assert change.Change()
    writer = gdcm.ImageWriter()
    writer.SetFile(reader.GetFile())
    writer.SetImage(change.GetOutput())
    writer.SetFileName(str(file))
    assert writer.Write()


def by_itk(folder: Path) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return density and voxel size of a series as SimpleITK reads it, the highest slice first."""
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder)))
    image = reader.Execute()
    return sitk.GetArrayFromImage(image)[::-1] + 1000, image.GetSpacing()[::-1]


@pytest.mark.parametrize("kind", [*LOSSLESS, *LOSSY, "RLE", "none"])
def test_a_compressed_series_is_read_as_it_was_and_as_itk_reads_it(
    tmp_path: Path, kind: str
) -> None:
    for file in series(tmp_path):
        if kind == "RLE":
            data = pydicom.dcmread(file)
            data.compress(pydicom.uid.RLELossless)
            data.save_as(file)
        elif kind != "none":
            compress(file, (LOSSLESS | LOSSY)[kind])
    syntax = pydicom.dcmread(file).file_meta.TransferSyntaxUID
    assert syntax.is_compressed == (kind != "none")
    scan, (itk, spacing) = load_volume(tmp_path), by_itk(tmp_path)
    assert scan.spacing == pytest.approx(spacing)
    np.testing.assert_array_equal(scan.volume, itk)
    wanted = np.clip(PLANES[::-1] + 1000, 0, None)
    apart = np.abs(scan.volume.astype(int) - wanted).max()
    assert apart == 0 if kind not in LOSSY else apart < 400


def test_a_missing_codec_is_named_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in series(tmp_path):
        compress(file, gdcm.TransferSyntax.JPEGLosslessProcess14_1)
    decoder = pydicom.pixels.get_decoder(pydicom.uid.JPEGLosslessSV1)
    monkeypatch.setattr(type(decoder), "is_available", property(lambda self: False))
    with pytest.raises(
        ImportError,
        match=r"3.dcm is compressed as JPEG Lossless.* needs python-gdcm; run: pip install",
    ):
        load_volume(tmp_path)


def test_what_no_codec_can_decode_is_told_in_one_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for file in series(tmp_path):
        compress(file, gdcm.TransferSyntax.JPEGExtendedProcess2_4)
    with pytest.raises(ValueError, match=r"pixels of .*3.dcm cannot be read: .* 12-bit") as told:
        load_volume(tmp_path)
    assert "\n" not in str(told.value)
    # pydicom writes whole tracebacks.
    assert not caplog.records


TURNED = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


@pytest.mark.parametrize(
    "along",
    [(0, 1, 0, 0, 0, -1), (1, 0, 0, 0, 0, -1), (-1, 0, 0, 0, -1, 0), [*TURNED[0], *TURNED[1]]],
    ids=["sagittal", "coronal", "prone", "oblique"],
)
def test_a_series_of_any_direction_is_read_as_itk_reads_it(tmp_path: Path, along: Any) -> None:
    up = np.cross(along[:3], along[3:])
    for k, file in enumerate(series(tmp_path, PixelRepresentation=1)):
        data = pydicom.dcmread(file)
        data.ImageOrientationPatient = [f"{v:.9f}" for v in along]
        data.ImagePositionPatient = [f"{v:.6f}" for v in 2.5 * k * up + (7, 8, 9)]
        # Signed numbers of 16 bits, and a slope.
        data.BitsStored, data.HighBit = 16, 15
        data.RescaleSlope, data.RescaleIntercept = 2, -500
        data.PixelData = (PLANES[k] // 2 - 100).astype("<i2").tobytes()
        data.save_as(file)
    scan, (itk, spacing) = load_volume(tmp_path), by_itk(tmp_path)
    assert scan.spacing == pytest.approx(spacing)
    np.testing.assert_array_equal(scan.volume, np.clip(itk, 0, None))


def test_a_way_of_storing_that_is_none_of_images_is_refused(tmp_path: Path) -> None:
    for file in series(tmp_path):
        data = pydicom.dcmread(file)
        data.file_meta.TransferSyntaxUID = pydicom.uid.MPEG2MPML
        data["PixelData"].is_undefined_length = True
        data.PixelData = pydicom.encaps.encapsulate([b"film"])
        data.save_as(file)
    with pytest.raises(ValueError, match=r"3.dcm is compressed as MPEG2 .*, which is no way"):
        load_volume(tmp_path)
