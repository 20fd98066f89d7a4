"""What runs when: newest requests, idle phases, debounces, animation, and long work."""

from __future__ import annotations

import gc
import threading
import weakref

import pytest

from manual_scheduler import ManualScheduler
from napari_unpack.tasks import Cancelled, Task
from napari_unpack.viewer.scheduler import IdlePhase, Scheduler, Worker


@pytest.fixture
def scheduler(qtbot):
    """Return a scheduler with threads."""
    made = Scheduler()
    yield made
    made.close()


@pytest.fixture
def manual() -> ManualScheduler:
    """Return a scheduler moved by hand."""
    return ManualScheduler()


def constant(key: object, value: object = None) -> Task:
    return Task(key, lambda _: value)


def test_a_result_arrives_and_the_work_ran_elsewhere(scheduler, qtbot) -> None:
    found = []
    task = Task("a", lambda _: threading.current_thread())
    scheduler.submit(task, Worker.LONG, lambda x: found.append((x, threading.current_thread())))
    qtbot.waitUntil(lambda: bool(found), timeout=10_000)
    assert found[0][0] is not threading.main_thread()
    assert found[0][1] is threading.main_thread()


def test_the_newest_of_a_slot_replaces_what_waits(manual) -> None:
    found = []
    for k in range(3):
        manual.submit(constant("a", k), Worker.PREVIEW, found.append)
    manual.submit(constant("a", 7), Worker.REFINE, found.append)
    manual.finish_tasks()
    assert sorted(found) == [2, 7]


def test_what_runs_is_finished_and_delivered_before_the_newest(manual) -> None:
    found = []
    manual.submit(constant("a", 1), Worker.PREVIEW, found.append)
    manual.workers.start(Worker.PREVIEW, "a")
    manual.submit(constant("a", 2), Worker.PREVIEW, found.append)
    assert manual.has("a")
    manual.finish_tasks()
    assert found == [1, 2]
    assert not manual.busy


def test_the_same_question_in_a_slot_is_answered_once_for_both(manual) -> None:
    found, ran = [], []
    for key in ("old", "same", "same"):
        task = Task(key, lambda _, key=key: ran.append(key) or key)
        manual.submit(task, Worker.QUERY, found.append, slot="question")
    manual.finish_tasks()
    assert ran == ["same"]
    assert found == ["same", "same"]


def test_a_modal_task_joins_the_one_that_runs(manual) -> None:
    ran, found = [], []
    task = Task("same", lambda _: ran.append(1) or 5)
    manual.submit(task, Worker.QUERY, found.append, slot="question")
    manual.workers.start(Worker.QUERY, "question")
    assert manual.run_modal(task, Worker.QUERY, "question") == 5
    assert (ran, found) == ([1], [5])


def test_a_worker_goes_on_while_results_wait_for_the_main_thread(scheduler, qtbot) -> None:
    second, results = threading.Event(), []
    scheduler.submit(constant("a", 1), Worker.QUERY, results.append)
    scheduler.submit(Task("b", lambda _: second.set() or 2), Worker.QUERY, results.append)
    # No events are handled here: the first result is not delivered yet.
    assert second.wait(10)
    assert results == []
    assert scheduler.has("a")
    qtbot.waitUntil(lambda: results == [1, 2], timeout=10_000)
    assert not scheduler.busy


def test_results_come_in_the_order_in_which_tasks_were_finished(scheduler, qtbot) -> None:
    results: list[int] = []
    for k in range(2000):
        scheduler.submit(constant(k, k), Worker.QUERY, results.append)
    qtbot.waitUntil(lambda: len(results) == 2000, timeout=60_000)
    assert results == list(range(2000))


def test_errors_go_to_the_task_s_own_handler_or_become_a_sentence(manual) -> None:
    told, errors = [], []

    def fall_short(_) -> None:
        raise MemoryError

    inner = manual.scope(told.append)
    inner.submit(Task("a", lambda _: 1 / 0), Worker.LONG, print, failed=errors.append)
    inner.submit(Task("b", lambda _: 1 / 0), Worker.QUERY, print)
    inner.submit(Task("c", fall_short), Worker.QUERY, print)
    manual.finish_tasks()
    assert [type(e) for e in errors] == [ZeroDivisionError]
    assert told == ["division by zero", "MemoryError"]


def test_a_task_that_ends_its_thread_is_told_and_nobody_waits_for_it(scheduler, qtbot) -> None:
    told: list[str] = []
    inner = scheduler.scope(told.append)

    def leave(_) -> None:
        raise SystemExit(3)

    assert inner.run_modal(Task("a", leave), Worker.QUERY) is None
    assert told == ["the work was ended by SystemExit: 3"]
    assert inner.run_modal(constant("b", 2), Worker.QUERY) == 2


def test_a_listener_that_raises_keeps_no_other_from_hearing(manual) -> None:
    found: list[int] = []

    def fall_short(_) -> None:
        raise ValueError("no use for it")

    for done in (found.append, fall_short, found.append):
        manual.submit(constant("same", 5), Worker.QUERY, done, slot="question")
    with pytest.raises(ValueError, match="no use for it"):
        manual.finish_tasks()
    assert found == [5, 5]
    assert not manual.busy


def test_progress_is_heard_on_the_main_thread_and_the_last_report_always(scheduler, qtbot) -> None:
    heard, done = [], []

    def work(progress) -> int:
        for k in range(1001):
            progress(k / 1000, "counting")
        return 1

    scheduler.submit(
        Task("count", work),
        Worker.LONG,
        done.append,
        lambda fraction, text: heard.append((fraction, text, threading.current_thread())),
    )
    qtbot.waitUntil(lambda: bool(done), timeout=10_000)
    assert {thread for *_, thread in heard} == {threading.main_thread()}
    assert heard[-1][:2] == (1.0, "counting")
    assert len(heard) < 100


def test_cancelling_stops_what_runs_at_its_next_report_and_what_waits(scheduler, qtbot) -> None:
    started, errors = threading.Event(), []

    def work(progress) -> None:
        while True:
            progress(0.5, "for ever")
            started.set()

    for _ in range(2):
        scheduler.submit(Task("a", work), Worker.LONG, print, failed=errors.append)
        assert started.wait(10)
    scheduler.cancel("a")
    qtbot.waitUntil(lambda: not scheduler.busy, timeout=10_000)
    assert [type(e) for e in errors] == [Cancelled, Cancelled]


def test_a_finished_task_keeps_nothing_of_what_it_worked_on(scheduler, qtbot) -> None:
    class Heavy:
        pass

    heavy, done = Heavy(), []
    kept = weakref.ref(heavy)
    scheduler.submit(Task("a", lambda _, heavy=heavy: 1), Worker.LONG, done.append)
    del heavy
    qtbot.waitUntil(lambda: bool(done), timeout=10_000)

    def gone() -> bool:
        gc.collect()
        return kept() is None

    qtbot.waitUntil(gone, timeout=10_000)


def test_a_closed_scope_gets_nothing_and_the_others_go_on(manual) -> None:
    found = []
    inner, other = manual.scope(), manual.scope()
    for scope in (inner, other):
        scope.submit(constant("a", scope), Worker.QUERY, found.append)
        scope.debounce(10, lambda scope=scope: found.append(scope))
        scope.soon(lambda scope=scope: found.append(scope))
    inner.close()
    manual.advance(100)
    manual.finish_tasks()
    assert found == [other] * 3


def test_a_task_that_runs_on_for_a_closed_scope_holds_nothing_up(scheduler, qtbot) -> None:
    found, ran, began, end = [], [], threading.Event(), threading.Event()
    before, after = scheduler.scope(), scheduler.scope()
    before.submit(Task("a", lambda _: (began.set(), end.wait(20))), Worker.QUERY, found.append)
    assert began.wait(10)
    before.submit(Task("b", ran.append), Worker.QUERY, found.append)
    after.submit(constant("a", 1), Worker.QUERY, found.append)
    before.close()
    try:
        qtbot.waitUntil(lambda: found == [1], timeout=10_000)
        after.submit(constant("a", 2), Worker.QUERY, found.append)
        qtbot.waitUntil(lambda: found == [1, 2], timeout=10_000)
    finally:
        end.set()
    assert ran == []


def test_a_task_that_begins_while_it_is_cancelled_is_delivered_once(manual) -> None:
    results, errors = [], []
    manual.submit(constant("a", 1), Worker.LONG, results.append, failed=errors.append)
    seen = manual.workers.jobs(manual)
    manual.workers.start(Worker.LONG, "a")
    # As it was when a thread took the task between the look and the cancelling.
    manual.workers.jobs = lambda _: seen
    manual.cancel("a")
    manual.workers.finish(Worker.LONG)
    assert (results, errors) == ([1], [])


def test_a_debounce_waits_for_the_last_and_a_throttle_for_the_first(manual) -> None:
    calls = []

    class Told:
        def late(self) -> None:
            calls.append(("late", manual.timers.ms))

        def early(self) -> None:
            calls.append(("early", manual.timers.ms))

    told = Told()
    for _ in range(3):
        # Each time it is another object that is the same method.
        manual.debounce(30, told.late)
        manual.throttle(30, told.early)
        manual.advance(20)
    assert calls == [("early", 30)]
    manual.advance(20)
    assert calls == [("early", 30), ("late", 70), ("early", 70)]
    manual.debounce(30, told.late)
    manual.forget(told.late)
    manual.advance(100)
    assert len(calls) == 3
    assert not manual.pending(told.late)


def test_idle_phases_come_after_the_last_movement_unless_held(manual) -> None:
    calls, held = [], [False]
    for phase in IdlePhase:
        manual.on_idle(phase, lambda phase=phase: calls.append(phase))
    manual.hold_idle("flying", lambda: held[0], IdlePhase.QUERIES)
    manual.touch()
    manual.advance(100)
    manual.touch()
    manual.advance(100)
    assert calls == []
    manual.advance(30)
    assert calls == [IdlePhase.IMAGE]
    held[0] = True
    manual.advance(1000)
    assert calls == [IdlePhase.IMAGE]
    assert manual.idle_pending(IdlePhase.QUERIES)
    held[0] = False
    manual.advance(300)
    assert calls == [IdlePhase.IMAGE, IdlePhase.QUERIES]
    manual.advance(1000)
    assert len(calls) == 2


def test_slow_frames_put_the_full_image_off(manual) -> None:
    calls = []
    manual.on_idle(IdlePhase.IMAGE, lambda: calls.append(1))
    manual.set_idle_delay(IdlePhase.IMAGE, 400)
    manual.touch(IdlePhase.IMAGE)
    manual.advance(300)
    assert calls == []
    manual.skip_idle(IdlePhase.IMAGE)
    manual.advance(300)
    assert calls == []
    manual.set_idle_delay(IdlePhase.IMAGE, 1)
    manual.touch(IdlePhase.IMAGE)
    manual.advance(IdlePhase.IMAGE.value)
    assert calls == [1]


def test_animations_tick_while_they_run(manual) -> None:
    times = []
    animation = manual.animate(times.append)
    manual.advance(100)
    assert times == []
    animation.start()
    manual.advance(100)
    assert len(times) == 6
    animation.stop()
    manual.advance(100)
    assert len(times) == 6


def test_what_is_asked_again_after_it_was_cancelled_is_answered(scheduler, qtbot) -> None:
    found, errors, began, go_on = [], [], threading.Event(), threading.Event()

    def work(progress) -> str:
        began.set()
        assert go_on.wait(20)
        progress(0.5, "")
        return "result"

    def ask() -> None:
        scheduler.submit(
            Task("key", work), Worker.QUERY, found.append, failed=errors.append, slot="slot"
        )

    ask()
    assert began.wait(10)
    scheduler.cancel("slot")
    ask()
    go_on.set()
    qtbot.waitUntil(lambda: not scheduler.busy, timeout=10_000)
    assert found == ["result"]
    assert [type(error) for error in errors] == [Cancelled]
