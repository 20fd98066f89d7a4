"""Many rays looked at together against each looked at alone."""

from __future__ import annotations

import numpy as np
import pytest
from ray_scenes import along

from napari_unpack.rendering.cpu import ray_packets
from napari_unpack.rendering.cpu.object_ids import bricks_ahead
from napari_unpack.rendering.cpu.ray_sampling import octant_of, per_voxel, ray_numbers, ray_of
from napari_unpack.rendering.cpu.space_skipping import DirectionalSkipping

SHAPE = (40, 56, 72)


def owners() -> np.ndarray:
    rng = np.random.default_rng(4)
    grid = np.zeros(tuple(n // 8 for n in SHAPE), np.int32)
    grid[1:4, 2:6, 3:8] = 70_000
    grid[rng.random(grid.shape) < 0.1] = -1
    return grid


@pytest.mark.parametrize(
    ("direction", "fov"),
    [
        ((0.2, 1, 0.1), 0),
        ((-1, 0.3, 0.9), 0),
        ((0.1, 0, -1), 0),
        ((1, 1, 1), 100),
        ((0, -1, 0), 20),
    ],
)
def test_each_sees_what_it_sees_alone(direction, fov) -> None:
    rng, grid = np.random.default_rng(7), owners()
    rays = along(direction, SHAPE, size=(64, 64), fov=fov, step=0.9)
    ahead = DirectionalSkipping.of(grid, rays)
    looks = ray_packets.looks_of(grid, ahead.grids, np.arange(grid.size, dtype=np.int32)).reshape(
        -1
    )
    table, step, near = ray_numbers(rays)
    numbers, chosen = [], []
    while len(numbers) < 40 * ray_packets.LANES:
        ray = ray_of(table, float(rng.integers(64)), float(rng.integers(64)))
        k = int(rng.integers(-400, 400))
        voxel = np.array(ray[:3]) + (k + 0.5) * step * np.array(ray[3:])
        if (k + 0.5) * step > near and ((voxel >= -0.5) & (voxel < np.array(SHAPE) - 0.5)).all():
            numbers.append(ray)
            chosen.append(k)
    uniform = 0
    for first in range(0, len(numbers), ray_packets.LANES):
        lanes = range(first, first + ray_packets.LANES)
        f = np.zeros(ray_packets.FLOAT_ROWS * ray_packets.LANES)
        n = np.zeros(ray_packets.INTEGER_ROWS * ray_packets.LANES, np.int32)
        paces = [tuple(per_voxel(d, step) for d in numbers[i][3:]) for i in lanes]
        grids = [int(ahead.slots[octant_of(*pace)]) for pace in paces]
        f[: 9 * ray_packets.LANES] = np.array(
            [(*numbers[i], *pace) for i, pace in zip(lanes, paces, strict=True)]
        ).T.ravel()
        f[ray_packets.K : ray_packets.K + ray_packets.LANES] = chosen[
            first : first + ray_packets.LANES
        ]
        n[: ray_packets.LANES] = np.array(grids) * grid.size
        ray_packets.look_ahead(looks, *grid.shape[1:], ahead.axis, step, f, n)
        for lane, i in enumerate(lanes):
            own, free, brick = bricks_ahead(
                grid, ahead.grids, grids[lane], ahead.axis, chosen[i], step, *numbers[i],
                *paces[lane],
            )  # fmt: skip
            look = int(n[ray_packets.SKIP + lane])
            assert (look >> 8 if look > 0 else -1) == own
            assert look > 0 or ~look == brick
            assert int(f[ray_packets.BEYOND + lane]) == free
            assert int(n[ray_packets.BRICK + lane]) == brick
            uniform += own >= 0
    assert 100 < uniform < len(numbers)
