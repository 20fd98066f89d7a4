"""The table of objects in a dock of its own, as tall as the window, and the button for it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, QSignalBlocker, Qt, Signal
from qtpy.QtWidgets import QDockWidget, QMainWindow, QWidget

from napari_unpack.layers.compat import unwrap
from napari_unpack.widgets.objects_pane import ObjectsPane
from napari_unpack.widgets.section import button, column, row
from napari_unpack.widgets.theme import GAP, palette_of, style_sheet
from napari_unpack.widgets.wheel_guard import WheelGuard

if TYPE_CHECKING:
    import napari
    from napari.utils.events import Event
    from qtpy.QtGui import QHideEvent, QShowEvent

NAME = "Table of objects"

# Pixels: the narrowest, with names, states and volumes; the others in a wider dock.
WIDTH = 330

# Pixels that the picture keeps of its width.
LEAST_PICTURE = 300


class TableDock(QWidget):
    """A table with its search; `shown` tells whether it is to be seen.

    Parameters
    ----------
    viewer : napari.Viewer
    pane : ObjectsPane
        That shares model and selection with the panel's.
    """

    shown = Signal(bool)

    def __init__(self, viewer: napari.Viewer, pane: ObjectsPane) -> None:
        super().__init__()
        # The style sheet names the panel; what stands beside it looks like it.
        self.setObjectName("unpacking_table")
        self._viewer, self.pane = viewer, pane
        self.setMinimumWidth(WIDTH)
        self.columns = button("Columns…", "Choose which columns the table has.")
        self.columns.clicked.connect(self._open_columns)
        contents = column(self)
        contents.setContentsMargins(GAP, GAP, GAP, GAP)
        contents.addWidget(pane, stretch=1)
        contents.addLayout(row(self.columns))
        WheelGuard(self)
        viewer.events.theme.connect(self._dress)
        self._dress()

    def end(self) -> None:
        """Stop listening."""
        self._viewer.events.theme.disconnect(self._dress)

    def _open_columns(self) -> None:
        menu = self.pane.table.columns_menu()
        menu.popup(self.columns.mapToGlobal(self.columns.rect().bottomLeft()))

    def _dress(self, _event: Event | None = None) -> None:
        self.setStyleSheet(style_sheet(palette_of(self._viewer.theme)))

    def showEvent(self, event: QShowEvent) -> None:
        """Tell that it is seen."""
        super().showEvent(event)
        self.shown.emit(True)

    def hideEvent(self, event: QHideEvent) -> None:
        """Tell that it is not seen."""
        super().hideEvent(event)
        self.shown.emit(False)


class TableButton(QObject):
    """Opens the dock of the table and closes it.

    Parameters
    ----------
    viewer : napari.Viewer
    new_pane : callable
        Given the key of its columns, makes a table.
    parent : QObject, optional

    Attributes
    ----------
    button : QPushButton
    dock : TableDock or None
        None until it is opened for the first time.
    """

    def __init__(
        self,
        viewer: napari.Viewer,
        new_pane: Callable[[str], ObjectsPane],
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._viewer, self._new_pane = viewer, new_pane
        self.dock: TableDock | None = None
        self.button = button(
            "Table in a dock", "Show this table beside the 3D view, with all its columns."
        )
        self.button.setCheckable(True)
        self.button.toggled.connect(self._toggle)

    def end(self) -> None:
        """Take the dock away."""
        dock, self.dock = self.dock, None
        if dock is None:
            return
        dock.shown.disconnect(self._follow)
        dock.end()
        # The window may have taken it away, or have gone itself.
        with suppress(LookupError, RuntimeError):
            unwrap(self._viewer).window.remove_dock_widget(dock)
        dock.deleteLater()

    def _toggle(self, wanted: bool) -> None:
        if self.dock is None:
            if not wanted:
                return
            self.dock = TableDock(self._viewer, self._new_pane("dock"))
            self.dock.shown.connect(self._follow)
        # Closed by its own cross it has been taken out of its frame, which is gone.
        if wanted and self.dock.parentWidget() is None:
            unwrap(self._viewer).window.add_dock_widget(self.dock, name=NAME, area="right")
            self._stand_beside_the_panel(self.dock.parentWidget())
        frame = self.dock.parentWidget()
        if frame is not None:
            frame.setVisible(wanted)

    def _stand_beside_the_panel(self, frame: QWidget | None) -> None:
        """Put the dock between picture and panel, as tall as both; below in a narrow window."""
        window, panel = self.button.window(), self.button.parentWidget()
        while panel is not None and not isinstance(panel, QDockWidget):
            panel = panel.parentWidget()
        if not (isinstance(window, QMainWindow) and isinstance(frame, QDockWidget)):
            return
        middle = window.centralWidget()
        if middle is not None and middle.width() < WIDTH + LEAST_PICTURE:
            window.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, frame)
        elif panel is not None:
            window.splitDockWidget(frame, panel, Qt.Orientation.Horizontal)

    def _follow(self, shown: bool) -> None:
        """Show whether the dock is open, however it was opened or closed."""
        with QSignalBlocker(self.button):
            self.button.setChecked(shown)
