"""A session that looks along 26 directions: the best way out, and reveal along any of them."""

from __future__ import annotations

import numpy as np
import pytest
from bags import AxisRays, hooked, session_of, stack_of_plates

from napari_unpack.session import ObjectState, Session
from napari_unpack.tasks import no_progress


def boxed_in() -> np.ndarray:
    """A core (1) between plates: one (2) towards -y, two towards every other side."""
    labels = np.zeros((15, 15, 15), np.uint16)
    labels[6:9, 6:9, 6:9] = 1
    labels[6:9, 5, 6:9] = 2
    for k, (axis, first, second) in enumerate(
        [(1, 9, 11), (0, 5, 3), (0, 9, 11), (2, 5, 3), (2, 9, 11)]
    ):
        for j, place in enumerate((first, second)):
            part = [slice(6, 9)] * 3
            part[axis] = slice(place, place + 1)
            labels[tuple(part)] = 3 + 2 * k + j
    return labels


def real_session(labels: np.ndarray) -> Session:
    volume = np.where(labels > 0, 1000.0, 0.0).astype(np.float32)
    session = Session(volume, labels)
    session.backend = "cpu"
    return session


def test_the_least_that_frees_the_core_is_the_lid():
    session = real_session(boxed_in())
    found = session.reveal_plan(1)
    assert found.ids == {1, 2}
    np.testing.assert_allclose(found.direction, (0, -1, 0))
    session.direction = "+z"
    assert len(session.queries.occlusion().blocking.needed(1)) == 3
    assert session.reveal(1, "any") == (2, 1)
    assert session.direction == (1.0, 0.0, 0.0)
    assert session.states[1] is ObjectState.UNPACKED
    out = session.state.placements
    np.testing.assert_allclose(out[1].direction, (0, -1, 0))
    session.undo()
    assert set(session.states.values()) == {ObjectState.PACKED}


def test_a_survey_serves_while_objects_leave_and_not_when_one_comes_back():
    session = real_session(boxed_in())
    session.hide(2)
    queries = session.queries
    task = queries.survey_task()
    survey = task.run(no_progress)
    assert len(survey.directions) == 26
    assert queries.store(task, survey)
    assert queries.survey_task() is None
    session.direction = "+x"
    session.unpack([12])
    assert queries.survey_task() is None
    session.restore()
    assert queries.survey_task() is None
    assert session.best_direction() is not None
    session.show(2)
    assert queries.survey_task() is not None
    assert session.best_direction() is None
    assert not queries.store(task, survey)
    assert session.best_direction(ask=True) is not None


def test_with_a_tolerance_a_survey_of_the_fuller_bag_does_not_serve():
    # Whom a tolerance exempts depends on all that is packed: 3 hides a sliver of 1 above.
    labels = np.zeros((14, 8, 12), np.uint16)
    labels[6:9, 1:7, 1:9] = 1
    labels[1, 1:4, 1:9], labels[3, 1, 1], labels[11] = 2, 3, 4
    labels[6:9, 0], labels[6:9, 7], labels[:, :, 0], labels[:, :, 11] = 5, 6, 7, 8
    session = real_session(labels)
    session.tolerance, session.direction = 0.05, "+z"
    assert session.reveal_plan(1).ids == {1, 4}
    session.hide(2)
    assert session.best_direction() is None
    assert session.reveal_plan(1).ids == {1}


def test_half_the_compass_is_cast_and_opposites_are_the_same_turned_round():
    labels = stack_of_plates()
    session = session_of(labels)
    rays: AxisRays = session.ray_queries
    survey = session.queries.survey()
    assert rays.asked == 13
    by_way = {tuple(np.round(o.direction, 3)): o for o in survey.directions}
    assert by_way[(1.0, 0.0, 0.0)].unpackable_groups() == [(5,)]
    assert by_way[(-1.0, 0.0, 0.0)].unpackable_groups() == [(1,)]
    assert len(by_way[(0.0, 1.0, 0.0)].unpackable_groups()) == 5
    session.tolerance = 0.001
    session.queries.survey()
    assert rays.asked == 13 + 26


def test_the_best_way_out_of_plates_is_sideways_and_along_hooks_too():
    session = session_of(stack_of_plates())
    assert session.best_direction(ask=True).ids == {1, 2, 3, 4, 5}
    held = session_of(hooked())
    held.direction = "-z"
    assert held.reveal(3) == (1, 2, 3)
    held.undo()
    assert len(held.reveal(3, "any")) == 1


def test_reveal_says_what_is_wrong():
    session = session_of(stack_of_plates())
    session.unpack(1)
    with pytest.raises(ValueError, match="Object 1 is not in the bag"):
        session.reveal_plan(1)
    with pytest.raises(ValueError, match="direction must be one of"):
        session.reveal(3, "sideways")
    session.hide(3)
    with pytest.raises(ValueError, match="Object 3 is hidden: show it first"):
        session.reveal(3)


@pytest.mark.parametrize(
    ("named", "along"), [("view", (-1, 0, 0)), ("up", (0, -1, 0)), ("+x", (0, 0, 1))]
)
def test_reveal_takes_every_direction_that_has_a_name(named, along):
    session = session_of(stack_of_plates())
    session.direction = "+z"
    # Only the viewer stands where others are in the way.
    assert session.reveal(3, named) == ((1, 2, 3) if named == "view" else (3,))
    left_along = session.state.placements[3].direction
    np.testing.assert_allclose(left_along, along, atol=1e-3)
    assert session.direction == (1, 0, 0)


def test_where_the_voxels_want_more_than_was_proposed_the_next_best_is_looked_along() -> None:
    # A survey of rays takes the way past the wall's foot for free along a diagonal; it is not.
    labels = np.zeros((3, 3, 7), np.uint8)
    labels[2, 2, 4], labels[:, 2, 3] = 1, 2
    session = Session(labels * np.float32(100), labels)
    assert session.reveal_plan(1).ids == {1}


def test_reveal_is_answered_once_few_enough_are_packed_whatever_was_asked_before() -> None:
    grid = np.arange(0, 34, 2)
    labels = np.zeros((34, 34, 34), np.uint16)
    labels[np.ix_(grid, grid, grid)] = np.arange(1, 17**3 + 1).reshape(17, 17, 17)
    session = real_session(labels)
    session.direction = "+z"
    session.unpackable()
    assert session.best_direction(ask=True) is None
    session.hide(range(1, 1900))
    # 2000 stands at (6, 15, 10): ten more stand behind it along z.
    column = labels[12::2, 30, 20]
    assert session.best_direction(ask=True) is not None
    assert session.reveal(2000) == tuple(int(i) for i in column[::-1])
