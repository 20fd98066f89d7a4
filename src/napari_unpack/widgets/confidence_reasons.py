"""Why objects have the confidence they have, worked out in a worker where somebody asks."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject

from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session.placement import Bag

SLOT = "why a confidence is low"


class ConfidenceReasons(QObject):
    """Answers why for one object after the other; a table asks again when it is pointed at.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._bag: Bag | None = None
        self._oracle: object = None
        self._known: dict[int, str] = {}
        workspace.switched.connect(self._forget)

    def of(self, object_id: int) -> str:
        """Return a sentence; that it is being worked out where it is not known yet."""
        session = self._workspace.session
        if session is None:
            return ""
        # Other labels or another model have other reasons.
        if session.bag is not self._bag or session.label_editor.oracle is not self._oracle:
            self._bag, self._oracle, self._known = session.bag, session.label_editor.oracle, {}
        if object_id not in self._known:
            from napari_unpack.session.object_facts import reasons_of

            key = (SLOT, session.label_data.revision, object_id)
            task = Task(key, lambda _: reasons_of(session, object_id))
            # What is found of other labels or by another model is of no use any more.
            take = partial(_take, self._known, object_id)
            self._workspace.scheduler.submit(task, Worker.LONG, take, failed=lambda _: None)
        return self._known.get(object_id, "Why: being worked out, point here again in a moment.")

    def _forget(self) -> None:
        # It would keep the volume of a closed session alive.
        self._bag, self._oracle, self._known = None, None, {}


def _take(known: dict[int, str], object_id: int, reasons: tuple[str, ...]) -> None:
    lowered = f"Lowered because {'; '.join(reasons)}."
    known[object_id] = lowered if reasons else "No single measure stands out."
