"""Objects moved out of a label volume: whom they meet, by hand and by brute force."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.rendering.cpu.bricks import Bricks
from napari_unpack.rendering.cpu.sweep import SweepTest, sweep_blockers, whole_shifts


def brute(labels, way, visible):
    """Move whole masks; everything that is written out is compared."""
    ids = np.flatnonzero(visible)
    blocks = np.zeros((len(ids),) * 2, bool)
    way = np.asarray(way, float) / np.linalg.norm(way)
    for column, label in enumerate(ids):
        mine = np.argwhere(labels == label)
        for s in np.arange(0.25, sum(labels.shape) + 1, 0.25):
            moved = mine + np.rint(s * way).astype(int)
            moved = moved[((moved >= 0) & (moved < labels.shape)).all(axis=1)]
            there = set(labels[tuple(moved.T)].tolist()) - {label}
            blocks[[row for row, other in enumerate(ids) if other in there], column] = True
    return ids, blocks


def crumbs(seed, objects, edge):
    """Make cubes of objects with holes in them, tell who is visible, and choose a direction."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, objects + 1, (5, 6, 7)).astype(np.uint16)
    labels = labels.repeat(edge, 0).repeat(edge, 1).repeat(edge, 2)
    labels[rng.random(labels.shape) < 0.3] = 0
    visible = np.ones(objects + 1, bool)
    visible[[0, 3]] = False, seed % 2 == 0
    return labels, visible, rng.normal(size=3)


@pytest.mark.parametrize("seed", range(6))
def test_it_meets_whom_moved_masks_overlap(seed):
    labels, visible, direction = crumbs(seed, 4, 2)
    found = sweep_blockers(labels, (1, 1, 1), direction, visible)
    ids, blocks = brute(labels, direction, visible)
    np.testing.assert_array_equal(found[0], ids)
    np.testing.assert_array_equal(found[1], blocks)


@pytest.mark.parametrize("seed", range(8))
def test_bricks_save_looking_and_change_nothing(seed):
    rng = np.random.default_rng(seed)
    labels = np.zeros((40, 52, 61), np.uint16)
    for label in range(1, 9):
        low = rng.integers(0, 30, 3)
        high = low + rng.integers(9, 30, 3)
        labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = label
    visible = np.ones(9, bool)
    visible[[0, 5]] = False
    direction = np.eye(3)[seed] * (-1) ** seed if seed < 3 else rng.normal(size=3)
    plain = sweep_blockers(labels, (1, 1, 1), direction, visible)
    found = sweep_blockers(labels, (1, 1, 1), direction, visible, Bricks.of(labels))
    assert plain[1].any()
    np.testing.assert_array_equal(found[1], plain[1])
    some = np.arange(9) % 2 == 0
    part = sweep_blockers(labels, (1, 1, 1), direction, visible, moved=some)
    np.testing.assert_array_equal(part[1], plain[1] & some[plain[0]])


def test_steps_of_two_surfaces_do_not_hold_what_slides_along_them():
    # Two halves of a block, cut along a plane in which D lies: each is free.
    _, y, x = np.indices((6, 20, 20))
    labels = np.where(y > x, 1, 2).astype(np.uint16)
    visible = np.array([False, True, True])
    _, blocks = sweep_blockers(labels, (1, 1, 1), (0, 1, 1), visible)
    assert not blocks.any()
    _, blocks = sweep_blockers(labels, (1, 1, 1), (0, 1, 0), visible)
    assert blocks.tolist() == [[False, True], [False, False]]


def test_spacing_bends_the_way_in_voxels():
    labels = np.zeros((9, 9, 1), np.uint16)
    labels[0, 0], labels[4, 8] = 1, 2
    visible = np.array([False, True, True])
    assert sweep_blockers(labels, (2, 1, 1), (1, 1, 0), visible)[1][1, 0]
    assert not sweep_blockers(labels, (1, 1, 1), (1, 1, 0), visible)[1].any()


def test_shifts_go_out_of_the_volume_a_voxel_at_a_time():
    shifts = whole_shifts(np.array([0.0, -2.0, 1.0]), (4, 6, 8))
    assert (np.abs(np.diff(shifts, axis=0, prepend=np.zeros((1, 3), int))) <= 1).all()
    assert len(np.unique(shifts, axis=0)) == len(shifts)
    assert abs(shifts[-1, 1]) >= 6


def test_above_4096_objects_there_is_no_table():
    assert (
        sweep_blockers(np.zeros((2, 2, 2), np.uint16), (1, 1, 1), (1, 0, 0), np.ones(5000, bool))
        is None
    )


@pytest.mark.parametrize("seed", range(6))
def test_one_object_moved_alone_meets_whom_it_meets_among_all(seed):
    labels, visible, direction = crumbs(seed, 5, 3)
    ids, blocks = brute(labels, direction, visible)
    pulling = SweepTest.of(labels, (1, 1, 1), direction, visible, Bricks.of(labels))
    for column, label in enumerate(ids):
        where = np.argwhere(labels == label)
        box = tuple(
            slice(a, b + 1) for a, b in zip(where.min(axis=0), where.max(axis=0), strict=True)
        )
        wanted = {int(i) for i in ids[blocks[:, column]]}
        assert pulling.blockers(int(label), box, 9) == wanted
        # Where one is enough, one is found if there is any, and no object who is not met.
        some = pulling.blockers(int(label), box, 0)
        assert some <= wanted
        assert bool(some) == bool(wanted)
