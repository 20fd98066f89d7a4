"""The clock of flights: about sixty ticks a second, only while something moves."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from qtpy.QtCore import Qt, QTimer


class Clock:
    """Ticks while it is needed.

    Parameters
    ----------
    tick : callable
        Called with the time, s. Ticks that come late are dropped, never made up for, so a slow
        machine shows fewer frames of the same flight.
    """

    def __init__(self, tick: Callable[[float], None]) -> None:
        self._tick = tick
        self._timer = QTimer()
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(16)
        self._timer.timeout.connect(self._on_timeout)

    @staticmethod
    def now() -> float:
        """Return the time, s."""
        return perf_counter()

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
        self._timer.stop()

    def _on_timeout(self) -> None:
        self._tick(self.now())
