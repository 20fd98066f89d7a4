"""Step 4: the table of objects, connected to the session both ways."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QComboBox, QLineEdit, QMenu

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.confidence_box import ConfidenceBox
from napari_unpack.widgets.object_model import ObjectModel
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.section import Section, button, label, row
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from qtpy.QtCore import QPoint

    MenuEntry = tuple[str, Callable[[], object], bool]

FILTERS: dict[str, frozenset[ObjectState] | None] = {
    "All": None,
    "In the bag": frozenset({ObjectState.PACKED}),
    "Taken out": frozenset(ObjectState) - {ObjectState.PACKED, ObjectState.HIDDEN},
    "Hidden": frozenset({ObjectState.HIDDEN}),
}


class ObjectsSection(Section):
    """Find, select, hide, isolate, name and repair objects.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    planner : RevealPlanner
        Finds what blocks an object.
    """

    def __init__(self, workspace: Workspace, commands: Commands, planner: RevealPlanner) -> None:
        super().__init__("4", "Objects")
        self._workspace, self._commands, self._planner = workspace, commands, planner
        self.model = ObjectModel(commands.rename, self)
        self.table = ObjectTable(self.model)
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search names")
        self.search.setClearButtonEnabled(True)
        self.search.setToolTip("List only the objects whose name contains this, or with this ID.")
        self.filter = QComboBox()
        self.filter.addItems(list(FILTERS))
        self.filter.setToolTip("List all objects, or only those in the bag, outside or hidden.")
        self.isolate = button("Isolate", "Hide all objects but the selected ones.")
        self.hide_chosen = button("Hide", "Hide the selected objects in the 3D view (H).")
        self.show_all = button("Show all", "Show every hidden object again.")

        self.repair = RepairTools(workspace, self)
        self.split = button(
            "Split", "Split an object: click two points of it, in the 3D view or in a 2D slice."
        )
        self.split.setCheckable(True)
        self.merge = button("Merge", "Make one object of the selected ones (Ctrl-click rows).")
        self.delete = button(
            "Delete",
            "Remove the selected objects from the labels (Delete; Ctrl+Z undoes). "
            "Restore those outside the bag first.",
        )
        self.next_click = label("", "hint", wrap=True)
        self.next_click.hide()

        self.contents.addLayout(row(self.search, self.filter))
        self.contents.addWidget(self.table, stretch=1)
        self.contents.addLayout(row(self.isolate, self.hide_chosen, self.show_all))
        self.contents.addLayout(row(self.split, self.merge, self.delete))
        self.contents.addWidget(self.next_click)
        self.confidence = ConfidenceBox(workspace, commands, self.table.selected_ids, self._reload)
        self.contents.addWidget(self.confidence)
        self._connect()
        self._reload()

    def _connect(self) -> None:
        commands, chosen = self._commands, self.table.selected_ids
        self.search.textChanged.connect(self.table.rows.keep_text)
        self.filter.currentTextChanged.connect(
            lambda text: self.table.rows.keep_states(FILTERS[text])
        )
        self.isolate.clicked.connect(lambda: commands.isolate(chosen()))
        self.hide_chosen.clicked.connect(lambda: commands.hide(chosen()))
        self.show_all.clicked.connect(commands.show_all)
        self.split.clicked.connect(lambda: self.repair.split_by_clicks())
        self.merge.clicked.connect(lambda: self.repair.merge(chosen()))
        self.delete.clicked.connect(lambda: self.repair.delete(chosen()))
        self.repair.splitting.connect(self._show_next_click)
        self.repair.busy.connect(lambda _: self._enable())
        self.table.eye_clicked.connect(self._toggle_shown)
        self.table.swatch_clicked.connect(self._toggle_isolated)
        self.table.ids_selected.connect(commands.select)
        self.table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.table.customContextMenuRequested.connect(self._open_menu)
        self._planner.found.connect(
            lambda plan: self.model.refresh(first=() if plan is None else plan.first)
        )
        self._workspace.switched.connect(self._reload)
        self._workspace.changed.connect(self._refresh)

    def _reload(self) -> None:
        session = self._workspace.session
        self.model.load(session)
        if session is not None:
            self.table.show_selection(frozenset(session.selected))
        self.lock("Objects appear here after step 1." if session is None else None)
        self._count()
        self._enable()

    def _refresh(self, change: Change) -> None:
        session = self._workspace.session
        if session is None:
            return
        if Change.LABELS in change:
            # Rows came or went, so that refreshing in place is not possible.
            self.model.load(session)
            self._count()
        elif change & (Change.STATES | Change.HUES | Change.QUEUE):
            self.model.refresh()
            self._count()
        if change & (Change.SELECTED | Change.LABELS):
            self.table.show_selection(frozenset(session.selected))
        self._enable()

    def mark_unpackable(self, ids: frozenset[int]) -> None:
        """Mark the objects that nothing blocks now."""
        self.model.refresh(unpackable=ids)

    def _count(self) -> None:
        session = self._workspace.session
        if session is None:
            self.set_status("")
            return
        hidden = len(objects_in(session, ObjectState.HIDDEN))
        self.set_status(f"{len(session.states)}" + (f", {hidden} hidden" if hidden else ""))

    def _enable(self) -> None:
        session, chosen = self._workspace.session, self.table.selected_ids()
        is_open = session is not None
        # One repair at a time: the second would start from labels that are about to change.
        idle = is_open and not self.repair.running
        self.isolate.setEnabled(is_open and bool(chosen))
        self.hide_chosen.setEnabled(is_open and bool(chosen))
        self.split.setEnabled(idle)
        self.merge.setEnabled(self.repair.can_merge(chosen))
        self.delete.setEnabled(self.repair.can_delete(chosen))
        self.show_all.setEnabled(bool(objects_in(session, ObjectState.HIDDEN)))
        self.confidence.refresh()

    def _show_next_click(self, sentence: str) -> None:
        self.split.setChecked(bool(sentence))
        self.next_click.setText(sentence)
        self.next_click.setVisible(bool(sentence))

    def _toggle_shown(self, object_id: int) -> None:
        hidden = object_id in objects_in(self._workspace.session, ObjectState.HIDDEN)
        (self._commands.show if hidden else self._commands.hide)([object_id])

    def _toggle_isolated(self, object_id: int) -> None:
        session = self._workspace.session
        alone = objects_in(session, ObjectState.PACKED) == [object_id]
        # A second click on the same swatch is the way back.
        if alone and objects_in(session, ObjectState.HIDDEN):
            self._commands.show_all()
        else:
            self._commands.isolate([object_id])

    def _open_menu(self, position: QPoint) -> None:
        menu = self.menu()
        if menu is not None:
            menu.popup(self.table.viewport().mapToGlobal(position))

    def menu(self) -> QMenu | None:
        """Make the context menu of the selected rows; None where none is selected."""
        ids, session = self.table.selected_ids(), self._workspace.session
        if not ids or session is None:
            return None
        commands, repair, planner = self._commands, self.repair, self._planner
        states, chosen, one = {session.states[i] for i in ids}, set(ids), len(ids) == 1
        packed, hidden = ObjectState.PACKED in states, ObjectState.HIDDEN in states
        locked, examples = session.locked_hues, session.examples
        blocks: list[list[MenuEntry]] = [
            [
                ("Unpack", lambda: commands.unpack(ids), packed),
                ("Reveal…", lambda: planner.reveal(ids[0]), one and packed),
                ("Restore", lambda: commands.restore(ids), ObjectState.UNPACKED in states),
                ("Inspect", lambda: commands.inspect(ids[0]), one and not hidden),
            ],
            [
                ("Merge", lambda: repair.merge(ids), repair.can_merge(ids)),
                ("Delete", lambda: repair.delete(ids), repair.can_delete(ids)),
            ],
            [
                ("Isolate", lambda: commands.isolate(ids), True),
                ("Hide", lambda: commands.hide(ids), states != {ObjectState.HIDDEN}),
                ("Show", lambda: commands.show(ids), hidden),
                ("Show all", commands.show_all, bool(objects_in(session, ObjectState.HIDDEN))),
            ],
            [
                ("Keep colour", lambda: commands.lock_hues(ids), not chosen <= locked),
                (
                    "Let colour change",
                    lambda: commands.lock_hues(ids, False),
                    bool(chosen & locked),
                ),
            ],
            [
                ("Mark as example", lambda: commands.mark_examples(ids), not chosen <= examples),
                ("Unmark", lambda: commands.mark_examples(ids, False), bool(chosen & examples)),
            ],
        ]
        menu = QMenu(self)
        # Or every menu ever opened would stay with the panel.
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for block in blocks:
            if not menu.isEmpty():
                menu.addSeparator()
            for text, act, enabled in block:
                action = menu.addAction(text)
                action.setEnabled(enabled)
                action.triggered.connect(act)
        return menu
