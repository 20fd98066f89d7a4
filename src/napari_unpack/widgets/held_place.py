"""Scrolling that keeps what the hand is on in its place while lines appear above it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent, QObject
from qtpy.QtWidgets import QApplication, QScrollArea, QWidget

from napari_unpack.widgets.section import LAID_OUT_MS

if TYPE_CHECKING:
    from qtpy.QtGui import QMoveEvent

    from napari_unpack.viewer.scheduler import Scheduler


# Until a session that was opened shows all that it has: counts, the bar of steps, a sentence.
OPENED_MS = 1000


class HeldPlace(QObject):
    """Scrolls along with a part of the panel that is moved by what comes and goes above it.

    What the mouse is on stays where it is, else what has the focus, else this part.

    Parameters
    ----------
    scroll : QScrollArea
        What holds it.
    kept : QWidget
        A child of what is scrolled.
    scheduler : Scheduler
    """

    def __init__(self, scroll: QScrollArea, kept: QWidget, scheduler: Scheduler) -> None:
        super().__init__(scroll)
        self._scroll, self._kept, self._scheduler = scroll, kept, scheduler
        self._moved = 0
        # Until there is a session, what comes at the top is news that must be seen.
        self._waits = True
        kept.installEventFilter(self)
        scroll.verticalScrollBar().rangeChanged.connect(lambda *_: self._follow())

    def eventFilter(self, watched: QObject, event: QEvent | QMoveEvent) -> bool:
        """Follow the part where it is moved.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        if event.type() == QEvent.Type.Move and self._stays(event.oldPos().y()):
            self._moved += event.pos().y() - event.oldPos().y()
            # Once the layout is done.
            self._scheduler.soon(self._follow)
        return False

    def let_go(self) -> None:
        """Let all of the panel be laid out anew: another session is shown."""
        self._waits = True
        self._scheduler.debounce(OPENED_MS, self._hold)

    def _hold(self) -> None:
        self._waits = False

    def _stays(self, top: int) -> bool:
        if self._waits:
            return False
        # A button above that folds something is not to run away from the mouse.
        if self._scroll.underMouse():
            return bool(self._kept.underMouse())
        focus = QApplication.focusWidget()
        if focus is not None and self._scroll.isAncestorOf(focus):
            return bool(self._kept.isAncestorOf(focus))
        # What was out of sight has no place to keep.
        seen = self._scroll.verticalScrollBar().value()
        return seen < top + self._kept.height() and top < seen + self._scroll.viewport().height()

    def _follow(self) -> None:
        bar = self._scroll.verticalScrollBar()
        wanted = bar.value() + self._moved
        bar.setValue(wanted)
        # What is beyond the end may be within reach when the bar's range follows.
        self._moved = max(0, wanted - bar.value())
        if self._moved:
            self._scheduler.debounce(LAID_OUT_MS, self._forget)

    def _forget(self) -> None:
        self._moved = 0
