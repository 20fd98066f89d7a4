"""What blocks a buried object, and the direction in which most objects are unpackable."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Qt, Signal
from qtpy.QtWidgets import QWidget

from napari_unpack.geometry.axes import triple
from napari_unpack.session.errors import listed_objects
from napari_unpack.session.object_state import ObjectState
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.directions import words_of
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard
from napari_unpack.widgets.notifications import errors_shown, inform, show_error
from napari_unpack.widgets.section import button, column, label, row
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.unpacking.direction_survey import RevealPlan


# One task runs and one waits: two at once would share the processors, and both come later.
SLOT = "reveal planner"


class RevealPlanner(QObject):
    """Works out in a worker what takes the session longer than a moment.

    Signals: `best` carries a `BestDirection`, or None while it is unknown or there is none;
    `found` a `RevealPlan`, or None when none is shown any more; `busy` (bool).

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    parent : QObject, optional
    """

    best = Signal(object)
    found = Signal(object)
    busy = Signal(bool)

    def __init__(
        self, workspace: Workspace, commands: Commands, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._workspace, self._commands = workspace, commands
        self.plan: RevealPlan | None = None
        """What is shown."""
        workspace.switched.connect(self._clear)
        workspace.changed.connect(self._follow)

    @property
    def running(self) -> bool:
        """Whether something is being worked out."""
        return self._workspace.scheduler.has(SLOT)

    def find_best_direction(self) -> None:
        """Find the direction of 26 in which most objects are unpackable, for `best`."""
        session = self._workspace.session
        if session is None:
            return
        task = session.queries.survey_task()
        if task is None:
            self.best.emit(session.best_direction())
        else:
            self._start(session, task, 0)

    def reveal(self, object_id: int) -> None:
        """Find what blocks a buried object, for `found`."""
        session = self._workspace.session
        if session is None:
            return
        with errors_shown():
            # None where the plan is known: then it takes no time.
            task = session.queries.reveal_plan_task(object_id)
            if task is None:
                self._show(session.reveal_plan(object_id))
            else:
                self._start(session, task, object_id)

    def reveal_selected(self) -> None:
        """Find what blocks the selected object, or say that one must be selected."""
        session = self._workspace.session
        if session is None:
            return
        chosen = sorted(session.selected)
        if len(chosen) == 1:
            self.reveal(chosen[0])
        else:
            inform("Select one object in the bag to reveal: click it in the table.")

    def unpack_plan(self) -> None:
        """Unpack the objects that block the buried one, and it as well."""
        plan = self.plan
        if plan is not None:
            # Before unpacking, which would be news that cancels the plan.
            self.forget()
            self._commands.reveal(plan.target, triple(plan.direction))

    def forget(self) -> None:
        """Show no plan any more."""
        if self.plan is not None:
            self.plan = None
            self._outline(0, frozenset())
            self.found.emit(None)

    def _start(self, session: Session, task: Task[Any], object_id: int) -> None:
        """Run a task for a buried object, or with 0 for the best direction."""
        take = partial(self._take, session, task, object_id)
        self._workspace.scheduler.submit(task, Worker.LONG, take, failed=self._fail, slot=SLOT)
        self.busy.emit(True)

    def _take(self, session: Session, task: Task[Any], object_id: int, result: Any) -> None:
        self.busy.emit(self.running)
        # Another bag was opened meanwhile.
        if session is not self._workspace.session:
            return
        with errors_shown():
            if session.queries.store(task, result):
                if object_id:
                    self._show(session.reveal_plan(object_id))
                else:
                    self.best.emit(session.best_direction())
            elif object_id in session.queries.packed:
                # D has turned meanwhile; the survey is kept, so this takes a moment.
                self.reveal(object_id)
            elif not object_id:
                # Something has left or come back meanwhile.
                self.find_best_direction()

    def _fail(self, error: Exception) -> None:
        self.busy.emit(self.running)
        show_error(error)

    def _show(self, plan: RevealPlan) -> None:
        # It loads the kernels, which the panel's opening must not wait for.
        from napari_unpack.viewer.modal_queries import boxes_task

        self.plan = plan
        session = self._workspace.session
        task = None if session is None else boxes_task(session, plan.ids)
        if task is not None:
            # While the sentence is read.
            self._workspace.scheduler.submit(task, Worker.LONG, lambda _: None)
        self._outline(plan.target, plan.first)
        self.found.emit(plan)

    def _outline(self, target: int, first: frozenset[int]) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.overlays.show_reveal_plan(target, first)

    def _follow(self, change: Change) -> None:
        session = self._workspace.session
        if session is None or self.plan is None:
            return
        if Change.LABELS in change:
            self.forget()
        elif Change.STATES in change:
            states = session.states
            # An object of the plan has left, so the plan is no longer what remains to be done.
            if any(states[i] is not ObjectState.PACKED for i in self.plan.ids):
                self.forget()

    def _clear(self) -> None:
        self._workspace.scheduler.cancel(SLOT)
        self.plan = None
        self.best.emit(None)
        self.found.emit(None)


class RevealBox(KeepsKeyboard, QWidget):
    """A sentence on what blocks a buried object, and two buttons; shown while that is known."""

    def __init__(self, planner: RevealPlanner) -> None:
        super().__init__()
        self._plan: RevealPlan | None = None
        self.sentence = label("", "hint", wrap=True)
        # As many lines as most plans have: with a longer one alone what is below moves.
        self.sentence.setMinimumHeight(3 * self.sentence.fontMetrics().lineSpacing())
        self.sentence.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.take = button(
            "Unpack these", "Unpack the objects in the way, if any, and this one last.", True
        )
        self.cancel = button("Not now", "Hide this plan (Escape).")
        contents = column(self)
        contents.addWidget(self.sentence)
        contents.addWidget(row(self.take, self.cancel))
        self.take.clicked.connect(planner.unpack_plan)
        self.cancel.clicked.connect(planner.forget)
        self.hide()

    def show_plan(self, plan: RevealPlan | None, session: Session | None) -> None:
        """Say what to take out.

        Parameters
        ----------
        plan : RevealPlan, optional
            None hides the box.
        session : Session, optional
            It names the objects and knows the view.
        """
        self._plan = plan
        self.setVisible(plan is not None)
        self.refresh(session)

    def refresh(self, session: Session | None) -> None:
        """Word the direction as the bag is seen now."""
        plan = self._plan
        if plan is not None and session is not None:
            names = session.objects["name"]
            first = [str(names[i]) for i in sorted(plan.first)]
            way = words_of(plan.direction, session.camera)
            self.sentence.setText(sentence(str(names[plan.target]), first, way))
            self.take.setText("Unpack these" if first else "Unpack it")


def sentence(name: str, first: Sequence[str], way: str) -> str:
    """Say what must happen before an object is unpackable.

    Parameters
    ----------
    name : str
        Of the object.
    first : sequence of str
        Names of the objects to take out first or with it.
    way : str
        The direction in words.
    """
    if not first:
        return f"{name} is unpackable ({way})."
    return f"To reach {name}, take out {listed_objects(first)} ({way})."
