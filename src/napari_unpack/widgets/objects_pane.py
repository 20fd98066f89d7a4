"""Search, filter and table of the objects, for the panel and for a dock of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QMenu, QWidget

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.color_chooser import ColorChooser
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.narrow import Choice, Field
from napari_unpack.widgets.object_columns import FLAG_ROUND, Column, Row
from napari_unpack.widgets.object_menu import ObjectMenu
from napari_unpack.widgets.object_model import ObjectModel
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.section import column, row
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from qtpy.QtCore import QPoint
    from qtpy.QtGui import QKeyEvent

FILTERS: dict[str, Callable[[Row], bool]] = {
    "All": lambda row: True,
    "In the bag": lambda row: row.state is ObjectState.PACKED,
    "Unpacked": lambda row: row.state not in (ObjectState.PACKED, ObjectState.HIDDEN),
    "Hidden": lambda row: row.state is ObjectState.HIDDEN,
    "Flagged": lambda row: row.flag is not None,
    "With a note": lambda row: bool(row.note),
}


class Search(Field):
    """A field that Escape empties; where it is empty, Escape is the viewer's."""

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Empty it by Escape."""
        if event.key() == Qt.Key.Key_Escape and self.text():
            self.clear()
        else:
            super().keyPressEvent(event)


class ObjectsPane(QWidget):
    """One table of the objects with its search; several share model, selection and menu.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    model : ObjectModel
    actions : ObjectMenu
    chooser : ColorChooser
    key : str
        Under which the columns are remembered.
    """

    def __init__(
        self,
        workspace: Workspace,
        commands: Commands,
        model: ObjectModel,
        actions: ObjectMenu,
        chooser: ColorChooser,
        key: str,
    ) -> None:
        super().__init__()
        self._workspace, self._commands = workspace, commands
        self._actions = actions
        self.table = ObjectTable(model, key)
        self.search = Search()
        self.search.setPlaceholderText("Search objects")
        self.search.setAccessibleName("Search objects")
        self.search.setClearButtonEnabled(True)
        self.search.setToolTip(
            "List only the objects with this in their name, note or flag, or with this ID."
        )
        self.filter = Choice(*FILTERS)
        self.filter.setAccessibleName("Which objects are listed")
        self.filter.setToolTip(
            "List all objects, or only those in the bag, unpacked, hidden, flagged or with a note."
        )
        contents = column(self)
        contents.addWidget(row(self.search, self.filter))
        contents.addWidget(self.table, stretch=1)
        table = self.table
        self.search.textChanged.connect(table.rows.keep_text)
        self.filter.currentTextChanged.connect(lambda text: table.rows.keep(FILTERS[text]))
        # Rows that come back are selected as they were.
        self.search.textChanged.connect(lambda _: self.show_selection())
        self.filter.currentTextChanged.connect(lambda _: self.show_selection())
        table.eye_clicked.connect(self._toggle_shown)
        table.swatch_clicked.connect(lambda i: chooser.choose(self._with(i)))
        table.flag_clicked.connect(self._turn_flag)
        table.ids_selected.connect(commands.select)
        table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        table.customContextMenuRequested.connect(self._open_menu)
        model.modelReset.connect(self.show_selection)
        workspace.changed.connect(self._follow)
        self.show_selection()

    def show_selection(self) -> None:
        """Select the rows of what is selected in the session."""
        session = self._workspace.session
        if session is not None:
            self.table.show_selection(frozenset(session.selected))

    def menu(self) -> QMenu | None:
        """Make the context menu of the selected rows; None where none is selected."""
        table = self.table
        return self._actions.of(table.selected_ids(), self, lambda i: table.write(i, Column.NOTE))

    def _follow(self, change: Change) -> None:
        if change & (Change.SELECTED | Change.LABELS):
            self.show_selection()

    def _with(self, object_id: int) -> list[int]:
        """Return the selected objects where this is one of them, else this alone."""
        chosen = self.table.selected_ids()
        return chosen if object_id in chosen else [object_id]

    def _toggle_shown(self, object_id: int) -> None:
        hidden = object_id in objects_in(self._workspace.session, ObjectState.HIDDEN)
        (self._commands.show if hidden else self._commands.hide)([object_id])

    def _turn_flag(self, object_id: int) -> None:
        session = self._workspace.session
        if session is not None:
            now = FLAG_ROUND.index(session.state.flags.get(object_id))
            after = FLAG_ROUND[(now + 1) % len(FLAG_ROUND)]
            self._commands.annotate.flag(self._with(object_id), after)

    def _open_menu(self, position: QPoint) -> None:
        menu = self.menu()
        if menu is not None:
            menu.popup(self.table.viewport().mapToGlobal(position))
