"""The clock of flights, about sixty ticks a second while something moves, and other timers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from qtpy.QtCore import Qt, QTimer


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
