"""Work for other threads: the newest request of each kind, results back on the main thread.

The clock of flights, about sixty ticks a second while something moves, and other timers.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from qtpy.QtCore import QCoreApplication, QEventLoop, QObject, Qt, QTimer, Signal
from qtpy.QtGui import QGuiApplication


def stop(timer: QTimer) -> None:
    """Stop a timer, also one that Qt has deleted at the end of the application."""
    with contextlib.suppress(RuntimeError):
        timer.stop()


def single_shot(then: Callable[[], None], milliseconds: int = 0) -> QTimer:
    """Return a timer that calls once, so long after it was started last."""
    timer = QTimer()
    timer.setSingleShot(True)
    timer.setInterval(milliseconds)
    timer.timeout.connect(then)
    return timer


class Clock:
    """Ticks while it is needed.

    Parameters
    ----------
    tick : callable
        Called with the time, s. Ticks that come late are dropped, never made up for, so a slow
        machine shows fewer frames of the same flight.
    now : callable
        Returns the time, s.
    """

    def __init__(self, tick: Callable[[float], None], now: Callable[[], float]) -> None:
        self._tick, self.now = tick, now
        self._timer = QTimer()
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(16)
        self._timer.timeout.connect(self._on_timeout)

    @property
    def running(self) -> bool:
        """Whether it ticks."""
        return bool(self._timer.isActive())

    def start(self) -> None:
        """Tick from now on."""
        if not self.running:
            self._timer.start()

    def stop(self) -> None:
        """Tick no more."""
        stop(self._timer)

    def _on_timeout(self) -> None:
        self._tick(self.now())


@dataclass(frozen=True, eq=False)
class _Job:
    lane: str
    key: str
    work: Callable[[], Any]
    then: Callable[[Any], None]


@dataclass(eq=False)
class _Lane:
    pool: ThreadPoolExecutor
    running: _Job | None = None
    waiting: dict[str, _Job] = field(default_factory=dict)
    done: list[_Job] = field(default_factory=list)
    """Whose results are on their way to the main thread."""


class _Post(QObject):  # type: ignore[misc]
    finished = Signal(object, object, object)


class Jobs:
    """Lanes of one thread each.

    Parameters
    ----------
    lanes : tuple of str
        Names. What is in one lane is done one after another, first asked first.
    failed : callable
        Told the text of an error in a job.

    Notes
    -----
    A request replaces one of the same key that still waits. A job that already runs is finished
    and its result delivered; whoever asked decides whether it is stale. A lane goes on with what
    waits while the main thread is busy drawing; results come in the order of the jobs.
    """

    def __init__(self, lanes: tuple[str, ...], failed: Callable[[str], None]) -> None:
        self._lanes = {
            name: _Lane(ThreadPoolExecutor(1, thread_name_prefix=f"unpack-{name}"))
            for name in lanes
        }
        self._failed = failed
        self._lock = Lock()
        self._closed = False
        self._post = _Post()
        self._post.finished.connect(self._on_finished, Qt.ConnectionType.QueuedConnection)

    @property
    def busy(self) -> bool:
        """Whether anything runs or waits."""
        with self._lock:
            return any(lane.running or lane.waiting or lane.done for lane in self._lanes.values())

    def has(self, key: str, within: str | None = None) -> bool:
        """Return whether a job of this key, in one lane or any, runs, waits, or is undelivered."""
        with self._lock:
            return any(
                key in lane.waiting
                or any(job.key == key for job in lane.done)
                or (lane.running is not None and lane.running.key == key)
                for name, lane in self._lanes.items()
                if within in (None, name)
            )

    @property
    def turning(self) -> bool:
        """Whether a picture of the bag as it moves is on its way: nothing has come to rest.

        Where the machine is slow, redraws are further apart than a camera takes to rest.
        """
        return self.has("packed", "quick")

    def ask(
        self, lane: str, key: str, work: Callable[[], Any], then: Callable[[Any], None]
    ) -> None:
        """Have work done in a lane.

        Parameters
        ----------
        lane, key : str
            Where, and what kind of request it is.
        work : callable
            Runs in the lane's thread; must touch neither Qt nor GL.
        then : callable
            Takes the result on the main thread.
        """
        if self._closed:
            return
        with self._lock:
            self._lanes[lane].waiting[key] = _Job(lane, key, work, then)
            self._start(self._lanes[lane])

    def do(self, lane: str, key: str, work: Callable[[], Any]) -> Any:
        """Have work done in a lane and return its result, drawing meanwhile.

        Parameters
        ----------
        lane, key, work
            As for `ask`.

        Returns
        -------
        object
            None if the work failed (which `failed` was told) or the lanes were closed meanwhile.

        Notes
        -----
        The mouse and the keyboard wait until it is done, so that nobody asks again.
        """
        found: list[Any] = []
        self.ask(lane, key, work, found.append)
        self.wait(key)
        return found[0] if found else None

    def wait(self, key: str) -> None:
        """Wait until no job of a key runs or waits, drawing meanwhile; see `do`."""
        if not self.has(key):
            return
        QGuiApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            while self.has(key) and not self._closed:
                flags = QEventLoop.ProcessEventsFlag.ExcludeUserInputEvents
                QCoreApplication.processEvents(
                    flags | QEventLoop.ProcessEventsFlag.WaitForMoreEvents
                )
        finally:
            QGuiApplication.restoreOverrideCursor()

    def drop(self, key: str) -> None:
        """Forget what waits under a key."""
        with self._lock:
            for lane in self._lanes.values():
                lane.waiting.pop(key, None)

    def close(self) -> None:
        """Forget everything; what runs is finished and its result thrown away."""
        with self._lock:
            self._closed = True
            for lane in self._lanes.values():
                lane.waiting.clear()
                lane.pool.shutdown(wait=False, cancel_futures=True)

    def _start(self, lane: _Lane) -> None:
        # Under the lock.
        if lane.running is not None or not lane.waiting or self._closed:
            return
        job = lane.running = lane.waiting.pop(next(iter(lane.waiting)))
        lane.pool.submit(self._run, job)

    def _run(self, job: _Job) -> None:
        result, error = None, None
        try:
            result = job.work()
        except Exception as caught:
            error = caught
        with self._lock:
            if self._closed:
                return
            lane = self._lanes[job.lane]
            lane.running = None
            lane.done.append(job)
            self._start(lane)
        self._post.finished.emit(job, result, error)

    def _on_finished(self, job: _Job, result: Any, error: Exception | None) -> None:
        if self._closed:
            return
        with self._lock:
            self._lanes[job.lane].done.remove(job)
        if error is None:
            job.then(result)
        else:
            self._failed(f"{job.key}: {error}")
