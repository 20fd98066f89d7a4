from __future__ import annotations

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.appearance import arc_hues, assign_hues, color_classes, hue_distance


def graph_of(edges, nodes=()):
    graph = nx.Graph()
    graph.add_nodes_from(nodes)
    graph.add_edges_from(edges)
    return graph


def least_distance(graph, hues):
    return min((hue_distance(hues[a], hues[b]) for a, b in graph.edges), default=0.5)


def test_classes_are_taken_by_decreasing_degree_with_ties_by_id():
    # Degrees: 2 and 5 have three neighbours, 1 and 3 two, 4 and 6 one.
    graph = graph_of([(5, 6), (5, 1), (5, 3), (2, 1), (2, 3), (2, 4)])
    # 2 gets class 0, 5 too (not joined to 2), 1 and 3 see both: class 1; 4 and 6 as well.
    assert color_classes(graph) == [[2, 5], [1, 3, 4, 6]]


def test_the_colouring_does_not_depend_on_the_order_of_insertion():
    edges = [(1, 2), (2, 3), (3, 1), (3, 4), (4, 5), (5, 1)]
    assert assign_hues(graph_of(edges)) == assign_hues(graph_of(reversed(edges)))


def test_the_arcs_of_a_worked_example():
    # Three classes: {1, 4}, {2, 5}, {3, 6}, arcs [0, 1/3), [1/3, 2/3), [2/3, 1).
    classes = [[1, 4], [2, 5], [3, 6]]
    graph = graph_of([(1, 2), (1, 3), (2, 3), (4, 2), (4, 5), (5, 6), (6, 4)])
    # Neighbours in the next class: 1 has {2}, 4 has {2, 5}: 4 stands first, furthest from the
    # next arc. 2 has {3}, 5 has {6}: a tie, by ID. 3 has {1} and 6 has {4}: again by ID.
    # Two members of an arc stand at a quarter and three quarters of it.
    assert arc_hues(graph, classes) == pytest.approx(
        {4: 1 / 12, 1: 3 / 12, 2: 5 / 12, 5: 7 / 12, 3: 9 / 12, 6: 11 / 12}
    )


def test_a_margin_keeps_the_ends_of_every_arc_empty():
    graph = graph_of([(1, 2), (2, 3), (3, 1)])
    hues = arc_hues(graph, [[1], [2], [3]], margin=0.4)
    assert hues == pytest.approx({1: 1 / 6, 2: 3 / 6, 3: 5 / 6})
    pairs = arc_hues(graph_of([(1, 3)], nodes=range(1, 6)), [[1, 2], [3, 4], [5]], margin=0.5)
    # Arc 0 uses [1/12, 3/12]: its members stand a quarter and three quarters into that.
    assert pairs[1] == pytest.approx(1 / 12 + 1 / 24)
    assert pairs[2] == pytest.approx(1 / 12 + 3 / 24)


def test_one_class_spreads_over_the_whole_circle_by_id():
    assert assign_hues(graph_of([], nodes=[5, 2, 9, 7])) == pytest.approx(
        {2: 1 / 8, 5: 3 / 8, 7: 5 / 8, 9: 7 / 8}
    )


def test_of_two_classes_the_most_interfering_stand_in_the_middle_of_their_arcs():
    # Class {1, 2, 3} on [0, 1/2) with places 1/12, 3/12, 5/12; 3 has two neighbours.
    graph = graph_of([(3, 4), (3, 5), (1, 4), (2, 5)])
    hues = arc_hues(graph, [[1, 2, 3], [4, 5]])
    assert hues[3] == pytest.approx(3 / 12)
    assert {round(hues[1] * 12), round(hues[2] * 12)} == {1, 5}


def test_no_graph_no_hues():
    assert assign_hues(nx.Graph()) == {}


def test_hues_that_still_separate_stay_exactly():
    graph = graph_of([(1, 2), (2, 3), (3, 1)])
    before = {1: 0.02, 2: 0.41, 3: 0.77, 99: 0.5}
    assert assign_hues(graph, before) == {1: 0.02, 2: 0.41, 3: 0.77}


def test_only_one_of_two_too_alike_moves_and_no_further_than_it_must():
    # Two classes: neighbours must be 0.25 apart. 1 and 2 are 0.05 apart; 1 has only this
    # neighbour, 2 another one, so 1 moves, to the nearer side: 0.10 + 0.05 - 0.25 = 0.90.
    graph = graph_of([(1, 2), (2, 3)])
    hues = assign_hues(graph, {1: 0.10, 2: 0.15, 3: 0.65})
    assert hues == pytest.approx({1: 0.90, 2: 0.15, 3: 0.65})


def test_a_locked_hue_stays_and_its_neighbour_gives_way():
    graph = graph_of([(1, 2), (2, 3)])
    hues = assign_hues(graph, {1: 0.10, 2: 0.15, 3: 0.65}, locked=[1])
    assert hues[1] == 0.10
    assert least_distance(graph, hues) >= 0.25 - 1e-9


def test_a_newcomer_takes_a_free_hue_and_moves_nobody():
    graph = graph_of([(1, 2), (2, 3), (3, 1)])
    hues = assign_hues(graph, {1: 0.0, 2: 0.5})
    assert (hues[1], hues[2]) == (0.0, 0.5)
    assert least_distance(graph, hues) >= 1 / 6 - 1e-9


def test_a_bad_margin_is_refused():
    with pytest.raises(ValueError, match=r"margin must be in \[0, 1\)"):
        assign_hues(nx.Graph(), margin=1.0)


@pytest.mark.parametrize("hue", [float("nan"), float("inf"), None, "red"])
def test_a_previous_hue_that_is_none_is_refused(hue):
    with pytest.raises(ValueError, match=r"previous must hold finite hues, got .* for object 1"):
        assign_hues(graph_of([(1, 2)]), {1: hue})


@pytest.mark.parametrize("separation", [float("nan"), -0.1, 0.6, "wide"])
def test_a_bad_separation_is_refused(separation):
    with pytest.raises((TypeError, ValueError), match="separation must be"):
        assign_hues(graph_of([(1, 2)]), {1: 0.1}, separation=separation)


@pytest.mark.parametrize("margin", [None, "wide", float("nan")])
def test_a_margin_that_is_no_number_is_refused(margin):
    with pytest.raises((TypeError, ValueError), match="margin must be"):
        assign_hues(nx.Graph(), margin=margin)


graphs = st.builds(
    lambda n, pairs: graph_of([(a % n, b % n) for a, b in pairs if a % n != b % n], range(n)),
    st.integers(1, 14),
    st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99)), max_size=40),
)


@settings(max_examples=150, deadline=None)
@given(graphs)
def test_neighbours_of_a_fresh_assignment_with_a_margin_are_apart(graph):
    classes = len(color_classes(graph))
    hues = assign_hues(graph, margin=0.5)
    assert set(hues) == set(graph)
    assert all(0 <= hue < 1 for hue in hues.values())
    assert least_distance(graph, hues) >= 0.5 / classes - 1e-9


@settings(max_examples=150, deadline=None)
@given(graphs, st.dictionaries(st.integers(0, 13), st.floats(-1.5, 2), max_size=14))
def test_whatever_the_hues_before_neighbours_are_apart_after(graph, previous):
    classes = len(color_classes(graph))
    hues = assign_hues(graph, previous, margin=0.5)
    assert set(hues) == set(graph)
    assert all(0 <= hue < 1 for hue in hues.values())
    assert least_distance(graph, hues) >= 0.5 / classes - 1e-9


def test_a_slowly_changing_graph_recolours_few():
    # A ring of 40 objects whose neighbourhood changes by one edge a step.
    order = list(range(40))
    hues = None
    moved = fresh = 0
    last = None
    for step in range(30):
        graph = graph_of([(order[k], order[(k + d) % 40]) for k in range(40) for d in (1, 2, 3)])
        after = assign_hues(graph, hues, margin=0.5)
        again = assign_hues(graph, margin=0.5)
        if hues is not None:
            moved += sum(after[i] != hues[i] for i in order)
            fresh += sum(again[i] != last[i] for i in order)
        hues, last = after, again
        k = (7 * step) % 39
        order[k], order[k + 1] = order[k + 1], order[k]
    assert moved * 5 <= fresh
