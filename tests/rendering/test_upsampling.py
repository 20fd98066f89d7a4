"""Small objects are shown on a finer grid, without stairs, and otherwise as they were."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.geometry.transforms import Pose, rotation_about
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.compose import object_image, sprite_image
from napari_unpack.rendering.upsampling import MOST_VOXELS, divisions, upsampled

TURN = rotation_about((0.0, 1.0, 0.0), 0.5) @ rotation_about((0.0, 0.0, 1.0), 0.4)
STILL = Pose(np.zeros(3), np.eye(3), 1.0)
PIXELS = 15.0
"""A mm, which is a voxel here."""


def session_of(
    labels: np.ndarray, volume: np.ndarray, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Any:
    """Return a session whose densities of 400 and more are opaque, of less invisible."""
    session = nu.Session(volume, labels, spacing)
    points = (
        (0.0, 0.0),
        (300.0, 0.0),
        (400.0, 1.0),
        (4000.0, 1.0),
    )
    session.transfer_function = nu.TransferFunction(points)
    return session


def ball_in_a_block(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return labels and density of a ball, 1, within as dense a block, 2, within air."""
    z, y, x = np.indices((40, 40, 40))
    away = np.sqrt((z - 20.0) ** 2 + (y - 20.0) ** 2 + (x - 20.0) ** 2)
    labels = np.zeros((40, 40, 40), np.uint16)
    labels[6:34, 6:34, 6:34] = 2
    labels[away < radius] = 1
    return labels, np.where(labels > 0, 1000, 0).astype(np.uint16)


def alone(session: Any, smooth: bool, pose: Pose = STILL, side: float = 16.0) -> np.ndarray:
    """Return the (N, N, 4) image of object 1."""
    size = round(side * PIXELS)
    camera = Camera(np.eye(3), np.zeros(3), side)
    patch = object_image(
        session.scene(), 1, pose, camera, (size, size), 1 / 3, "cpu", smooth=smooth
    )
    picture = np.zeros((size, size, 4), np.float32)
    height, width = patch.size
    picture[patch.row : patch.row + height, patch.col : patch.col + width] = patch.rgba
    return picture


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_the_outline_of_a_ball_within_a_block_is_a_circle(turn: np.ndarray) -> None:
    radius = 5.2
    session = session_of(*ball_in_a_block(radius))
    middle = (16 * PIXELS - 1) / 2
    row, col = np.indices((240, 240)) - middle
    away = np.hypot(row, col) / PIXELS
    # Where the outline of a ball of voxels may be is known to half a voxel.
    surely_in, surely_out = away < radius - 0.5, away > radius + 0.5
    pose = replace(STILL, rotation=turn)
    smooth, stairs = (alone(session, s, pose)[..., 3] for s in (True, False))
    assert (smooth[surely_in] > 0.99).all()
    assert (smooth[surely_out] < 0.01).all()
    # How far from a circle of the same area, in parts of the area.
    unlike = []
    for alpha in (smooth, stairs):
        drawn = alpha > 0.5
        equal = np.sqrt(drawn.sum() / np.pi) / PIXELS
        unlike.append(((drawn != (away < equal)).sum() / drawn.sum(), abs(equal - radius)))
    assert unlike[0][0] < 0.05
    assert unlike[0][0] < 0.8 * unlike[1][0]
    assert unlike[0][1] < 0.3


def test_densities_stay_at_their_places_in_the_world() -> None:
    spacing = np.array([2.0, 1.0, 1.0])
    z, y, x = np.indices((20, 24, 28)).astype(np.float32)
    volume = 500 + 30 * z - 4 * y + 7 * x
    labels = np.zeros(volume.shape, np.uint16)
    labels[6:14, 8:16, 8:18] = 1
    cache = session_of(labels, volume, tuple(spacing)).scene().subvolumes
    fine = upsampled(cache.of_object(1), 1, spacing, float(volume.min()))
    assert fine.finer[0] == 2 * fine.finer[1] == 2 * fine.finer[2] > 2

    index = np.stack(np.indices(fine.volume.shape), axis=-1).reshape(-1, 3)
    back = np.linalg.inv(fine.voxel_from_world)
    world = index @ back[:3, :3].T + back[:3, 3]
    voxel = world / spacing
    deep = ((voxel > [8, 10, 10]) & (voxel < [11, 13, 15])).all(axis=1)
    assert deep.sum() > 1000
    wanted = 500 + voxel[deep] @ [30, -4, 7]
    np.testing.assert_allclose(fine.volume.reshape(-1)[deep], wanted, atol=0.01)
    # Nothing of it beyond the fringe of two voxels and the smoothing's reach of two more.
    inside = fine.labels.reshape(-1) == 1
    assert ((voxel[inside] > [2, 4, 4]) & (voxel[inside] < [17, 19, 21])).all()
    np.testing.assert_allclose(fine.volume.reshape(-1)[~inside], volume.min(), atol=0.01)


def test_what_is_translucent_is_as_translucent_and_as_bright_as_before() -> None:
    labels = np.zeros((30, 40, 40), np.uint16)
    labels[12:18, 10:30, 10:30] = 1
    volume = np.where(labels == 1, 1000, 0).astype(np.uint16)
    session = session_of(labels, volume)
    points = ((0.0, 0.0), (1000.0, 0.2), (4000.0, 0.2))
    session.transfer_function = nu.TransferFunction(points)
    before, after = (
        alone(session, smooth, side=30.0)[200:250, 200:250] for smooth in (False, True)
    )
    assert 0.5 < before[..., 3].mean() < 0.9
    np.testing.assert_allclose(after[..., 3], before[..., 3], atol=0.005)
    # The skin in which light falls is as deep as the gradient reaches, in voxels.
    np.testing.assert_allclose(after, before, atol=0.05)


def test_a_wire_of_one_voxel_stays_in_one_piece() -> None:
    labels = np.zeros((30, 30, 60), np.uint16)
    labels[10:20, 10:20, 10:50] = 2
    labels[15, 15, 15:45] = 1
    session = session_of(labels, np.where(labels > 0, 1000, 0).astype(np.uint16))
    picture = alone(session, True, side=36.0)[..., 3]
    along = picture.max(axis=0) > 0.5
    columns = np.flatnonzero(along)
    assert len(columns) == np.ptp(columns) + 1
    assert np.ptp(columns) / PIXELS == pytest.approx(30, abs=2.0)


def test_large_objects_are_left_and_no_crop_grows_beyond_bounds() -> None:
    labels = np.zeros((20, 20, 200), np.uint16)
    labels[5:15, 5:15, 5:195] = 1
    volume = np.where(labels == 1, 1000, 0).astype(np.uint16)
    cache = session_of(labels, volume).scene().subvolumes
    subvolume = cache.of_object(1)
    assert upsampled(subvolume, 1, np.ones(3), 0.0) is subvolume

    spacing = np.array([3.0, 1.0, 1.0])
    for side in (1, 3, 10, 40, 90, 130):
        inside = np.ones((side, side, side), np.bool_)
        finer = divisions(inside, spacing)
        assert inside.size * np.prod(finer) <= MOST_VOXELS or finer == (1, 1, 1)
        assert finer[1] == finer[2]
    assert divisions(np.ones((10, 10, 10), np.bool_), spacing) == (12, 4, 4)
    assert divisions(np.zeros((10, 10, 10), np.bool_), spacing) == (1, 1, 1)


def test_an_object_in_the_corner_of_a_tiny_volume_has_a_sprite() -> None:
    labels = np.zeros((2, 3, 1), np.uint16)
    labels[0, 0, 0] = 1
    session = session_of(labels, np.where(labels == 1, 1000, 0).astype(np.uint16))
    assert sprite_image(session.scene(), 1, STILL, 12.0, backend="cpu").rgba[..., 3].max() > 0.5
