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


def test_what_a_compressed_stack_needs_is_named(tmp_path: Path) -> None:
    path, planes = tmp_path / "a.tif", [Image.fromarray(z.view(np.uint16)) for z in VOLUME]
    planes[0].save(path, save_all=True, append_images=planes[1:], compression="tiff_lzw")
    if find_spec("imagecodecs"):
        np.testing.assert_array_equal(load_volume(path).volume, VOLUME.view(np.uint16))
        return
    with pytest.raises(ImportError, match=r"a\.tif is compressed as LZW, .* pip install imagec"):
        load_volume(path)
