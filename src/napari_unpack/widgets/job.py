"""Long work off the main thread, with progress and cancel."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QObject, Signal

from napari_unpack.tasks import Cancelled, Progress, TaskResult

_PAUSE = 1 / 30


class Job(QObject):
    """One piece of work at a time on napari's worker threads.

    Signals, all received on the main thread: `progressed` (fraction in [0, 1], text) at most
    thirty times a second, `ended` (`TaskResult`).
    """

    progressed = Signal(float, str)
    ended = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._stop = threading.Event()
        self._worker: Any = None

    @property
    def running(self) -> bool:
        """Whether work is under way."""
        return self._worker is not None

    def start(self, work: Callable[[Progress], Any]) -> None:
        """Begin.

        Parameters
        ----------
        work : callable
            Takes a progress callable (fraction, text), returns the result. The callable raises
            `Cancelled` once `cancel` was called.

        Raises
        ------
        RuntimeError
            If earlier work is still under way.
        """
        from napari.qt.threading import create_worker

        if self.running:
            raise RuntimeError("earlier work is still under way; cancel it first")
        self._stop = stop = threading.Event()
        last = 0.0

        def report(fraction: float, text: str) -> None:
            nonlocal last
            if stop.is_set():
                raise Cancelled
            now = time.monotonic()
            if now - last >= _PAUSE or fraction >= 1.0:
                last = now
                self.progressed.emit(float(fraction), str(text))

        # napari keeps every worker it has had: what the work holds, whole sessions, must go.
        todo = [(work, report)]

        def run() -> TaskResult[Any]:
            begun, told = todo.pop()
            try:
                return TaskResult(result=begun(told))
            except Exception as error:
                return TaskResult(error=error)

        self._worker = create_worker(run)
        self._worker.returned.connect(self._finish)
        self._worker.start()

    def cancel(self) -> None:
        """Ask the work to stop at its next report; harmless when nothing runs."""
        self._stop.set()

    def _finish(self, outcome: TaskResult[Any]) -> None:
        self._worker = None
        self.ended.emit(outcome)
