"""Cameras out of a canvas's matrices: hand-made projections in, known cameras out."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.view_camera import (
    camera_from_render,
    camera_in_session,
    napari_view,
    parts_of,
    same_camera,
)


def test_an_orthographic_matrix_gives_height_centre_and_axes() -> None:
    # Looking along +z with x right and y down, which is left-handed; 100 mm are visible.
    matrix = np.array([[0.01, 0, 0, -0.3], [0, -0.02, 0, 0.8], [0, 0, 0.001, 0.0], [0, 0, 0, 1.0]])
    camera = camera_from_render(matrix, (5.0, 40.0, 30.0))
    np.testing.assert_allclose(camera.linear, [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=1e-12)
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)
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


def test_where_angles_stay_nothing_is_stretched() -> None:
    quarter = np.array([[0, -1, 0, 7], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    scale, rotation, stretch = parts_of(np.diag([3, 3, 3, 1.0]) @ quarter)
    assert scale == pytest.approx(3.0)
    np.testing.assert_allclose(rotation, quarter[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(stretch, np.eye(3))


def test_a_mirror_is_a_reflection_in_a_point_and_a_half_turn() -> None:
    _, rotation, stretch = parts_of(np.diag([1, 1, -1, 1.0]))
    np.testing.assert_allclose(rotation, np.diag([-1, -1, 1]), atol=1e-12)
    np.testing.assert_array_equal(stretch, -np.eye(3))


@pytest.mark.parametrize("seed", range(12))
def test_every_affine_is_a_length_a_turn_and_a_stretch(seed: int) -> None:
    matrix = random_affine(seed)
    scale, rotation, stretch = parts_of(matrix)
    np.testing.assert_allclose(scale * rotation @ stretch, matrix[:3, :3], atol=1e-9)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_array_equal(stretch, stretch.T)
    assert abs(np.linalg.det(stretch)) == pytest.approx(1.0)
    lengths = np.linalg.eigvalsh(stretch)
    assert (lengths > 0).all() or (lengths < 0).all()


def test_an_affine_that_flattens_space_is_refused() -> None:
    with pytest.raises(ValueError, match="can be inverted"):
        parts_of(np.diag([1.0, 0.0, 1.0, 1.0]))


@pytest.mark.parametrize("seed", range(12))
def test_a_camera_in_the_session_sees_a_point_where_napari_shows_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = random_affine(seed)
    fov = float(rng.uniform(10, 50)) if seed % 2 else 0.0
    seen = Camera.looking(rng.normal(size=3), None, rng.normal(size=3), 40.0, fov)
    points = rng.uniform(-4, 4, (20, 3))
    in_napari = points @ matrix[:3, :3].T + matrix[:3, 3]
    camera = camera_in_session(seen, matrix)
    np.testing.assert_allclose(
        camera.project(points, (300, 400)), seen.project(in_napari, (300, 400)), atol=1e-6
    )
    # And the way back: what to set on napari's camera.
    center, zoom, direction, up = napari_view(camera, matrix, view_height=300)
    np.testing.assert_allclose(center, seen.center, atol=1e-9)
    assert zoom == pytest.approx(300 / 40.0)
    np.testing.assert_allclose(direction, seen.direction, atol=1e-9)
    np.testing.assert_allclose(up, seen.up, atol=1e-9)


@pytest.mark.parametrize("fov", [0.0, 90.0])
def test_a_canvas_that_swaps_left_and_right_gives_a_mirrored_camera(fov: float) -> None:
    swapped = np.diag([-1.0, 1.0, 1.0, 1.0])
    if fov:
        matrix = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1.0, -0.2], [0, 0, 1, 0.0]])
    else:
        matrix = np.array([[0.02, 0, 0, 0], [0, -0.02, 0, 0], [0, 0, 0.001, 0], [0, 0, 0, 1.0]])
    size, point = (100, 100), np.array([[55.0, 7.0, 20.0]])
    plain = camera_from_render(matrix, (50.0, 0.0, 0.0)).project(point, size)[0]
    other = camera_from_render(swapped @ matrix, (50.0, 0.0, 0.0))
    assert np.linalg.det(other.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(other.project(point, size)[0], [plain[0], 99.0 - plain[1]])


def random_affine(seed: int) -> np.ndarray:
    """Turned, scaled and moved, and by the seed mirrored, stretched or sheared."""
    rng = np.random.default_rng(100 + seed)
    turn = Camera.looking(rng.normal(size=3), rng.normal(size=3), (0, 0, 0), 1.0).rotation
    shape = np.diag(rng.choice([1.0, -1.0], 3) * (1.0 if seed % 3 == 0 else rng.uniform(0.4, 3, 3)))
    if seed % 3 == 2:
        shape[np.triu_indices(3, 1)] = rng.uniform(-0.6, 0.6, 3)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rng.uniform(0.2, 5) * turn @ shape, rng.normal(size=3)
    return matrix


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
