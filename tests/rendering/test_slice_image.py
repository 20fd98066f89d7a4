"""Images of slices, by hand."""

from __future__ import annotations

import dask.array
import numpy as np
import pytest

from napari_unpack.rendering.slice_image import (
    ALONG_X,
    ALONG_Y,
    ALONG_Z,
    PLANES,
    edge_of,
    object_window,
    slice_image,
    window_for,
)

NO_TINT = np.zeros((4, 4), np.float32)


def _numbered() -> np.ndarray:
    return np.arange(24, dtype=np.uint16).reshape(2, 3, 4)


def test_slices_are_cut_along_their_axes() -> None:
    volume = _numbered()
    np.testing.assert_array_equal(ALONG_Z.cut(volume, 1), volume[1])
    np.testing.assert_array_equal(ALONG_Y.cut(volume, 2), volume[:, 2])
    # Rows run along y in both slices that show it, so that they stand level beside each other.
    np.testing.assert_array_equal(ALONG_X.cut(volume, 3), volume[:, :, 3].T)
    assert [plane.normal for plane in PLANES] == [0, 2, 1]


def test_the_window_goes_from_black_to_white() -> None:
    volume = np.array([[[0, 100, 150, 200, 900]]], np.uint16)
    labels = np.zeros(volume.shape, np.uint16)
    image = slice_image(volume, labels, NO_TINT, ALONG_Z, 0, (100, 200))
    assert image.shape == (1, 5, 4)
    assert image.dtype == np.uint8
    assert image[0, :, 0].tolist() == [0, 0, 128, 255, 255]
    assert (image[..., 0] == image[..., 2]).all()
    assert (image[..., 3] == 255).all()


def test_tints_lie_over_the_greys_by_their_share() -> None:
    volume = np.full((1, 1, 3), 100, np.int16)
    labels = np.array([[[0, 1, 2]]], np.uint16)
    tints = np.array([[0, 0, 0, 0], [1, 0, 0, 0.5], [0, 1, 0, 1]], np.float32)
    image = slice_image(volume, labels, tints, ALONG_Z, 0, (0, 200))
    np.testing.assert_allclose(image[0, 0, :3], 128, atol=1)
    np.testing.assert_allclose(image[0, 1, :3], [191, 64, 64], atol=1)
    np.testing.assert_array_equal(image[0, 2, :3], [0, 255, 0])


def test_densities_that_are_not_known_are_black() -> None:
    volume = np.array([[[np.nan, np.inf, -np.inf, 0.5]]])
    labels = np.zeros(volume.shape, np.uint16)
    image = slice_image(volume, labels, NO_TINT, ALONG_Z, 0, (0.0, 1.0))
    assert image[0, :, 0].tolist() == [0, 255, 0, 128]


def test_an_outlined_object_has_a_white_edge_of_one_pixel() -> None:
    labels = np.zeros((1, 7, 7), np.uint16)
    labels[0, 1:6, 1:6] = 3
    image = slice_image(labels, labels, NO_TINT, ALONG_Z, 0, (0, 100), [3])
    white = (image[..., :3] == 255).all(axis=-1)
    assert white.sum() == 16
    assert not white[2:5, 2:5].any()
    # At the border of the slice the object goes on out of sight, and is closed off there.
    assert edge_of(np.ones((3, 3), bool)).sum() == 8


@pytest.mark.parametrize("plane", PLANES)
def test_of_a_volume_on_a_disk_one_slice_is_read(plane) -> None:
    read = []

    def block(block_info=None) -> np.ndarray:
        place = block_info[None]["array-location"]
        read.append(place)
        return _numbered()[tuple(slice(*ends) for ends in place)]

    far = dask.array.map_blocks(
        block, chunks=((1,) * 2, (1,) * 3, (1,) * 4), dtype=np.uint16, meta=np.zeros((0, 0, 0))
    )
    labels = np.zeros(far.shape, np.uint16)
    image = slice_image(far, labels, NO_TINT, plane, 1, (0, 24))
    np.testing.assert_array_equal(
        image, slice_image(_numbered(), labels, NO_TINT, plane, 1, (0, 24))
    )
    assert {place[plane.normal] for place in read} == {(1, 2)}


def test_the_window_of_a_volume_leaves_metal_out() -> None:
    volume = np.linspace(0, 1000, 64**3).reshape(64, 64, 64)
    volume[0, 0, :2] = 32000
    low, high = window_for(volume)
    assert low == pytest.approx(5, abs=1)
    assert high == pytest.approx(995, abs=1)
    flat_low, flat_high = window_for(np.full((2, 2, 2), 7))
    assert flat_low < 7 < flat_high
    assert window_for(np.full((2, 2, 2), np.nan)) == (0.0, 1.0)


@pytest.mark.parametrize("metal", [0.0, 0.01, 0.1, 0.4])
def test_the_window_of_objects_shows_water_and_plastic_beside_any_amount_of_metal(
    metal: float,
) -> None:
    rng = np.random.default_rng(0)
    volume = rng.normal(1100, 80, (40, 40, 40))
    volume[rng.random(volume.shape) < metal] = 17_000
    labels = np.ones(volume.shape, np.uint16)
    # Metal of no object, and air around: neither counts.
    volume[:2], labels[:2] = 30_000, 0
    volume[2:20], labels[2:20] = 0, 0
    low, high = object_window(volume, labels)
    assert low == 0
    assert 0.25 < (1000 - low) / (high - low) < 0.95
    assert object_window(volume, np.zeros_like(labels)) == (0.0, 1.0)
    assert object_window(np.zeros_like(volume), labels) == (0.0, 1.0)
