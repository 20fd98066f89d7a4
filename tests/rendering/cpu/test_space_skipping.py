"""Corridors of like bricks against rays walked in small steps."""

from __future__ import annotations

import numpy as np
import pytest
from ray_scenes import along

from napari_unpack.rendering.cpu.space_skipping import DirectionalSkipping


def blobs() -> np.ndarray:
    rng = np.random.default_rng(2)
    owners = np.zeros((7, 9, 10), np.int32)
    owners[2:7, 3:8, 4:9] = 5
    owners[4:6, :4, :3] = 7
    owners[rng.random(owners.shape) < 0.02] = -1
    return owners


WAYS = [(1, 0, 0), (0, 0, -1), (0.2, 1, 0.1), (-0.3, -0.2, 1), (-1, 0.9, 0.8), (0.5, -0.35, -1)]


@pytest.mark.parametrize("direction", WAYS)
@pytest.mark.parametrize("fov", [0, 20])
def test_no_ray_leaves_its_owner_within_a_corridor(direction, fov) -> None:
    owners = blobs()
    shape = tuple(8 * n for n in owners.shape)
    rays = along(direction, shape, (1, 1, 1), (37, 41), fov, 1.0)
    found = DirectionalSkipping.of(owners, rays)
    if found.axis < 0:
        assert fov
        return
    assert found.axis == int(np.argmax(np.abs(direction)))
    grid, walked = found.grids[0], 0
    np.testing.assert_array_equal(grid == 0, owners < 0)
    t = (np.arange(-400, 400) + 0.5) * 0.37
    for row in range(0, 37, 4):
        for col in range(0, 41, 4):
            pixel = np.array([1.0, row, col])
            points = pixel @ rays.table[:3] + t[:, None] * (pixel @ rays.table[3:])
            voxels = np.floor(points + 0.5).astype(int)
            inside = ((voxels >= 0) & (voxels < shape)).all(axis=1) & (t > rays.near)
            bricks = voxels[inside] // 8
            for i, brick in enumerate(bricks):
                layers = int(grid[tuple(brick)]) - 1
                ahead = bricks[i:]
                near = np.abs(ahead[:, found.axis] - brick[found.axis]) < layers
                assert (owners[tuple(ahead[near].T)] == owners[tuple(brick)]).all()
                walked += int(near.sum())
    assert walked > 1000


def test_along_an_axis_a_corridor_is_as_wide_as_its_rays_stray() -> None:
    owners = np.zeros((6, 5, 5), np.int32)
    owners[4, 2, 2] = -1
    owners[3, 0, 2] = 4
    grid = DirectionalSkipping.of(owners, along((1, 0, 0), (48, 40, 40))).grids[0]
    # Four layers lie before the mixed brick, and 1 is said more; three before the other.
    assert grid[0, 2, 2] == 5
    assert grid[0, 4, 4] > 90
    assert grid[0, 0, 2] == 4
    assert grid[5, 2, 2] > 90


def test_rays_that_have_no_axis_in_common_get_cubes() -> None:
    owners = np.zeros((4, 4, 4), np.int32)
    found = DirectionalSkipping.of(owners, along((1, 1, 1), (32, 32, 32), fov=100))
    assert found.axis == -1
