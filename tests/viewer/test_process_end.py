"""A process whose script leaves Qt objects behind ends as the script says."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

LEAVES_OBJECTS_THAT_HOLD_EACH_OTHER = """
from qtpy.QtCore import QObject
from qtpy.QtWidgets import QApplication
from napari_unpack.viewer.process_end import end_with_process

class Panel:
    def end(self):
        print("ended")

app, panel = QApplication([]), Panel()
end_with_process(panel.end)
left = [QObject() for _ in range(9)]
for each in left:
    each.destroyed.connect(left.clear)
del each
raise SystemExit(3)
"""


def test_qt_objects_that_go_with_the_last_who_hears_of_it_end_no_process() -> None:
    # With freed memory overwritten, PyQt's own end crashes here every time.
    environment = {**os.environ, "PYTHONMALLOC": "debug", "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", LEAVES_OBJECTS_THAT_HOLD_EACH_OTHER]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "ended\n", "")


LEAVES_A_WORKER_BUSY = """
import atexit, sys, threading
from qtpy.QtWidgets import QApplication
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Scheduler, Worker

atexit.register(print, "ended")
app, began, scheduler = QApplication([]), threading.Event(), Scheduler()
work = lambda _: (began.set(), threading.Event().wait(100))
scheduler.submit(Task("long", work), Worker.LONG, print)
began.wait()
scheduler.close()
"""


@pytest.mark.parametrize(
    ("end", "status"),
    [("", 0), ("sys.exit(3)", 3), ("sys.exit('refused')", 1), ("raise RuntimeError('failed')", 1)],
)
def test_a_busy_worker_holds_up_no_end_and_the_status_is_the_scripts(end: str, status: int) -> None:
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", LEAVES_A_WORKER_BUSY + end]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=90)
    assert (ended.returncode, ended.stdout) == (status, "ended\n")
    # Of Qt, which hears from no thread but its own.
    assert "CRITICAL" not in ended.stderr
