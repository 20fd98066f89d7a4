"""Equations 3 and 4, and poses: an object's box centre lands where it is sent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import (
    Pose,
    packed_pose,
    rotation_about,
    slerp,
    translation,
)
from napari_unpack.geometry.view import Camera, View

numbers = st.floats(-50, 50)
triples = st.tuples(numbers, numbers, numbers)
angles = st.floats(-3, 3)


def a_camera(direction=(0.3, -0.5, 0.8), fov=0.0) -> Camera:
    return View(direction=direction, fov=fov).camera((40, 50, 60), (1.0, 2.0, 0.5))


@given(offset=triples, target=triples, direction=st.tuples(angles, angles))
def test_a_pose_that_keeps_the_turn_of_the_bag_is_moved_by_equation_4(
    offset, target, direction
) -> None:
    camera = a_camera((4.0, *direction))
    model = np.diag([0.8, 1.5, 2.0, 1.0])
    inverse = np.linalg.inv(camera.pivot_from_world() @ model)
    # t = (V M)^-1 u - o in voxels, applied right of M.
    t = transform_points(inverse, target) - offset
    pose = Pose(np.array(target), camera.rotation)
    moved = pose.world_from_world(transform_points(model, offset), camera)
    np.testing.assert_allclose(moved @ model, model @ translation(t), atol=1e-6)


@given(center=triples, box=triples, angle=angles, scale=st.floats(0.1, 5))
def test_a_pose_puts_the_box_centre_where_it_says_on_the_world_side_too(
    center, box, angle, scale
) -> None:
    camera = a_camera(fov=30.0)
    pose = Pose(np.array(center), rotation_about((1, 1, 0), angle) @ camera.rotation, scale)
    np.testing.assert_allclose(transform_points(pose.pivot_from_world(box), box), center, atol=1e-6)
    world = transform_points(pose.world_from_world(box, camera), box)
    np.testing.assert_allclose(
        transform_points(camera.pivot_from_world(), world), center, atol=1e-6
    )


def test_a_packed_object_stays_where_it_is() -> None:
    camera = a_camera()
    pose = packed_pose((7.0, 8.0, 9.0), camera)
    np.testing.assert_allclose(pose.world_from_world((7.0, 8.0, 9.0), camera), np.eye(4), atol=1e-9)


def test_a_packed_pose_moved_by_an_offset_is_moved_in_the_bag() -> None:
    camera = a_camera()
    pose = packed_pose((7.0, 8.0, 9.0), camera, offset=(1.0, -2.0, 3.0))
    expected = translation((1.0, -2.0, 3.0))
    np.testing.assert_allclose(pose.world_from_world((7.0, 8.0, 9.0), camera), expected, atol=1e-9)


def test_a_quarter_turn_takes_y_to_x_about_z() -> None:
    # Right-handed in (z, y, x): cross(z, y) = x.
    np.testing.assert_allclose(
        rotation_about((1, 0, 0), np.pi / 2) @ (0, 1, 0), (0, 0, 1), atol=1e-12
    )


def test_slerp_halves_the_angle_and_is_clamped() -> None:
    start, end = np.eye(3), rotation_about((0, 0, 2), 1.2)
    np.testing.assert_allclose(slerp(start, end, 0.5), rotation_about((0, 0, 1), 0.6), atol=1e-9)
    np.testing.assert_allclose(slerp(start, end, 7.0), end, atol=1e-9)


def test_toward_goes_from_one_pose_to_the_other() -> None:
    first = Pose(np.zeros(3), np.eye(3), 1.0)
    second = Pose(np.array([2.0, 4.0, 6.0]), rotation_about((1, 0, 0), 1.0), 4.0)
    half = first.toward(second, 0.5)
    np.testing.assert_allclose(half.center, (1, 2, 3))
    assert half.scale == pytest.approx(2.0)
    np.testing.assert_allclose(half.rotation, rotation_about((1, 0, 0), 0.5), atol=1e-9)
