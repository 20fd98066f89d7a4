"""Scrolling that keeps what the hand is on in its place while lines appear above it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent, QObject
from qtpy.QtWidgets import QApplication, QScrollArea, QWidget

if TYPE_CHECKING:
    from qtpy.QtGui import QMoveEvent


class HeldPlace(QObject):
    """Scrolls along with a part of the panel that is moved while a person is at it.

    Parameters
    ----------
    scroll : QScrollArea
        What holds it.
    kept : QWidget
        A child of what is scrolled.
    soon : callable
        Runs a function as soon as the layout is done.
    """

    def __init__(
        self, scroll: QScrollArea, kept: QWidget, soon: Callable[[Callable[[], None]], None]
    ) -> None:
        super().__init__(scroll)
        self._scroll, self._kept, self._soon = scroll, kept, soon
        self._moved = 0
        kept.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent | QMoveEvent) -> bool:
        """Follow the part where it is moved.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        if event.type() == QEvent.Type.Move and self._in_hand():
            self._moved += event.pos().y() - event.oldPos().y()
            # The bar's range is that of the layout before.
            self._soon(self._follow)
        return False

    def _in_hand(self) -> bool:
        # A button above that folds something is not to run away from the mouse.
        if self._scroll.underMouse():
            return bool(self._kept.underMouse())
        focus = QApplication.focusWidget()
        return focus is not None and self._kept.isAncestorOf(focus)

    def _follow(self) -> None:
        moved, self._moved = self._moved, 0
        bar = self._scroll.verticalScrollBar()
        bar.setValue(bar.value() + moved)
