"""What is disabled or hidden keeps the keyboard it had."""

from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QVBoxLayout, QWidget

from keys import KEY, Keys
from napari_unpack.widgets.section import button


def test_a_button_disabled_while_another_window_is_active_keeps_the_keyboard(qtbot: QtBot) -> None:
    window, dialog = QWidget(), QWidget()
    one, two = button("One", ""), button("Two", "")
    pressed: list[object] = []
    two.clicked.connect(lambda: pressed.append(two))
    layout = QVBoxLayout(window)
    for widget in (one, two):
        layout.addWidget(widget)
    for each in (window, dialog):
        qtbot.addWidget(each)
        each.show()
    keys = Keys(window, qtbot)
    one.setFocus()
    Keys(dialog, qtbot)
    one.setEnabled(False)
    assert window.focusWidget() is one
    dialog.close()
    keys.activate()
    keys.press(KEY.Key_Space)
    assert not pressed
    keys.press(KEY.Key_Tab)
    assert keys.focus == "Two"
