"""A multiscale volume that fits no memory: unpacked at a coarser level, measured at the finest."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import dask.array as da
import numpy as np
import pytest
import zarr
from napari.layers import Image, Labels, Layer
from numpy.typing import NDArray
from pytestqt.qtbot import QtBot

from napari_unpack.io.napari_reader import read_layers
from napari_unpack.io.ome_zarr import write_labels_zarr
from napari_unpack.layers.levels import factors_of, finest_fitting, place_of_level
from napari_unpack.widgets import layer_inputs
from napari_unpack.widgets.layer_inputs import labels_of, volume_of, whole_labels_of
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import controller_with

MM = (0.5, 0.25, 0.25)
AXES = [{"name": axis, "type": "space", "unit": "millimeter"} for axis in "zyx"]


def _blocks() -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return densities and labels of two blocks, 96 voxels wide, whose faces lie at odd voxels."""
    labels = np.zeros((96, 96, 96), np.uint16)
    labels[11:44, 11:60, 11:60], labels[51:86, 20:91, 30:79] = 3, 70
    volume = np.full(labels.shape, 20, np.uint16)
    volume[labels == 3], volume[labels == 70] = 1000, 1500
    # Seen at full resolution only.
    volume[12, 12, 12] = 60000
    return volume, labels


def _written(node: Any, data: NDArray[np.uint16]) -> None:
    levels = []
    for k in range(3):
        level = data[:: 2**k, :: 2**k, :: 2**k]
        node.create_array(str(k), shape=level.shape, dtype=level.dtype)[...] = level
        scale = [mm * 2.0**k for mm in MM]
        steps = [{"type": "scale", "scale": scale}]
        levels.append({"path": str(k), "coordinateTransformations": steps})
    node.attrs["multiscales"] = [{"version": "0.4", "axes": AXES, "datasets": levels}]


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Return an OME-Zarr of the blocks with their labels, three levels each."""
    path = tmp_path / "blocks.zarr"
    node = zarr.open_group(str(path), mode="w", zarr_format=2)
    volume, labels = _blocks()
    _written(node, volume)
    group = node.create_group("labels")
    group.attrs["labels"] = ["blocks"]
    _written(group.create_group("blocks"), labels)
    return path


@pytest.fixture
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the finest level not fit, to read and to unpack, but the next."""
    finest = 96**3
    monkeypatch.setattr("napari_unpack.file_sizes.free_memory", lambda: 2 * finest)
    monkeypatch.setattr(layer_inputs, "total_memory", lambda: 10 * finest)


def _layers(path: Path) -> tuple[Image, Labels]:
    image, labels = (Layer.create(*data) for data in read_layers(str(path)))
    assert isinstance(image, Image)
    assert isinstance(labels, Labels)
    return image, labels


def test_what_fits_the_memory_is_read_as_it_is(stored: Path) -> None:
    image, labels = _layers(stored)
    assert not image.multiscale
    assert isinstance(image.data, np.ndarray)
    assert labels.data.shape == (96, 96, 96)


def test_what_does_not_is_layers_of_levels_that_are_not_read(
    stored: Path, little_memory: None
) -> None:
    image, labels = _layers(stored)
    shapes = [(96, 96, 96), (48, 48, 48), (24, 24, 24)]
    assert [level.shape for level in image.data] == shapes
    assert [level.shape for level in labels.data] == shapes
    assert not isinstance(image.data[0], np.ndarray)
    np.testing.assert_allclose(image.scale, MM)
    volume = volume_of(image)
    assert volume.data.shape == (48, 48, 48)
    assert volume.name == "blocks (level 1)"
    np.testing.assert_allclose(volume.spacing, np.multiply(MM, 2))
    np.testing.assert_allclose(volume.whole_spacing, MM)
    np.testing.assert_array_equal(labels_of(labels, volume), _blocks()[1][::2, ::2, ::2])
    finest = whole_labels_of(labels, volume)
    assert finest is not None
    assert finest.shape == (96, 96, 96)


def test_the_finest_level_that_fits_is_taken_and_the_coarsest_where_none_does() -> None:
    shapes = [(64, 64, 64), (32, 32, 32), (16, 16, 16)]
    taken = [finest_fitting(shapes, 2, memory) for memory in (2 * 64**3, 2 * 64**3 - 1, 1.0)]
    assert taken == [0, 1, 2]


def test_levels_that_keep_or_drop_the_last_voxel_have_the_same_factors() -> None:
    assert factors_of((101, 101, 64), (51, 50, 64)) == (2, 2, 1)


def test_coarser_labels_stand_where_their_file_says(tmp_path: Path) -> None:
    path, labels = tmp_path / "found.zarr", np.ones((512, 4, 1), np.int32)
    place = np.eye(4)[[2, 1, 0, 3]]
    place[:3, 3] = 30, 20, 10
    write_labels_zarr(path, labels, (3.0, 2.0, 1.0), place)
    node = zarr.open_group(str(path), mode="r")
    layer = Labels(labels, scale=(3, 2, 1), translate=(10, 20, 30))
    levels = node.attrs["multiscales"][0]["datasets"]
    assert [node[level["path"]].shape[0] for level in levels] == [512, 256, 128]
    for level in levels:
        scale, move = level["coordinateTransformations"]
        stands = place_of_level(layer, factors_of(labels.shape, node[level["path"]].shape))
        np.testing.assert_allclose(stands["affine"][:3, 3], move["translation"])
        np.testing.assert_allclose(np.diag(stands["affine"])[:3], scale["scale"])


def test_a_voxel_of_a_level_stands_in_the_middle_of_those_that_it_stands_for() -> None:
    turned = Image(np.zeros((8, 8, 8)), scale=(2, 1, 1), translate=(5, 6, 7), rotate=[0, 0, 90])
    level = Image(np.zeros((4, 4, 8)), **place_of_level(turned, (2, 2, 1)))
    for voxel in ([0, 0, 0], [3, 1, 6]):
        z, y, x = voxel
        middle = [2 * z + 0.5, 2 * y + 0.5, x]
        np.testing.assert_allclose(level.data_to_world(voxel), turned.data_to_world(middle))


@pytest.mark.parametrize("found", [False, True])
def test_it_is_unpacked_at_the_level_and_its_table_is_of_the_full_resolution(
    stored: Path, little_memory: None, panel: UnpackingWidget, qtbot: QtBot, found: bool
) -> None:
    viewer = panel.workspace.viewer
    image, labels = (viewer.add_layer(layer) for layer in _layers(stored))
    session = controller_with(panel, qtbot, None if found else labels)
    assert session.volume.shape == (48, 48, 48)
    np.testing.assert_allclose(session.spacing, np.multiply(MM, 2))
    # Edges of 33 x 49 x 49 and 35 x 71 x 49 voxels, counted by hand.
    voxels = {3: 33 * 49 * 49, 70: 35 * 71 * 49}
    table = session.objects.sort_values("voxels")
    if found:
        # Borders that were found may be off by a part of a voxel.
        np.testing.assert_allclose(table["voxels"], list(voxels.values()), rtol=0.05)
    else:
        assert dict(table["voxels"]) == voxels
        np.testing.assert_allclose(table["volume_mm3"], np.array([*voxels.values()]) / 32)
        mean = 1000 + (60000 - 1000) / voxels[3]
        np.testing.assert_allclose(table["mean_density"], [mean, 1500])
        # The middle of voxels 11 to 43, 11 to 59 and 11 to 59.
        center = table.loc[3, ["z", "y", "x"]].astype(float)
        np.testing.assert_allclose(center, [13.5, 8.75, 8.75])
    # The level stands for all levels, which are out of sight.
    assert not image.visible
    level = panel.workspace.controller.sources[0]
    assert level.name == "blocks (level 1)"
    assert level.data.shape == (48, 48, 48)
    assert [layer.data.shape for layer in panel.workspace.controller.sources[1:]] == [(48, 48, 48)]


def test_a_level_is_read_off_the_windows_thread(
    stored: Path,
    little_memory: None,
    panel: UnpackingWidget,
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = panel.workspace.viewer
    _, labels = (viewer.add_layer(layer) for layer in _layers(stored))
    read, here = da.Array.__array__, set()

    def noted(array: da.Array, *args: Any, **kwargs: Any) -> Any:
        if threading.current_thread() is threading.main_thread():
            here.add(array.shape)
        return read(array, *args, **kwargs)

    monkeypatch.setattr(da.Array, "__array__", noted)
    controller_with(panel, qtbot, labels)
    # napari itself reads planes.
    assert all(len(shape) < 3 for shape in here), here


@pytest.mark.parametrize("chosen", [None, (5.0, 1900.0)])
def test_a_level_shows_what_is_in_it_or_what_a_person_chose(
    stored: Path,
    little_memory: None,
    panel: UnpackingWidget,
    qtbot: QtBot,
    chosen: tuple[float, float] | None,
) -> None:
    viewer = panel.workspace.viewer
    image, labels = (viewer.add_layer(layer) for layer in _layers(stored))
    if chosen is not None:
        image.contrast_limits = chosen
    controller_with(panel, qtbot, labels)
    low, high = panel.workspace.controller.sources[0].contrast_limits
    # Objects of 1000 and 1500 in air of 20; the first plane holds air alone.
    assert (low, high) == (chosen or pytest.approx((20, 1500)))
