"""Every thread, timer and animation frame of the viewer side.

Results, progress and timers arrive on the main thread. Nothing else under `viewer`, `layers` and
`widgets` starts threads or timers, so what runs when can be read here and nowhere else; what
remains of it at the end of the process is `process_end`'s.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from time import monotonic, perf_counter
from typing import Any, Protocol, TypeVar

from qtpy.QtCore import QCoreApplication, QEventLoop, QObject, Qt, QTimer, Signal
from qtpy.QtGui import QGuiApplication

from napari_unpack.tasks import Cancelled, Task, TaskResult
from napari_unpack.viewer.process_end import end_despite_workers

T = TypeVar("T")
Call = Callable[[], None]
Done = Callable[[Any], None]
Failed = Callable[[Exception], None] | None

# About sixty animation frames a second, as screens show them.
FRAME_MS = 16

# Progress is passed on no more often: more would only fill the event queue.
PROGRESS_SECONDS = 1 / 30

# For those who come after a closed owner whose task runs on: few ever close so fast.
SPARE_THREADS = 4


class Worker(Enum):
    """Where a task runs, and on how many threads."""

    MOTION = "motion", 1
    PREVIEW = "preview", 1
    REFINE = "refine", 1
    BACKGROUND = "background", 1
    QUERY = "query", 1
    # A slice read from a disk must not keep an image of the bag waiting.
    SLICE = "slice", 1
    # Segmenting takes minutes; a repair or a report must not wait for it.
    LONG = "long", 4

    @property
    def threads(self) -> int:
        """The most tasks that run at once."""
        return self.value[1]


class IdlePhase(Enum):
    """What waits until nothing moves, by the milliseconds after the last movement."""

    IMAGE = 120
    QUERIES = 250


class _Timer(Protocol):
    @property
    def active(self) -> bool: ...

    def start(self, milliseconds: int) -> None: ...

    def stop(self) -> None: ...


class _Timers(Protocol):
    # Tests have one whose time is moved by hand.
    def make(self, call: Call, repeating: bool = False) -> _Timer: ...

    def now(self) -> float: ...


class _QtTimer:
    def __init__(self, call: Call, repeating: bool) -> None:
        self._timer = QTimer()
        self._timer.setSingleShot(not repeating)
        if repeating:
            # A coarse timer may be a frame late.
            self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._call = call
        # A bound method: Qt would keep whatever a function or a lambda knows.
        self._timer.timeout.connect(self._fire)

    def _fire(self) -> None:
        self._call()

    @property
    def active(self) -> bool:
        return bool(self._timer.isActive())

    def start(self, milliseconds: int) -> None:
        self._timer.start(milliseconds)

    def stop(self) -> None:
        # Qt may have deleted it at the end of the application.
        with contextlib.suppress(RuntimeError):
            self._timer.stop()


class _QtTimers:
    def make(self, call: Call, repeating: bool = False) -> _Timer:
        return _QtTimer(call, repeating)

    def now(self) -> float:
        return perf_counter()


@dataclass(eq=False)
class Job:
    """A task on its way through a worker.

    Parameters
    ----------
    owner : Scheduler
        Delivers the result.
    worker : Worker
    slot : hashable
        Of those that wait in one slot only the newest is kept.
    task : Task
    progress : callable, optional
        Given the fraction done and what is being done, on the main thread.
    listeners : list of (callable, callable or None)
        What takes the result, and what takes the error.
    """

    owner: Scheduler
    worker: Worker
    slot: Hashable
    task: Task[Any]
    progress: Callable[[float, str], None] | None
    listeners: list[tuple[Done, Failed]]
    stopping: threading.Event = field(default_factory=threading.Event)

    def run(self, report: Callable[[Job, float, str], None]) -> TaskResult[Any]:
        """Run the task; `report` passes its progress on."""
        last = 0.0

        def progress(fraction: float, text: str) -> None:
            nonlocal last
            if self.stopping.is_set():
                raise Cancelled
            now = monotonic()
            if self.progress is not None and (now - last >= PROGRESS_SECONDS or fraction >= 1.0):
                last = now
                report(self, float(fraction), str(text))

        try:
            return TaskResult(result=self.task.run(progress))
        except Exception as error:
            return TaskResult(error=error)
        except BaseException as error:
            # Of a library that ends its program, or of Rust: whoever waits is to hear of it.
            ended = RuntimeError(f"the work was ended by {type(error).__name__}: {error}")
            ended.__cause__ = error
            return TaskResult(error=ended)


class _Workers(Protocol):
    # Tests have one that begins and finishes jobs when told.
    def add(self, job: Job) -> None: ...

    def jobs(self, owner: Scheduler) -> list[Job]: ...

    def drop(self, job: Job) -> bool: ...

    def wait_while(self, waits: Callable[[], bool]) -> None: ...

    def post(self, call: Call) -> None: ...

    def close(self) -> None: ...


@dataclass(eq=False)
class _Pool:
    threads: int
    executor: ThreadPoolExecutor
    waiting: list[Job] = field(default_factory=list)
    running: list[Job] = field(default_factory=list)
    finished: list[Job] = field(default_factory=list)
    """Their results are on their way to the main thread."""


class _Post(QObject):  # type: ignore[misc]
    finished = Signal(object, object)
    progressed = Signal(object, float, str)
    called = Signal(object)


class ThreadWorkers:
    """A pool of threads for each worker. First come, first served.

    Notes
    -----
    A worker goes on while the main thread draws; results come in the order of finishing.
    """

    def __init__(self) -> None:
        self._pools = {
            worker: _Pool(
                worker.threads,
                ThreadPoolExecutor(worker.threads + SPARE_THREADS, f"unpack-{worker.name}"),
            )
            for worker in Worker
        }
        self._lock = threading.Lock()
        self._closed = False
        self._post = _Post()
        self._post.finished.connect(self._deliver, Qt.ConnectionType.QueuedConnection)
        self._post.progressed.connect(_show_progress, Qt.ConnectionType.QueuedConnection)
        self._post.called.connect(_call, Qt.ConnectionType.QueuedConnection)

    def add(self, job: Job) -> None:
        """Run a job when its worker gets to it."""
        with self._lock:
            pool = self._pools[job.worker]
            pool.waiting.append(job)
            self._start(pool)

    def jobs(self, owner: Scheduler) -> list[Job]:
        """List an owner's jobs that wait, run, or are not delivered."""
        with self._lock:
            pools = self._pools.values()
            found = [j for p in pools for part in (p.finished, p.running, p.waiting) for j in part]
        return [job for job in found if job.owner is owner]

    def drop(self, job: Job) -> bool:
        """Forget a job that waits; return whether it did."""
        with self._lock:
            waiting = self._pools[job.worker].waiting
            # A thread may have begun it since the caller looked.
            waits = job in waiting
            if waits:
                waiting.remove(job)
            # Of a closed owner: what runs for it holds nothing up from now on.
            self._start(self._pools[job.worker])
            return waits

    def wait_while(self, waits: Callable[[], bool]) -> None:
        """Go on drawing while something holds, without mouse and keyboard."""
        if not waits():
            return
        # With mouse and keys a second command could begin within the first.
        kinds = QEventLoop.ProcessEventsFlag
        flags = kinds.ExcludeUserInputEvents | kinds.WaitForMoreEvents
        QGuiApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            while waits():
                QCoreApplication.processEvents(flags)
        finally:
            QGuiApplication.restoreOverrideCursor()

    def post(self, call: Call) -> None:
        """Call soon, on the main thread; from any thread."""
        self._post.called.emit(call)

    def close(self) -> None:
        """Start nothing more; what runs is finished, and its result thrown away."""
        with self._lock:
            self._closed = True
            if any(pool.running for pool in self._pools.values()):
                end_despite_workers()
            for pool in self._pools.values():
                pool.waiting.clear()
                pool.executor.shutdown(wait=False, cancel_futures=True)

    def _start(self, pool: _Pool) -> None:
        # Under the lock. Two tasks of one slot would race for what they both replace.
        while not self._closed:
            # What runs for a closed owner is of no use: the next bag must not wait for it.
            if sum(not job.owner.closed for job in pool.running) >= pool.threads:
                return
            taken = {(job.owner, job.slot) for job in pool.running}
            wanted = (j for j in pool.waiting if not j.owner.closed)
            job = next((j for j in wanted if (j.owner, j.slot) not in taken), None)
            if job is None:
                return
            pool.waiting.remove(job)
            pool.running.append(job)
            pool.executor.submit(self._run, job)

    def _run(self, job: Job) -> None:
        result = job.run(self._post.progressed.emit)
        with self._lock:
            # What it worked on is let go of with the job.
            if self._closed:
                return
            pool = self._pools[job.worker]
            pool.running.remove(job)
            pool.finished.append(job)
            # Before the next one starts, which may be quicker than the way from here to there.
            self._post.finished.emit(job, result)
            self._start(pool)

    def _deliver(self, job: Job, result: TaskResult[Any]) -> None:
        with self._lock:
            self._pools[job.worker].finished.remove(job)
        job.owner.deliver(job, result)


def _show_progress(job: Job, fraction: float, text: str) -> None:
    if job.progress is not None and not job.owner.closed:
        job.progress(fraction, text)


def _call(call: Call) -> None:
    call()


class Animation:
    """Ticks while it runs.

    Parameters
    ----------
    tick, now
        As for `Scheduler.animate`.
    changed : callable
        Called when it starts or stops.
    """

    def __init__(
        self, tick: Callable[[float], None], now: Callable[[], float], changed: Call
    ) -> None:
        self.tick, self.now, self._changed = tick, now, changed
        self.running = False

    def start(self) -> None:
        """Tick from now on."""
        self.running = True
        self._changed()

    def stop(self) -> None:
        """Tick no more."""
        self.running = False
        self._changed()


@dataclass(eq=False)
class _Idle:
    timer: _Timer
    milliseconds: int
    calls: list[Call] = field(default_factory=list)
    holds: dict[str, Callable[[], bool]] = field(default_factory=dict)


def on_main_thread() -> bool:
    """Return whether this is the thread of an event loop of Qt."""
    main = threading.current_thread() is threading.main_thread()
    return main and QCoreApplication.instance() is not None


class Scheduler:
    """Says what runs when, for one dock widget or one controller.

    Parameters
    ----------
    failed : callable, optional
        Given a sentence when a task without a `failed` of its own raised an error.
    workers : ThreadWorkers, optional
        By default a set of threads of its own, which `close` ends.
    timers : object, optional
        By default Qt's.

    Notes
    -----
    To be used on the main thread, but for `soon`.
    """

    def __init__(
        self,
        failed: Callable[[str], None] | None = None,
        workers: _Workers | None = None,
        timers: _Timers | None = None,
    ) -> None:
        self.closed = False
        self._failed = failed
        self._owns_workers = workers is None
        self._workers: _Workers = ThreadWorkers() if workers is None else workers
        self._timers: _Timers = _QtTimers() if timers is None else timers
        self._debounced: dict[Call, _Timer] = {}
        self._animations: list[Animation] = []
        self._frames = self._timers.make(self._on_frame, repeating=True)
        self._idle = {
            phase: _Idle(self._timers.make(partial(self._on_idle, phase)), phase.value)
            for phase in IdlePhase
        }

    def scope(self, failed: Callable[[str], None] | None = None) -> Scheduler:
        """Return a scheduler on the same threads whose slots, timers and end are its own."""
        return Scheduler(failed, self._workers, self._timers)

    # Tasks.

    @property
    def busy(self) -> bool:
        """Whether any task waits, runs or is not delivered."""
        return bool(self._workers.jobs(self))

    def has(self, slot: Hashable, worker: Worker | None = None) -> bool:
        """Return whether a task waits, runs or is not delivered.

        Parameters
        ----------
        slot : hashable
        worker : Worker, optional
            By default any.
        """
        jobs = self._workers.jobs(self)
        return any(job.slot == slot and worker in (None, job.worker) for job in jobs)

    def submit(
        self,
        task: Task[T],
        worker: Worker,
        done: Callable[[T], None],
        progress: Callable[[float, str], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        slot: Hashable | None = None,
    ) -> None:
        """Run a task in a worker.

        Parameters
        ----------
        task : Task
            Touches neither Qt nor GL.
        worker : Worker
        done : callable
            Takes the result.
        progress : callable, optional
            Takes the fraction done, in [0, 1], and what is being done.
        failed : callable, optional
            Takes the error, `Cancelled` among them; by default the scheduler's own `failed` does.
        slot : hashable, optional
            Replaces what waits in this slot of the worker; by default the task's key. Where a
            task of the same key, not cancelled, is on its way in a given slot, it serves both.
        """
        if self.closed:
            return
        place = task.key if slot is None else slot
        here = [j for j in self._workers.jobs(self) if (j.worker, j.slot) == (worker, place)]
        # What is being answered already, and not cancelled, is not computed twice.
        same = [j for j in here if slot is not None and j.task.key == task.key]
        if same and not same[-1].stopping.is_set():
            same[-1].listeners.append((done, failed))
            return
        for job in here:
            self._workers.drop(job)
        self._workers.add(Job(self, worker, place, task, progress, [(done, failed)]))

    def run_modal(self, task: Task[T], worker: Worker, slot: Hashable | None = None) -> T | None:
        """Run a task and return its result, drawing meanwhile.

        Parameters
        ----------
        task, worker, slot
            As for `submit`.

        Returns
        -------
        object
            None if the task failed or the scheduler was closed meanwhile.

        Notes
        -----
        Mouse and keyboard wait until it is done, so that nothing else is asked for.
        """
        found: list[T] = []
        place = task.key if slot is None else slot
        self.submit(task, worker, found.append, slot=slot)
        self._workers.wait_while(lambda: not (found or self.closed) and self.has(place, worker))
        return found[0] if found else None

    def wait(self, slot: Hashable) -> None:
        """Wait until no task of a slot waits or runs; see `run_modal`."""
        self._workers.wait_while(lambda: not self.closed and self.has(slot))

    def cancel(self, slot: Hashable) -> None:
        """Forget what waits in a slot, and ask what runs in it to stop at its next report."""
        for job in self._workers.jobs(self):
            if job.slot == slot:
                # Other tasks never look: what they return is delivered as ever.
                job.stopping.set()
                if self._workers.drop(job):
                    self.deliver(job, TaskResult(error=Cancelled()))

    def deliver(self, job: Job, result: TaskResult[Any]) -> None:
        """Hand a result over; for the workers.

        Parameters
        ----------
        job : Job
        result : TaskResult
        """
        # All hear of it in turn, also where one of them raises an error.
        with contextlib.ExitStack() as stack:
            for listener in reversed(job.listeners):
                stack.callback(self._tell, result, *listener)

    def _tell(self, result: TaskResult[Any], done: Done, failed: Failed) -> None:
        # A listener may close the scheduler.
        if self.closed:
            return
        if result.error is None:
            done(result.result)
        elif failed is not None:
            failed(result.error)
        elif self._failed is not None and not result.cancelled:
            self._failed(str(result.error) or type(result.error).__name__)

    # Timers.

    def soon(self, call: Call) -> None:
        """Call once the event loop gets to it; from any thread, and never once closed."""
        if not self.closed:
            self._workers.post(lambda: None if self.closed else call())

    def later(self, milliseconds: int, call: Call) -> None:
        """Call once.

        Parameters
        ----------
        milliseconds : int
            From now.
        call : callable
        """
        # A new function is one that nothing else asks for.
        self.debounce(milliseconds, lambda: call())

    def debounce(self, milliseconds: int, call: Call) -> None:
        """Call once, when this was not asked for again for some time.

        Parameters
        ----------
        milliseconds : int
            After the last request.
        call : callable
            Equal ones, as a method of one object always is, are one request.
        """
        if self.closed:
            return
        if call not in self._debounced:

            def fire() -> None:
                # First: the call may ask again.
                del self._debounced[call]
                call()

            self._debounced[call] = self._timers.make(fire)
        self._debounced[call].start(milliseconds)

    def throttle(self, milliseconds: int, call: Call) -> None:
        """Call once for all requests of some time.

        Parameters
        ----------
        milliseconds : int
            After the first request.
        call : callable
            As for `debounce`.
        """
        if not self.pending(call):
            self.debounce(milliseconds, call)

    def pending(self, call: Call) -> bool:
        """Return whether `debounce` or `throttle` is to make a call."""
        return call in self._debounced

    def forget(self, call: Call) -> None:
        """Do not make a call of `debounce` or `throttle`."""
        if call in self._debounced:
            self._debounced.pop(call).stop()

    # Idle phases.

    def on_idle(self, phase: IdlePhase, call: Call) -> None:
        """Call whenever a phase is reached after `touch`.

        Parameters
        ----------
        phase : IdlePhase
        call : callable
        """
        self._idle[phase].calls.append(call)

    def touch(self, *phases: IdlePhase) -> None:
        """Take note that something moved: phases, all where none is named, begin anew."""
        for phase in phases or IdlePhase:
            if not self.closed:
                self._idle[phase].timer.start(self._idle[phase].milliseconds)

    def skip_idle(self, phase: IdlePhase) -> None:
        """Do not call until the next `touch`: what would be done then has been begun."""
        self._idle[phase].timer.stop()

    def idle_pending(self, phase: IdlePhase) -> bool:
        """Return whether the calls of a phase are to come."""
        return self._idle[phase].timer.active

    def set_idle_delay(self, phase: IdlePhase, milliseconds: int) -> None:
        """Wait longer where frames are slow and far apart; never less than the phase's own time.

        Parameters
        ----------
        phase : IdlePhase
            Begins anew where it is pending.
        milliseconds : int
        """
        self._idle[phase].milliseconds = max(phase.value, milliseconds)
        # The frame that was so slow is the newest movement.
        if self.idle_pending(phase):
            self.touch(phase)

    def hold_idle(self, reason: str, held: Callable[[], bool], *phases: IdlePhase) -> None:
        """Put phases off as long as something holds.

        Parameters
        ----------
        reason : str
            Replaces what was given for the same reason.
        held : callable
            Returns whether it holds.
        *phases : IdlePhase
            By default all.
        """
        for phase in phases or IdlePhase:
            self._idle[phase].holds[reason] = held

    def idle_held(self, phase: IdlePhase) -> bool:
        """Return whether something puts a phase off."""
        return any(held() for held in self._idle[phase].holds.values())

    def _on_idle(self, phase: IdlePhase) -> None:
        if self.closed:
            return
        # Looked at again after a whole phase: what held it may have moved things.
        if self.idle_held(phase):
            self.touch(phase)
            return
        for call in tuple(self._idle[phase].calls):
            call()

    # Animation.

    def animate(
        self, tick: Callable[[float], None], now: Callable[[], float] | None = None
    ) -> Animation:
        """Return an animation, which is to be started.

        Parameters
        ----------
        tick : callable
            Called about sixty times a second with the time, s. Frames that come late are left
            out, never made up for, so a slow machine shows fewer frames of the same flight.
        now : callable, optional
            Returns the time; by default the scheduler's.
        """
        made = Animation(tick, self._timers.now if now is None else now, self._on_animations)
        self._animations.append(made)
        return made

    def _on_animations(self) -> None:
        wanted = not self.closed and any(one.running for one in self._animations)
        if wanted and not self._frames.active:
            self._frames.start(FRAME_MS)
        elif not wanted:
            self._frames.stop()

    def _on_frame(self) -> None:
        # A tick may start or stop others.
        for one in tuple(self._animations):
            if one.running:
                one.tick(one.now())

    def close(self) -> None:
        """Forget everything; what runs is asked to stop and its result thrown away."""
        self.closed = True
        # First, or they would begin what else waits.
        if self._owns_workers:
            self._workers.close()
        for job in self._workers.jobs(self):
            # Long work stops at its next report; the process ends without it if it must.
            job.stopping.set()
            self._workers.drop(job)
        idle = (phase.timer for phase in self._idle.values())
        for timer in (*self._debounced.values(), *idle, self._frames):
            timer.stop()
        self._debounced.clear()
