"""A dialog for the colour and the opacity of objects, which shows each choice at once."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject
from qtpy.QtGui import QColor
from qtpy.QtWidgets import QColorDialog, QDialog, QDialogButtonBox, QLabel, QWidget

from napari_unpack.appearance import tints_of
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.inspection_box import APPLY_MS
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session.history import Step


class ColorChooser(QObject):
    """Asks for the colour of objects, beside the picture that shows it.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    parent : QWidget
        Of the dialog.
    """

    def __init__(self, workspace: Workspace, commands: Commands, parent: QWidget) -> None:
        super().__init__(parent)
        self._workspace, self._commands, self._parent = workspace, commands, parent
        self._ids: list[int] = []
        # The one that the dialog made; another may follow it while the dialog is open.
        self._made: Step | None = None
        self.dialog: QColorDialog | None = None
        workspace.switched.connect(self._close)

    def choose(self, ids: Iterable[int]) -> None:
        """Open the dialog for some objects, at the colour of the first."""
        session = self._workspace.session
        self._close()
        self._ids, self._made = list(ids), None
        if session is None or not self._ids:
            return
        first, names = self._ids[0], session.objects["name"]
        own = session.state.colors.get(first)
        tint = tints_of({first: session.hues[first]}, first, mode=session.tint_mode)[first]
        dialog = _dialog(QColor.fromRgbF(*(float(v) for v in own or tint)), self._parent)
        more = f" and {len(self._ids) - 1} more" if len(self._ids) > 1 else ""
        dialog.setWindowTitle(f"Colour of {names[first]}{more}")
        buttons = dialog.findChild(QDialogButtonBox)
        automatic = buttons.addButton("Automatic", QDialogButtonBox.ButtonRole.ResetRole)
        automatic.setToolTip("Take the hue that the view chooses, and full opacity, again.")
        automatic.clicked.connect(self._take_automatic)
        dialog.currentColorChanged.connect(lambda _: self._apply_soon())
        dialog.finished.connect(self._finish)
        self.dialog = dialog
        # Not modal: one turns the bag to see what the colour does.
        dialog.show()

    def _apply_soon(self) -> None:
        self._workspace.scheduler.throttle(APPLY_MS, self._apply)

    def _apply(self) -> None:
        session = self._workspace.session
        if self.dialog is not None and session is not None:
            color, before = self.dialog.currentColor().getRgbF(), session.history.done
            self._commands.annotate.color(self._ids, color, merge=self._is_last)
            # The colour that there is already makes no step, and there and back again takes one.
            if (last := session.history.done[-1:]) and last[0] not in before:
                (self._made,) = last

    @property
    def _is_last(self) -> bool:
        """Whether the step that the dialog made is what an undo would take back."""
        session = self._workspace.session
        return session is not None and self._made in session.history.done[-1:]

    def _take_automatic(self) -> None:
        self._workspace.scheduler.forget(self._apply)
        self._commands.annotate.color(self._ids, None, merge=self._is_last)
        self._close()

    def _finish(self, result: int) -> None:
        self._workspace.scheduler.forget(self._apply)
        session = self._workspace.session
        if result == QDialog.DialogCode.Accepted:
            # The last choice may still wait; one that was there before is taken over as well.
            self._apply()
        elif session is not None and self._is_last:
            session.undo()
        self.dialog = None

    def _close(self) -> None:
        dialog, self.dialog = self.dialog, None
        self._workspace.scheduler.forget(self._apply)
        if dialog is not None:
            dialog.finished.disconnect(self._finish)
            dialog.close()


def _dialog(color: QColor, parent: QWidget) -> QColorDialog:
    dialog = QColorDialog(color, parent)
    # Qt's own on every system: those of the systems take no further button.
    dialog.setOption(QColorDialog.ColorDialogOption.DontUseNativeDialog)
    dialog.setOption(QColorDialog.ColorDialogOption.ShowAlphaChannel)
    # The option changes the channel of a colour set before.
    dialog.setCurrentColor(color)
    for words in dialog.findChildren(QLabel):
        if "lpha" in words.text():
            words.setText("&Opacity:")
    return dialog
