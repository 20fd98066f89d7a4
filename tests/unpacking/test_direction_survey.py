"""The best of 26 directions, and the least that must leave before a buried object."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.unpacking.direction_survey import (
    DIRECTIONS_26,
    DirectionalBlocking,
    best_direction,
    reveal_plans,
)

UP, DOWN, SIDE = np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), np.array([0, 1.0, 0])


def blocking(direction, ids, *pairs):
    table = np.zeros((len(ids), len(ids)), bool)
    for front, behind in pairs:
        table[ids.index(front), ids.index(behind)] = True
    return DirectionalBlocking(np.asarray(direction), np.array(ids), table)


def test_the_compass_holds_26_directions_with_their_opposites():
    assert DIRECTIONS_26.shape == (26, 3)
    assert len({tuple(np.sign(d).astype(int)) for d in DIRECTIONS_26}) == 26
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS_26, axis=1), 1)
    np.testing.assert_array_equal(DIRECTIONS_26, -DIRECTIONS_26[::-1])


def test_what_hangs_together_is_one_group_and_what_it_blocks_is_not_free():
    one = blocking(UP, [2, 3, 5, 8], (2, 3), (3, 2), (3, 5))
    assert sorted(one.unpackable_groups()) == [(2, 3), (8,)]
    assert sorted(one.among({3, 5, 8}).unpackable_groups()) == [(3,), (8,)]
    assert sorted(one.opposite().unpackable_groups()) == [(5,), (8,)]


def test_the_best_way_frees_most_and_ties_go_to_the_nearest():
    ids = [1, 2, 3]
    blockings = [
        blocking(UP, ids, (1, 2), (2, 3)),
        blocking(SIDE, ids, (1, 2)),
        blocking(DOWN, ids, (3, 2)),
    ]
    assert best_direction(blockings, ids, 4, UP).ids == {1, 3}
    assert best_direction(blockings, ids, 4, -SIDE).direction @ DOWN == 1
    assert best_direction(blockings, ids, 4, SIDE).direction @ SIDE == 1
    assert best_direction(blockings, {2, 3}, 4, DOWN).ids == {2, 3}


def test_nobody_is_free_where_all_hang_together_and_groups_are_to_be_small():
    blockings = [blocking(UP, [1, 2, 3], (1, 2), (2, 3), (3, 1))]
    assert best_direction(blockings, [1, 2, 3], 2, UP) is None
    assert best_direction(blockings, [1, 2, 3], 3, UP).groups == ((1, 2, 3),)


def test_the_least_unearthing_names_direction_and_objects():
    ids = [1, 2, 3, 4]
    blockings = [blocking(UP, ids, (1, 2), (2, 4), (1, 3)), blocking(SIDE, ids, (3, 4))]
    found = reveal_plans(blockings, ids, 4, UP)[0]
    assert found.ids == {3, 4}
    assert found.first == {3}
    assert found.direction @ SIDE == 1
    # With 1 and 2 gone, both ways want one object more or none: up is free.
    assert reveal_plans(blockings, {3, 4}, 4, UP)[0].ids == {4}
    with pytest.raises(ValueError, match="packed"):
        reveal_plans(blockings, {3}, 4, UP)


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 6), st.data())
def test_needed_is_the_smallest_set_that_nobody_outside_blocks(count, data):
    ids = list(range(1, count + 1))
    pairs = [(a, b) for a in ids for b in ids if a != b]
    chosen = data.draw(st.lists(st.sampled_from(pairs), max_size=10))
    target = data.draw(st.sampled_from(ids))
    found = blocking(UP, ids, *chosen).needed(target)

    def closed(group):
        return not any(b in group and a not in group for a, b in chosen)

    sizes = [
        set(some)
        for n in range(1, count + 1)
        for some in combinations(ids, n)
        if target in some and closed(set(some))
    ]
    assert found == min(sizes, key=len)
    assert sum(len(s) == len(found) for s in sizes) == 1


def test_objects_no_ray_met_block_nobody_and_the_tolerance_frees():
    counts = np.zeros((5, 8), np.int64)
    counts[0, [2, 7]] = counts[1, [2, 7]] = 100
    counts[4, 7] = 1
    blocks = np.array([[False, True], [False, False]])
    met = OcclusionCounts(np.array([2, 7]), *counts, blocks=blocks)
    strict = DirectionalBlocking.of(UP, met, {2, 5, 7}, 0.0)
    assert sorted(strict.unpackable_groups()) == [(2,), (5,)]
    assert strict.needed(7) == {2, 7}
    assert sorted(DirectionalBlocking.of(UP, met, {2, 5, 7}, 0.02).unpackable_groups()) == [
        (2,),
        (5,),
        (7,),
    ]
