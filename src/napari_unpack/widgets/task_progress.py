"""What a section shows while it works: a bar, what is being done, and Cancel.

A progress bar that moves smoothly between the steps it is told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QEasingCurve, QPropertyAnimation, Signal
from qtpy.QtWidgets import QHBoxLayout, QProgressBar, QWidget

from napari_unpack.tasks import Progress, TaskResult
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.section import button, column, label

STEPS = 1000
GLIDE_MS = 400


class GlidingBar(QProgressBar):
    """Glides to where the work is; never back, never ahead of it."""

    def __init__(self) -> None:
        super().__init__()
        self.setTextVisible(False)
        self.setRange(0, STEPS)
        self._glide = QPropertyAnimation(self, b"value", self)
        self._glide.setDuration(GLIDE_MS)
        self._glide.setEasingCurve(QEasingCurve.Type.OutCubic)

    def start(self) -> None:
        """Begin again at nothing."""
        self._glide.stop()
        self._glide.setEndValue(0)
        self.setValue(0)

    def glide(self, fraction: float) -> None:
        """Move towards a part of the whole, in [0, 1].

        What is below the part told last is ignored.
        """
        target = round(STEPS * fraction)
        if target <= int(self._glide.endValue() or 0):
            return
        self._glide.stop()
        self._glide.setStartValue(self.value())
        self._glide.setEndValue(target)
        self._glide.start()


class TaskProgress(QWidget):
    """Run one piece of work at a time, seen only while it runs.

    `ended` carries the `TaskResult`, on the main thread, when this is hidden again.

    Parameters
    ----------
    promise : str
        What Cancel leaves as it was, for its tooltip.
    """

    ended = Signal(object)

    def __init__(self, promise: str) -> None:
        super().__init__()
        self.bar = GlidingBar()
        self.told = label("", "hint", wrap=True)
        self.cancel = button("Cancel", promise)
        self.job = Job(self)
        layout = column(self)
        layout.addWidget(self.bar)
        line = QHBoxLayout()
        line.addWidget(self.told, stretch=1)
        line.addWidget(self.cancel)
        layout.addLayout(line)
        self.cancel.clicked.connect(self.stop)
        self.job.progressed.connect(self._show)
        self.job.ended.connect(self._end)
        self.hide()

    @property
    def running(self) -> bool:
        """Whether work is under way."""
        return self.job.running

    def begin(self, work: Callable[[Progress], Any]) -> None:
        """Begin work, and show how far it is.

        Parameters
        ----------
        work : callable
            As `Job.start` takes it.

        Raises
        ------
        RuntimeError
            If earlier work is still under way.
        """
        self.job.start(work)
        self.cancel.setEnabled(True)
        self.bar.start()
        self.told.setText("Starting")
        self.show()

    def stop(self) -> None:
        """Ask the work to stop; harmless when nothing runs."""
        self.cancel.setEnabled(False)
        self.told.setText("Stopping")
        self.job.cancel()

    def _show(self, fraction: float, text: str) -> None:
        self.bar.glide(fraction)
        if self.cancel.isEnabled():
            self.told.setText(text)

    def _end(self, outcome: TaskResult[Any]) -> None:
        self.hide()
        self.ended.emit(outcome)
