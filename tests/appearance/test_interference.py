from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from napari_unpack.appearance import interference


def edges(ids, distance, layers=None):
    graph = interference(ids, distance, layers)
    return {tuple(sorted(pair)) for pair in graph.edges}


def test_the_8_by_8_case_worked_out_by_hand():
    # Object 1 covers rows 1-2, columns 1-2; object 2 rows 1-2, columns 5-6; object 3 rows 5-6,
    # column 4. Nearest pixels: 1 and 2 are (1, 2) and (1, 5), 3 apart; 2 and 3 are (2, 5) and
    # (5, 4), sqrt(9 + 1) = 3.162; 1 and 3 are (2, 2) and (5, 4), sqrt(9 + 4) = 3.606.
    ids = np.zeros((8, 8), np.int32)
    ids[1:3, 1:3] = 1
    ids[1:3, 5:7] = 2
    ids[5:7, 4] = 3
    assert edges(ids, 2.9) == set()
    assert edges(ids, 3) == {(1, 2)}
    assert edges(ids, 3.2) == {(1, 2), (2, 3)}
    assert edges(ids, 3.6) == {(1, 2), (2, 3)}
    assert edges(ids, 3.61) == {(1, 2), (2, 3), (1, 3)}
    # Pixels within 3 of the other object: column 2 of object 1 (two pixels) and column 5 of
    # object 2 (two pixels); the diagonal (1, 2)-(2, 5) is sqrt(10) away.
    assert interference(ids, 3).edges[1, 2]["weight"] == 4


def test_ids_beyond_every_table_are_kept_apart_by_name():
    # Two halves of an image that touch along a line of three pixels on both sides.
    ids = np.zeros((2, 3, 6), np.int64)
    ids[0, :, :3], ids[0, :, 3:] = 7_000_000_000, 70_000
    graph = interference(ids, 1)
    assert list(graph.nodes) == [70_000, 7_000_000_000]
    assert graph.edges[70_000, 7_000_000_000]["weight"] == 6
    assert list(interference(ids[:1, :, :3], 1).nodes) == [7_000_000_000]


def test_touching_is_a_distance_of_one_pixel():
    ids = np.array([[1, 1, 2, 2]])
    assert edges(ids, 0) == set()
    assert edges(ids, 1) == {(1, 2)}
    assert interference(ids, 1).edges[1, 2]["weight"] == 2


def test_objects_on_one_pixel_in_two_layers_interfere_at_distance_zero():
    front = np.zeros((6, 6), np.int32)
    back = np.zeros((6, 6), np.int32)
    front[:, :] = 4
    back[2:4, 2:4] = 9
    ids = np.stack([front, back])
    assert edges(ids, 0) == {(4, 9)}
    assert edges(ids, 0, layers=1) == set()
    # Two full layers have no border at all and interfere all the same.
    assert interference(np.stack([front, front + 1]), 0).edges[4, 5]["weight"] == 1


def test_every_object_in_view_is_a_node_in_order_of_ids_and_the_background_is_none():
    graph = interference(np.array([[7, 0, 0, 0, 0, 0, 0, 0, 3]]), 2)
    assert list(graph.nodes) == [3, 7]
    assert graph.number_of_edges() == 0
    assert interference(np.zeros((2, 4, 4), int)).number_of_nodes() == 0
    assert interference(np.zeros((2, 0, 4), int)).number_of_nodes() == 0


@settings(max_examples=80, deadline=None)
@given(
    arrays(np.int32, st.tuples(st.integers(1, 2), st.integers(1, 9), st.integers(1, 9)),
           elements=st.integers(0, 4)),
    st.sampled_from([0, 1, 1.5, 2, 2.3, 3, 4.5]),
)  # fmt: skip
def test_it_agrees_with_the_distance_of_every_pair_of_pixels(ids, distance):
    present = [int(i) for i in np.unique(ids) if i]
    expected = set()
    for a in present:
        for b in present:
            if a < b:
                first, second = np.argwhere(ids == a)[:, 1:], np.argwhere(ids == b)[:, 1:]
                squares = ((first[:, None] - second[None]) ** 2).sum(axis=-1)
                if squares.min() <= distance**2:
                    expected.add((a, b))
    assert edges(ids, distance) == expected


@settings(max_examples=60, deadline=None)
@given(
    arrays(np.int32, st.tuples(st.integers(1, 2), st.integers(1, 7), st.integers(1, 7)),
           elements=st.integers(0, 3)),
    st.sampled_from([0, 1, 1.5, 3]),
)  # fmt: skip
def test_the_contact_length_counts_border_pixels_near_the_other_object(ids, distance):
    padded = np.pad(ids, ((0, 0), (1, 1), (1, 1)), mode="edge")
    inner = padded[:, 1:-1, 1:-1]
    border = np.zeros(ids.shape, bool)
    for moved in (
        padded[:, :-2, 1:-1],
        padded[:, 2:, 1:-1],
        padded[:, 1:-1, :-2],
        padded[:, 1:-1, 2:],
    ):
        border |= moved != inner
    for a, b, weight in interference(ids, distance).edges(data="weight"):
        expected = 0
        for one, other in ((a, b), (b, a)):
            targets = np.argwhere(ids == other)[:, 1:]
            for place in np.argwhere(border & (ids == one))[:, 1:]:
                expected += ((targets - place) ** 2).sum(axis=1).min() <= distance**2
        assert weight == max(expected, 1)


def test_bands_of_rows_do_not_count_a_pixel_twice_or_lose_one():
    # Two columns of 100 pixels each, side by side: every one of the 200 sees the other.
    ids = np.zeros((100, 4), np.int32)
    ids[:, 1], ids[:, 2] = 1, 2
    assert interference(ids, 1).edges[1, 2]["weight"] == 200


def test_many_ids_grow_the_table_of_pairs():
    # 3,000 single pixels in a row: each interferes with its one or two neighbours.
    graph = interference(np.arange(1, 3001).reshape(1, -1), 1)
    assert graph.number_of_edges() == 2999
    assert all(weight == 2 for _, _, weight in graph.edges(data="weight"))


@pytest.mark.parametrize(
    ("ids", "settings", "error"),
    [
        (np.zeros((2, 2)), {}, TypeError),
        (np.zeros(4, int), {}, ValueError),
        (np.array([[-1]]), {}, ValueError),
        (np.array([[1]]), {"distance": -1}, ValueError),
        (np.array([[1]]), {"distance": float("nan")}, ValueError),
        (np.array([[1]]), {"layers": 0}, ValueError),
    ],
)
def test_bad_input_is_refused(ids, settings, error):
    with pytest.raises(error, match=r"ids|distance|layers"):
        interference(ids, **settings)
