"""What must leave for a buried object: a sentence and two buttons.

Other ways out: the best of 26 directions, and what frees a buried object, in a worker.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qtpy.QtCore import QObject, Signal
from qtpy.QtWidgets import QWidget

from napari_unpack.session.errors import listed
from napari_unpack.tasks import Task, TaskResult
from napari_unpack.widgets.directions import words_of
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.notifications import spoken
from napari_unpack.widgets.section import button, column, label, row
from napari_unpack.widgets.workspace import Workspace


class RevealPlanner(QObject):
    """Asks the session's longer questions when somebody wants to know.

    Signals: `best` carries a `BestDirection`, or None while it is unknown or there is none;
    `found` a `RevealPlan`, or None when none is shown any more; `busy` tells whether rays are
    being cast.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    best = Signal(object)
    found = Signal(object)
    busy = Signal(bool)

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._job = Job(self)
        self._asked: tuple[Any, Task[Any], int] | None = None
        self._next: tuple[str, int] | None = None
        self._found: Any = None
        self._job.ended.connect(self._take)
        workspace.staged.connect(self._clear)
        workspace.changed.connect(self._hear)

    @property
    def running(self) -> bool:
        """Whether rays are being cast."""
        return self._job.running

    @property
    def shown(self) -> bool:
        """Whether it is shown what frees a buried object."""
        return self._found is not None

    def look(self) -> None:
        """Find the best direction; `best` tells."""
        session = self._workspace.session
        if session is None:
            return
        task = session.queries.survey_task()
        if task is None:
            self.best.emit(session.best_direction())
        else:
            self._start("survey", task, 0)

    def reveal(self, object_id: int) -> None:
        """Find what frees a buried object; `found` tells."""
        session = self._workspace.session
        if session is None:
            return
        with spoken():
            task = session.queries.reveal_plan_task(object_id)
            if task is None:
                self._settle(session.reveal_plan(object_id))
            else:
                self._start("reveal", task, object_id)

    def unpack_found(self) -> None:
        """Unpack those who free the buried object, and it as well."""
        if self._found is not None:
            one = self._found
            self.forget()
            self._workspace.reveal(one.target, tuple(float(v) for v in one.direction))

    def forget(self) -> None:
        """Show no buried object any more."""
        if self._found is not None:
            self._found = None
            self._show(0, frozenset())
            self.found.emit(None)

    def end(self) -> None:
        """Ask nothing more."""
        self._job.cancel()
        self._asked = self._next = None

    def _start(self, kind: str, task: Task[Any], object_id: int) -> None:
        if self._job.running:
            # The one that runs is finished or cancelled first.
            self._next = (kind, object_id)
            return
        self._asked = self._workspace.session, task, object_id
        self.busy.emit(True)
        self._job.start(task.run)

    def _take(self, outcome: TaskResult[Any]) -> None:
        asked, self._asked = self._asked, None
        waiting, self._next = self._next, None
        self.busy.emit(False)
        session = self._workspace.session
        if asked is None or session is None or session is not asked[0]:
            return
        with spoken():
            _, task, object_id = asked
            if session.queries.store(task, outcome.get()):
                if object_id:
                    self._settle(session.reveal_plan(object_id))
                else:
                    self.best.emit(session.best_direction())
        if waiting is not None:
            kind, object_id = waiting
            self.look() if kind == "survey" else self.reveal(object_id)

    def _settle(self, one: Any) -> None:
        self._found = one
        self._show(one.target, one.first)
        self.found.emit(one)

    def _show(self, target: int, leaving: frozenset[int]) -> None:
        overlays = getattr(self._workspace.controller, "overlays", None)
        if overlays is not None:
            overlays.unearth(target, leaving)

    def _hear(self, news: frozenset[str]) -> None:
        if "labels" in news:
            self.forget()
        elif "states" in news and self._found is not None:
            states = self._workspace.session.states
            if any(states[i].name != "PACKED" for i in self._found.ids):
                self.forget()

    def _clear(self) -> None:
        self._job.cancel()
        self._found = self._next = None
        self.best.emit(None)
        self.found.emit(None)


class RevealBox(QWidget):
    """Shown while it is known what frees a buried object.

    Parameters
    ----------
    ways : RevealPlanner
    """

    def __init__(self, ways: RevealPlanner) -> None:
        super().__init__()
        self._ways = ways
        self._found: Any = None
        self.news = label("", "hint", wrap=True)
        self.take = button("Unpack just those", "Fly them out, the buried one last.", True)
        self.cancel = button("Not now", "Show this no more (Escape).")
        contents = column(self)
        contents.addWidget(self.news)
        contents.addLayout(row(self.take, self.cancel))
        self.take.clicked.connect(ways.unpack_found)
        self.cancel.clicked.connect(ways.forget)
        self.hide()

    def show_found(self, one: Any, session: Any) -> None:
        """Say what must leave; None hides the box."""
        self._found = one
        self.setVisible(one is not None)
        self.look(session)

    def look(self, session: Any) -> None:
        """Say which way it is in the picture of now."""
        one = self._found
        if one is not None and session is not None:
            names = session.objects["name"]
            first = [str(names[i]) for i in sorted(one.first)]
            words = words_of(one.direction, session.camera)
            self.news.setText(sentence(str(names[one.target]), first, words))


def sentence(name: str, first: Sequence[str], way: str) -> str:
    """Return what must happen before an object is free, naming who must leave if they are few."""
    if not first:
        return f"{name} can leave now, {way}."
    return f"{name}: {listed(first)} must leave first or with it, {way}."
