"""What can be done with the selected rows of a table of objects: the menu of a right click."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QMenu, QWidget

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.color_chooser import ColorChooser
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.object_columns import FLAG_WORDS
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session import Session

    MenuEntry = tuple[str, Callable[[], object], bool]


class ObjectMenu:
    """Makes the menu of some objects; every table of them opens the same.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    planner : RevealPlanner
    repair : RepairTools
    chooser : ColorChooser
    """

    def __init__(
        self,
        workspace: Workspace,
        commands: Commands,
        planner: RevealPlanner,
        repair: RepairTools,
        chooser: ColorChooser,
    ) -> None:
        self._workspace, self._commands, self._planner = workspace, commands, planner
        self._repair, self._chooser = repair, chooser

    def of(
        self, ids: Sequence[int], parent: QWidget, write_note: Callable[[int], None]
    ) -> QMenu | None:
        """Make the menu; None where there is nothing to do anything with.

        Parameters
        ----------
        ids : sequence of int
            The selected objects.
        parent : QWidget
            Of the menu.
        write_note : callable
            Lets a person type the note of an object.
        """
        session = self._workspace.session
        if not ids or session is None:
            return None
        menu = QMenu(parent)
        # Or every menu ever opened would stay with the panel.
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for block in (*self._places(ids, session), self._colors(ids, session)):
            if not menu.isEmpty():
                menu.addSeparator()
            _fill(menu, block)
        menu.addSeparator()
        _fill(menu, [("Note…", lambda: write_note(ids[0]), len(ids) == 1)])
        _fill(menu.addMenu("Flag"), self._flags(ids, session))
        _fill(menu, self._examples(ids, session))
        return menu

    def _places(self, ids: Sequence[int], session: Session) -> list[list[MenuEntry]]:
        commands, repair, planner = self._commands, self._repair, self._planner
        states, one = {session.states[i] for i in ids}, len(ids) == 1
        packed, hidden = ObjectState.PACKED in states, ObjectState.HIDDEN in states
        return [
            [
                ("Unpack", lambda: commands.unpack(ids), packed),
                ("Reveal…", lambda: planner.reveal(ids[0]), one and packed),
                ("Restore", lambda: commands.restore(ids), ObjectState.UNPACKED in states),
                ("Inspect", lambda: commands.inspect(ids[0]), one and not hidden),
            ],
            [
                ("Merge", lambda: repair.merge(list(ids)), repair.can_merge(list(ids))),
                ("Delete", lambda: repair.delete(list(ids)), repair.can_delete(list(ids))),
            ],
            [
                ("Isolate", lambda: commands.isolate(ids), True),
                ("Hide", lambda: commands.hide(ids), states != {ObjectState.HIDDEN}),
                ("Show", lambda: commands.show(ids), hidden),
                ("Show all", commands.show_all, bool(objects_in(session, ObjectState.HIDDEN))),
            ],
        ]

    def _colors(self, ids: Sequence[int], session: Session) -> list[MenuEntry]:
        commands, chosen, locked = self._commands, set(ids), session.locked_hues
        own = session.state.colors.keys()
        return [
            ("Colour…", lambda: self._chooser.choose(ids), True),
            ("Automatic colour", lambda: commands.annotate.color(ids, None), bool(chosen & own)),
            ("Keep colour", lambda: commands.lock_hues(ids), not chosen <= locked),
            ("Let colour change", lambda: commands.lock_hues(ids, False), bool(chosen & locked)),
        ]

    def _flags(self, ids: Sequence[int], session: Session) -> list[MenuEntry]:
        now, mark = {session.state.flags.get(i) for i in ids}, self._commands.annotate.flag
        return [
            (words.capitalize(), partial(mark, ids, flag), now != {flag})
            for flag, words in FLAG_WORDS.items()
        ]

    def _examples(self, ids: Sequence[int], session: Session) -> list[MenuEntry]:
        commands, chosen, examples = self._commands, set(ids), session.examples
        return [
            ("Mark as example", lambda: commands.mark_examples(ids), not chosen <= examples),
            (
                "Unmark as example",
                lambda: commands.mark_examples(ids, False),
                bool(chosen & examples),
            ),
        ]


def _fill(menu: QMenu, entries: Sequence[MenuEntry]) -> None:
    for text, act, enabled in entries:
        action = menu.addAction(text)
        action.setEnabled(enabled)
        action.triggered.connect(lambda _=False, act=act: act())
