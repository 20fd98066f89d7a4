"""Questions wait until nothing moves, however slow the images are, and are asked once."""

from __future__ import annotations

import pytest

from manual_scheduler import ManualScheduler
from napari_unpack.session import Session
from napari_unpack.tasks import Task
from napari_unpack.viewer.background_queries import OCCLUSION, BackgroundQueries
from napari_unpack.viewer.modal_queries import find_unpackable
from napari_unpack.viewer.scheduler import IdlePhase, Worker


@pytest.fixture
def asking(session: Session):
    """Return (queries, scheduler, what was known of the unpackable objects so far)."""
    scheduler, known = ManualScheduler(), []
    queries = BackgroundQueries(session, scheduler, lambda: True, known.append)
    return queries, scheduler, known


def asked(scheduler: ManualScheduler, slot: str) -> int:
    return scheduler.workers.asked.count(slot)


def test_nothing_is_asked_while_the_image_of_a_turn_is_on_its_way(asking) -> None:
    queries, scheduler, _ = asking
    scheduler.hold_idle("preview", lambda: scheduler.has("packed", Worker.PREVIEW))
    scheduler.submit(Task("packed", lambda _: None), Worker.PREVIEW, lambda _: None)
    queries.moved()
    scheduler.advance(2000)
    assert scheduler.workers.asked == ["packed"]
    assert queries.pending
    scheduler.finish_tasks()
    scheduler.advance(IdlePhase.QUERIES.value)
    assert {OCCLUSION, "hues"} <= set(scheduler.workers.asked)


def test_no_question_is_computed_twice_and_its_answer_reaches_the_panel(asking, session) -> None:
    queries, scheduler, known = asking
    session.events.states.connect(queries.moved)
    session.events.queue.connect(queries.queue_changed)
    for _ in range(3):
        queries.moved()
        scheduler.advance(100)
    scheduler.advance(1000)
    scheduler.finish_tasks()
    scheduler.advance(5000)
    scheduler.finish_tasks()
    assert asked(scheduler, OCCLUSION) == 1
    assert known[-1] == frozenset(session.queries.unpackable_groups()[0]) | known[-1]
    assert known[-1]
    everything = session.queries.packed
    # With one object gone it is known still, and told before anything is computed; but asked once
    # more, for what its voxels may have held by a corner.
    (gone,) = session.unpack(1)
    for object_id in list(session.flights):
        session.land(object_id)
    scheduler.advance(1000)
    told = known[-1]
    assert told == {i for group in session.queries.unpackable_groups() for i in group}
    scheduler.finish_tasks()
    for _ in range(3):
        queries.moved()
        scheduler.advance(5000)
        scheduler.finish_tasks()
    # There and back: both are known.
    session.restore(1)
    for object_id in list(session.flights):
        session.land(object_id)
    scheduler.advance(5000)
    scheduler.finish_tasks()
    session.unpack([gone])
    for object_id in list(session.flights):
        session.land(object_id)
    scheduler.advance(5000)
    scheduler.finish_tasks()
    assert known[-1] == {i for group in session.queries.unpackable_groups() for i in group}
    questions = [key for slot, key in scheduler.workers.ran if slot == OCCLUSION]
    assert [key.packed for key in questions] == [everything, everything - {gone}]
    assert len({(key.revision, key.direction, key.rule, key.tolerance) for key in questions}) == 1


def test_a_command_waits_for_the_question_that_runs_and_asks_no_second_one(asking, session) -> None:
    queries, scheduler, known = asking
    queries.moved()
    scheduler.advance(1000)
    scheduler.workers.start(Worker.QUERY, OCCLUSION)
    find_unpackable(session, scheduler, None, lambda _: None)
    scheduler.finish_tasks()
    assert asked(scheduler, OCCLUSION) == 1
    assert known[-1]


def test_another_direction_says_nothing_of_the_last_answer(asking, session) -> None:
    queries, scheduler, known = asking
    session.events.queue.connect(queries.queue_changed)
    queries.moved()
    scheduler.advance(1000)
    scheduler.finish_tasks()
    session.direction = "+x"
    assert known[-1] is None
    scheduler.advance(1000)
    scheduler.finish_tasks()
    assert known[-1] == {i for group in session.queries.unpackable_groups() for i in group}
    assert asked(scheduler, OCCLUSION) == 2


def test_hues_of_a_view_come_also_after_the_camera_went_and_came_back(asking, session) -> None:
    queries, scheduler, _ = asking
    before, here = session.hues, session.camera
    queries.moved()
    scheduler.advance(1000)
    scheduler.workers.start(Worker.BACKGROUND, "hues")
    # There and back while they are worked out: they are kept, but not shown in the movement.
    queries.moved()
    scheduler.workers.finish(Worker.BACKGROUND)
    assert session.hues == before
    assert session.camera is here
    scheduler.finish_tasks()
    scheduler.advance(1000)
    scheduler.finish_tasks()
    assert session.hues == session.queries.hues()
    assert session.hues != before
