"""Long work off the main thread."""

import threading

import pytest
from pytestqt.qtbot import QtBot

from napari_unpack.tasks import Cancelled, Progress, TaskResult
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.task_progress import TaskProgress


def _run(qtbot: QtBot, job: Job, work: object) -> TaskResult:
    with qtbot.waitSignal(job.ended, timeout=20000) as heard:
        job.start(work)
    return heard.args[0]


def test_the_result_arrives_and_the_work_ran_elsewhere(qtbot: QtBot) -> None:
    outcome = _run(qtbot, Job(), lambda progress: threading.current_thread().name)
    assert outcome.error is None
    assert outcome.result != threading.main_thread().name


def test_what_the_work_raises_arrives_as_an_outcome(qtbot: QtBot) -> None:
    def work(progress: Progress) -> None:
        raise ValueError("no")

    outcome = _run(qtbot, Job(), work)
    assert isinstance(outcome.error, ValueError)
    assert str(outcome.error) == "no"


def test_progress_is_heard_on_the_main_thread_and_the_last_report_always(qtbot: QtBot) -> None:
    job, heard = Job(), []
    job.progressed.connect(lambda f, text: heard.append((f, text, threading.current_thread())))

    def work(progress: Progress) -> None:
        for k in range(1001):
            progress(k / 1000, "counting")

    _run(qtbot, job, work)
    assert {thread for *_, thread in heard} == {threading.main_thread()}
    assert heard[-1][:2] == (1.0, "counting")
    assert len(heard) < 100


def test_cancelling_stops_the_work_at_its_next_report(qtbot: QtBot) -> None:
    job, started = Job(), threading.Event()

    def work(progress: Progress) -> None:
        while True:
            progress(0.5, "for ever")
            started.set()

    with qtbot.waitSignal(job.ended, timeout=20000) as heard:
        job.start(work)
        qtbot.waitUntil(started.is_set)
        job.cancel()
    outcome = heard.args[0]
    assert isinstance(outcome.error, Cancelled)
    assert outcome.cancelled
    with pytest.raises(Cancelled):
        outcome.get()
    assert not job.running


def test_waiting_is_seen_while_it_works_and_says_that_it_stops(qtbot: QtBot) -> None:
    waiting, started = TaskProgress(Scheduler(), "Nothing changes."), threading.Event()
    qtbot.addWidget(waiting)
    assert waiting.isHidden()

    def work(progress: Progress) -> None:
        while True:
            progress(0.25, "halfway there")
            started.set()

    waiting.begin(work)
    assert waiting.running
    qtbot.waitUntil(lambda: waiting.text.text() == "halfway there", timeout=20000)
    assert not waiting.isHidden()
    with pytest.raises(RuntimeError):
        waiting.begin(work)
    with qtbot.waitSignal(waiting.ended, timeout=20000) as heard:
        waiting.cancel.click()
        assert waiting.text.text() == "Stopping"
        assert not waiting.cancel.isEnabled()
    assert heard.args[0].cancelled
    assert waiting.isHidden()
    assert not waiting.running


def test_a_job_can_be_used_again_after_a_cancel(qtbot: QtBot) -> None:
    job = Job()
    job.cancel()
    assert _run(qtbot, job, lambda progress: 7).result == 7
    assert _run(qtbot, job, lambda progress: 8).result == 8
