"""The wheel scrolls; it changes a setting only where the user has given that control the focus."""

from __future__ import annotations

from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import (
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QScrollBar,
    QWidget,
)

GUARDED = (QComboBox, QAbstractSpinBox, QAbstractSlider)


class WheelGuard(QObject):
    """Keeps the wheel off the boxes and sliders in a widget, also those that come later.

    Parameters
    ----------
    root : QWidget
        All that is inside is guarded: sections, docks, dialogs with a parent in it.
    """

    def __init__(self, root: QWidget) -> None:
        super().__init__(root)
        self._guard(root)

    def _guard(self, widget: QWidget) -> None:
        for each in (widget, *widget.findChildren(QWidget)):
            # Installed twice, a filter would be asked once all the same.
            each.installEventFilter(self)
            # Else the wheel gives the focus, and the next notch changes the setting.
            if _changes_by_wheel(each) and each.focusPolicy() == Qt.FocusPolicy.WheelFocus:
                each.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Scroll what is around a control that has not the focus; guard new controls.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        kind = event.type()
        # Polished, a child is whole; when it is added, it may still be under construction.
        if kind == QEvent.Type.ChildPolished and isinstance(event.child(), QWidget):
            self._guard(event.child())
        if kind != QEvent.Type.Wheel or not _changes_by_wheel(watched) or watched.hasFocus():
            return False
        event.ignore()
        area = watched.parent()
        while area is not None and not isinstance(area, QAbstractScrollArea):
            area = area.parent()
        if area is not None:
            QApplication.sendEvent(area.viewport(), event)
        return True


def _changes_by_wheel(widget: QObject) -> bool:
    return isinstance(widget, GUARDED) and not isinstance(widget, QScrollBar)
