"""A progress bar that moves smoothly between the steps it is told."""

from __future__ import annotations

from qtpy.QtCore import QEasingCurve, QPropertyAnimation
from qtpy.QtWidgets import QProgressBar

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
