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
    assert scan.turned


def test_a_file_of_a_series_opens_its_series(tmp_path: Path) -> None:
    write_series(tmp_path)
    write_series(tmp_path, NUMBERS[:2], SeriesInstanceUID="1.2.4")
    (tmp_path / "a").rename(tmp_path / "slice.dcm")
    assert load_volume(tmp_path / "slice.dcm").volume.shape == (3, 4, 5)
    assert load_volume(tmp_path / "c1.2.4").volume.shape == (2, 4, 5)
    scan = load_volume(tmp_path)
    assert scan.volume.shape == (3, 4, 5)
    assert "2 series of [3, 2] images" in scan.assumed[0]


def test_folders_below_are_read_where_a_folder_has_no_scan_itself(tmp_path: Path) -> None:
    write_series(tmp_path / "p")
    write_series(tmp_path / "p" / "more", NUMBERS + 5, SeriesInstanceUID="1.2.4")
    screen = dataset(NUMBERS[0], PhotometricInterpretation="PALETTE COLOR")
    screen.save_as(tmp_path / "p" / "0.dcm", enforce_file_format=True)
    scan = load_volume(tmp_path / "p")
    np.testing.assert_array_equal(scan.volume[1], 1000 + np.arange(20).reshape(4, 5))
    assert scan.volume.shape == (3, 4, 5)
    assert "folders in it were left out" in scan.assumed
    # A screenshot and a scout are no scan.
    for name in "ab":
        (tmp_path / "p" / name).unlink()
    scan = load_volume(tmp_path / "p" / "more")
    np.testing.assert_array_equal(load_volume(tmp_path / "p").volume, scan.volume)


AXIAL = [1, 0, 0, 0, 1, 0]


def save_slices(folder: Path, planes: Any, places: Any, **tags: Any) -> None:
    for plane, place in zip(planes, places, strict=True):
        data = dataset(
            plane, ImagePositionPatient=list(place), ImageOrientationPatient=AXIAL, **tags
        )
        data.save_as(folder / f"{len(list(folder.iterdir()))}.dcm", enforce_file_format=True)


def flat(*numbers: int, shape: tuple[int, int] = (4, 5)) -> list[np.ndarray]:
    return [np.full(shape, number) for number in numbers]


def test_a_missing_slice_is_interpolated_and_told(tmp_path: Path) -> None:
    save_slices(tmp_path, flat(0, 100, 200, 400), [(0, 0, z) for z in (0.0, 1.0, 2.0, 4.0)])
    scan = load_volume(tmp_path)
    # From the top: 400 at 4 mm, half way to 200 at 3 mm, and so on.
    assert scan.volume[:, 0, 0].tolist() == [1400, 1300, 1200, 1100, 1000]
    assert scan.spacing[0] == 1.0
    assert "1 to 2 mm apart: they were interpolated to 1 mm" in scan.assumed[0]


def test_a_gap_too_large_to_bridge_is_refused(tmp_path: Path) -> None:
    save_slices(tmp_path, flat(0, 0, 0, 0), [(0, 0, z) for z in (0.0, 1.0, 2.0, 9.0)])
    with pytest.raises(ValueError, match=r"1 mm apart, but 7 mm at 9 mm: slices are missing"):
        load_volume(tmp_path)


def test_slices_of_a_tilted_gantry_are_moved_back(tmp_path: Path) -> None:
    # A column of water that stands upright: each slice begins one row, 0.5 mm, further back.
    planes = [
        np.where(np.arange(8)[:, None] == 5 - k, 0, -1000) + np.zeros((8, 4)) for k in range(4)
    ]
    save_slices(tmp_path, planes, [(0, 0.5 * k, 2.0 * k) for k in range(4)])
    scan = load_volume(tmp_path)
    assert scan.volume.shape == (4, 11, 4)
    np.testing.assert_array_equal(scan.volume[:, :, 0].argmax(axis=1), 5)
    assert scan.volume[:, 5].min() == 1000
    assert np.delete(scan.volume, 5, axis=1).max() == 0
    assert "shifted by up to 3 pixels, as of a tilted gantry" in scan.assumed[0]
    # The column stands at y = 2.5 mm; in the first slice, the highest, it was pixel 2 at 1.5 mm.
    assert scan.scanner_from_scan is not None
    there = scan.scanner_from_scan @ [0, 5 * scan.spacing[1], 0, 1]
    assert there[:3] == pytest.approx((0, 2.5, 6))


def test_two_phases_of_one_place_are_time_points(tmp_path: Path) -> None:
    places = [(0, 0, z) for z in (0.0, 1.0, 2.0)]
    save_slices(tmp_path, flat(7, 8, 9), places, AcquisitionNumber=2)
    save_slices(tmp_path, flat(0, 1, 2), places, AcquisitionNumber=1)
    with pytest.raises(ValueError, match=r"holds 2 time points .* from 0 to 1, such as t=0"):
        load_volume(tmp_path)
    assert load_volume(tmp_path, {"t": 0}).volume[:, 0, 0].tolist() == [1002, 1001, 1000]
    assert load_volume(tmp_path, {"t": 1}).volume[:, 0, 0].tolist() == [1009, 1008, 1007]
    with pytest.raises(ValueError, match="there is no t=2"):
        load_volume(tmp_path, {"t": 2})


def test_a_slice_that_is_there_twice_is_taken_once_or_refused(tmp_path: Path) -> None:
    save_slices(tmp_path, flat(0, 1, 2, 1), [(0, 0, z) for z in (0.0, 1.0, 2.0, 1.0)])
    scan = load_volume(tmp_path)
    assert scan.volume[:, 0, 0].tolist() == [1002, 1001, 1000]
    assert scan.assumed == ("1 of its images are there twice: taken once",)
    save_slices(tmp_path, flat(5), [(0, 0, 2.0)])
    with pytest.raises(ValueError, match="2 different slices at 2 mm"):
        load_volume(tmp_path)


def test_scouts_and_slices_of_other_pixels_are_left_out(tmp_path: Path) -> None:
    save_slices(tmp_path, flat(0, 1, 2), [(0, 0, z) for z in (0.0, 1.0, 2.0)])
    for name, tags in {
        "scout": {
            "ImageOrientationPatient": [0, 1, 0, 0, 0, -1],
            "ImagePositionPatient": [0, 0, 1],
        },
        "coarse": {
            "ImageOrientationPatient": AXIAL,
            "ImagePositionPatient": [0, 0, 3],
            "PixelSpacing": [1, 1],
        },
    }.items():
        dataset(np.zeros((4, 5), int), **tags).save_as(
            tmp_path / f"{name}.dcm", enforce_file_format=True
        )
    scan = load_volume(tmp_path)
    assert scan.volume.shape == (3, 4, 5)
    assert scan.assumed == (
        "2 of its 5 images have another size, direction or pixel size: they were left out",
    )


def test_as_many_slices_of_two_kinds_are_refused(tmp_path: Path) -> None:
    save_slices(tmp_path, flat(0, 1), [(0, 0, 0), (0, 0, 1)])
    save_slices(tmp_path, flat(0, 1), [(0, 0, 0), (0, 0, 1)], PixelSpacing=[1, 1])
    with pytest.raises(ValueError, match="2 kinds of slices, as many of each"):
        load_volume(tmp_path)


def test_what_a_series_does_not_say_is_told(tmp_path: Path) -> None:
    for i, plane in enumerate(flat(0, 1, 2)):
        data = dataset(plane, InstanceNumber=i + 1, SliceThickness=2.0)
        del data.PixelSpacing, data.RescaleIntercept
        data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)
    scan = load_volume(tmp_path)
    assert scan.spacing == (2.0, 1.0, 1.0)
    assert scan.volume[:, 0, 0].tolist() == [2024, 2025, 2026]
    assert [sentence.split(":")[0] for sentence in scan.assumed] == [
        "it gives no pixel size",
        "it does not say what its numbers mean",
        "it gives no positions of its slices",
        "it gives no distance of slices",
    ]


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        ({"RescaleSlope": "nan"}, "RescaleSlope"),
        ({"RescaleSlope": 0}, "RescaleSlope of 0"),
        ({"RescaleSlope": [1, 1]}, "a number as its RescaleSlope, got 1, 1"),
        (
            {"RescaleIntercept": [-1024, -1024]},
            "a number as its RescaleIntercept, got -1024, -1024",
        ),
        ({"PixelSpacing": [0, 0.7]}, "positive numbers"),
        ({"PixelSpacing": 0.7}, "2 numbers as its PixelSpacing, got 0.7"),
        ({"ImageOrientationPatient": [2, 0, 0, 0, 2, 0]}, "length 1"),
        ({"ImageOrientationPatient": [1, 0, 0, 0.5, 0.8, 0]}, "right angles"),
        ({"ImageOrientationPatient": [0, 0, 0, 0, 0, 0]}, "length 1"),
        ({"PhotometricInterpretation": "PALETTE COLOR"}, "colours"),
    ],
)
def test_slices_of_numbers_that_mean_nothing_are_refused(
    tmp_path: Path, tags: dict[str, Any], said: str
) -> None:
    for i, plane in enumerate(NUMBERS):
        data = dataset(plane, ImageOrientationPatient=AXIAL, ImagePositionPatient=[0, 0, i])
        data.update(dataset(plane, **tags))
        data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match=said):
        load_volume(tmp_path)


def test_directions_of_two_decimals_give_the_distance_of_slices(tmp_path: Path) -> None:
    # Turned by 45 degrees about x; (0, 0.71, 0.71) is 0.4 % too long.
    for i, plane in enumerate(NUMBERS):
        place = [0, -2 * i * 0.5**0.5, 2 * i * 0.5**0.5]
        data = dataset(
            plane, ImageOrientationPatient=[1, 0, 0, 0, 0.71, 0.71], ImagePositionPatient=place
        )
        data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)
    assert load_volume(tmp_path).spacing[0] == pytest.approx(2, rel=1e-6)


def test_directions_not_quite_at_right_angles_place_the_scan_at_right_angles(
    tmp_path: Path,
) -> None:
    for i, plane in enumerate(NUMBERS):
        tags = {"ImageOrientationPatient": [1, 0.01, 0, 0, 1, 0]}
        data = dataset(plane, ImagePositionPatient=[0, 0, 2 * i], **tags)
        data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)
    place = load_volume(tmp_path).scanner_from_scan
    assert place is not None
    np.testing.assert_allclose(place[:3, :3] @ place[:3, :3].T, np.eye(3), atol=1e-12)


def test_images_in_colours_are_no_slices(tmp_path: Path) -> None:
    colours = {
        "SamplesPerPixel": 3,
        "PhotometricInterpretation": "RGB",
        "PlanarConfiguration": 0,
        "BitsAllocated": 8,
        "BitsStored": 8,
        "HighBit": 7,
        "PixelData": bytes(60),
    }
    for i in range(2):
        data = dataset(NUMBERS[0], ImagePositionPatient=[0, 0, i], **colours)
        data.save_as(tmp_path / f"screen {i}.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match="image in colours"):
        load_volume(tmp_path)
    with pytest.raises(ValueError, match="image in colours"):
        load_volume(tmp_path / "screen 0.dcm")
    write_series(tmp_path)
    scan = load_volume(tmp_path)
    assert scan.volume.shape == (3, 4, 5)
    assert "2 image(s) in colours (screen 0.dcm, screen 1.dcm): left out" in scan.assumed[0]


def test_acquisitions_that_lie_between_each_other_are_told(tmp_path: Path) -> None:
    def write(heights: list[float]) -> None:
        for i, height in enumerate(heights):
            data = dataset(
                NUMBERS[i % 3],
                ImagePositionPatient=[0, 0, height],
                ImageOrientationPatient=AXIAL,
                AcquisitionNumber=1 + i // 3,
            )
            data.save_as(tmp_path / f"{i}.dcm", enforce_file_format=True)

    write([0, 2, 4, 1, 3, 5])
    assert "2 acquisitions (AcquisitionNumber)" in load_volume(tmp_path).assumed[0]
    # The third begins and ends within the first; in order it lies between the other two.
    write([0, 10, 20, 1, 2, 3, 4.5, 14.5, 24.5])
    assert "3 acquisitions (AcquisitionNumber)" in load_volume(tmp_path).assumed[0]
    for i in range(6, 9):
        (tmp_path / f"{i}.dcm").unlink()
    # One stretch after the other is how long scans are made.
    write([0, 1, 2, 3, 4, 5])
    assert load_volume(tmp_path).assumed == ()


def test_one_image_that_does_not_say_what_its_numbers_mean_is_told(tmp_path: Path) -> None:
    write_series(tmp_path)
    data = pydicom.dcmread(tmp_path / "b")
    del data.RescaleIntercept
    data.save_as(tmp_path / "b")
    assert load_volume(tmp_path).assumed == (
        "1 of its 3 images do not say what their numbers mean: CT numbers were assumed",
    )


def test_a_regular_series_is_as_simpleitk_reads_it(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    rng = np.random.default_rng(0)
    planes = rng.integers(-1000, 2000, (5, 6, 7))
    save_slices(tmp_path, planes, [(3, 4, 1.5 * k) for k in range(5)])
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(tmp_path)))
    expected = reader.Execute()
    scan = load_volume(tmp_path)
    # ITK stacks from the lowest slice up; here the highest comes first.
    np.testing.assert_array_equal(scan.volume[::-1], sitk.GetArrayFromImage(expected) + 1000.0)
    assert scan.spacing == pytest.approx(expected.GetSpacing()[::-1])
    assert scan.assumed == ()
    assert scan.scanner_from_scan is not None
    for z, y, x in ((0, 0, 0), (4, 5, 6)):
        there = scan.scanner_from_scan @ [*np.multiply((z, y, x), scan.spacing), 1]
        assert there[:3] == pytest.approx(expected.TransformIndexToPhysicalPoint((x, y, 4 - z)))


GAP, TILT, DOUBLE = (
    [(3, 4, z) for z in (0.0, 1.5, 3.0, 6.0)],
    [(3, 4 + 0.5 * k, 2.0 * k) for k in range(4)],
    [(3, 4, z) for z in (0.0, 1.5, 3.0, 1.5)],
)


@pytest.mark.parametrize(
    ("places", "order", "at"),
    [
        (GAP, (0, 1, 2, 3), None),
        (TILT, (0, 1, 2, 3), None),
        (DOUBLE, (0, 1, 2, 1), None),
        (GAP[:3], (0, 1, 2), {"t": 1}),
    ],
    ids=["gap", "tilt", "double", "phases"],
)
def test_every_slice_of_an_irregular_series_is_and_lies_as_simpleitk_reads_it(
    tmp_path: Path, places: Any, order: Any, at: Any
) -> None:
    sitk = pytest.importorskip("SimpleITK")
    from scipy.ndimage import map_coordinates

    planes = np.random.default_rng(0).integers(-900, 2000, (4, 6, 7))
    save_slices(tmp_path, planes[list(order)], places, AcquisitionNumber=2)
    files = sorted(tmp_path.iterdir())
    if at is not None:
        save_slices(tmp_path, planes[:3] + 50, places, AcquisitionNumber=1)
    scan = load_volume(tmp_path, at)
    assert scan.scanner_from_scan is not None
    assert (scan.assumed != ()) == (at is None)
    scan_from_scanner = np.linalg.inv(scan.scanner_from_scan)
    for file in files:
        image = sitk.ReadImage(str(file))
        values = sitk.GetArrayFromImage(image)[0] + 1000.0
        for y, x in np.ndindex(values.shape):
            there = [*image.TransformIndexToPhysicalPoint((x, y, 0)), 1]
            index = (scan_from_scanner @ there)[:3] / scan.spacing
            found = map_coordinates(scan.volume.astype(float), index[:, None], order=1)
            assert found == pytest.approx(values[y, x], abs=1e-3)


@pytest.mark.parametrize("shared", [True, False])
def test_an_enhanced_file_has_its_groups_honoured(tmp_path: Path, shared: bool) -> None:
    from pydicom.dataset import Dataset

    def item(**values: Any) -> Any:
        made = Dataset()
        for name, value in values.items():
            setattr(made, name, value)
        return made

    def groups(k: int, positioned: bool, valued: bool) -> Any:
        made = Dataset()
        if positioned:
            made.PlanePositionSequence = [item(ImagePositionPatient=[0, 0, 1.5 * k])]
        if valued:
            made.PlaneOrientationSequence = [item(ImageOrientationPatient=AXIAL)]
            made.PixelMeasuresSequence = [item(PixelSpacing=[0.5, 0.75], SliceThickness=9)]
            # Each frame by its own rescale, where the groups are the frames' own.
            slope = 1 if shared else k + 1
            made.PixelValueTransformationSequence = [
                item(RescaleSlope=slope, RescaleIntercept=-1000, RescaleType="HU")
            ]
        return made

    stored = np.arange(3 * 4 * 5).reshape(3, 4, 5)
    data = dataset(stored - 1024, NumberOfFrames=3)
    del data.PixelSpacing, data.RescaleSlope, data.RescaleIntercept
    data.PerFrameFunctionalGroupsSequence = [groups(k, True, not shared) for k in range(3)]
    data.SharedFunctionalGroupsSequence = [groups(0, False, shared)]
    data.save_as(tmp_path / "enhanced.dcm", enforce_file_format=True)
    scan = load_volume(tmp_path / "enhanced.dcm")
    slopes = np.ones(3, int) if shared else np.array([1, 2, 3])
    np.testing.assert_array_equal(scan.volume, (stored * slopes[:, None, None])[::-1])
    assert scan.spacing == (1.5, 0.5, 0.75)
    assert scan.assumed == ()


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


def test_a_named_file_without_a_preamble_opens_its_own_series(tmp_path: Path) -> None:
    write_series(tmp_path)
    write_series(tmp_path / "other", NUMBERS[:2] + 7, SeriesInstanceUID="1.2.4")
    for file in (tmp_path / "other").iterdir():
        (tmp_path / f"{file.name}.dcs").write_bytes(file.read_bytes()[132:])
    (tmp_path / "readme.txt").write_text("not an image")
    scan = load_volume(tmp_path / "a1.2.4.dcs")
    np.testing.assert_array_equal(scan.volume[1], 7 + np.arange(20).reshape(4, 5))
    assert scan.volume.shape == (2, 4, 5)
    assert load_volume(tmp_path / "a").volume.shape == (3, 4, 5)
    # A series of one is told as such: nothing else is taken for it.
    (tmp_path / "a1.2.4.dcs").unlink()
    with pytest.raises(ValueError, match="single slice"):
        load_volume(tmp_path / "c1.2.4.dcs")


def test_what_begins_unlike_dicom_is_not_taken_apart_beside_a_file_without_a_preamble(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_series(tmp_path)
    for file in list(tmp_path.iterdir()):
        (tmp_path / f"{file.name}.dcs").write_bytes(file.read_bytes()[132:])
        file.unlink()
    # Zeros are elements to a parser that is forced, a million of them in 8 MB.
    (tmp_path / "zeros.raw").write_bytes(bytes(8000))
    forced, read = [], pydicom.dcmread

    def noting(path: Path, force: bool = False, **more: Any) -> Any:
        forced.extend([path.name] * force)
        return read(path, force=force, **more)

    monkeypatch.setattr(pydicom, "dcmread", noting)
    assert load_volume(tmp_path / "a.dcs").volume.shape == (3, 4, 5)
    assert set(forced) == {"a.dcs", "b.dcs", "c.dcs"}


@pytest.mark.parametrize("more", [{"NumberOfFrames": 10**8}, {"Rows": 60000, "Columns": 60000}])
def test_a_dicom_file_asks_for_no_more_than_it_holds(tmp_path: Path, more: dict[str, int]) -> None:
    path = tmp_path / "a.dcm"
    data = dataset(NUMBERS, **{"NumberOfFrames": 3, **more})
    data.save_as(path, enforce_file_format=True)
    with pytest.raises(ValueError, match=r"a.dcm is not whole: its header asks for [\d,]+ bytes"):
        load_volume(path)


def test_a_single_slice_is_no_volume(tmp_path: Path) -> None:
    dataset(NUMBERS[0]).save_as(tmp_path / "one.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match="single slice"):
        load_volume(tmp_path / "one.dcm")


def segmentation(segments: np.ndarray) -> Any:
    """Return a binary segmentation of (S, K, R, C) segments, a frame a slice of each."""
    from pydicom.pixels import pack_bits
    from pydicom.uid import SegmentationStorage

    count, slices = segments.shape[:2]
    data = dataset(
        segments, SOPClassUID=SegmentationStorage, NumberOfFrames=count * slices, Modality="SEG"
    )
    data.SeriesInstanceUID, data.SegmentationType = "1.2.5", "BINARY"
    data.BitsAllocated, data.BitsStored, data.HighBit = 1, 1, 0
    data.PixelData = pack_bits(segments.astype(np.uint8))
    del data.RescaleSlope, data.RescaleIntercept
    data.PerFrameFunctionalGroupsSequence = [pydicom.Dataset() for _ in range(count * slices)]
    for n, groups in enumerate(data.PerFrameFunctionalGroupsSequence):
        position, which = pydicom.Dataset(), pydicom.Dataset()
        position.ImagePositionPatient = [7, 8, 2.5 * (n % slices)]
        which.ReferencedSegmentNumber = 1 + n // slices
        groups.PlanePositionSequence = [position]
        groups.SegmentIdentificationSequence = [which]
    return data


@pytest.mark.parametrize("named", ["segments.dcm", "."])
def test_a_segmentation_is_told_as_such_and_never_read_as_time_points(
    tmp_path: Path, named: str
) -> None:
    # Two segments of three slices: six frames at three places, as two time points have.
    segments = np.zeros((2, 3, 4, 5), np.int32)
    segments[0, :, :2], segments[1, :, 2:] = 1, 1
    segmentation(segments).save_as(tmp_path / "segments.dcm", enforce_file_format=True)
    with pytest.raises(ValueError, match=r"segments.dcm is a DICOM segmentation, not a scan: save"):
        load_volume(tmp_path / named)


def test_a_segmentation_beside_a_scan_is_left_out(tmp_path: Path) -> None:
    write_series(tmp_path)
    segments = np.ones((2, 3, 4, 5), np.int32)
    segmentation(segments).save_as(tmp_path / "segments.dcm", enforce_file_format=True)
    scan = load_volume(tmp_path)
    assert scan.volume[1].tolist() == (1000 + np.arange(20).reshape(4, 5)).tolist()
    assert scan.assumed == ("it holds 1 segmentation(s) (segments.dcm): left out",)
