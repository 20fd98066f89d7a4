"""The button that opens the dock of slices and closes it."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt

from napari_unpack.layers.compat import native_window, unwrap
from napari_unpack.widgets.dock_button import DockButton
from napari_unpack.widgets.remembered import remembered
from napari_unpack.widgets.section import button
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.widgets.slices_dock import SlicesDock

NAME = "Slices"
# Of what is remembered.
OPEN = "slices/open"


class SlicesButton:
    """Opens three linked slices beside the 3D view; whether they are open is remembered.

    Parameters
    ----------
    workspace : Workspace

    Attributes
    ----------
    button : QPushButton
    dock : SlicesDock or None
        None until it is opened for the first time.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.button = button(
            NAME, "Open three slices that follow the mouse, and that the 3D view follows."
        )
        self._opener = DockButton(workspace.viewer, self.button, self._new_dock, self._add)
        self.end = self._opener.end
        workspace.switched.connect(self._reopen)

    @property
    def dock(self) -> SlicesDock | None:
        """What stands in the dock."""
        return self._opener.dock

    def _reopen(self) -> None:
        """Open the dock with the first session where it was open the last time."""
        first = self.dock is None and self._workspace.controller is not None
        if first and remembered().value(OPEN, False, type=bool):
            self.button.setChecked(True)

    def _new_dock(self) -> SlicesDock:
        # What draws slices takes seconds to import, which the panel need not wait for.
        from napari_unpack.widgets.slices_dock import SlicesDock

        dock = SlicesDock(self._workspace)
        dock.shown.connect(self._remember)
        return dock

    def _add(self, dock: SlicesDock) -> None:
        viewer = self._workspace.viewer
        native = native_window(viewer)
        if native is not None:
            self._opener.stand_beside_left_docks(native)
            # Slices are tall as well: above them nothing would be left of the panel.
            right = Qt.DockWidgetArea.RightDockWidgetArea
            self._opener.give_corner(native, Qt.Corner.BottomRightCorner, right)
        window = unwrap(viewer).window
        docked = window.add_dock_widget(dock, name=NAME, area="bottom", add_vertical_stretch=False)
        if native is not None:
            # Half of a low window is the picture's, however tall the slices would like to be.
            height = min(docked.sizeHint().height(), native.height() // 2)
            native.resizeDocks([docked], [height], Qt.Orientation.Vertical)

    def _remember(self, shown: bool) -> None:
        window = native_window(self._workspace.viewer)
        # With the whole window, or what is left of it, it is hidden too, and open the next time.
        with suppress(RuntimeError):
            if self.dock is not None and window is not None and window.isVisible():
                remembered().setValue(OPEN, shown)
