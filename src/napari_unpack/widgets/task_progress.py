"""What a section shows while it works: a bar that moves smoothly, what is being done, Cancel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QEasingCurve, QPropertyAnimation, Signal
from qtpy.QtWidgets import QHBoxLayout, QProgressBar, QWidget

from napari_unpack.tasks import Progress, Task, TaskResult
from napari_unpack.viewer.scheduler import Scheduler, Worker
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
    scheduler : Scheduler
    promise : str
        What Cancel leaves as it was, for its tooltip.
    """

    ended = Signal(object)

    def __init__(self, scheduler: Scheduler, promise: str) -> None:
        super().__init__()
        self._scheduler = scheduler
        # Its own slot: sections work at the same time.
        self._slot = object()
        self.bar = GlidingBar()
        self.told = label("", "hint", wrap=True)
        self.cancel = button("Cancel", promise)
        layout = column(self)
        layout.addWidget(self.bar)
        line = QHBoxLayout()
        line.addWidget(self.told, stretch=1)
        line.addWidget(self.cancel)
        layout.addLayout(line)
        self.cancel.clicked.connect(self.stop)
        self.hide()

    @property
    def running(self) -> bool:
        """Whether work is under way."""
        return self._scheduler.has(self._slot)

    def begin(self, work: Callable[[Progress], Any]) -> None:
        """Begin work, and show how far it is.

        Parameters
        ----------
        work : callable
            Takes a `Progress`, returns the result; touches no Qt and no GL.

        Raises
        ------
        RuntimeError
            If earlier work is still under way.
        """
        if self.running:
            raise RuntimeError("earlier work is still under way; cancel it first")
        self._scheduler.submit(
            Task(self._slot, work),
            Worker.LONG,
            lambda result: self._end(TaskResult(result)),
            self._show,
            lambda error: self._end(TaskResult(error=error)),
        )
        self.cancel.setEnabled(True)
        self.bar.start()
        self.told.setText("Starting")
        self.show()

    def stop(self) -> None:
        """Ask the work to stop; harmless when nothing runs."""
        self.cancel.setEnabled(False)
        self.told.setText("Stopping")
        self._scheduler.cancel(self._slot)

    def _show(self, fraction: float, text: str) -> None:
        self.bar.glide(fraction)
        if self.cancel.isEnabled():
            self.told.setText(text)

    def _end(self, outcome: TaskResult[Any]) -> None:
        self.hide()
        self.ended.emit(outcome)
