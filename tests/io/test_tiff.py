"""TIFF stacks as other programs write them."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from napari_unpack.io import load_volume
from napari_unpack.io.file_data import NO_VOXEL_SIZE
from napari_unpack.io.napari_reader import get_reader

VOLUME = np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4) - 1000


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


def test_what_a_compressed_stack_needs_is_named(tmp_path: Path) -> None:
    path, planes = tmp_path / "a.tif", [Image.fromarray(z.view(np.uint16)) for z in VOLUME]
    planes[0].save(path, save_all=True, append_images=planes[1:], compression="tiff_lzw")
    if find_spec("imagecodecs"):
        np.testing.assert_array_equal(load_volume(path).volume, VOLUME.view(np.uint16))
        return
    with pytest.raises(ImportError, match=r"a\.tif is compressed as LZW, .* pip install imagec"):
        load_volume(path)
