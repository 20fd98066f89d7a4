"""Step 4: the table of objects, wired to the session both ways."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QComboBox, QLineEdit, QMenu

from napari_unpack.widgets.confidence_box import ConfidenceBox
from napari_unpack.widgets.object_model import ObjectModel
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.section import Section, button, label, row
from napari_unpack.widgets.workspace import Workspace

_SHOWN: dict[str, frozenset[str] | None] = {
    "All": None,
    "In the bag": frozenset({"PACKED"}),
    "Taken out": frozenset({"UNPACKED", "FLYING_OUT", "FLYING_BACK", "INSPECTED"}),
    "Hidden": frozenset({"HIDDEN"}),
}


_INSIDE = {"PACKED", "HIDDEN"}


class ObjectsSection(Section):
    """Find, select, hide, isolate and name objects.

    Parameters
    ----------
    workspace : Workspace
    ways : RevealPlanner
        Knows how buried objects are freed.
    """

    def __init__(self, workspace: Workspace, ways: RevealPlanner) -> None:
        super().__init__("4", "Objects")
        self._workspace, self._ways = workspace, ways
        self.model = ObjectModel(self)
        self.table = ObjectTable(self.model)
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search names")
        self.search.setClearButtonEnabled(True)
        self.search.setToolTip("List only the objects whose name contains this, or with this ID.")
        self.filter = QComboBox()
        self.filter.addItems(list(_SHOWN))
        self.filter.setToolTip("List only the objects that are here.")
        self.isolate = button("Isolate", "Show the selected objects alone.")
        self.hide_chosen = button("Hide", "Hide the selected objects from the picture (H).")
        self.show_all = button("Show all", "Show every hidden object again.")

        self.repair = RepairTools(workspace, self)
        self.split = button(
            "Split", "Split an object: click two points of it, in the picture or in a 2D slice."
        )
        self.split.setCheckable(True)
        self.merge = button("Merge", "Make one object of the selected ones (Ctrl-click rows).")
        self.delete = button(
            "Delete", "Take the selected objects out of the labels. Ctrl+Z undoes."
        )
        self.next_click = label("", "hint", wrap=True)
        self.next_click.hide()

        self.contents.addLayout(row(self.search, self.filter))
        self.contents.addWidget(self.table, stretch=1)
        self.contents.addLayout(row(self.isolate, self.hide_chosen, self.show_all))
        self.contents.addLayout(row(self.split, self.merge, self.delete))
        self.contents.addWidget(self.next_click)
        self.confidence = ConfidenceBox(workspace, self._chosen, self._reload)
        self.contents.addWidget(self.confidence)

        self.search.textChanged.connect(self.table.rows.keep_text)
        self.filter.currentTextChanged.connect(
            lambda text: self.table.rows.keep_states(_SHOWN[text])
        )
        self.isolate.clicked.connect(lambda: self._workspace.isolate(self._chosen()))
        self.hide_chosen.clicked.connect(lambda: self._workspace.hide(self._chosen()))
        self.show_all.clicked.connect(self._show_all)
        self.split.clicked.connect(lambda: self.repair.split_by_clicks())
        self.merge.clicked.connect(lambda: self.repair.merge(self._chosen()))
        self.delete.clicked.connect(lambda: self.repair.delete(self._chosen()))
        self.repair.splitting.connect(self._say_next_click)
        self.repair.busy.connect(lambda _: self._enable())
        self.table.eye_clicked.connect(self._toggle_eye)
        self.table.swatch_clicked.connect(self._toggle_alone)
        self.table.ids_selected.connect(self._workspace.select)
        self.table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.table.customContextMenuRequested.connect(self._open_menu)
        ways.found.connect(lambda one: self.model.refresh(first=(one and one.first) or ()))
        workspace.staged.connect(self._reload)
        workspace.changed.connect(self._refresh)
        self._reload()

    def _reload(self) -> None:
        session = self._workspace.session
        self.model.load(session)
        if session is not None:
            self.table.show_selection(frozenset(session.selected))
        self.lock("Objects appear here after step 1." if session is None else None)
        self._count()
        self._enable()

    def _refresh(self, news: frozenset[str]) -> None:
        if "labels" in news:
            self.model.load(self._workspace.session)
            self.table.show_selection(frozenset(self._workspace.session.selected))
            self._count()
        elif news & {"states", "hues", "queue"}:
            self.model.refresh()
            self._count()
        if "selected" in news:
            self.table.show_selection(frozenset(self._workspace.session.selected))
        self._enable()

    def mark_free(self, ids: frozenset[int]) -> None:
        """Mark the objects that nothing blocks now."""
        self.model.refresh(free=ids)

    def _count(self) -> None:
        session = self._workspace.session
        if session is None:
            self.set_status("")
            return
        hidden = len(self._in("HIDDEN"))
        self.set_status(f"{len(session.states)}" + (f", {hidden} hidden" if hidden else ""))

    def _enable(self) -> None:
        some = self._workspace.session is not None and bool(self._chosen())
        self.isolate.setEnabled(some)
        self.hide_chosen.setEnabled(some)
        idle = self._workspace.session is not None and not self.repair.running
        self.split.setEnabled(idle)
        self.merge.setEnabled(idle and len(self._chosen()) > 1)
        self.delete.setEnabled(idle and some)
        self.show_all.setEnabled(bool(self._in("HIDDEN")))
        self.confidence.refresh()

    def _say_next_click(self, words: str) -> None:
        self.split.setChecked(bool(words))
        self.next_click.setText(words)
        self.next_click.setVisible(bool(words))

    def _in(self, *states: str) -> list[int]:
        session = self._workspace.session
        if session is None:
            return []
        return [i for i, state in session.states.items() if state.name in states]

    def _chosen(self) -> list[int]:
        return self.table.selected_ids()

    def _show_all(self) -> None:
        self._workspace.show(self._in("HIDDEN"))

    def _toggle_eye(self, object_id: int) -> None:
        hidden = object_id in self._in("HIDDEN")
        (self._workspace.show if hidden else self._workspace.hide)([object_id])

    def _toggle_alone(self, object_id: int) -> None:
        alone = self._in("PACKED") == [object_id] and bool(self._in("HIDDEN"))
        if alone:
            self._show_all()
        else:
            self._workspace.isolate([object_id])

    def _open_menu(self, position: Any) -> None:
        menu = self.menu()
        if menu is not None:
            menu.popup(self.table.viewport().mapToGlobal(position))

    def menu(self) -> QMenu | None:
        """Make the context menu of the selected rows; None where none is selected."""
        ids = self._chosen()
        if not ids:
            return None
        workspace, ways = self._workspace, self._ways
        states = {workspace.session.states[i].name for i in ids}
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        entries = (
            ("Unpack", lambda: workspace.unpack(ids), "PACKED" in states),
            ("Reveal…", lambda: ways.reveal(ids[0]), len(ids) == 1 and "PACKED" in states),
            ("Restore", lambda: workspace.restore(ids), "UNPACKED" in states),
            (
                "Inspect",
                lambda: workspace.inspect(ids[0]),
                len(ids) == 1 and "HIDDEN" not in states,
            ),
            (None, None, False),
            ("Merge", lambda: self.repair.merge(ids), len(ids) > 1 and states <= _INSIDE),
            ("Delete", lambda: self.repair.delete(ids), states <= _INSIDE),
            (None, None, False),
            ("Isolate", lambda: workspace.isolate(ids), True),
            ("Hide", lambda: workspace.hide(ids), states != {"HIDDEN"}),
            ("Show", lambda: workspace.show(ids), "HIDDEN" in states),
            ("Show all", self._show_all, bool(self._in("HIDDEN"))),
            (None, None, False),
            ("Keep colour", lambda: workspace.keep_hues(ids), not set(ids) <= workspace.kept_hues),
            (
                "Let colour change",
                lambda: workspace.keep_hues(ids, False),
                bool(set(ids) & workspace.kept_hues),
            ),
            (None, None, False),
            (
                "Mark good",
                lambda: workspace.mark_examples(ids),
                not set(ids) <= workspace.session.examples,
            ),
            (
                "Unmark",
                lambda: workspace.mark_examples(ids, False),
                bool(set(ids) & workspace.session.examples),
            ),
        )
        for text, act, enabled in entries:
            if text is None:
                menu.addSeparator()
                continue
            action = menu.addAction(text)
            action.setEnabled(enabled)
            action.triggered.connect(act)
        return menu
