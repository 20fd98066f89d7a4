"""BrickCache of density and differences against numpy, and images that need more than there are."""

from __future__ import annotations

import numpy as np
import pytest
from ray_scenes import VIEWS, along, patches, ramp

from napari_unpack.geometry.shading import Shading
from napari_unpack.rendering.cpu import Bricks, tinted
from napari_unpack.rendering.cpu.brick_cache import BLOCK, CAPACITY, BrickCache, fill
from napari_unpack.rendering.cpu.simd import EDGE

SHAPE = (20, 29, 34)


def filled(volume, labels, bricks, brick):
    """Return (10, 10, 10, 4) cells and (10, 10, 10) labels of one brick, in the third block."""
    grid = tuple(-(-n // 8) for n in volume.shape)
    blocks = BrickCache.of(volume, np.ones(grid, bool), bricks)
    at = 2 * BLOCK
    number = int(np.ravel_multi_index(brick, grid))
    fill(
        volume.ravel(), labels.ravel(), number, *volume.shape, at, blocks.cells, blocks.names,
        blocks.around, blocks.starts, blocks.ids,
    )  # fmt: skip
    cells = blocks.cells[4 * at : 4 * (at + EDGE**3)].reshape(EDGE, EDGE, EDGE, 4)
    return cells, blocks.names[at : at + EDGE**3].reshape(EDGE, EDGE, EDGE)


@pytest.mark.parametrize("brick", [(0, 0, 0), (1, 1, 1), (1, 2, 2), (2, 3, 4), (0, 1, 4)])
@pytest.mark.parametrize(
    ("dtype", "largest", "looked_over", "kept"),
    [
        (np.uint16, 32767, True, np.int16),
        (np.uint16, 32767, False, np.float32),
        (np.uint16, 65535, True, np.float32),
        (np.float32, 4000, True, np.float32),
    ],
)
def test_a_block_holds_density_and_differences(brick, dtype, largest, looked_over, kept) -> None:
    rng = np.random.default_rng(3)
    volume = rng.choice([0, 1, largest // 2, largest], SHAPE).astype(dtype)
    labels = patches(rng, SHAPE)
    labels[8:16, 8:16, 8:16] = 3
    bricks = Bricks.of(labels, volume) if looked_over else None
    cells, names = filled(volume, labels, bricks, brick)
    assert cells.dtype == kept
    corner = 8 * np.array(brick)
    # The block begins a voxel before the brick; two more all around are clamped copies.
    padded = np.pad(volume.astype(np.float64), 16, mode="edge")
    at = tuple(slice(c + 15, c + 15 + EDGE) for c in corner)
    np.testing.assert_array_equal(cells[..., 0], padded[at])
    for axis in range(3):
        after, before = np.roll(padded, -1, axis), np.roll(padded, 1, axis)
        np.testing.assert_array_equal(cells[..., 1 + axis], (after - before)[at])
    own = tuple(slice(c, c + 8) for c in corner)
    expected = labels[own]
    within = tuple(slice(1, 1 + n) for n in expected.shape)
    np.testing.assert_array_equal(names[within], expected)


@pytest.mark.parametrize(("direction", "spacing", "fov"), VIEWS)
def test_a_picture_of_more_bricks_than_there_are_blocks(direction, spacing, fov) -> None:
    rng = np.random.default_rng(8)
    shape = (80, 72, 104)
    volume = rng.uniform(0, 4000, shape).astype(np.uint16)
    labels = np.ones(shape, np.uint16)
    labels[rng.uniform(size=shape) < 0.1] = 2
    table, domain = ramp()
    table[:, 3] *= 0.02
    tints = np.array([[0, 0, 0, 0], [1, 0.5, 0.2, 1], [0.1, 0.2, 1, 0.7]], np.float32)
    bricks = Bricks.of(labels, volume)
    rays = along(direction, shape, spacing, (30, 31), fov)
    given = (spacing, table, domain, tints, Shading(), bricks)
    image, _ = tinted(volume, labels, rays, *given, threads=1)
    assert bricks.occupied(table, domain, tints).sum() > 2 * CAPACITY
    assert (image[..., 3] > 0.1).sum() > 100
    for row, col in rng.integers(0, 30, (25, 2)):
        # A single ray meets far fewer bricks.
        one, _ = tinted(volume, labels, rays.window(row, col, (1, 1)), *given, threads=1)
        # Origins of windows are rounded otherwise.
        np.testing.assert_allclose(image[row, col], one[0, 0], atol=2e-4)


@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf, np.finfo(np.float32).max])
@pytest.mark.parametrize("looked_over", [False, True])
def test_what_is_no_density_spoils_but_its_own_pixels(hole, looked_over) -> None:
    # Volumes belong to a user, who may write into them after they have been looked over.
    rng = np.random.default_rng(2)
    volume = rng.uniform(0, 4000, (9, 19, 19)).astype(np.float32)
    labels = np.ones(volume.shape, np.uint16)
    table, domain = ramp()
    rays = along((1, 0, 0), volume.shape, size=(25, 25))
    tints, bricks = np.ones((2, 4), np.float32), Bricks.of(labels, volume) if looked_over else None
    given = (labels, rays, (1, 1, 1), table, domain, tints, Shading(), bricks)
    before, _ = tinted(volume, *given)
    volume[3:5, 9, 9] = hole
    after, _ = tinted(volume, *given)
    far = np.ones(after.shape[:2], bool)
    # A pixel is 1.12 mm; a sample's light comes from within two voxels.
    far[9:16, 9:16] = False
    assert (before[..., 3] > 0.1).sum() > 200
    np.testing.assert_array_equal(after[far], before[far])
    assert np.isfinite(after).all()
