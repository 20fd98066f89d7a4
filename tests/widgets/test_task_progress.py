"""A section's progress bar, its words and its Cancel."""

import threading
from time import monotonic

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QVBoxLayout, QWidget

from keys import KEY, Keys
from manual_scheduler import ManualScheduler
from napari_unpack.tasks import Progress
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.widgets.section import button
from napari_unpack.widgets.task_progress import SmoothBar, TaskProgress


def test_progress_is_seen_while_it_works_and_says_that_it_stops(qtbot: QtBot) -> None:
    progress_bar, started = (
        TaskProgress(Scheduler(), "Nothing changes.", "Files"),
        threading.Event(),
    )
    qtbot.addWidget(progress_bar)
    assert progress_bar.isHidden()

    def work(progress: Progress) -> None:
        while True:
            progress(0.25, "halfway there")
            started.set()

    progress_bar.begin(work)
    assert progress_bar.running
    qtbot.waitUntil(lambda: progress_bar.text.text() == "halfway there", timeout=20000)
    assert not progress_bar.isHidden()
    with pytest.raises(RuntimeError):
        progress_bar.begin(work)
    with qtbot.waitSignal(progress_bar.ended, timeout=20000) as heard:
        progress_bar.cancel.click()
        assert progress_bar.text.text() == "Stopping"
        assert not progress_bar.cancel.isEnabled()
    assert heard.args[0].cancelled
    assert progress_bar.isHidden()
    assert not progress_bar.running


def test_the_bar_glides_by_the_schedulers_clock_and_never_back(qtbot: QtBot) -> None:
    scheduler = ManualScheduler()
    bar = SmoothBar(scheduler)
    qtbot.addWidget(bar)
    bar.start()
    bar.move_to(0.4)
    seen = [bar.value()]
    for fraction in (0.2, 0.8, 0.8, 0.1, 0.1):
        scheduler.advance(250)
        seen.append(bar.value())
        bar.move_to(fraction)
    assert seen == sorted(seen)
    assert 0 == seen[0] < seen[1] < 400
    assert seen[-1] == 800
    bar.start()
    scheduler.advance(250)
    assert bar.value() == 0


def test_cancel_answers_within_a_second_whatever_the_work_is_doing(qtbot: QtBot) -> None:
    bar, go_on, ended = (
        TaskProgress(Scheduler(), "Nothing changes.", "Files"),
        threading.Event(),
        [],
    )
    qtbot.addWidget(bar)
    bar.ended.connect(ended.append)

    def deaf(progress: Progress) -> str:
        progress(0.5, "in a library's code")
        go_on.wait(20)
        return "of no use any more"

    bar.begin(deaf)
    qtbot.waitUntil(lambda: bar.text.text() == "in a library's code", timeout=20000)
    begun = monotonic()
    with qtbot.waitSignal(bar.ended, timeout=20000):
        bar.cancel.click()
    assert monotonic() - begun < 1
    assert ended.pop().cancelled
    assert bar.isHidden()
    # The next does not wait for it, and is not disturbed when it ends after all.
    with qtbot.waitSignal(bar.ended, timeout=20000):
        bar.begin(lambda _: "the next")
    go_on.set()
    assert [outcome.get() for outcome in ended] == ["the next"]


def test_cancel_hands_its_key_to_no_other_when_the_work_is_done(qtbot: QtBot) -> None:
    scheduler, window = Scheduler(), QWidget()
    qtbot.addWidget(window)
    progress = TaskProgress(scheduler, "Stop.", "Confidence")
    begin, other = button("Built-in", ""), button("Measure", "")
    layout = QVBoxLayout(window)
    for widget in (begin, progress, other):
        layout.addWidget(widget)
    goes_on, pressed = threading.Event(), []
    begin.clicked.connect(lambda: progress.begin(lambda _: goes_on.wait(10)))
    other.clicked.connect(lambda: pressed.append(other))
    # What began it can be done once.
    progress.ended.connect(lambda _: begin.setEnabled(False))
    window.show()
    keys = Keys(window, qtbot)
    begin.setFocus()
    with qtbot.waitSignal(progress.ended, timeout=10000):
        keys.press(KEY.Key_Space)
        assert keys.focus == "Cancel: Confidence"
        goes_on.set()
    assert not progress.isVisible()
    keys.press(KEY.Key_Space)
    assert not pressed
    assert not progress.running
    # Tab goes on from there.
    keys.press(KEY.Key_Tab)
    assert keys.focus == "Measure"
    scheduler.close()
