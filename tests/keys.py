"""A person without a mouse: keys go to the window, and from there to whatever has the focus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import ref

from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt, QTimer
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QAbstractButton, QApplication, QDialog, QMenu, QWidget

KEY, PLAIN = Qt.Key, Qt.KeyboardModifier.NoModifier
ALT, CONTROL = Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.ControlModifier
SHIFT = Qt.KeyboardModifier.ShiftModifier

# More than a window has controls.
MOST = 150


def called(widget: QWidget | None) -> str:
    """Return what a screen reader says of a control."""
    if widget is None:
        return ""
    own = widget.text() if isinstance(widget, QAbstractButton) else ""
    return str(widget.accessibleName() or own)


class Keys:
    """Presses keys in the window that is active.

    Parameters
    ----------
    window : QWidget
    qtbot : QtBot
    """

    def __init__(self, window: QWidget, qtbot: QtBot) -> None:
        # Whoever keeps this must not keep the window.
        self._window, self._qtbot = ref(window), qtbot
        self.activate()

    def activate(self) -> None:
        """Do what a window manager does, which virtual screens lack."""
        window = self._window()
        assert window is not None
        window.activateWindow()
        QApplication.setActiveWindow(window)
        self._qtbot.waitUntil(window.isActiveWindow, timeout=5000)

    @property
    def focus(self) -> str:
        """What has the keyboard."""
        return called(QApplication.focusWidget())

    def press(self, key: Any, modifiers: Any = PLAIN, times: int = 1) -> None:
        """Press a key, or type a text."""
        for _ in range(times):
            for one in key if isinstance(key, str) else [key]:
                popup = QApplication.activePopupWidget()
                window = QApplication.activeModalWidget() or QApplication.activeWindow()
                assert popup or window, "no window has the keyboard"
                QTest.keyClick(popup or window.windowHandle(), one, modifiers)
                QApplication.processEvents()

    def to(self, name: str, back: bool = False) -> None:
        """Go on with Tab, or back with Shift+Tab, until a control has the keyboard."""
        tab = (KEY.Key_Backtab, SHIFT) if back else (KEY.Key_Tab, PLAIN)
        passed = []
        for _ in range(MOST):
            if self.focus == name:
                return
            passed.append(self.focus)
            self.press(*tab)
        raise AssertionError(f"Tab never comes to {name!r}, but to {passed}")

    def choose(self, *words: str) -> None:
        """Choose an entry of the menu that is open, through its submenus."""
        for word in words:
            self._qtbot.waitUntil(lambda: QApplication.activePopupWidget() is not None)
            menu = QApplication.activePopupWidget()
            assert isinstance(menu, QMenu)
            for _ in range(MOST):
                action = menu.activeAction()
                if action is not None and action.text().replace("&", "").startswith(word):
                    break
                self.press(KEY.Key_Down)
            else:
                raise AssertionError(f"no {word!r} among {[a.text() for a in menu.actions()]}")
            self.press(KEY.Key_Return)

    def answer(self, typed: str = "", button: str = "") -> Callable[[], None]:
        """Answer the dialog that comes, by a text and Return or by one of its buttons.

        Returns what is to be called once it has gone.
        """
        said: list[str] = []

        def type_in() -> None:
            dialog = QApplication.activeModalWidget()
            if not isinstance(dialog, QDialog) or not dialog.isVisible():
                return
            timer.stop()
            # As above.
            dialog.activateWindow()
            QApplication.setActiveWindow(dialog)
            QApplication.processEvents()
            said.append(dialog.windowTitle())
            if button:
                self.to(button)
                self.press(KEY.Key_Space)
                return
            self.press(KEY.Key_A, CONTROL)
            self.press(typed)
            self.press(KEY.Key_Return)

        timer = QTimer()
        timer.timeout.connect(type_in)
        timer.start(50)

        def over() -> None:
            self._qtbot.waitUntil(lambda: bool(said), timeout=10000)
            timer.stop()
            self.activate()

        return over
