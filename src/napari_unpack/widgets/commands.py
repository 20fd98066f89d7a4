"""Every command that a button, a key or a menu of the panel gives.

A command never raises for bad input: the reason becomes a notification and nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.widgets import notifications
from napari_unpack.widgets.annotation_commands import AnnotationCommands
from napari_unpack.widgets.session_settings import SessionSettings
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.geometry.standard_views import Side
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController
    from napari_unpack.widgets.directions import Direction


class Commands:
    """The commands, on the session that the workspace shows.

    Attributes
    ----------
    settings : SessionSettings
        What is set once and holds for later commands.
    annotate : AnnotationCommands
        Give objects colours, notes and flags.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.settings = SessionSettings(workspace)
        self.annotate = AnnotationCommands(workspace)

    def _run(self, command: Callable[[SessionController], object]) -> None:
        """Run a command, or say that there is no session yet."""
        if self._workspace.controller is None:
            notifications.inform(
                "Segment a volume first, or choose its labels: step 1 of Virtual Unpacking."
            )
            return
        self._run_if_open(command)

    def _run_if_open(self, command: Callable[[SessionController], object]) -> None:
        """Run a command, or nothing without a session."""
        if self._workspace.controller is not None:
            with notifications.errors_shown():
                command(self._workspace.controller)

    # Objects leave and come back.

    def unpack(self, what: int | Iterable[int] = 1) -> None:
        """Fly the next unpackable objects out, or these."""
        self._run(lambda controller: controller.unpack(what))

    def unpack_least_occluded(self) -> None:
        """Fly the next object out, the least occluded one where none is unpackable."""

        def command(controller: SessionController) -> None:
            session = controller.session
            # The rule holds for this command alone; the check box says what holds for others.
            before, session.take_least_occluded = session.take_least_occluded, True
            try:
                controller.unpack(1)
            finally:
                session.take_least_occluded = before

        self._run(command)

    def unpack_selected(self) -> None:
        """Fly the selected objects out."""

        def command(controller: SessionController) -> None:
            session = controller.session
            # Selected sprites are outside already.
            packed = objects_in(session, ObjectState.PACKED)
            chosen = [i for i in packed if i in session.selected]
            if chosen:
                controller.unpack(chosen)
            else:
                notifications.inform(
                    "Select objects in the bag first: click them in the 3D view or the table."
                )

        self._run(command)

    def unpack_all_unpackable(self) -> None:
        """Fly every object out that is unpackable now."""

        def command(controller: SessionController) -> None:
            ids = controller.session.unpackable()
            # Empty where every object is blocked and the rules force none.
            if ids:
                controller.unpack(ids)

        self._run(command)

    def reveal(self, object_id: int, direction: Direction = None) -> None:
        """Fly a buried object out, and before it the objects that block it.

        Parameters
        ----------
        object_id : int
        direction : str or (3,) tuple of float, optional
            Where they leave to; by default the session's direction.
        """
        self._run(lambda controller: controller.reveal(object_id, direction))

    def restore(self, what: int | Iterable[int] = 1) -> None:
        """Fly the last unpacked objects back, or these."""
        self._run(lambda controller: controller.restore(what))

    def restore_all(self) -> None:
        """Fly every object back into the bag."""

        def command(controller: SessionController) -> None:
            states = controller.session.states.values()
            # With none outside, one is asked for, so that the session says why it cannot be done.
            controller.restore(max(sum(state.is_outside for state in states), 1))

        self._run(command)

    def go_to(self, step: int, flying: bool = False) -> None:
        """Run the unpacking to a step.

        Parameters
        ----------
        step : int
        flying : bool
            Whether objects fly there; else they are there at once.
        """
        self._run(lambda controller: controller.go_to(step, flying))

    def undo(self) -> None:
        """Undo the last command."""
        self._run(lambda controller: controller.undo())

    def redo(self) -> None:
        """Do the command undone last once more."""
        self._run(lambda controller: controller.redo())

    # One object alone.

    def inspect(self, object_id: int) -> None:
        """Show one object alone."""
        self._run(lambda controller: controller.inspect(object_id))

    def leave(self) -> None:
        """Come back from inspecting an object."""
        self._run(lambda controller: controller.leave())

    def toggle_inspection(self) -> None:
        """Inspect the selected or else the last unpacked object; during an inspection, leave."""

        def command(controller: SessionController) -> None:
            session = controller.session
            if objects_in(session, ObjectState.INSPECTED):
                controller.leave()
                return
            # The last unpacked one is what the user has just looked at.
            chosen = sorted(session.selected) or objects_in(session, ObjectState.UNPACKED)
            if chosen:
                controller.inspect(chosen[-1])

        self._run_if_open(command)

    def open_container(self, object_id: int) -> None:
        """Show what is inside an object as a bag of its own."""
        self._run(lambda _: self._workspace.open_container(object_id))

    def leave_container(self) -> None:
        """Go back to the bag that the opened object is from."""
        self._run_if_open(lambda _: self._workspace.leave_container())

    # Where one looks from; not undoable.

    def fit(self) -> None:
        """Bring the bag and all that is out of it into the window."""
        self._run(lambda controller: controller.framing.fit())

    def look_from(self, side: Side | None) -> None:
        """Look at the bag from a side, or from where objects leave to."""
        self._run(lambda controller: controller.look_from_side(side))

    # What is seen, and how.

    def hide(self, ids: Iterable[int]) -> None:
        """Hide objects in the 3D view; the labels stay as they are."""
        # Iterators are read once here: the session goes through the IDs more than once.
        self._run(lambda controller: controller.session.hide(list(ids)))

    def hide_selected(self) -> None:
        """Hide the selected objects, if any."""

        def command(controller: SessionController) -> None:
            if controller.session.selected:
                controller.session.hide(sorted(controller.session.selected))

        self._run_if_open(command)

    def show(self, ids: Iterable[int]) -> None:
        """Show hidden objects again."""
        self._run(lambda controller: controller.session.show(list(ids)))

    def show_all(self) -> None:
        """Show every hidden object again."""

        def command(controller: SessionController) -> None:
            controller.session.show(objects_in(controller.session, ObjectState.HIDDEN))

        self._run(command)

    def isolate(self, ids: Iterable[int]) -> None:
        """Hide all objects but these."""
        self._run(lambda controller: controller.session.isolate(list(ids)))

    def select(self, ids: Iterable[int]) -> None:
        """Select objects in the 3D view, the slices and the table."""
        self._run(lambda controller: controller.session.select(list(ids)))

    def recolor(self) -> None:
        """Choose new hues for this view."""
        self._run(lambda controller: controller.recolor())

    def lock_hues(self, ids: Iterable[int], locked: bool = True) -> None:
        """Keep the hues of objects in every view, or let them change again.

        Parameters
        ----------
        ids : iterable of int
        locked : bool
        """

        def command(controller: SessionController) -> None:
            session, chosen = controller.session, set(ids)
            before = session.locked_hues
            session.locked_hues = before | chosen if locked else before - chosen

        self._run_if_open(command)

    # What is known of objects.

    def rename(self, object_id: int, name: str) -> None:
        """Give an object a name.

        Parameters
        ----------
        object_id : int
        name : str
        """
        self._run(lambda controller: controller.session.rename(object_id, name))

    def mark_examples(self, ids: Iterable[int], examples: bool = True) -> None:
        """Mark objects as examples of whole ones, or unmark them.

        Parameters
        ----------
        ids : iterable of int
        examples : bool
        """
        self._run(lambda controller: controller.session.mark_examples(list(ids), examples))


def objects_in(session: Session | None, *states: ObjectState) -> list[int]:
    """Return the IDs of the objects in some states.

    Parameters
    ----------
    session : Session, optional
        Without one there are no objects.
    *states : ObjectState
    """
    if session is None:
        return []
    return ids_in(session.states, *states)
