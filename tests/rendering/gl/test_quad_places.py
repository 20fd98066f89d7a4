import numpy as np
import pytest

from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering.gl.depth_quads import (
    PivotPlace,
    ScreenPlace,
    clip_from_pivot,
    depth_row,
)
from napari_unpack.rendering.gl.matrices import matrix_of


def clip_of_camera(camera: Camera, aspect: float, depth: float = 1e4) -> np.ndarray:
    """Return the clip matrix of a camera on a canvas of its own."""
    matrix = np.zeros((4, 4))
    matrix[0, 2] = 2 / (camera.height * aspect)
    matrix[1, 1] = -2 / camera.height
    if np.isinf(camera.distance):
        matrix[2, 0], matrix[3, 3] = -1 / depth, 1.0
        return matrix
    far_eye, near_eye = camera.distance + depth, camera.distance / 100
    # At eye distance e = distance + t: w = e / distance, z_ndc from -1 at near to 1 at far.
    matrix[3, 0], matrix[3, 3] = -1 / camera.distance, 1.0
    slope = (far_eye + near_eye) / (far_eye - near_eye)
    shift = -2 * far_eye * near_eye / (far_eye - near_eye)
    matrix[2, 0] = -slope / camera.distance
    matrix[2, 3] = slope + shift / camera.distance
    return matrix


@pytest.mark.parametrize("fov", [0.0, 40.0])
def test_the_clip_matrix_agrees_with_the_cameras_pixels(fov):
    camera = View(direction=(1, 2, -1), height=120.0, fov=fov).camera((30, 40, 50), (1, 1, 2))
    points = np.random.default_rng(0).uniform(-30, 30, (20, 3))
    clip = np.c_[points, np.ones(20)] @ clip_of_camera(camera, aspect=1.5).T
    ndc = clip[:, :3] / clip[:, 3:]
    row, col = camera.pixels(points, (200, 300)).T
    np.testing.assert_allclose((1 - ndc[:, 1]) / 2 * 200 - 0.5, row, atol=1e-9)
    np.testing.assert_allclose((1 + ndc[:, 0]) / 2 * 300 - 0.5, col, atol=1e-9)
    # Nearer to the viewer is nearer to -1.
    assert (np.diff(ndc[np.argsort(points[:, 0]), 2]) < 0).all()


@pytest.mark.parametrize("fov", [0.0, 40.0])
def test_the_depth_of_t_is_the_matrixs_own(fov):
    camera = View(height=120.0, fov=fov).camera((30, 40, 50), (1, 1, 1))
    matrix = clip_of_camera(camera, aspect=1.0)
    a, b, c, d = depth_row(matrix)
    for t in (-20.0, 0.0, 35.0):
        clip = matrix @ [-t, 7.0, -3.0, 1.0]
        assert (a * t + b) / (c * t + d) == pytest.approx(clip[2] / clip[3])
    assert depth_row(matrix, 0.25).tolist() == [0, 0.25, 0, 1]


def test_clip_from_pivot_undoes_the_way_into_pivot_space():
    camera = View(direction=(1, 2, -1), height=90.0).camera((30, 40, 50), (1, 1, 1))
    clip_from_world = np.random.default_rng(1).normal(size=(4, 4))
    world = np.array([4.0, 5.0, 6.0])
    pivot = camera.pivot_from_world() @ [*world, 1.0]
    wanted = clip_from_world @ [6.0, 5.0, 4.0, 1.0]
    np.testing.assert_allclose(clip_from_pivot(clip_from_world, camera) @ pivot, wanted)


def test_a_screen_patch_spans_its_pixels():
    # Rows 10 to 14 of 40 and columns 15 to 29 of 60.
    place = ScreenPlace.of_pixels(10, 15, (5, 15), (40, 60))
    assert (place.left, place.right) == pytest.approx((-0.5, 0.0))
    assert (place.top, place.bottom) == pytest.approx((0.5, 0.25))


def test_a_sprite_counts_depth_from_its_own_plane():
    place = PivotPlace((12.0, 0.0, 0.0), (5.0, 5.0))
    assert (place.t, place.t_origin) == (-12.0, -12.0)


def test_a_chain_of_vispy_transforms_has_one_matrix():
    pytest.importorskip("vispy")
    from vispy.visuals.transforms import LogTransform, MatrixTransform, NullTransform, STTransform

    turn = MatrixTransform()
    turn.rotate(90, (0, 0, 1))
    chain = STTransform(scale=(2, 2, 2), translate=(1, 0, 0)) * turn * NullTransform()
    # x turned into y, doubled, and moved along x.
    np.testing.assert_allclose(matrix_of(chain) @ [1, 0, 0, 1], [1, 2, 0, 1], atol=1e-9)
    with pytest.raises(TypeError, match="matrices and scales"):
        matrix_of(LogTransform())
