"""The table of objects in a dock of its own, as tall as the window, and the button for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QDockWidget, QMainWindow, QWidget

from napari_unpack.layers.compat import unwrap
from napari_unpack.widgets.dock_button import DockButton, DockContents
from napari_unpack.widgets.objects_pane import ObjectsPane
from napari_unpack.widgets.section import button, column, row
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.wheel_guard import WheelGuard

if TYPE_CHECKING:
    import napari

NAME = "Table of objects"

# Pixels: the narrowest, with names, states and volumes; the others in a wider dock.
WIDTH = 330

# Pixels that the picture keeps of its width.
LEAST_PICTURE = 300


class TableDock(DockContents):
    """A table with its search; `shown` tells whether it is to be seen.

    Parameters
    ----------
    viewer : napari.Viewer
    pane : ObjectsPane
        That shares model and selection with the panel's.
    """

    def __init__(self, viewer: napari.Viewer, pane: ObjectsPane) -> None:
        super().__init__(viewer, "unpacking_table")
        self.pane = pane
        # The panel's table has a search as well.
        pane.table.setAccessibleName("Table of objects")
        pane.search.setAccessibleName("Search the table of objects")
        pane.filter.setAccessibleName("Which objects the table lists")
        self.setMinimumWidth(WIDTH)
        self.columns = button("Columns…", "Choose which columns the table has.")
        self.columns.clicked.connect(self._open_columns)
        contents = column(self)
        contents.setContentsMargins(GAP, GAP, GAP, GAP)
        contents.addWidget(pane, stretch=1)
        contents.addWidget(row(self.columns))
        WheelGuard(self)

    def take_keyboard(self) -> None:
        """Give the keyboard to the table."""
        self.pane.table.setFocus(Qt.FocusReason.TabFocusReason)

    def _open_columns(self) -> None:
        menu = self.pane.table.columns_menu()
        menu.popup(self.columns.mapToGlobal(self.columns.rect().bottomLeft()))


class TableButton:
    """Opens the dock of the table and closes it.

    Parameters
    ----------
    viewer : napari.Viewer
    new_pane : callable
        Given the key of its columns, makes a table.

    Attributes
    ----------
    button : QPushButton
    dock : TableDock or None
        None until it is opened for the first time.
    """

    def __init__(self, viewer: napari.Viewer, new_pane: Callable[[str], ObjectsPane]) -> None:
        self._viewer, self._new_pane = viewer, new_pane
        self.button = button(
            "Table in a dock", "Show this table beside the 3D view, with room for more columns."
        )
        self._opener = DockButton(viewer, self.button, self._new_dock, self._add)
        self.end = self._opener.end

    @property
    def dock(self) -> TableDock | None:
        """What stands in the dock."""
        return self._opener.dock

    def _new_dock(self) -> TableDock:
        dock = TableDock(self._viewer, self._new_pane("dock"))
        dock.shown.connect(self._keep_panel)
        return dock

    def _add(self, dock: TableDock) -> None:
        unwrap(self._viewer).window.add_dock_widget(dock, name=NAME, area="right")
        self._stand_beside_the_panel(dock.parentWidget())

    def _stand_beside_the_panel(self, frame: QWidget | None) -> None:
        """Put the dock between picture and panel, as tall as both; below in a narrow window."""
        window, panel = self.button.window(), self._panel()
        if not (isinstance(window, QMainWindow) and isinstance(frame, QDockWidget)):
            return
        middle = window.centralWidget()
        if middle is not None and middle.width() < WIDTH + LEAST_PICTURE:
            self._opener.stand_beside_left_docks(window)
            window.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, frame)
        elif panel is not None:
            window.splitDockWidget(frame, panel, Qt.Orientation.Horizontal)

    def _keep_panel(self, shown: bool) -> None:
        """Give the room of a closed table to the picture, not to the panel beside it."""
        window, panel = self.button.window(), self._panel()
        if not shown and panel is not None and isinstance(window, QMainWindow):
            window.resizeDocks([panel], [panel.width()], Qt.Orientation.Horizontal)

    def _panel(self) -> QDockWidget | None:
        """Return the dock of the panel."""
        panel = self.button.parentWidget()
        while panel is not None and not isinstance(panel, QDockWidget):
            panel = panel.parentWidget()
        return panel
