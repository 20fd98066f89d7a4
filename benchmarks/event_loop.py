"""A watch on Qt's event loop: how long nothing could be drawn or clicked, and in whose code.

A timer of 20 ms that comes late tells of a stall. Meanwhile a signal every 5 ms looks at what the
main thread is doing. The innermost frame of ours or of napari's and vispy's tells who is at work:
numpy that napari calls is napari's, what napari calls of ours is ours.
"""

from __future__ import annotations

import signal
import time
from collections import Counter
from dataclasses import dataclass, field
from types import FrameType

from qtpy.QtCore import Qt, QTimer

TICK_SECONDS = 0.020
SAMPLE_SECONDS = 0.005
# Shorter ones are a frame of the picture being drawn.
LEAST_SECONDS = 0.030
OURS, THEIRS = "napari_unpack", ("napari", "vispy", "app_model", "superqt", "magicgui")


@dataclass
class Stall:
    """A time in which the event loop did not turn.

    Parameters
    ----------
    phase : str
        What was being done.
    seconds : float
        By how much the timer was late.
    ours, ours_cpu : float
        Seconds of it in our code, and those of the processor on the main thread: on a busy
        machine the first grow.
    where : str
        Our line that was seen most often.
    """

    phase: str
    seconds: float
    ours: float
    ours_cpu: float
    where: str


@dataclass
class _Seen:
    ours: float = 0.0
    ours_cpu: float = 0.0
    total: float = 0.0
    places: Counter[str] = field(default_factory=Counter)


class EventLoopWatch:
    """Watches from `start` to `stop`; on the main thread of a Qt application.

    Attributes
    ----------
    phase : str
        What is being done, for the stalls from now on.
    stalls : list of Stall
    """

    def __init__(self) -> None:
        self.phase = ""
        self.stalls: list[Stall] = []
        self._timer = QTimer()
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)

    def start(self) -> None:
        """Watch from now on."""
        self._before = signal.signal(signal.SIGALRM, self._look)
        self._begin()
        self._looked, self._looked_cpu = time.perf_counter(), time.thread_time()
        self._timer.start(round(1000 * TICK_SECONDS))
        signal.setitimer(signal.ITIMER_REAL, SAMPLE_SECONDS, SAMPLE_SECONDS)

    def stop(self) -> None:
        """Watch no longer."""
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, self._before)
        self._timer.stop()

    def longest(self, phase: str | None = None) -> Stall:
        """Return the stall with most seconds in our code."""
        found = [stall for stall in self.stalls if phase in (None, stall.phase)]
        return max(found, key=lambda stall: stall.ours, default=Stall("", 0.0, 0.0, 0.0, ""))

    def _begin(self) -> None:
        self._ticked, self._seen = time.perf_counter(), _Seen()

    def _tick(self) -> None:
        late = time.perf_counter() - self._ticked - TICK_SECONDS
        seen = self._seen
        # First: the signal that adds places may come while they are looked over.
        self._begin()
        if late > LEAST_SECONDS:
            share = seen.ours / seen.total if seen.total else 0.0
            where = seen.places.most_common(1)[0][0] if seen.places else ""
            self.stalls.append(Stall(self.phase, late, late * share, seen.ours_cpu, where))

    def _look(self, _number: int, frame: FrameType | None) -> None:
        now, cpu = time.perf_counter(), time.thread_time()
        passed, worked = now - self._looked, cpu - self._looked_cpu
        self._looked, self._looked_cpu = now, cpu
        # What was before the last tick is no part of this stall.
        passed = min(passed, now - self._ticked)
        self._seen.total += passed
        while frame is not None:
            package, name = _package(frame.f_code.co_filename), frame.f_code.co_name
            if package in THEIRS:
                return
            if package == OURS:
                self._seen.ours += passed
                self._seen.ours_cpu += min(worked, passed)
                place = frame.f_code.co_filename.rpartition(OURS + "/")[2]
                self._seen.places[f"{place}:{frame.f_lineno} {name}"] += 1
                return
            frame = frame.f_back


def _package(path: str) -> str:
    """Return the package of a source file, as far as it is of interest here."""
    for package in (OURS, *THEIRS):
        if f"/{package}/" in path:
            return package
    return ""
