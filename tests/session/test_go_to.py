"""The unpacking gone along forwards and backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bags import hooked, session_of, stack_of_plates

from napari_unpack.io.session_json import given_labels, record_of, session_from
from napari_unpack.rendering.compose import scene_image
from napari_unpack.session import ObjectState
from napari_unpack.tasks import no_progress


def out(session):
    return [i for i, s in session.states.items() if s is ObjectState.UNPACKED]


def test_going_to_a_step_takes_back_and_repeats_departures():
    session = session_of(stack_of_plates())
    assert session.step == 0
    assert session.steps == ()
    assert session.go_to(3) == 3
    assert out(session) == [1, 2, 3]
    assert session.steps == ((1,), (2,), (3,))
    assert session.go_to(1) == 1
    assert out(session) == [1]
    assert session.steps == ((1,), (2,), (3,))
    assert session.go_to(99) == 5
    assert out(session) == [1, 2, 3, 4, 5]
    assert session.go_to(0) == 0
    assert session.steps == ((1,), (2,), (3,), (4,), (5,))
    with pytest.raises(ValueError, match="step must not be negative, got -1"):
        session.go_to(-1)


def test_repeated_departures_end_where_they_did_also_when_moved_by_hand():
    session = session_of(stack_of_plates())
    session.go_to(4)
    session.place(2, replace(session.poses[2], center=np.array([0.0, 30.0, 40.0]), scale=0.5))
    before = session.poses
    session.go_to(0)
    session.go_to(4)
    for i, pose in before.items():
        np.testing.assert_array_equal(session.poses[i].center, pose.center)
        np.testing.assert_array_equal(session.poses[i].rotation, pose.rotation)
        assert session.poses[i].scale == pose.scale


def test_a_group_is_one_step():
    session = session_of(hooked())
    session.go_to(1)
    assert session.steps == ((1, 2),)
    assert session.go_to(99) == 2
    assert session.go_to(1) == 1
    assert out(session) == [1, 2]


def test_a_group_returns_whole_though_one_of_it_is_hidden():
    session = session_of(hooked())
    session.go_to(1)
    session.hide([2])
    assert sorted(session.restore(1)) == [1, 2]
    assert session.step == 0
    assert session.states[2] is ObjectState.HIDDEN
    assert session.states[1] is ObjectState.PACKED


def test_a_session_opens_whose_log_names_an_object_since_deleted():
    session = session_of(stack_of_plates())
    session.unpack(1)
    session.restore(1)
    session.delete([1])
    record = record_of(session)
    again = session_from(record, session.volume, given_labels(session))
    assert again.log[0].ids == (1,)
    assert 1 not in again.ids


def test_scrubbing_is_one_step_of_undo_and_back_at_the_start_all_is_packed_as_before():
    session = session_of(stack_of_plates())
    session.recolor()
    size = (60, 80)
    first = scene_image(session.scene(), session.overview(), size, backend="cpu")
    for step in (1, 3, 5, 2, 4, 1):
        session.go_to(step)
    unpacked = scene_image(session.scene(), session.overview(), size, backend="cpu")
    assert np.abs(unpacked - first).max() > 0.1
    assert session.undo() == "scrub"
    assert session.step == 0
    assert session.steps == ()
    session.redo()
    assert len(session.steps) == 5
    # There and back again it is no step, and all the same known.
    session.go_to(0)
    np.testing.assert_array_equal(
        scene_image(session.scene(), session.overview(), size, backend="cpu"), first
    )
    assert [step.verb for step in session.history.done] == ["recolor"]
    assert len(session.steps) == 5


def test_another_command_forgets_what_was_taken_back_and_the_queue_goes_on():
    session = session_of(stack_of_plates())
    session.go_to(3)
    session.go_to(1)
    session.hide([2])
    assert session.steps == ((1,),)
    session.go_to(3)
    assert session.steps == ((1,), (3,), (4,))
    session.show()
    assert session.restore(1) == (4,)
    assert session.steps == ((1,), (3,))


def test_hidden_objects_that_were_out_are_packed_at_the_start():
    session = session_of(stack_of_plates())
    session.go_to(2)
    session.hide([1])
    session.go_to(0)
    session.show()
    assert set(session.states.values()) == {ObjectState.PACKED}


def test_where_nobody_is_free_scrubbing_stops_and_says_so():
    session = session_of(hooked())
    session.take_least_occluded, session.max_group_size = False, 1
    heard = []
    session.events.message.connect(heard.append)
    assert session.go_to(3) == 0
    assert "Nothing is unpackable" in heard[0]


def test_other_rules_make_the_old_answer_worthless():
    session = session_of(stack_of_plates())
    assert session.unpackable() == (1,)
    assert session.queries.occlusion_task() is None
    session.direction = "+y"
    late = session.queries.occlusion_task()
    session.tolerance = 0.9999
    assert session.queue.ids == ()
    assert session.queries.occlusion_task() is not None
    assert not session.queries.store(late, late.run(no_progress))
    session.direction = None
    session.tolerance = 0.0
    assert session.unpackable() == (1,)
    session.unpack(1)
    session.rule = "first_hit"
    session.undo()
    # The queue of then was filled by another rule.
    assert not session.queue.serves(
        session.unpack_direction, frozenset(session.ids), session.rules.terms
    )
    for name, bad in (("rule", "best"), ("tolerance", 1.5), ("max_group_size", 0)):
        with pytest.raises(ValueError, match=name):
            setattr(session, name, bad)


def test_rays_cast_elsewhere_count_as_a_query_in_the_log():
    session = session_of(stack_of_plates())
    task = session.queries.occlusion_task()
    assert session.queries.store(task, task.run(no_progress))
    session.unpack(1)
    session.unpack(1)
    session.view = replace(session.view, direction=(-1.0, 0.0, 0.0))
    session.unpack(1)
    assert [entry.event for entry in session.log] == ["query run", "queue reuse", "query run"]
    assert session.log[1].seconds == 0
    assert session.log[0].seconds > 0
