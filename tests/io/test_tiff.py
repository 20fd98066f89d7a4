"""TIFF stacks as other programs write them."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from napari_unpack.io import load_volume
from napari_unpack.io.file_data import NO_UNIT, NO_VOXEL_SIZE
from napari_unpack.io.napari_reader import get_reader
from napari_unpack.io.slice_folder import slices_in

VOLUME = np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4) - 1000
# Not so narrow that it might be colours.
STACK = np.arange(6 * 7 * 8, dtype=np.uint16).reshape(6, 7, 8)


def test_signed_numbers_of_imagej_are_read_as_it_shows_them(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    stored = (VOLUME.astype(np.int32) + 32768).astype(np.uint16)
    notes = {"axes": "ZYX", "cf": 0, "c0": -32768.0, "c1": 1.0, "vunit": "Gray Value"}
    tifffile.imwrite(path, stored, imagej=True, metadata=notes)
    np.testing.assert_array_equal(load_volume(path).volume, VOLUME, strict=True)
    # A density that was calibrated is no other number.
    tifffile.imwrite(path, stored, imagej=True, metadata=notes | {"c1": 0.5})
    np.testing.assert_array_equal(load_volume(path).volume, stored, strict=True)


def test_a_stack_written_slice_by_slice_is_a_volume(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as writer:
        for plane in VOLUME:
            writer.write(plane)
    found = load_volume(path)
    np.testing.assert_array_equal(found.volume, VOLUME, strict=True)
    assert found.assumed == (NO_VOXEL_SIZE,)
    assert get_reader(str(path)) is not None
    # Pictures of several sizes are none.
    tifffile.imwrite(path, VOLUME[0, :2], append=True)
    assert get_reader(str(path)) is None
    with pytest.raises(ValueError, match="axes z, y, x"):
        load_volume(path)


def test_resolutions_of_screens_are_no_voxel_sizes(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    # The last two as pixels a centimetre, which are rounded.
    for resolution, unit in ((72, "INCH"), (96, "INCH"), (300, "INCH"), (37.8, 3), (28.35, 3)):
        tifffile.imwrite(path, STACK, resolution=(resolution,) * 2, resolutionunit=unit)
        found = load_volume(path)
        assert (found.spacing, found.assumed) == ((1.0, 1.0, 1.0), (NO_VOXEL_SIZE,))
    tifffile.imwrite(path, STACK, resolution=(97, 97), resolutionunit="INCH")
    assert load_volume(path).spacing == pytest.approx((25.4 / 97,) * 3)


def test_proportions_of_imagej_without_a_unit_are_kept(tmp_path: Path) -> None:
    path, notes = tmp_path / "a.tif", {"axes": "ZYX", "spacing": 2.0}
    for unit in ({}, {"unit": "pixel"}):
        tifffile.imwrite(path, STACK, imagej=True, resolution=(2, 4), metadata=notes | unit)
        found = load_volume(path)
        assert (found.spacing, found.assumed) == ((2.0, 0.25, 0.5), (NO_UNIT,))
    # Edges of 1 are those of no measured voxels.
    for metadata in ({"axes": "ZYX"}, notes | {"spacing": 1.0}):
        tifffile.imwrite(path, STACK, imagej=True, metadata=metadata)
        found = load_volume(path)
        assert (found.spacing, found.assumed) == ((1.0, 1.0, 1.0), (NO_VOXEL_SIZE,))


def test_slices_are_the_last_of_the_axes_without_a_name(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.stack([STACK, STACK // 2]), photometric="minisblack")
    reason = r"holds 2 elements of an axis without a name \(axes q \(2\), z \(6\), .* such as q=0"
    with pytest.raises(ValueError, match=reason):
        load_volume(path)
    np.testing.assert_array_equal(load_volume(path, {"q": 1}).volume, STACK // 2, strict=True)


def test_a_folder_of_numbered_slices_is_a_volume(tmp_path: Path) -> None:
    planes = np.concatenate([STACK, STACK + 1])
    for number, plane in enumerate(planes, start=1):
        tifffile.imwrite(tmp_path / f"slice{number}.tif", plane)
    (tmp_path / "notes.txt").write_text("of the scanner")
    found = load_volume(tmp_path)
    np.testing.assert_array_equal(found.volume, planes, strict=True)
    order = "its 12 slices are in the order of the numbers in their names"
    assert found.assumed == (order, NO_VOXEL_SIZE)
    reader = get_reader(str(tmp_path))
    assert reader is not None
    with pytest.warns(UserWarning, match=order):
        ((data, _, kind),) = reader(str(tmp_path))
    assert (kind, data.shape) == ("image", planes.shape)
    # Their voxel size is that of the first.
    unit = {"resolution": (50, 100), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(tmp_path / "slice1.tif", planes[0], **unit)
    assert load_volume(tmp_path).spacing == pytest.approx((0.1, 0.1, 0.2))
    tifffile.imwrite(tmp_path / "slice7.tif", planes[0, 1:])
    with pytest.raises(ValueError, match=r"slice7\.tif is 6 x 8 of uint16, slice1\.tif 7 x 8 of"):
        load_volume(tmp_path)
    tifffile.imwrite(tmp_path / "slice7.tif", STACK, photometric="minisblack")
    with pytest.raises(ValueError, match=r"slice7\.tif has the shape \(6, 7, 8\): name a file"):
        load_volume(tmp_path)


def test_what_the_names_of_slices_say_against_one_scan_is_told(tmp_path: Path) -> None:
    def told(*names: str) -> list[str]:
        folder = tmp_path / str(len([*tmp_path.iterdir()]))
        folder.mkdir()
        for name in names:
            tifffile.imwrite(folder / name, STACK[0])
        return [
            note
            for note in load_volume(folder).assumed
            if "names such as" in note or "going" in note
        ]

    assert told("2024_s1.tif", "2024_s2.tif", "2024_s3.tif") == []
    assert told("s10.tif", "s12.tif", "s14.tif", "s16.tif") == []
    (gap,) = told("s08.tif", "s09.tif", "s10.tif", "s13.tif", "s14.tif", "s16.tif")
    assert "3 slices are missing, the first after s10.tif" in gap
    (scans,) = told("a1.tif", "a2.tif", "b1.tif", "b2.tif")
    assert "names such as a1.tif and b1.tif are of 2 kinds" in scans
    # By number within number nobody knows how many there should be.
    assert told("s1.tif", "s01.tif") == []
    assert told("r1_s1.tif", "r1_s2.tif", "r2_s1.tif", "r2_s5.tif") == []


@pytest.mark.parametrize("place", [".", "series"])
def test_slices_beside_or_above_dicom_are_no_volume(tmp_path: Path, place: str) -> None:
    for number in range(2):
        tifffile.imwrite(tmp_path / f"{number}.tif", STACK[0])
    assert len(slices_in(tmp_path)) == 2
    (tmp_path / place).mkdir(exist_ok=True)
    (tmp_path / place / "IM0001").write_bytes(b"\0" * 128 + b"DICM")
    assert slices_in(tmp_path) == []


@pytest.mark.parametrize("picture", [np.zeros((7, 8, 3), np.uint8), STACK])
def test_folders_of_photographs_and_of_stacks_are_left_to_napari(
    tmp_path: Path, picture: np.ndarray
) -> None:
    kind = "rgb" if picture.shape[-1] == 3 else "minisblack"
    for number in range(3):
        tifffile.imwrite(tmp_path / f"{number}.tif", picture, photometric=kind)
    assert get_reader(str(tmp_path)) is None


def test_labels_of_slices_are_no_slices(tmp_path: Path) -> None:
    for number in (9, 10):
        tifffile.imwrite(tmp_path / f"s{number}.tif", STACK[0])
        tifffile.imwrite(tmp_path / f"s{number}.labels.tif", STACK[0])
    # Not a decimal digit, though Python calls it one.
    tifffile.imwrite(tmp_path / "s²1.tif", STACK[0])
    assert [path.name for path in slices_in(tmp_path)] == ["s9.tif", "s10.tif", "s²1.tif"]


@pytest.mark.parametrize(
    ("resolution", "spacing"), [(1.0, 0.0), (1.0, np.nan), (72.0, 1.0), (0.0, 1.0)]
)
def test_numbers_of_imagej_that_say_nothing_are_no_voxel_size(
    tmp_path: Path, resolution: float, spacing: float
) -> None:
    path, metadata = tmp_path / "a.tif", {"spacing": spacing, "axes": "ZYX"}
    both = resolution, resolution
    tifffile.imwrite(path, STACK, imagej=True, resolution=both, metadata=metadata)
    found = load_volume(path)
    assert (found.spacing, found.assumed) == ((1.0, 1.0, 1.0), (NO_VOXEL_SIZE,))


def test_what_to_do_where_there_are_no_slices_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK, imagej=True, metadata={"axes": "TYX"})
    with pytest.raises(
        ValueError, match=r"x \(8\): if its time points are slices, call that axis z"
    ):
        load_volume(path)
    tifffile.imwrite(path, STACK[0])
    with pytest.raises(ValueError, match=r"axes y \(7\), x \(8\): save all slices as one stack"):
        load_volume(path)
    np.save(tmp_path / "a.npy", STACK[0])
    with pytest.raises(ValueError, match=r"shape \(7, 8\); a volume has three axes"):
        load_volume(tmp_path / "a.npy")
    (tmp_path / "pictures").mkdir()
    with pytest.raises(
        ValueError, match="nor slices in TIFF: save other pictures as one TIFF stack"
    ):
        load_volume(tmp_path / "pictures")


def test_what_a_compressed_stack_needs_is_named(tmp_path: Path) -> None:
    path, planes = tmp_path / "a.tif", [Image.fromarray(z.view(np.uint16)) for z in VOLUME]
    planes[0].save(path, save_all=True, append_images=planes[1:], compression="tiff_lzw")
    if find_spec("imagecodecs"):
        np.testing.assert_array_equal(load_volume(path).volume, VOLUME.view(np.uint16))
        return
    with pytest.raises(ImportError, match=r"a\.tif is compressed as LZW, .* pip install imagec"):
        load_volume(path)
