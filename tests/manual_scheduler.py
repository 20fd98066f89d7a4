"""A scheduler whose time and whose threads are moved by the test."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

from napari_unpack.tasks import TaskResult
from napari_unpack.viewer.scheduler import Job, Scheduler, Worker


class ManualTimer:
    """Fires when its `ManualTimers` are moved past its time."""

    def __init__(self, timers: ManualTimers, call: Callable[[], None], repeating: bool) -> None:
        self._timers, self.call, self.repeating = timers, call, repeating
        self.due: float | None = None
        self.milliseconds = 0

    @property
    def active(self) -> bool:
        return self.due is not None

    def start(self, milliseconds: int) -> None:
        self.milliseconds, self.due = milliseconds, self._timers.ms + milliseconds

    def stop(self) -> None:
        self.due = None


class ManualTimers:
    """Timers of a clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.ms = 0.0
        self._made: list[ManualTimer] = []

    def make(self, call: Callable[[], None], repeating: bool = False) -> ManualTimer:
        self._made.append(ManualTimer(self, call, repeating))
        return self._made[-1]

    def now(self) -> float:
        return self.ms / 1000

    def advance(self, milliseconds: float) -> None:
        """Move the time on, firing what is due in the order of time."""
        end = self.ms + milliseconds
        while True:
            due = [t for t in self._made if t.due is not None and t.due <= end]
            if not due:
                break
            first = min(due, key=lambda t: t.due or 0.0)
            self.ms = max(self.ms, first.due or 0.0)
            if first.repeating:
                first.start(first.milliseconds)
            else:
                first.due = None
            first.call()
        self.ms = end


class ManualWorkers:
    """Workers that begin and finish a job when told."""

    def __init__(self) -> None:
        self._waiting: list[Job] = []
        self._running: list[tuple[Job, TaskResult[Any]]] = []
        self._posted: list[Callable[[], None]] = []
        self.asked: list[Hashable] = []
        """Slots of all that was ever submitted."""
        self.ran: list[tuple[Hashable, Hashable]] = []
        """Slot and key of all that was computed."""

    def add(self, job: Job) -> None:
        self.asked.append(job.slot)
        self._waiting.append(job)

    def jobs(self, owner: Scheduler) -> list[Job]:
        return [j for j in [*(j for j, _ in self._running), *self._waiting] if j.owner is owner]

    def drop(self, job: Job) -> bool:
        waits = job in self._waiting
        if waits:
            self._waiting.remove(job)
        return waits

    def wait_while(self, waits: Callable[[], bool]) -> None:
        while waits():
            self.step()

    def post(self, call: Callable[[], None]) -> None:
        self._posted.append(call)

    def close(self) -> None:
        self._waiting.clear()

    def start(self, worker: Worker, slot: Hashable) -> None:
        """Run the job that waits, and keep its result."""
        assert not any(job.worker is worker for job, _ in self._running)
        job = next(j for j in self._waiting if (j.worker, j.slot) == (worker, slot))
        self._waiting.remove(job)
        self.ran.append((job.slot, job.task.key))
        self._running.append((job, job.run(_show)))

    def finish(self, worker: Worker) -> None:
        """Deliver the result that was kept."""
        job, result = next((j, r) for j, r in self._running if j.worker is worker)
        self._running.remove((job, result))
        job.owner.deliver(job, result)

    def startable(self) -> list[tuple[Worker, Hashable]]:
        """List the worker and slot of all jobs that could begin now."""
        busy = self.running()
        return [(job.worker, job.slot) for job in self._waiting if job.worker not in busy]

    def running(self) -> list[Worker]:
        """List the workers that have begun a job."""
        return [job.worker for job, _ in self._running]

    def step(self) -> None:
        """Make what was posted, and begin and finish one job a worker."""
        posted, self._posted = self._posted, []
        for call in posted:
            call()
        for worker in {job.worker for job in self._waiting}:
            if not any(job.worker is worker for job, _ in self._running):
                self.start(worker, next(j.slot for j in self._waiting if j.worker is worker))
        for job, _ in list(self._running):
            self.finish(job.worker)

    @property
    def idle(self) -> bool:
        """Whether nothing is left to do."""
        return not (self._waiting or self._running or self._posted)


def _show(job: Job, fraction: float, text: str) -> None:
    if job.progress is not None:
        job.progress(fraction, text)


class ManualScheduler(Scheduler):
    """As `Scheduler`; `advance` moves time, `finish_tasks` runs all tasks on the main thread."""

    def __init__(self, failed: Callable[[str], None] | None = None) -> None:
        self.timers, self.workers = ManualTimers(), ManualWorkers()
        super().__init__(failed, self.workers, self.timers)

    def advance(self, milliseconds: float) -> None:
        """Move the time on."""
        self.timers.advance(milliseconds)

    def finish_tasks(self) -> None:
        """Run all tasks, and those that they lead to."""
        while not self.workers.idle:
            self.workers.step()
