"""Cameras out of a canvas's matrices: hand-made projections in, known cameras out."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.view_camera import (
    camera_from_render,
    napari_view,
    same_camera,
    similarity,
)


def test_an_orthographic_matrix_gives_height_centre_and_axes() -> None:
    # Looking along +z with x right and y down; 2 / 0.02 = 100 mm are visible.
    matrix = np.array([[0.01, 0, 0, -0.3], [0, -0.02, 0, 0.8], [0, 0, 0.001, 0.0], [0, 0, 0, 1.0]])
    camera = camera_from_render(matrix, (5.0, 40.0, 30.0))
    np.testing.assert_allclose(camera.rotation, [[-1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-12)
    assert camera.height == pytest.approx(100.0)
    assert camera.fov == 0.0
    np.testing.assert_allclose(camera.center, [5.0, 40.0, 30.0])


def test_a_perspective_matrix_gives_field_of_view_and_height_at_the_centre() -> None:
    # Eye at z = 0 looking along +z, 90 degrees: at the centre, 50 mm away, 100 mm are visible.
    matrix = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1.0, -0.2], [0, 0, 1, 0.0]])
    camera = camera_from_render(matrix, (50.0, 0.0, 0.0))
    assert camera.fov == pytest.approx(90.0)
    assert camera.height == pytest.approx(100.0)
    assert camera.distance == pytest.approx(50.0)
    np.testing.assert_allclose(camera.direction, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera.up, [0, -1, 0], atol=1e-12)


def test_a_matrix_that_projects_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="must be a projection"):
        camera_from_render(np.zeros((4, 4)), (0, 0, 0))
    with pytest.raises(ValueError, match="must be a projection"):
        camera_from_render(np.full((4, 4), np.nan), (0, 0, 0))


def test_only_uniform_scales_and_turns_are_similarities() -> None:
    quarter = np.array([[0, -1, 0, 7], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    found = similarity(np.diag([3, 3, 3, 1.0]) @ quarter)
    assert found is not None
    assert found[0] == pytest.approx(3.0)
    np.testing.assert_allclose(found[1], quarter[:3, :3], atol=1e-12)
    assert similarity(np.diag([1, 1, 2, 1.0])) is None
    assert similarity(np.diag([1, 1, -1, 1.0])) is None


def test_a_camera_becomes_napari_units_under_a_scaled_world() -> None:
    camera = Camera(np.eye(3), np.array([1.0, 2.0, 3.0]), height=50.0)
    world = np.diag([10.0, 10.0, 10.0, 1.0])
    center, zoom, direction, up = napari_view(camera, world, view_height=600)
    np.testing.assert_allclose(center, [10, 20, 30])
    assert zoom == pytest.approx(600 / 500)
    np.testing.assert_allclose(direction, [-1, 0, 0])
    np.testing.assert_allclose(up, [0, -1, 0])


def test_cameras_differ_by_a_turn_of_a_thousandth_of_a_degree() -> None:
    camera = Camera(np.eye(3), np.zeros(3), 100.0)
    angle = np.radians(1e-3)
    c, s = np.cos(angle), np.sin(angle)
    turned = Camera(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.zeros(3), 100.0)
    assert same_camera(camera, Camera(np.eye(3), np.zeros(3), 100.0))
    assert not same_camera(camera, turned)
