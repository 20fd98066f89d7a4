"""A progress bar, what is being done, and Cancel, shown while a task runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from qtpy.QtCore import QEasingCurve, Qt, Signal
from qtpy.QtWidgets import QAbstractButton, QHBoxLayout, QProgressBar, QWidget

from napari_unpack.tasks import Cancelled, Progress, Task, TaskResult
from napari_unpack.viewer.scheduler import Scheduler, Worker
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard
from napari_unpack.widgets.section import button, column, label, scroll_to_new

# More than the bar has pixels, so that it moves without steps.
STEPS = 1000

# About the time between two reports of a segmentation, so that the bar hardly ever stands.
GLIDE_SECONDS = 0.4

# Cancel is over after this, whatever the work is doing then: within a second for a person.
PATIENCE_MS = 700


class SmoothBar(QProgressBar):
    """Moves smoothly to the share done; never back, never ahead of it.

    Parameters
    ----------
    scheduler : Scheduler
        Whose frames it moves with.
    """

    def __init__(self, scheduler: Scheduler) -> None:
        super().__init__()
        self.setTextVisible(False)
        self.setRange(0, STEPS)
        self._glide = scheduler.animate(self._tick)
        # Not at rest when it begins: the next report comes before it would be fast.
        self._easing = QEasingCurve(QEasingCurve.Type.OutCubic)
        self._start, self._target, self._begun = 0, 0, 0.0

    def start(self) -> None:
        """Begin again at 0."""
        self.stop()
        self._target = 0
        self.setValue(0)

    def stop(self) -> None:
        """Stay where it is."""
        self._glide.stop()

    def move_to(self, fraction: float) -> None:
        """Move towards the share done, in [0, 1]; a smaller one than before is ignored."""
        target = round(STEPS * fraction)
        if target <= self._target:
            return
        # From where the bar is now, which an earlier move may not have reached.
        self._start, self._target, self._begun = self.value(), target, self._glide.now()
        self._glide.start()

    def _tick(self, now: float) -> None:
        share = min((now - self._begun) / GLIDE_SECONDS, 1.0)
        way = self._easing.valueForProgress(share) * (self._target - self._start)
        self.setValue(self._start + round(way))
        if share == 1.0:
            self.stop()


class TaskProgress(KeepsKeyboard, QWidget):
    """Runs one task at a time, and is shown only while it runs.

    Signals, on the main thread: `progressed` (fraction in [0, 1], text); `ended` (`TaskResult`)
    when this is hidden again.

    Parameters
    ----------
    scheduler : Scheduler
    promise : str
        Tooltip of Cancel: what stays as it was.
    step : str
        Of which step of the panel: its Cancel is told from the others by it.

    Attributes
    ----------
    next_steps : tuple of QWidget
        Where a button that began the work by a key is gone after it, the first of these that can
        be used has the keyboard.
    """

    progressed = Signal(float, str)
    ended = Signal(object)

    def __init__(self, scheduler: Scheduler, promise: str, step: str) -> None:
        super().__init__()
        self._scheduler = scheduler
        # Of the work shown. A slot for each, as sections work at the same time, and work that was
        # cancelled may still be under way.
        self._slot = object()
        self.next_steps: tuple[QWidget, ...] = ()
        self._began_it: QWidget | None = None
        self.bar = SmoothBar(scheduler)
        self.text = label("", "hint", wrap=True)
        self.cancel = button("Cancel", promise)
        self.cancel.setAccessibleName(f"Cancel: {step}")
        layout = column(self)
        layout.addWidget(self.bar)
        line = QHBoxLayout()
        line.addWidget(self.text, stretch=1)
        line.addWidget(self.cancel)
        layout.addLayout(line)
        self.cancel.clicked.connect(self.stop)
        self.hide()

    @property
    def running(self) -> bool:
        """Whether a task runs."""
        return self._scheduler.has(self._slot)

    def begin(self, work: Callable[[Progress], Any]) -> None:
        """Run a task and show its progress.

        Parameters
        ----------
        work : callable
            Takes a `Progress`, returns the result; touches no Qt and no GL.

        Raises
        ------
        RuntimeError
            If another task still runs.
        """
        if self.running:
            raise RuntimeError("earlier work is still under way; cancel it first")
        self._slot = slot = object()
        self._scheduler.submit(
            Task(slot, work),
            Worker.LONG,
            lambda result: self._end(slot, TaskResult(result)),
            partial(self._show, slot),
            lambda error: self._end(slot, TaskResult(error=error)),
        )
        self.cancel.setEnabled(True)
        self.bar.start()
        self.text.setText("Starting")
        self.show()
        # A button that is disabled now would hand the keyboard to any other. Of the window: after a
        # dialog it may not be the active one yet.
        focused, home = self.window().focusWidget(), self.parentWidget()
        # What was begun elsewhere, by a file dropped on the picture say, leaves the panel in place.
        if home and not home.visibleRegion().isEmpty():
            scroll_to_new(self, self._scheduler)
        by_key = isinstance(focused, QAbstractButton) and home and home.isAncestorOf(focused)
        self._began_it = focused if by_key else None
        if by_key:
            self.cancel.setFocus()

    def stop(self) -> None:
        """Ask the task to stop; does nothing when none runs."""
        if not self.running:
            return
        if self.window().focusWidget() is self.cancel:
            self.setFocus()
        self.cancel.setEnabled(False)
        self.text.setText("Stopping")
        slot = self._slot
        self._scheduler.cancel(slot)
        # The task ends at its next report. In a library, or while a kernel is compiled, that may
        # take longer: then it is left to itself, and what it returns is thrown away.
        given_up = TaskResult[Any](error=Cancelled())
        self._scheduler.later(PATIENCE_MS, lambda: self._end(slot, given_up))

    def _show(self, slot: object, fraction: float, text: str) -> None:
        if slot is not self._slot:
            return
        self.progressed.emit(fraction, text)
        self.bar.move_to(fraction)
        if self.cancel.isEnabled():
            self.text.setText(text)

    def _end(self, slot: object, outcome: TaskResult[Any]) -> None:
        if slot is not self._slot:
            return
        # From now on nothing runs here, though the task may.
        self._slot = object()
        stayed = self.window().focusWidget() in (self, self.cancel)
        self.bar.stop()
        self.hide()
        self.ended.emit(outcome)
        if stayed and self._began_it is not None:
            self._hand_on(self._began_it)

    def _hand_on(self, began_it: QWidget) -> None:
        """Give the keyboard back to what began the work, or to what comes after it."""
        usable = (w for w in (began_it, *self.next_steps) if w.isVisible() and w.isEnabled())
        to = next(usable, None)
        if to is not None:
            to.setFocus(Qt.FocusReason.TabFocusReason)
