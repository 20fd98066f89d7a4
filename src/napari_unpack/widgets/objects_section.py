"""Step 4: the table of objects, connected to the session both ways."""

from __future__ import annotations

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.color_chooser import ColorChooser
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.confidence_box import ConfidenceBox
from napari_unpack.widgets.confidence_reasons import ConfidenceReasons
from napari_unpack.widgets.object_menu import ObjectMenu
from napari_unpack.widgets.object_model import ObjectModel
from napari_unpack.widgets.object_sizes import ObjectSizes
from napari_unpack.widgets.objects_pane import ObjectsPane
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.review_box import ReviewBox
from napari_unpack.widgets.section import Section, button, label, row, scroll_to_new
from napari_unpack.widgets.table_dock import TableButton
from napari_unpack.widgets.workspace import Change, Workspace


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
        self.repair = RepairTools(workspace, self)
        self.chooser = ColorChooser(workspace, commands, self)
        self._sizes = ObjectSizes(workspace, self)
        why = ConfidenceReasons(workspace, self).of
        self.model = ObjectModel(commands.rename, self, commands.annotate.note, self._sizes, why)
        self._actions = ObjectMenu(workspace, commands, planner, self.repair, self.chooser)
        self.pane = self.new_pane("panel")
        self.table = self.pane.table
        self.isolate = button("Isolate", "Hide all objects but the selected ones.")
        self.hide_chosen = button("Hide", "Hide the selected objects in the 3D view (H).")
        self.show_all = button("Show all", "Show every hidden object again.")

        self.split = button(
            "Split", "Split an object: click two points of it, in the 3D view or in slices."
        )
        self.split.setCheckable(True)
        self.merge = button(
            "Merge", "Make one object of the selected ones (Ctrl+click selects several)."
        )
        self.delete = button(
            "Delete",
            "Remove the selected objects from the labels (Delete; Ctrl+Z undoes). "
            "Restore unpacked ones first.",
        )
        self.table_button = TableButton(workspace.viewer, self.new_pane)
        self.next_click = label("", "hint", wrap=True)
        self.next_click.hide()

        self.contents.addWidget(self.pane, stretch=1)
        self.contents.addWidget(row(self.isolate, self.hide_chosen, self.show_all))
        self.contents.addWidget(row(self.split, self.merge, self.delete))
        self.contents.addWidget(self.next_click)
        self.contents.addWidget(self.table_button.button)
        self.review = ReviewBox(workspace, self.repair)
        self.contents.addWidget(self.review)
        self.confidence = ConfidenceBox(workspace, commands, self.chosen)
        self.contents.addWidget(self.confidence)
        self._connect()
        self._reload()

    def _connect(self) -> None:
        commands, chosen = self._commands, self.chosen
        self.isolate.clicked.connect(lambda: commands.isolate(chosen()))
        self.hide_chosen.clicked.connect(lambda: commands.hide(chosen()))
        self.show_all.clicked.connect(commands.show_all)
        self.split.clicked.connect(lambda: self.repair.split_by_clicks())
        self.merge.clicked.connect(lambda: self.repair.merge(chosen()))
        self.delete.clicked.connect(lambda: self.repair.delete(chosen()))
        self.repair.splitting.connect(self._show_next_click)
        self.repair.busy.connect(lambda _: self._enable())
        self.confidence.scored.connect(self._reload)
        self._sizes.measured.connect(self.model.show_sizes)
        self._planner.found.connect(
            lambda plan: self.model.refresh(first=() if plan is None else plan.first)
        )
        self._workspace.switched.connect(self._reload)
        self._workspace.changed.connect(self._refresh)

    def _reload(self) -> None:
        session = self._workspace.session
        self.model.load(session)
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
        elif change & (Change.STATES | Change.HUES | Change.QUEUE | Change.SURROUNDINGS):
            self.model.refresh()
            self._count()
        self._enable()

    def chosen(self) -> list[int]:
        """Return what is selected, also where a search leaves it out of the table."""
        session = self._workspace.session
        return [] if session is None else sorted(session.selected)

    def end(self) -> None:
        """Take the dock of the table away."""
        self.table_button.end()

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
        session, chosen = self._workspace.session, self.chosen()
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
        if sentence:
            scroll_to_new(self.next_click, self._workspace.scheduler)

    def new_pane(self, key: str) -> ObjectsPane:
        """Make another table of these objects, with the same model, selection and menu."""
        return ObjectsPane(
            self._workspace, self._commands, self.model, self._actions, self.chooser, key
        )
