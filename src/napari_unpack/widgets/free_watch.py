"""Keep an eye on who is free, once the bag has come to rest."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import QObject, QTimer, Signal

from napari_unpack.tasks import TaskResult
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.workspace import Change, Workspace

REST_MS = 350


class FreeWatch(QObject):
    """Ask who can leave after states, queue or view changed and then rested, on a worker thread.

    `known` carries a frozenset of the free objects' IDs, empty where everything is blocked, or
    None as soon as the last answer is out of date.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    known = Signal(object)

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._job = Job(self)
        self._asked: Any = None
        self._along: Any = None
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(REST_MS)
        self._rest.timeout.connect(self._ask)
        self._job.ended.connect(self._take)
        workspace.switched.connect(self._wait)
        workspace.changed.connect(self._hear)

    def end(self) -> None:
        """Stop watching."""
        self._rest.stop()
        self._asked = None

    def _hear(self, news: Change) -> None:
        if news & (Change.STATES | Change.VIEW | Change.QUEUE):
            session = self._workspace.session
            if session is not None and session.direction != self._along:
                # Another way out: what was said of the last one says nothing of this.
                self.known.emit(None)
            self._wait()

    def _wait(self) -> None:
        if self._workspace.session is None:
            self._rest.stop()
            self.known.emit(None)
        else:
            self._along = self._workspace.session.direction
            self._rest.start()

    def _ask(self) -> None:
        controller = self._workspace.controller
        if controller is None:
            return
        if controller.flying or self._job.running:
            self._rest.start()
            return
        task = controller.session.queries.occlusion_task()
        if task is None:
            self._tell()
            return
        self._asked = controller.session, task
        self._job.start(task.run)

    def _take(self, outcome: TaskResult[Any]) -> None:
        asked, self._asked = self._asked, None
        if asked is None or asked[0] is not self._workspace.session:
            return
        session, task = asked
        if session.queries.store(task, outcome.get()):
            self._tell()
        else:
            self._rest.start()

    def _tell(self) -> None:
        """Tell who is free of what is still in the bag, also while the queue is being used up."""
        session = self._workspace.session
        if session is None:
            return
        # The queue comes up to date, which may name the least blocked for want of a free one.
        session.unpackable()
        self.known.emit(frozenset(int(i) for group in session.unpackable_groups() for i in group))
