import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from napari_unpack.simulation import contacts, removable


def plane(*rows):
    return np.array([rows], np.uint16)


def test_what_lies_in_a_cup_leaves_upwards_only():
    # 2 lies in the cup 1; 3 stands beside the cup.
    labels = plane([0, 0, 0, 0, 0], [1, 2, 1, 0, 3], [1, 1, 1, 0, 3])
    assert removable(labels, 1, -1) == {2, 3}
    assert removable(labels, 1, 1) == {1, 3}
    assert removable(labels, 2, -1) == set()
    assert removable(labels, 2, 1) == {3}
    assert removable(labels, 0, 1) == {1, 2, 3}


def test_a_thing_behind_two_others_is_barred_by_either():
    labels = plane([4, 0, 5, 5, 6])
    assert removable(labels, 2, 1) == {6}
    assert removable(labels, 2, -1) == {4}


def test_two_interlocked_things_hold_each_other():
    labels = plane([1, 1, 0], [2, 1, 2], [2, 2, 2])
    assert removable(labels, 1, -1) == {1}
    assert removable(labels, 2, 1) == set()
    assert removable(labels, 2, -1) == set()


def test_an_empty_volume_has_nothing_to_remove():
    assert removable(np.zeros((2, 2, 2), np.uint16), 0, 1) == set()
    assert contacts(np.zeros((2, 2, 2), np.uint16)) == {}


@settings(max_examples=40, deadline=None)
@given(arrays(np.uint16, (3, 4, 3), elements=st.integers(0, 4)), st.integers(0, 2), st.booleans())
def test_the_sweep_agrees_with_moving_every_object_step_by_step(labels, axis, forward):
    sign = 1 if forward else -1
    free = set()
    for label in set(np.unique(labels).tolist()) - {0}:
        others = (labels != label) & (labels != 0)
        cells = np.argwhere(labels == label)
        clear = True
        for step in range(1, labels.shape[axis]):
            moved = cells.copy()
            moved[:, axis] += sign * step
            inside = (moved[:, axis] >= 0) & (moved[:, axis] < labels.shape[axis])
            clear &= not others[tuple(moved[inside].T)].any()
        if clear:
            free.add(label)
    assert removable(labels, axis, sign) == free


def test_contacts_count_the_faces_between_things():
    labels = plane([1, 1, 2], [3, 0, 2])
    assert contacts(labels) == {(1, 2): 1, (1, 3): 1}
    assert contacts(np.stack([labels[0], labels[0] * 0 + 3])) == {
        (1, 2): 1,
        (1, 3): 3,
        (2, 3): 2,
    }


@pytest.mark.parametrize(
    ("labels", "axis", "sign", "named"),
    [
        (np.zeros((2, 2), int), 0, 1, "labels"),
        (np.zeros((2, 2, 2), int), 3, 1, "axis"),
        (np.zeros((2, 2, 2), int), 0, 0, "sign"),
    ],
)
def test_bad_arguments_are_named(labels, axis, sign, named):
    with pytest.raises(ValueError, match=named):
        removable(labels, axis, sign)
