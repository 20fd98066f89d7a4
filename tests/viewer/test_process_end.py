"""A process whose script leaves Qt objects behind ends as the script says."""

from __future__ import annotations

import os
import subprocess
import sys

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
