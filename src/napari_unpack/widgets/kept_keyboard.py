"""What is disabled or hidden keeps the keyboard it had, so that its key acts on nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent

if TYPE_CHECKING:
    from qtpy.QtWidgets import QWidget as _Widget
else:
    # Qt's classes cannot have a second one of Qt beside them.
    _Widget = object


class KeepsKeyboard(_Widget):
    """Of a button, a row or a box: disabled or hidden it keeps the keyboard.

    Keys then do nothing there; Tab goes on from there. A box that comes and goes, and all between
    it and its buttons, must be such too.
    """

    def focusNextPrevChild(self, onwards: bool) -> bool:
        """Give the keyboard to the next widget, or to the one before."""
        # Of what cannot be used, Qt asks this to hand the keyboard on unasked.
        usable = self.isEnabled() and self.isVisible()
        # The window's own: the application has none, or another's, while this one is not active.
        if not usable and isinstance(self.window().focusWidget(), KeepsKeyboard):
            return True
        return bool(super().focusNextPrevChild(onwards))

    def event(self, event: QEvent) -> bool:
        """Leave the keys to those around while it is not to be seen."""
        # As Qt does where a widget is disabled.
        if event.type() == QEvent.Type.KeyPress and not self.isVisible():
            return False
        return bool(super().event(event))
