"""The button that opens the dock of slices and closes it."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, QSignalBlocker

from napari_unpack.layers.compat import native_window, unwrap
from napari_unpack.widgets.remembered import remembered
from napari_unpack.widgets.section import button
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.widgets.slices_dock import SlicesDock

NAME = "Slices"
# Of what is remembered.
OPEN = "slices/open"


class SlicesButton(QObject):
    """Opens three linked slices beside the 3D view; whether they are open is remembered.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional

    Attributes
    ----------
    button : QPushButton
    dock : SlicesDock or None
        None until it is opened for the first time.
    """

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self.dock: SlicesDock | None = None
        self.button = button(
            NAME, "Open three slices that follow the mouse, and that the 3D view follows."
        )
        self.button.setCheckable(True)
        self.button.toggled.connect(self._toggle)
        workspace.switched.connect(self._reopen)

    def end(self) -> None:
        """Take the dock away."""
        dock, self.dock = self.dock, None
        if dock is None:
            return
        dock.shown.disconnect(self._follow)
        dock.end()
        # The window may have taken it away, or have gone itself.
        with suppress(LookupError, RuntimeError):
            unwrap(self._workspace.viewer).window.remove_dock_widget(dock)
        dock.deleteLater()

    def _reopen(self) -> None:
        """Open the dock with the first session where it was open the last time."""
        first = self.dock is None and self._workspace.controller is not None
        if first and remembered().value(OPEN, False, type=bool):
            self.button.setChecked(True)

    def _toggle(self, wanted: bool) -> None:
        if not wanted:
            if self.dock is not None and self.dock.parentWidget() is not None:
                self.dock.parentWidget().close()
            return
        if self.dock is None:
            # What draws slices takes seconds to import, which the panel need not wait for.
            from napari_unpack.widgets.slices_dock import SlicesDock

            self.dock = SlicesDock(self._workspace)
            self.dock.shown.connect(self._follow)
        # Closed by its own cross it has been taken out of its frame, which is gone.
        if self.dock.parentWidget() is None:
            window = unwrap(self._workspace.viewer).window
            window.add_dock_widget(self.dock, name=NAME, area="bottom", add_vertical_stretch=False)
        self.dock.parentWidget().show()
        self.dock.parentWidget().raise_()

    def _follow(self, shown: bool) -> None:
        """Show whether the dock is open, however it was opened or closed."""
        with QSignalBlocker(self.button):
            self.button.setChecked(shown)
        window = native_window(self._workspace.viewer)
        # With the whole window, or what is left of it, it is hidden too, and open the next time.
        with suppress(RuntimeError):
            if window is not None and window.isVisible():
                remembered().setValue(OPEN, shown)
