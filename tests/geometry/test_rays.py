"""Rays: one lattice of samples for all, whatever part of the image is cast."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.rays import cast_rays, voxel_from_world, world_from_voxel
from napari_unpack.geometry.view import View

SHAPE, SPACING = (10, 20, 30), (2.0, 1.0, 0.5)


SHEARED = -np.array([[1.1, 0.2, 0.1], [0.2, 0.9, -0.3], [0.1, -0.3, 1.2]])


def rays_of(fov: float = 0.0, size: tuple[int, int] = (9, 11), step: float = 0.5, stretch=None):
    camera = View(direction=(0.2, -0.4, 1.0), fov=fov).camera(SHAPE, SPACING, stretch)
    return camera, cast_rays(camera, size, voxel_from_world(SPACING), step)


def test_an_axis_aligned_orthographic_ray_in_numbers() -> None:
    # Looking along +x at a cube of 8 voxels of 1 mm: centre (3.5, 3.5, 3.5), up is -y, so down
    # is +y and right = cross(towards, down) = cross((0, 0, -1), (0, 1, 0)) = (1, 0, 0), that is +z.
    # 5 x 5 pixels over 10 mm are 2 mm each; pixel (0, 0) is two pixels up and left of the middle.
    camera = View(direction=(0, 0, 1), height=10.0).camera((8, 8, 8), (1, 1, 1))
    rays = cast_rays(camera, (5, 5), voxel_from_world((1, 1, 1)), 1.0)
    np.testing.assert_allclose(rays.point(2, 2, 0.0), (3.5, 3.5, 3.5))
    np.testing.assert_allclose(rays.point(2, 2, 1.5), (3.5, 3.5, 5.0))
    np.testing.assert_allclose(rays.point(0, 0, 0.0), (-0.5, -0.5, 3.5))
    np.testing.assert_allclose(rays.point(0, 4, 0.0), (7.5, -0.5, 3.5))


@pytest.mark.parametrize("stretch", [None, -np.eye(3), SHEARED], ids=["as is", "mirror", "shear"])
@pytest.mark.parametrize("fov", [0.0, 35.0])
def test_every_point_of_a_ray_projects_to_its_pixel(fov: float, stretch) -> None:
    camera, rays = rays_of(fov, stretch=stretch)
    for row, col, t in [(0, 0, -3.0), (4, 5, 0.0), (8, 10, 7.5), (2, 9, 1.25)]:
        world = rays.point(row, col, t) * SPACING
        np.testing.assert_allclose(camera.project(world, rays.size), (row, col), atol=1e-9)


@pytest.mark.parametrize("fov", [0.0, 35.0])
def test_t_is_the_depth_from_the_pivot_plane(fov: float) -> None:
    camera, rays = rays_of(fov)
    for row, col, t in [(0, 0, -3.0), (8, 10, 7.5)]:
        world = rays.point(row, col, t) * SPACING
        assert (world - camera.center) @ camera.direction == pytest.approx(t, abs=1e-9)


def test_perspective_rays_meet_in_the_eye_and_visit_nothing_behind_it() -> None:
    camera, rays = rays_of(50.0)
    eye = (camera.center - camera.distance * camera.direction) / SPACING
    np.testing.assert_allclose(rays.point(0, 10, rays.near), eye, atol=1e-9)
    assert rays.near == -camera.distance


@pytest.mark.parametrize("fov", [0.0, 35.0])
def test_depth_is_measured_as_the_bag_is_drawn_where_it_is_sheared(fov: float) -> None:
    camera, rays = rays_of(fov, stretch=SHEARED)
    for row, col, t in [(0, 0, -3.0), (8, 10, 7.5)]:
        world = rays.point(row, col, t) * SPACING
        drawn = camera.rotation @ SHEARED @ (world - camera.center)
        assert -drawn[0] == pytest.approx(t, abs=1e-9)


@pytest.mark.parametrize("fov", [0.0, 35.0])
def test_a_window_holds_the_very_rays_of_the_whole_picture(fov: float) -> None:
    _, rays = rays_of(fov)
    part = rays.window(3, 4, (2, 5))
    assert part.size == (2, 5)
    assert (part.step, part.near) == (rays.step, rays.near)
    np.testing.assert_allclose(part.point(1, 2, 3.3), rays.point(4, 6, 3.3), atol=1e-12)


@pytest.mark.parametrize(("size", "step"), [((0, 5), 1.0), ((5, 5), 0.0), ((5, 5), float("nan"))])
def test_a_picture_without_pixels_or_step_is_refused(size: tuple[int, int], step: float) -> None:
    with pytest.raises(ValueError, match=r"size|step"):
        rays_of(size=size, step=step)


def test_voxels_and_world_are_inverse_maps() -> None:
    np.testing.assert_allclose(voxel_from_world(SPACING) @ world_from_voxel(SPACING), np.eye(4))
