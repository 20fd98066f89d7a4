from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.unpacking import BlockingGraph
from napari_unpack.unpacking.blocking_graph import blocking_graph, leading_groups

IDS = [2, 3, 5, 7, 9]


def table(*pairs: tuple[int, int]) -> np.ndarray:
    blocks = np.zeros((len(IDS), len(IDS)), bool)
    for a, b in pairs:
        blocks[IDS.index(a), IDS.index(b)] = True
    return blocks


def blocking(*pairs: tuple[int, int]) -> BlockingGraph:
    return BlockingGraph(blocking_graph(table(*pairs), IDS))


def test_a_chain_leaves_one_by_one_blockers_first():
    assert blocking((9, 7), (7, 5), (5, 3), (3, 2)).removals(IDS) == [(9,), (7,), (5,), (3,), (2,)]


def test_objects_that_hold_each_other_leave_together():
    # 3 and 5 block each other; 2 stands before both; 7 is behind 5; 9 is alone.
    pairs = [(3, 5), (5, 3), (2, 3), (5, 7)]
    graph = blocking(*pairs)
    assert graph.removals(IDS) == [(2,), (3, 5), (7,), (9,)]
    assert graph.unpackable_groups() == [(2,), (9,)]
    assert graph.among([3, 5, 7, 9]).unpackable_groups() == [(9,), (3, 5)]


def test_reveal_names_everything_that_stands_before_the_target():
    pairs = [(9, 7), (7, 5), (2, 5), (5, 3)]
    assert blocking(*pairs).needed(5) == {9, 7, 2, 5}
    assert blocking(*pairs).needed(9) == {9}
    with pytest.raises(ValueError, match="target must be a packed object"):
        blocking().needed(4)


def test_blockers_are_those_directly_in_front_and_not_among_the_chosen():
    graph = blocking((9, 7), (7, 5), (2, 5))
    assert graph.blockers([5]) == {7, 2}
    assert graph.blockers([5, 7]) == {2, 9}


def test_what_counts_as_unpackable_is_blocked_by_nobody():
    blocks = table((3, 5), (5, 7))
    free = BlockingGraph(blocking_graph(blocks, IDS, [5])).unpackable_groups()
    assert free == [(2,), (3,), (5,), (9,)]


def test_a_table_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"blocks must be \(5, 5\)"):
        blocking_graph(np.zeros((2, 2), bool), IDS)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(IDS), st.sampled_from(IDS)), max_size=12))
def test_departures_take_everyone_once_and_nobody_before_a_blocker(pairs):
    order = blocking(*pairs).removals(IDS)
    assert sorted(i for group in order for i in group) == IDS
    gone: set[int] = set()
    for group in order:
        for a, b in pairs:
            if b in group and a not in group:
                assert a in gone
        gone.update(group)


@given(st.lists(st.tuples(st.sampled_from(IDS), st.sampled_from(IDS)), max_size=9), st.randoms())
@settings(max_examples=200, deadline=None)
def test_asked_one_by_one_the_same_groups_lead_as_in_the_whole_graph(pairs, random) -> None:
    pairs = [(a, b) for a, b in pairs if a != b]
    order = random.sample(IDS, len(IDS))
    most = random.randint(1, 4)

    def blockers(object_id: int, enough: int) -> frozenset[int]:
        found = sorted({a for a, b in pairs if b == object_id})
        return frozenset(found[: enough + 1])

    found = list(leading_groups(order, blockers, most))
    whole = [g for g in blocking(*pairs).unpackable_groups() if len(g) <= most]
    assert found == sorted(whole, key=lambda group: min(order.index(i) for i in group))


def test_the_first_to_leave_is_found_without_asking_about_those_behind() -> None:
    asked = []

    def blockers(object_id: int, enough: int) -> frozenset[int]:
        asked.append(object_id)
        return frozenset({9} if object_id == 2 else ())

    assert next(leading_groups([2, 9, 3, 5, 7], blockers, 1)) == (9,)
    assert asked == [2, 9]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.4))
def test_who_is_free_among_those_left_is_what_a_search_by_hand_finds(seed, density):
    rng = np.random.default_rng(seed)
    ids = np.sort(rng.choice(40, 9, replace=False))
    blocks = rng.random((9, 9)) < density
    whole = BlockingGraph(blocking_graph(blocks, ids))
    left = [int(i) for i in ids if rng.random() < 0.7]
    reach = {(int(a), int(b)) for a in ids for b in ids if a != b and blocks[ids == a, ids == b][0]}
    before = {i: {i} for i in left}
    for _ in left:
        for a, b in reach:
            if a in before and b in before:
                before[b] |= before[a]
    # A group is free where all that must leave before one of it is the group.
    wanted = {
        tuple(sorted(before[i])) for i in left if all(before[j] == before[i] for j in before[i])
    }
    assert whole.among(left).unpackable_groups() == sorted(wanted, key=lambda g: (len(g), g))
    assert whole.among(ids).among(left).unpackable_groups() == whole.among(left).unpackable_groups()
    # Without an order of all, and of those that were asked about.
    asked = {i for i in left if rng.random() < 0.4}
    circles = [group for group in whole.among(left).removals(left) if asked.intersection(group)]
    assert whole.among(left).interlocked(asked) == sorted(circles, key=lambda g: (len(g), g))
