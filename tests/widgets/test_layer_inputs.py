"""What the panel takes from napari's layers."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import dask.array
import numpy as np
import pytest
from napari.layers import Image, Labels

from napari_unpack.geometry.view import View
from napari_unpack.layers.placement import place_of, scanner_from_scan, spacing_of
from napari_unpack.rendering.compose import scene_image
from napari_unpack.session import Session
from napari_unpack.widgets.layer_inputs import (
    Volume,
    extra_axes,
    in_memory,
    labels_of,
    misfit,
    names_of,
    volume_of,
)
from napari_unpack.widgets.session_builder import build


def test_a_volume_comes_with_its_voxel_size_in_millimetres() -> None:
    layer = Image(np.zeros((4, 5, 6)), scale=(500, -20, 30), units=("um", "mm", "cm"), name="bag")
    volume = volume_of(layer)
    assert volume.data.shape == (4, 5, 6)
    assert volume.spacing == pytest.approx((0.5, 20.0, 300.0))
    assert volume.name == "bag"


def test_a_scale_without_units_counts_as_millimetres() -> None:
    assert spacing_of(Image(np.zeros((4, 5, 6)), scale=(2, 1, 0.5))) == (2.0, 1.0, 0.5)


@pytest.mark.filterwarnings("ignore:Non-orthogonal slicing")
def test_an_affine_scales_voxels_as_the_scale_does() -> None:
    turn = np.array([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, -1, 7], [0, 0, 0, 1.0]])
    layer = Image(np.zeros((4, 5, 6)), scale=(3, 0.5, 0.25), affine=turn @ np.diag([2, 2, 4, 1]))
    assert spacing_of(layer) == (6.0, 1.0, 1.0)


@pytest.mark.filterwarnings("ignore:Non-orthogonal slicing")
def test_slices_of_a_tilted_gantry_are_as_far_apart_as_they_are() -> None:
    # Each slice lies 2 mm behind the one before and tan(15 degrees) as far down.
    tilt = np.eye(4)
    tilt[1, 0] = np.tan(np.radians(15))
    layer = Image(np.zeros((4, 5, 6)), scale=(2, 0.5, 0.5), affine=tilt)
    assert spacing_of(layer) == pytest.approx((2.0, 0.5, 0.5))


def test_of_a_multiscale_image_the_finest_level_is_taken() -> None:
    layer = Image([np.zeros((8, 8, 8)), np.zeros((4, 4, 4))], multiscale=True)
    assert volume_of(layer).data.shape == (8, 8, 8)


def test_labels_alone_count_as_water() -> None:
    labels = np.array([[[0, 3], [70000, 0]]])
    volume = volume_of(Labels(labels, name="atlas"))
    np.testing.assert_array_equal(in_memory(volume), [[[0, 1000], [1000, 0]]])
    assert volume.name == "atlas"


def test_labels_that_touch_have_a_groove_between_them() -> None:
    """It is drawn darker, by both backends alike: they are given the same densities."""
    labels = np.zeros((24, 40, 40), np.uint16)
    labels[6:18, 5:20, 5:35], labels[6:18, 20:35, 5:35] = 1, 2
    volume = in_memory(volume_of(Labels(labels, name="bricks")))
    assert set(np.unique(volume[:, 19:21, :][labels[:, 19:21, :] > 0])) == {600}
    assert (volume == 1000).sum() == (labels > 0).sum() - 2 * 12 * 30
    session = Session(volume, labels)
    # Of one hue, the light alone tells them apart.
    session.apply_hues({1: 0.3, 2: 0.3})
    session.view = View((1.0, 0.0, 0.0))
    camera = replace(session.camera, height=40.0)
    image = scene_image(session.scene(), camera, (80, 80), backend="cpu")[..., :3].sum(axis=-1)
    beside, between = image[30:34, 30:50].mean(), image[39:41, 30:50].mean()
    assert between < 0.85 * beside


def test_a_picture_is_not_a_volume() -> None:
    with pytest.raises(ValueError, match=r"'slice' is 2D \(5 x 6\): choose a 3D volume"):
        volume_of(Image(np.zeros((5, 6)), name="slice"))


def test_of_a_colour_volume_one_colour_is_taken() -> None:
    data = np.random.default_rng(0).integers(0, 255, (5, 6, 7, 3), np.uint8)
    layer = Image(data, rgb=True, name="photos")
    (axis,) = extra_axes(layer)
    assert (axis.title, axis.choices) == ("Colour", ("Red", "Green", "Blue"))
    volume = volume_of(layer, (1,))
    np.testing.assert_array_equal(volume.data, data[..., 1])
    assert volume.name == "photos (Green)"


def test_of_a_series_one_time_point_and_channel_is_taken_and_stays_lazy() -> None:
    data = np.random.default_rng(0).integers(0, 255, (3, 2, 5, 6, 7), np.uint16)
    lazy = dask.array.from_array(data, chunks=(1, 1, 5, 6, 7))
    layer = Image(
        lazy,
        name="cells",
        axis_labels=("t", "c", "z", "y", "x"),
        scale=(60, 1, 0.3, 0.1, 0.2),
        translate=(0, 0, 4, 5, 6),
    )
    assert [axis.title for axis in extra_axes(layer)] == ["Time", "Channel"]
    volume = volume_of(layer, (2, 1))
    assert isinstance(volume.data, dask.array.Array)
    np.testing.assert_array_equal(volume.data.compute(), data[2, 1])
    assert volume.name == "cells (time point 2, channel 1)"
    assert volume.spacing == pytest.approx((0.3, 0.1, 0.2))
    assert place_of(layer)["affine"][:3, 3] == pytest.approx((4, 5, 6))
    objects = Labels(data[:, 0] % 5, name="objects")
    with pytest.raises(ValueError, match="'objects' are 6 x 7"):
        labels_of(Labels(data[0, 0, 0] % 5, name="objects"), volume)
    assert misfit(layer, objects) == "3 x 5 x 6 x 7, not 2 x 5 x 6 x 7"
    assert misfit(layer, Labels(data % 5)) == misfit(layer, Labels(data[0, 0] % 5)) == ""
    np.testing.assert_array_equal(labels_of(Labels(data % 5), volume, (2, 1)), data[2, 1] % 5)
    np.testing.assert_array_equal(labels_of(Labels(data[0, 0]), volume, (2, 1)), data[0, 0])


def test_a_volume_without_voxels_is_refused() -> None:
    with pytest.raises(ValueError, match="no voxels"):
        volume_of(SimpleNamespace(name="bag", multiscale=False, data=np.zeros((5, 0, 7))))


def test_labels_of_another_shape_are_refused_by_name() -> None:
    volume = volume_of(Image(np.zeros((4, 5, 6)), name="bag"))
    labels = Labels(np.zeros((4, 5, 7), np.uint8), name="mine")
    with pytest.raises(ValueError, match="'mine' are 4 x 5 x 7 but 'bag' is 4 x 5 x 6"):
        labels_of(labels, volume)


def test_names_come_from_the_features_of_labels() -> None:
    features = {"index": [1, 3, 4], "name": ["Mug", "Shoe", ""]}
    labels = Labels(np.zeros((4, 5, 6), np.uint8), features=features)
    assert names_of(labels) == {1: "Mug", 3: "Shoe"}
    assert names_of(Labels(np.zeros((4, 5, 6), np.uint8))) == {}


@pytest.mark.parametrize("index", [[1, np.nan], [1, None], ["1", None]])
def test_rows_of_features_that_belong_to_no_label_are_passed_over(index: list[object]) -> None:
    features = {"index": index, "name": ["Mug", "spare"]}
    assert names_of(Labels(np.zeros((4, 5, 6), np.uint8), features=features)) == {1: "Mug"}


def test_what_is_painted_while_objects_are_measured_is_not_in_the_session(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    labels = np.zeros((8, 20, 40), np.uint16)
    labels[2:6, 4:16, 4:14], labels[2:6, 4:16, 24:34] = 1, 2
    layer = Labels(labels, name="found")
    volume = Volume((1000 * (labels > 0)).astype(np.uint16), (1.0, 1.0, 1.0), "bag")
    own = Session.own_labels

    def paint_first(session: Session, others: Any) -> None:
        # Of a large bag this is seconds after the table and the boxes are made.
        layer.data[0:2, 0:4, 0:10] = 1
        own(session, others)

    monkeypatch.setattr(Session, "own_labels", paint_first)
    built = build(volume, labels_of(layer, volume), {}, {}, lambda fraction, text: None)
    assert layer.data[0, 0, 0] == 1
    assert built.session.objects["voxels"].tolist() == [480, 480]
    assert np.bincount(built.session.labels.ravel()).tolist() == [5440, 480, 480]
    assert built.session.boxes.lower[0].tolist() == [2, 4, 4]


def test_what_is_no_place_in_the_scanner_is_not_taken_from_a_layer() -> None:
    layer = Image(np.zeros((4, 5, 6)))
    for other in (np.diag([2.0, 1.0, 1.0, 1.0]), np.full((4, 4), None)):
        layer.metadata["scanner_from_scan"] = other
        assert scanner_from_scan(layer) is None
    layer.metadata["scanner_from_scan"] = np.eye(4)
    assert scanner_from_scan(layer) is not None
