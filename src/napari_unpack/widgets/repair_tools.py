"""Repairs as the panel asks for them: worked out on a worker thread, one at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QObject, Signal

from napari_unpack.session.label_edits import LabelEditor
from napari_unpack.tasks import Task, TaskResult
from napari_unpack.widgets import notifications
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.workspace import Workspace


class RepairTools(QObject):
    """Split, merge, delete, and what a brush paints on the user's labels.

    Signals: `splitting` (a sentence on what to click next, empty when over); `busy` (bool) while
    a repair is being worked out.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    splitting = Signal(str)
    busy = Signal(bool)

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._job = Job(self)
        self._job.ended.connect(self._take)
        self._session: Any = None
        self._clicks: Any = None
        self._painted: Any = None
        workspace.staged.connect(self._follow)

    @property
    def running(self) -> bool:
        """Whether a repair is being worked out, or a brush stroke waits to be."""
        return self._job.running or (self._painted is not None and self._painted.waiting)

    @property
    def awaits_clicks(self) -> bool:
        """Whether clicks on an object are waited for."""
        return self._clicks is not None

    def split_by_clicks(self) -> None:
        """Wait for two clicks on one object; asked again, stop waiting."""
        from napari_unpack.viewer.split_tool import SplitTool

        if self._clicks is not None or self._workspace.controller is None:
            self.cancel()
            return
        self._clicks = SplitTool(self._workspace.controller, self.splitting.emit, self._clicked)

    def cancel(self) -> None:
        """Wait for no click any more."""
        if self._clicks is not None:
            self._clicks.close()
            self._clicks = None
            self.splitting.emit("")

    def merge(self, ids: list[int]) -> None:
        """Make one object of several."""
        self._put(lambda editor: editor.merge_task(ids))

    def delete(self, ids: list[int]) -> None:
        """Make background of objects."""
        self._put(lambda editor: editor.delete_task(ids))

    def _clicked(self, object_id: int, a: Any, b: Any) -> None:
        self.cancel()
        self._put(lambda editor: editor.split_task(object_id, a, b))

    def _put(self, task_of: Callable[[LabelEditor], Task[Any]]) -> None:
        session = self._workspace.session
        if session is None:
            return
        if self._job.running:
            notifications.inform("The last repair is still being worked out: wait a moment.")
            return
        with notifications.spoken():
            self._start(session, task_of(session.label_editor))

    def _ask(self, task: Task[Any]) -> bool:
        if self._job.running or self._workspace.session is None:
            return False
        self._start(self._workspace.session, task)
        return True

    def _start(self, session: Any, task: Task[Any]) -> None:
        self._session = session
        self.busy.emit(True)
        self._job.start(task.run)

    def _take(self, outcome: TaskResult[Any]) -> None:
        session, self._session = self._session, None
        self.busy.emit(False)
        if session is None or session is not self._workspace.session:
            return
        with notifications.spoken():
            edit = outcome.get()
            if edit is not None and not session.label_editor.apply(edit):
                notifications.warn("The labels have changed meanwhile: repair once more.")

    def _follow(self) -> None:
        from napari_unpack.viewer.label_sync import LabelSync

        self.cancel()
        if self._painted is not None:
            self._painted.close()
            self._painted = None
        controller = self._workspace.controller
        if controller is not None:
            self._painted = LabelSync(
                controller.session, controller.sources, self._ask, notifications.warn
            )
