"""OME-Zarr as other programs write it: labels of time points, folders of images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unpack.io import load_labels, load_volume
from napari_unpack.io.file_data import LABELS_LEFT_OUT
from napari_unpack.io.labels_on_volume import scan_with_label_file
from napari_unpack.io.napari_reader import read_layers
from napari_unpack.io.ome_zarr import stored_volume

zarr = pytest.importorskip("zarr")

VOLUME = np.arange(2 * 3 * 4, dtype=np.uint16).reshape(2, 3, 4)
LABELS = np.stack([VOLUME % 5, VOLUME % 7])


def add_image(group: Any, array: np.ndarray, axes: str) -> None:
    """Make an image of one level out of a group."""
    group.create_array("0", data=array)
    steps = [{"type": "scale", "scale": [2.0 if axis in "zyx" else 1.0 for axis in axes]}]
    unit = {"unit": "millimeter"}
    group.attrs["multiscales"] = [
        {
            "axes": [{"name": axis} | (unit if axis in "zyx" else {}) for axis in axes],
            "datasets": [{"path": "0", "coordinateTransformations": steps}],
        }
    ]


def save_image(path: Path, array: np.ndarray, axes: str, labels: np.ndarray | None = None) -> Path:
    """Write an image, and labels of one channel beside it."""
    root = zarr.open_group(str(path), mode="w", zarr_format=2)
    add_image(root, array, axes)
    if labels is not None:
        group = root.create_group("labels")
        group.attrs["labels"] = ["cells"]
        add_image(group.create_group("cells"), labels, "tczyx")
    return path


@pytest.mark.parametrize("axes", ["tzyx", "tczyx", "ctzyx"])
def test_each_time_point_has_its_own_labels(tmp_path: Path, axes: str) -> None:
    shape = tuple({"t": 2, "c": 3, "z": 2, "y": 3, "x": 4}[axis] for axis in axes)
    path = save_image(tmp_path / "a.zarr", np.ones(shape, np.uint8), axes, LABELS[:, None])
    channel = {"c": 2} if "c" in axes else {}
    for t in (0, 1):
        found = load_volume(path, {"t": t} | channel)
        np.testing.assert_array_equal(found.labels, LABELS[t])
    np.testing.assert_array_equal(load_labels(path)[0], LABELS[0])
    laid = scan_with_label_file(load_volume(path, {"t": 1} | channel), path)
    np.testing.assert_array_equal(laid.labels, LABELS[0])
    assert laid.assumed == ("its labels are those of the first of 2 time points",)
    chosen = {"t": 1} | channel
    laid = scan_with_label_file(load_volume(path, chosen), path, at=chosen)
    np.testing.assert_array_equal(laid.labels, LABELS[1])
    assert laid.assumed == ()
    np.testing.assert_array_equal(load_labels(path, at={"t": 1})[0], LABELS[1])
    with pytest.raises(ValueError, match="holds 2 time points, numbered from 0: there is no t=2"):
        load_labels(path, at={"t": 2})
    image, labels = read_layers(str(path))
    assert image[1]["axis_labels"] == labels[1]["axis_labels"] == tuple(axes)
    there = {"tzyx": (1,), "tczyx": (1, 2), "ctzyx": (2, 1)}[axes]
    np.testing.assert_array_equal(labels[0][there], LABELS[1])


def test_labels_of_other_time_points_are_left_out(tmp_path: Path) -> None:
    path = save_image(tmp_path / "a.zarr", VOLUME, "zyx", LABELS[:, None])
    assert load_volume(path).assumed == (LABELS_LEFT_OUT,)
    # One for all is laid over each.
    series = np.stack([VOLUME] * 3)
    path = save_image(tmp_path / "b.zarr", series, "tzyx", LABELS[:1, None])
    np.testing.assert_array_equal(load_volume(path, {"t": 2}).labels, LABELS[0])


def test_axes_of_length_1_are_left_out_of_a_volume_that_is_not_read(tmp_path: Path) -> None:
    array, about = stored_volume(save_image(tmp_path / "a.zarr", VOLUME[None, :, None], "tzcyx"))
    assert (about.axes, about.spacing) == ("zyx", (2.0, 2.0, 2.0))
    np.testing.assert_array_equal(np.asarray(array[:1, 1:]), VOLUME[:1, 1:])
    path = save_image(tmp_path / "b.zarr", np.stack([VOLUME] * 3)[None], "tczyx")
    with pytest.raises(ValueError, match=r"holds 3 channels: save one .* --at c=0 and write .npz"):
        stored_volume(path)


def test_the_first_image_of_a_converted_file_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    root = zarr.open_group(str(path), mode="w", zarr_format=2)
    root.attrs["bioformats2raw.layout"] = 3
    root.create_group("OME")
    add_image(root.create_group("0"), VOLUME, "zyx")
    found = load_volume(path)
    np.testing.assert_array_equal(found.volume, VOLUME)
    assert (found.spacing, found.assumed) == ((2.0, 2.0, 2.0), ())
    np.testing.assert_array_equal(stored_volume(path)[0][...], VOLUME)
    add_image(root.create_group("1"), VOLUME + 1, "zyx")
    found = load_volume(path)
    np.testing.assert_array_equal(found.volume, VOLUME)
    assert found.assumed == ("it holds 2 images: '0' was taken",)


def test_what_can_be_opened_of_another_group_is_named(tmp_path: Path) -> None:
    root = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for name in ("labels", "volume"):
        root.create_array(name, data=VOLUME)
    with pytest.raises(ValueError, match=r"is missing.*; open a.zarr/labels or a.zarr/volume$"):
        load_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(load_volume(tmp_path / "a.zarr" / "volume").volume, VOLUME)
