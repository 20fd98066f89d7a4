"""A section's progress bar, its words and its Cancel."""

import threading

import pytest
from pytestqt.qtbot import QtBot

from napari_unpack.tasks import Progress
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.widgets.task_progress import TaskProgress


def test_progress_is_seen_while_it_works_and_says_that_it_stops(qtbot: QtBot) -> None:
    progress_bar, started = TaskProgress(Scheduler(), "Nothing changes."), threading.Event()
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
