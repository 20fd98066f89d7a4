"""What the panel takes from napari's layers."""

from types import SimpleNamespace

import numpy as np
import pytest
from napari.layers import Image, Labels

from napari_unpack.widgets.layer_inputs import (
    labels_of,
    names_of,
    same_shape,
    spacing_of,
    volume_of,
)


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
    np.testing.assert_array_equal(volume.data, [[[0, 1000], [1000, 0]]])
    assert volume.name == "atlas"


def test_a_picture_is_not_a_volume() -> None:
    with pytest.raises(ValueError, match=r"'slice' is 2D \(5 x 6\): choose a 3D volume"):
        volume_of(Image(np.zeros((5, 6)), name="slice"))


def test_a_colour_volume_is_not_a_volume() -> None:
    with pytest.raises(ValueError, match="colour"):
        volume_of(Image(np.zeros((5, 6, 7, 3), np.uint8), rgb=True))


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


def test_shapes_are_compared_without_reading_data() -> None:
    image = Image(np.zeros((4, 5, 6)))
    assert same_shape(image, Labels(np.zeros((4, 5, 6), np.uint8)))
    assert not same_shape(image, Labels(np.zeros((4, 5, 7), np.uint8)))
