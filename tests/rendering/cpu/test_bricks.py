"""Bricks: what they hold, what they call empty, and how far one may leap."""

from __future__ import annotations

import numpy as np
import pytest
from ray_scenes import along

from napari_unpack.rendering.cpu import Bricks
from napari_unpack.rendering.cpu.bricks import Strides
from napari_unpack.rendering.cpu.thread_pool import over_bands


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_ranges_and_objects_by_brute_force(dtype) -> None:
    rng = np.random.default_rng(0)
    shape = (17, 8, 30)
    volume = rng.uniform(0, 4000, shape).astype(dtype)
    labels = rng.integers(0, 3000, shape).astype(np.uint16)
    labels[:8, :8, :8] = 7
    bricks = Bricks.of(labels, volume)
    assert bricks.low.shape == (3, 1, 4)
    for number, (z, y, x) in enumerate(np.ndindex(3, 1, 4)):
        own = tuple(slice(8 * i, 8 * i + 8) for i in (z, y, x))
        wide = tuple(slice(max(8 * i - 1, 0), 8 * i + 9) for i in (z, y, x))
        assert bricks.low[z, y, x] == volume[wide].min()
        assert bricks.high[z, y, x] == volume[wide].max()
        ids = bricks.ids[bricks.starts[number] : bricks.starts[number + 1]]
        assert sorted(ids.tolist()) == np.unique(labels[own]).tolist()


def test_a_brick_is_empty_by_density_or_by_tint() -> None:
    volume = np.zeros((8, 8, 24), np.uint16)
    labels = np.zeros((8, 8, 24), np.uint16)
    volume[3, 3, 3], volume[:, :, 18:22] = 1000, 500
    labels[:, :, 16:] = 1
    table = np.ones((5, 4), np.float32)
    table[:, 3] = [0, 0, 0, 0.5, 0.5]
    bricks = Bricks.of(labels, volume)
    tints = np.ones((2, 4), np.float32)
    # The ramp begins at 1/2 of the domain: 500 of 1000. The second brick holds nothing.
    assert bricks.occupied(table, (0, 1000), tints).ravel().tolist() == [True, False, True]
    assert bricks.occupied(table, (0, 2000), tints).ravel().tolist()[1] is False
    tints[1] = 0
    assert bricks.occupied(table, (0, 1000), tints).ravel().tolist() == [True, False, False]
    tints[0] = 0
    assert not bricks.occupied(table, (0, 1000), tints).any()


def test_inhabited_asks_only_for_visible_objects() -> None:
    labels = np.zeros((8, 8, 16), np.uint16)
    labels[0, 0, 0], labels[0, 0, 15] = 1, 2
    bricks = Bricks.of(labels)
    assert bricks.inhabited(np.array([False, True, False])).ravel().tolist() == [True, False]


@pytest.mark.parametrize(("rows", "threads", "band"), [(1, 4, None), (37, 3, 5), (64, 2, None)])
def test_bands_cover_every_row_once(rows, threads, band) -> None:
    done = np.zeros(rows, int)

    def work(own: list, first: int, last: int) -> None:
        done[first:last] += 1
        own.append((first, last))

    states = over_bands(rows, work, list, threads, band)
    assert (done == 1).all()
    assert sum(len(own) for own in states) >= 1


def test_an_error_in_a_band_is_raised() -> None:
    def work(_: None, first: int, last: int) -> None:
        raise RuntimeError(f"rows {first} to {last}")

    with pytest.raises(RuntimeError, match="rows"):
        over_bands(10, work, lambda: None, 2)


def test_owners_tell_full_empty_and_mixed_bricks() -> None:
    labels = np.zeros((8, 8, 40), np.uint16)
    labels[:, :, :8] = 3
    labels[:, :, 16:24] = 2
    labels[0, 0, 24] = 3
    labels[0, 0, 32] = 2
    bricks = Bricks.of(labels)
    shown = np.array([False, True, False, True])
    # All 3; nothing; only 2, which is hidden; 3 among air; hidden 2 among air.
    assert bricks.owners(shown).ravel().tolist() == [3, 0, 0, -1, 0]
    # Along +x the second and third are alike; along -x the third and second.
    for way, expected in ((1, [1, 2, 1, 0, 255]), (-1, [255, 1, 2, 0, 1])):
        strides = Strides.of(bricks.owners(shown), along((0, 0, way), labels.shape))
        assert strides.grids[strides.slots[0]].ravel().tolist() == expected


@pytest.mark.parametrize("signs", list(np.ndindex(2, 2, 2)))
def test_strides_are_the_largest_cubes_of_one_owner_ahead(signs) -> None:
    rng = np.random.default_rng(2)
    owners = np.zeros((7, 9, 10), np.int32)
    owners[2:7, 3:8, 4:9] = 5
    owners[4:6, :4, :3] = 7
    owners[rng.random(owners.shape) < 0.01] = -1
    direction = np.where(signs, 1, -1) * (0.5, 0.6, 0.7)
    strides = Strides.of(owners, along(direction, (56, 72, 80)))
    assert len(strides.grids) == 1
    found = strides.grids[0]
    for z, y, x in np.ndindex(*owners.shape):
        edge, ahead = 0, 0
        while edge < 11 and ahead == edge:
            edge += 1
            cube = owners[
                tuple(
                    slice(i, i + edge) if s else slice(max(i - edge + 1, 0), i + 1)
                    for i, s in zip((z, y, x), signs, strict=True)
                )
            ]
            ahead += bool(owners[z, y, x] >= 0 and (cube == owners[z, y, x]).all())
        # A cube larger than the grid is one without an end.
        assert found[z, y, x] == ahead or (ahead == 11 and found[z, y, x] > 10)


def test_a_perspective_picture_along_an_axis_looks_into_four_octants() -> None:
    strides = Strides.of(np.zeros((3, 3, 3), np.int32), along((1, 0, 0), (24, 24, 24), fov=40))
    assert len(strides.grids) == 4
    assert len(set(strides.slots[4:].tolist())) == 4
    np.testing.assert_array_equal(strides.slots[:4], strides.slots[4:])
    assert (strides.grids == 255).all()
