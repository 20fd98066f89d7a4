"""The tinted image and picking against brute force and by hand."""

from __future__ import annotations

import brute_force
import numpy as np
import pytest
from ray_scenes import VIEWS, along, patches, ramp

from napari_unpack.geometry.shading import Shading
from napari_unpack.rendering.cpu import Bricks, by_contribution, contributions, tinted

WHITE = np.ones((2, 4), np.float32)
FLAT = (np.array([[1, 1, 1, 0.25]] * 2, np.float32), (0.0, 1.0))


def scene(dtype=np.uint16, seed=5, shape=(11, 18, 13)):
    rng = np.random.default_rng(seed)
    labels = patches(rng, shape)
    volume = (rng.uniform(0, 4000, labels.shape) * (labels != 4)).astype(dtype)
    tints = rng.uniform(0.3, 1, (6, 4)).astype(np.float32)
    tints[2] = 0
    return volume, labels, tints


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
@pytest.mark.parametrize("step", [1.0, 0.45])
def test_colours_and_depth_match_brute_force(dtype, direction, spacing, fov, step) -> None:
    volume, labels, tints = scene(dtype)
    rays = along(direction, labels.shape, spacing, (8, 9), fov, step * min(spacing))
    table, domain = ramp()
    image, depth = tinted(volume, labels, rays, spacing, table, domain, tints, Shading())
    expected, at = brute_force.tinted(
        volume, labels, rays, spacing, table, domain, tints, Shading()
    )
    assert expected[..., 3].max() > 0.6
    np.testing.assert_allclose(image, expected, atol=1e-3)
    # Alpha may round to either side of 0.5 on a pixel or two.
    assert (depth != at.astype(np.float32)).sum() <= 2


def test_two_samples_of_fog_by_hand() -> None:
    # One ray through two voxels of opacity 1/4: alpha = 1 - 0.75^2 = 0.4375; white.
    volume, labels = np.ones((1, 1, 2), np.uint16), np.ones((1, 1, 2), np.uint16)
    rays = along((0, 0, 1), labels.shape, size=(1, 1))
    image, depth = tinted(volume, labels, rays, (1, 1, 1), *FLAT, WHITE, None)
    np.testing.assert_allclose(image[0, 0], [0.4375] * 4, atol=1e-6)
    assert depth[0, 0] == np.inf


@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("spacing", [(1, 1, 1), (1, 1, 2), (0.5, 3, 3)])
def test_opacity_does_not_depend_on_the_step(step, spacing) -> None:
    # Fog of opacity 1/4 a voxel of min(spacing) mm, 12 mm deep: alpha = 1 - 0.75^(12 / min).
    # Of 0.04 a voxel, to stay clear of the early end.
    fog = (np.array([[1, 1, 1, 0.04]] * 2, np.float32), (0.0, 1.0))
    deep = round(12 / spacing[2])
    volume = np.ones((1, 1, deep), np.uint16)
    rays = along((0, 0, 1), volume.shape, spacing, (1, 1), step=step)
    image, _ = tinted(volume, volume, rays, spacing, *fog, WHITE, None)
    assert image[0, 0, 3] == pytest.approx(1 - 0.96 ** (12 / min(spacing)), abs=2e-3)


def test_depth_is_where_alpha_reaches_one_half() -> None:
    # Six voxels of opacity 1/4 at t = -2.5 ... 2.5: alpha 0.25, 0.4375, 0.578 at the third.
    volume = np.ones((1, 1, 6), np.uint16)
    rays = along((0, 0, 1), volume.shape, size=(1, 1))
    _, depth = tinted(volume, volume, rays, (1, 1, 1), *FLAT, WHITE, None)
    assert depth[0, 0] == -0.5


def test_tints_multiply_colour_and_opacity() -> None:
    volume = np.ones((1, 1, 1), np.uint16)
    rays = along((0, 0, 1), volume.shape, size=(1, 1))
    tints = np.array([[0, 0, 0, 0], [1, 0.5, 0, 0.8]], np.float32)
    image, _ = tinted(volume, volume, rays, (1, 1, 1), *FLAT, tints, None)
    np.testing.assert_allclose(image[0, 0], [0.2, 0.1, 0, 0.2], atol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
@pytest.mark.parametrize("jitter", [False, True])
def test_bricks_and_threads_change_no_pixel(dtype, direction, spacing, fov, jitter) -> None:
    inner, small, tints = scene(dtype, shape=(17, 12, 22))
    volume, labels = np.zeros((40, 37, 61), dtype), np.zeros((40, 37, 61), np.uint16)
    volume[14:31, 9:21, 20:42], labels[14:31, 9:21, 20:42] = inner, small
    table, domain = ramp()
    rays = along(direction, labels.shape, spacing, (40, 41), fov)
    given = (volume, labels, rays, spacing, table, domain, tints, Shading())
    image, depth = tinted(*given, jitter=jitter, threads=1)
    assert (image[..., 3] > 0.1).sum() > 50
    other, behind = tinted(*given, Bricks.of(labels, volume), jitter=jitter, threads=2)
    np.testing.assert_array_equal(other, image)
    np.testing.assert_array_equal(behind, depth)


def test_a_hidden_object_leaves_what_lies_behind_as_if_it_were_air() -> None:
    volume, labels, tints = scene()
    table, domain = ramp()
    rays = along((0.31, -0.52, 0.87), labels.shape)
    tints[:] = 1
    tints[3] = 0
    gone = np.where(labels == 3, 5, labels).astype(np.uint16)
    unlit = (table, domain)
    image, _ = tinted(volume, labels, rays, (1, 1, 1), *unlit, tints, None)
    tints[5] = 0
    tints[3] = 1
    both, _ = tinted(volume, gone, rays, (1, 1, 1), *unlit, tints, None)
    tints[3] = 0
    neither, _ = tinted(volume, labels, rays, (1, 1, 1), *unlit, tints, None)
    np.testing.assert_array_equal(both, neither)
    assert np.abs(image - neither).max() > 0.05


def test_touching_visible_objects_show_no_seam() -> None:
    # Section 4.1: opacity across two touching objects varies as in the untinted rendering.
    volume, labels, _ = scene()
    table, domain = ramp()
    rays = along((0.31, -0.52, 0.87), labels.shape)
    coloured = np.ones((6, 4), np.float32)
    coloured[:, :3] = np.random.default_rng(0).uniform(0, 1, (6, 3))
    image, _ = tinted(volume, labels, rays, (1, 1, 1), table, domain, coloured, Shading())
    plain, _ = tinted(
        volume, np.zeros_like(labels), rays, (1, 1, 1), table, domain, WHITE, Shading()
    )
    np.testing.assert_array_equal(image[..., 3], plain[..., 3])


def test_premultiplied_colour_never_exceeds_alpha() -> None:
    volume, labels, tints = scene()
    table, domain = ramp()
    bright = Shading(ambient=1, diffuse=1, specular=1, shininess=1)
    rays = along((0.31, -0.52, 0.87), labels.shape)
    image, _ = tinted(volume, labels, rays, (1, 1, 1), table, domain, tints, bright)
    assert (image[..., :3] <= image[..., 3:] + 1e-6).all()


def test_a_clipping_plane_cuts_the_picture() -> None:
    # Six voxels of opacity 1/4; keeping x <= 2.5 leaves three: 1 - 0.75^3 = 0.578125.
    volume = np.ones((1, 1, 6), np.uint16)
    rays = along((0, 0, 1), volume.shape, size=(1, 1))
    plane = [[[0, 0, 2.7], [0, 0, -1]]]
    image, _ = tinted(volume, volume, rays, (1, 1, 1), *FLAT, WHITE, None, clipping=plane)
    assert image[0, 0, 3] == pytest.approx(0.578125)


def test_picking_adds_up_what_each_object_lends() -> None:
    # Opacity 1/4 each: object 1 gets 0.25, object 2 (two voxels) 0.75 (0.25 + 0.75 * 0.25)
    # = 0.328125, object 1 again 0.421875 * 0.25 = 0.10546875, together 0.35546875; then 3.
    labels = np.array([[[1, 2, 2, 1, 3]]], np.uint16)
    volume = np.ones_like(labels)
    rays = along((0, 0, 1), labels.shape, size=(1, 1))
    shares = contributions(volume, labels, rays, (1, 1, 1), *FLAT, np.ones((4, 4), np.float32))
    assert list(shares) == [1, 2, 3]
    assert shares == pytest.approx({1: 0.35546875, 2: 0.328125, 3: 0.0791015625})
    image, _ = tinted(volume, labels, rays, (1, 1, 1), *FLAT, np.ones((4, 4), np.float32), None)
    assert sum(shares.values()) == pytest.approx(image[0, 0, 3], abs=1e-6)


def test_the_pick_steps_deeper_from_the_strongest_and_ends_with_those_in_front() -> None:
    shares = {4: 0.1, 0: 0.9, 7: 0.4, 2: 0.2, 5: 0.0}
    assert [i for i, _ in by_contribution(shares)] == [7, 2, 5, 4]
    assert by_contribution({0: 0.5}) == []


def test_behind_opaque_matter_objects_can_still_be_stepped_to() -> None:
    labels = np.array([[[1, 1, 2, 2, 2, 3]]], np.uint16)
    rays = along((0, 0, 1), labels.shape, size=(1, 1))
    wall = np.ones((2, 4), np.float32)
    shares = contributions(
        np.ones_like(labels), labels, rays, (1, 1, 1), wall, (0, 1), np.ones((4, 4), np.float32)
    )
    assert shares == {1: 1.0, 2: 0.0, 3: 0.0}


def test_contributions_are_of_one_ray() -> None:
    labels = np.ones((2, 2, 2), np.uint16)
    rays = along((0, 0, 1), labels.shape, size=(2, 1))
    with pytest.raises(ValueError, match="one pixel"):
        contributions(labels, labels, rays, (1, 1, 1), *FLAT, WHITE)
