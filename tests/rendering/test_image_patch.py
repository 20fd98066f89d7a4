"""Patches: windows, trimming, and laying them over each other by depth."""

import numpy as np
import pytest

from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.image_patch import ImagePatch, compose, window_of

INF = np.inf


def patch(color: tuple[float, ...], depth: list[list[float]], **where: float) -> ImagePatch:
    d = np.array(depth, np.float32)
    rgba = np.broadcast_to(np.array(color, np.float32), (*d.shape, 4)).copy()
    return ImagePatch(
        rgba, d, int(where.get("row", 0)), int(where.get("col", 0)), where.get("plane", 0)
    )


RED, GREEN = (1, 0, 0, 1), (0, 1, 0, 1)


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_patch_is_in_front_whatever_the_order(order: int) -> None:
    red = patch(RED, [[1.0, 5.0, 1.0]])
    green = patch(GREEN, [[2.0, 2.0]], col=1)
    image = compose((1, 3), [red, green][::order])
    np.testing.assert_array_equal(image[0, :, :2], [[1, 0], [0, 1], [1, 0]])


def test_at_equal_depths_the_later_patch_is_in_front() -> None:
    image = compose((1, 1), [patch(RED, [[2.0]]), patch(GREEN, [[2.0]])])
    np.testing.assert_array_equal(image[0, 0], GREEN)


@pytest.mark.parametrize("order", [1, -1])
def test_a_translucent_pixel_stands_at_its_plane(order: int) -> None:
    # Premultiplied quarter-opaque red over and under opaque green at depth 2.
    green = patch(GREEN, [[2.0, 2.0]])
    near = patch((0.25, 0, 0, 0.25), [[INF]], col=0, plane=1.0)
    far = patch((0.25, 0, 0, 0.25), [[INF]], col=1, plane=3.0)
    image = compose((1, 2), [green, near, far][::order])
    np.testing.assert_allclose(image[0, 0], [0.25, 0.75, 0, 1])
    np.testing.assert_allclose(image[0, 1], [0, 1, 0, 1])


def test_the_background_shines_through_what_is_left() -> None:
    image = compose((1, 2), [patch((0.5, 0, 0, 0.5), [[INF]])], background=(0, 0, 1))
    np.testing.assert_allclose(image[0, 0], [0.5, 0, 0.5, 1])
    np.testing.assert_allclose(image[0, 1], [0, 0, 1, 1])
    clear = compose((1, 1), [], background=(1, 1, 1, 0.5))
    np.testing.assert_allclose(clear[0, 0], [0.5, 0.5, 0.5, 0.5])
    with pytest.raises(ValueError, match="background must be RGB or RGBA"):
        compose((1, 1), [], background=(1, 1))


def test_patches_are_cut_off_at_the_border() -> None:
    full = np.full((3, 3), 1.0).tolist()
    image = compose((2, 2), [patch(RED, full, row=-2, col=1), patch(GREEN, full, row=9, col=-9)])
    np.testing.assert_array_equal(image[..., 0], [[0, 1], [0, 0]])
    assert image[..., 1].max() == 0


def test_trimming_keeps_just_what_can_be_seen() -> None:
    rgba = np.zeros((5, 6, 4), np.float32)
    rgba[1, 4] = rgba[3, 2] = 0.5
    trimmed = ImagePatch(rgba, np.zeros((5, 6), np.float32), 10, 20, 1.0).trimmed()
    assert (trimmed.row, trimmed.col, trimmed.size, trimmed.plane) == (11, 22, (3, 3), 1.0)
    assert ImagePatch(0 * rgba, np.zeros((5, 6), np.float32), 0, 0).trimmed().is_empty


def test_moving_a_patch_moves_its_depths() -> None:
    moved = patch(RED, [[4.0, INF]], plane=5.0).at(1, 2, 15.0)
    assert (moved.row, moved.col, moved.plane) == (1, 2, 15.0)
    np.testing.assert_array_equal(moved.depth, [[14.0, INF]])


def test_the_window_of_a_box() -> None:
    # Orthographic, 1 pixel a mm, 20 x 30 pixels: pixel (r, c) is at (r - 9.5, c - 14.5) mm.
    camera = Camera(np.eye(3), np.zeros(3), 20.0)
    low, high = np.array([0.0, -3.0, 2.0]), np.array([1.0, 3.0, 6.2])
    away = np.array([0.0, 90.0, 0.0])
    assert window_of(box_corners(low, high), camera, (20, 30)) == (7, 17, 6, 4)
    assert window_of(box_corners(low + away, high + away), camera, (20, 30)) is None
    wide = box_corners(np.full(3, -99.0), np.full(3, 99.0))
    assert window_of(wide, camera, (20, 30)) == (0, 0, 20, 30)
