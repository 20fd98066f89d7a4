"""The short transition from one set of colours to the next."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from qtpy.QtWidgets import QApplication, QStyle

from napari_unpack.layers.clock import Clock

SECONDS = 0.3


class HueFade:
    """Tells, some sixty times a second, how far a change of colours has come.

    Parameters
    ----------
    step : callable
        Given the part of the way, in [0, 1] and smooth at both ends; 1 is the last.

    Attributes
    ----------
    allowed : bool
        False jumps to the end: for who asks for reduced motion.
    """

    def __init__(self, step: Callable[[float], None]) -> None:
        self.allowed = not motion_reduced()
        self._step = step
        self._began = 0.0
        self._clock = Clock(self._tick, perf_counter)

    @property
    def running(self) -> bool:
        """Whether colours are on their way."""
        return self._clock.running

    @property
    def part(self) -> float:
        """How far they have come; 1 where none are on their way."""
        if not self.running:
            return 1.0
        part = min(max((self._clock.now() - self._began) / SECONDS, 0.0), 1.0)
        return part * part * (3.0 - 2.0 * part)

    def begin(self) -> None:
        """Set out from the beginning."""
        self._began = self._clock.now()
        self._clock.start()

    def stop(self) -> None:
        """Leave colours where they are."""
        self._clock.stop()

    def _tick(self, _now: float) -> None:
        part = self.part
        if part >= 1.0:
            self._clock.stop()
        self._step(part)


def motion_reduced() -> bool:
    """Return whether the desktop asks for no animations."""
    style = QApplication.style() if QApplication.instance() is not None else None
    hint = QStyle.StyleHint.SH_Widget_Animation_Duration
    return style is not None and style.styleHint(hint) == 0
