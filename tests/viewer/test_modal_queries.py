"""A command is answered at once, also straight after a turn."""

from __future__ import annotations

from threading import Event, current_thread, main_thread

import pytest
from qtpy.QtWidgets import QApplication

from manual_scheduler import ManualScheduler
from napari_unpack.session import colors, occlusion
from napari_unpack.viewer.modal_queries import find_unpackable, run_to
from napari_unpack.widgets.unpacking_widget import UnpackingWidget


def turn(viewer, session) -> None:
    before = session.unpack_direction
    a, b, c = viewer.scene.camera.angles
    viewer.scene.camera.angles = a + 9, b + 6, c
    while abs(session.unpack_direction - before).max() < 1e-3:
        QApplication.processEvents()


def test_after_a_turn_an_object_leaves_before_the_whole_answer_is_there(
    staged, session, monkeypatch
) -> None:
    viewer, controller = staged
    allowed, whole = Event(), occlusion.find_occlusion

    def found(*arguments):
        assert allowed.wait(20)
        return whole(*arguments)

    monkeypatch.setattr(occlusion, "find_occlusion", found)
    turn(viewer, session)
    assert session.queries.occlusion_task() is not None
    left = controller.unpack(1)
    assert left
    assert set(session.flights) == set(left)
    assert controller.go_to(2, flying=True) == 2
    allowed.set()
    controller.finish()
    assert controller.settle(60)
    assert session.queries.occlusion_task() is None
    # The whole answer agrees: nobody who is in the bag was in the way.
    session.restore(len(session.steps))
    controller.finish()
    assert set(left) <= set(session.unpackable())


def test_hues_are_sought_beside_the_window(staged, session, monkeypatch) -> None:
    _, controller = staged
    controller.recolor_at_rest = False
    sought, threads = colors.chosen_hues, []

    def chosen(*arguments):
        threads.append(current_thread())
        return {i: (hue + 0.25) % 1.0 for i, hue in sought(*arguments).items()}

    monkeypatch.setattr(colors, "chosen_hues", chosen)
    session.hide(1)
    before = dict(session.hues)
    controller.recolor()
    assert len(threads) == 1
    assert threads[0] is not main_thread()
    assert session.hues[2] != before[2]
    session.undo()
    assert dict(session.hues) == before


def test_a_repair_that_ends_while_hues_are_sought_takes_its_objects_out(
    staged, session, monkeypatch
) -> None:
    _, controller = staged
    controller.recolor_at_rest = False
    sought, merged = colors.chosen_hues, Event()

    def merge() -> None:
        session.merge([2, 3])
        merged.set()

    def chosen(*arguments):
        controller.scheduler.soon(merge)
        assert merged.wait(20)
        return {i: (hue + 0.25) % 1.0 for i, hue in sought(*arguments).items()}

    monkeypatch.setattr(colors, "chosen_hues", chosen)
    session.hide(1)
    before = dict(session.hues)
    controller.recolor()
    assert session.ids == (1, 2, 4, 5, 6, 7)
    assert session.hues[4] != before[4]


def test_while_the_whole_answer_is_waited_for_that_is_said(
    make_napari_viewer_proxy, session, monkeypatch
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    panel = UnpackingWidget(viewer)
    panel.workspace.open(session)
    controller, news = panel.workspace.controller, panel.unpack.sentence
    controller.recolor_at_rest = False
    assert controller.settle(60)
    said, asked, whole = [], [], occlusion.find_occlusion
    controller.events.searching.connect(lambda searching: said.append((searching, news.text())))

    def found(*arguments):
        asked.append(list(said))
        return whole(*arguments)

    monkeypatch.setattr(occlusion, "find_occlusion", found)
    session.rule = "first_hit"
    controller.unpack(1)
    # Coming to rest may ask the same meanwhile.
    assert asked[0] == [(True, "Looking for unpackable objects…")]
    assert [searching for searching, _ in said] == [True, False]
    panel.end()


def test_a_viewer_closed_while_a_command_waits_unpacks_nothing(session, monkeypatch) -> None:
    scheduler = ManualScheduler()

    def close(waiting: bool) -> None:
        if waiting:
            scheduler.close()

    monkeypatch.setattr(type(session), "unpackable", lambda _: pytest.fail("asked at once"))
    assert run_to(session, scheduler, 2, False, close) == 0
    assert session.steps == ()
    assert find_unpackable(session, ManualScheduler(), None, lambda _: None)


def test_a_viewer_closed_while_what_leaves_is_measured_unpacks_nothing(
    staged, session, monkeypatch
) -> None:
    _, controller = staged
    closed, measured = Event(), type(session.bag).oriented
    controller.events.closed.connect(closed.set)

    def close(*arguments):
        controller.scheduler.soon(controller.close)
        assert closed.wait(20)
        return measured(*arguments)

    session.unpackable()
    monkeypatch.setattr(type(session.bag), "oriented", close)
    assert controller.unpack(session.ids) == ()
    assert session.steps == ()


def test_a_timeline_closed_while_what_leaves_is_measured_stays_where_it_is(
    session, monkeypatch
) -> None:
    scheduler, measured = ManualScheduler(), type(session.bag).oriented

    def close(*arguments):
        scheduler.close()
        return measured(*arguments)

    session.unpackable()
    monkeypatch.setattr(type(session.bag), "oriented", close)
    assert run_to(session, scheduler, 2, False, lambda _: None) == 0
    assert session.steps == ()


def test_what_is_in_the_air_flies_on_while_the_timeline_is_drawn(session) -> None:
    session.unpack(1)
    session.animated = True
    flying = session.unpack(1)
    assert set(session.flights) == set(flying)
    for step in (2, 3, 2):
        assert run_to(session, ManualScheduler(), step, False, lambda _: None) == step
        assert set(session.flights) == set(flying)
    assert session.animated
