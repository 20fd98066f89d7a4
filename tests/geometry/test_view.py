"""Views and cameras: framing, projection, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.axes import flip, flip_matrix, unit
from napari_unpack.geometry.view import Camera, View

SHAPE, SPACING = (30, 40, 50), (1.0, 1.0, 2.0)


def test_the_default_view_frames_the_bounding_sphere() -> None:
    # 30 x 40 x 100 mm: the diagonal is sqrt(900 + 1600 + 10000) = 111.803 mm. The first voxel's
    # centre is the origin, so the middle is at (14.5, 19.5, 49).
    camera = View().camera(SHAPE, SPACING)
    assert camera.height == pytest.approx(111.8034, abs=1e-4)
    np.testing.assert_allclose(camera.center, (14.5, 19.5, 49.0))


def test_in_perspective_the_sphere_still_just_touches_the_frame() -> None:
    camera = View(fov=40.0).camera(SHAPE, SPACING)
    radius = 111.8034 / 2
    assert np.sin(np.radians(20.0)) == pytest.approx(radius / camera.distance, rel=1e-5)


def test_axes_of_the_camera_looking_along_x() -> None:
    camera = View(direction=(0, 0, 3)).camera(SHAPE, SPACING)
    np.testing.assert_allclose(camera.direction, (0, 0, 1))
    np.testing.assert_allclose(camera.up, (0, -1, 0))
    np.testing.assert_allclose(camera.right, (1, 0, 0))
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)


def test_looking_along_y_takes_another_up() -> None:
    camera = View(direction=(0, 1, 0)).camera(SHAPE, SPACING)
    np.testing.assert_allclose(camera.up, (-1, 0, 0))


@pytest.mark.parametrize("fov", [0.0, 30.0])
def test_the_centre_projects_to_the_middle(fov: float) -> None:
    camera = View(direction=(1, 2, 3), fov=fov).camera(SHAPE, SPACING)
    np.testing.assert_allclose(camera.project(camera.center, (100, 60)), (49.5, 29.5))


def test_projection_in_numbers() -> None:
    # 100 mm over 50 pixels: 2 mm a pixel. A point 10 mm down and 6 mm right of the centre.
    camera = Camera(np.eye(3), np.zeros(3), height=100.0)
    np.testing.assert_allclose(camera.project((0, 10, 6), (50, 50)), (24.5 + 5, 24.5 + 3))
    # With 90 degrees the eye is 50 mm away; 25 mm towards it everything is twice as large.
    near = Camera(np.eye(3), np.zeros(3), height=100.0, fov=90.0)
    np.testing.assert_allclose(near.project((25, 10, 6), (50, 50)), (24.5 + 10, 24.5 + 6))


def test_without_perspective_a_plane_stays_and_what_is_before_it_comes_to_its_size() -> None:
    # The eye is 50 mm away; 25 mm towards it everything is twice as large.
    near = Camera(np.eye(3), np.zeros(3), height=100.0, fov=90.0)
    size, middle, seen = (50, 50), 24.5, np.array([10.0, 6.0])
    in_plane, before, behind = (25, 10, 6), (30, 10, 6), (0, 10, 6)
    flat, half = near.flattened(25.0), near.flattened(25.0, 0.5)
    assert flat is not None
    assert half is not None
    for point in (in_plane, before, behind):
        np.testing.assert_allclose(flat.pixels(point, size), middle + seen)
    # Half way to there the eye is twice as far away: 75 mm from the plane, 70 mm from the other.
    np.testing.assert_allclose(half.pixels(in_plane, size), middle + seen)
    np.testing.assert_allclose(half.pixels(before, size), middle + seen * 75 / 70)
    assert near.flattened(25.0, 0.0) is near
    assert near.flattened(50.0) is None


@pytest.mark.parametrize("fov", [0.0, 90.0])
def test_a_ray_goes_through_all_that_its_pixel_shows(fov: float) -> None:
    camera = Camera(np.eye(3), np.zeros(3), height=100.0, fov=fov)
    start, way = camera.ray((34.5, 18.5), (50, 50))
    np.testing.assert_allclose(start, (0, 20, -12))
    # Twice as near to an eye 50 mm away a point is half as far from the middle.
    np.testing.assert_allclose(start - 25 * way, (25, 10, -6) if fov else (25, 20, -12))


def test_orthographic_keeps_all_but_the_perspective() -> None:
    view = View(direction=(1, 2, 3), fov=30.0, height=80.0)
    assert view.orthographic() == View(direction=(1, 2, 3), height=80.0)
    camera = view.camera(SHAPE, SPACING).orthographic()
    assert camera.fov == 0.0
    assert camera.height == 80.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"direction": (0, 0, 0)}, "direction"),
        ({"direction": (0, 0, np.nan)}, "direction"),
        ({"direction": (0, 1)}, "direction"),
        ({"up": (0, 0, 2)}, "up"),
        ({"center": (1, 2)}, "center"),
        ({"center": (1, 2, np.inf)}, "center"),
        ({"fov": 170.0}, "fov"),
        ({"fov": -1.0}, "fov"),
        ({"height": 0.0}, "height"),
        ({"height": float("inf")}, "height"),
    ],
)
def test_an_impossible_view_is_refused_by_name(arguments, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        View(**arguments)


@pytest.mark.parametrize("name", ["fov", "height"])
@pytest.mark.parametrize("value", ["wide", [1.0, 2.0], np.nan], ids=repr)
def test_a_view_of_no_number_is_refused_by_name(name: str, value) -> None:
    with pytest.raises((TypeError, ValueError), match=name):
        View(**{name: value})


def test_a_view_holds_plain_numbers_and_is_as_good_as_its_equal() -> None:
    plain = View((1.0, 2.0, 3.0), (0.0, -1.0, 0.0), (4.0, 5.0, 6.0), 80.0, 20.0)
    listed = View([1, 2, 3], [0, -1, 0], [4, 5, 6], 80, 20)
    direction = np.array([1, 2, 3])
    arrays = View(
        direction, np.array([0, -1, 0]), np.array([4, 5, 6]), np.float32(80), np.int64(20)
    )
    direction[:] = 0
    assert plain == listed == arrays
    assert hash(plain) == hash(listed) == hash(arrays)
    numbers = [*arrays.direction, *arrays.up, *arrays.center, arrays.height, arrays.fov]
    assert {type(n) for n in numbers} == {float}


def test_a_camera_shares_no_array_and_none_can_be_written_to() -> None:
    center = np.zeros(3)
    camera = Camera.looking((0, 0, 1), None, center, np.float32(80), np.float32(20))
    center += 1
    assert camera.center.tolist() == [0, 0, 0]
    assert type(camera.height) is type(camera.fov) is float
    for array in (camera.center, camera.rotation, camera.stretch):
        with pytest.raises(ValueError, match="read-only"):
            array += 1


def test_flip_and_flip_matrix_agree() -> None:
    matrix = np.arange(16.0).reshape(4, 4)
    v = np.array([2.0, 3.0, 5.0])
    there = matrix[:3, :3] @ v + matrix[:3, 3]
    flipped = flip_matrix(matrix)
    np.testing.assert_allclose(flipped[:3, :3] @ flip(v) + flipped[:3, 3], flip(there))


def test_unit_has_length_one() -> None:
    np.testing.assert_allclose(unit((0, 3, 4)), (0, 0.6, 0.8))


SHEARED = np.array([[1.1, 0.2, 0.1], [0.2, 0.9, -0.3], [0.1, -0.3, 1.2]])


def test_points_behind_the_eye_or_just_before_it_have_no_place_in_the_image() -> None:
    # Of height 2 at an angle of 90 degrees, so that the eye is 1 mm from the centre.
    camera = Camera(np.eye(3), np.zeros(3), height=2.0, fov=90.0)
    assert not camera.behind_eye([(0.97, 0, 0), (-50, 3, 4)])
    assert camera.behind_eye([(0.99, 0, 0), (-50, 3, 4)])
    assert camera.behind_eye((7, 0, 0))
    assert not camera.orthographic().behind_eye([(1e9, 0, 0)])


@pytest.mark.parametrize("stretch", [np.eye(3), -np.eye(3), SHEARED, -SHEARED])
def test_a_stretched_bag_is_looked_at_along_the_direction_asked_for(stretch) -> None:
    camera = Camera.looking((1.0, 2.0, -0.5), (0.2, -1.0, 0.3), (4, 5, 6), 10.0, stretch=stretch)
    np.testing.assert_allclose(camera.direction, np.array([1, 2, -0.5]) / np.sqrt(5.25))
    # One step along the direction of looking changes the depth alone.
    there = camera.center + camera.direction
    np.testing.assert_allclose(camera.project(there, (64, 64)), [31.5, 31.5], atol=1e-9)
    # What is up in the world is up in the image, as far as the view lets it.
    row, col = camera.project(camera.center + np.array([0.2, -1.0, 0.3]), (64, 64))
    assert row < 31.5
    assert col == pytest.approx(31.5)
    np.testing.assert_allclose(camera.in_world(camera.linear @ [3.0, 1.0, 2.0]), [3.0, 1.0, 2.0])
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)


def test_a_mirrored_camera_shows_what_the_other_shows_with_left_and_right_swapped() -> None:
    points = np.random.default_rng(0).normal(size=(9, 3))
    for fov in (0.0, 30.0):
        plain, mirrored = (
            Camera.looking((1.0, 2.0, -0.5), (0, -1, 0), (0, 0, 0), 10.0, fov, stretch)
            for stretch in (None, -np.eye(3))
        )
        seen, swapped = plain.project(points, (50, 60)), mirrored.project(points, (50, 60))
        np.testing.assert_allclose(swapped, [0, 59] + [1, -1] * seen, atol=1e-9)


def test_a_direction_of_any_length_has_length_one() -> None:
    for length in (1e-300, 1e-5, 1.0, 1e308):
        np.testing.assert_allclose(unit((0, 0.6 * length, 0.8 * length)), (0, 0.6, 0.8))
    with pytest.raises(ValueError, match="must not be zero"):
        unit((0, 0, 0))
