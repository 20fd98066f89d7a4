"""Repairs of the labels, worked out in a worker one at a time."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Qt, Signal
from qtpy.QtWidgets import QApplication

from napari_unpack.session.errors import listed_objects
from napari_unpack.session.object_state import ObjectState
from napari_unpack.tasks import Cancelled, Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets import notifications
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari.layers import Labels

    from napari_unpack.segmentation.review.doubts import Doubt, Said
    from napari_unpack.session import Session
    from napari_unpack.session.label_edits import EditedLabels, LabelEditor
    from napari_unpack.viewer.label_sync import LabelSync
    from napari_unpack.viewer.split_tool import SplitTool, Voxel

    Apply = Callable[[EditedLabels | None], bool]
    Done = Callable[[EditedLabels | None], None]
    Refused = Callable[[Exception], None]

SLOT = "repair"

# Between two looks whether a stroke is in the session.
WAIT_MS = 100

# A repair would change the sprite of an unpacked object under the user's hand.
REPAIRABLE = frozenset({ObjectState.PACKED, ObjectState.HIDDEN})


class RepairTools(QObject):
    """Split, merge, delete, and take over what a brush paints on the user's labels.

    Signals: `splitting` (a sentence on what to click next, empty when over); `busy` (bool).

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
        self._split_tool: SplitTool | None = None
        self._label_sync: LabelSync | None = None
        # What a person asked for last, and what was called off while it was worked out.
        self._asked: Task[Any] | None = None
        self._called_off: Task[Any] | None = None
        # A repair that is asked for while a stroke is compared, which nobody waits for.
        self._next: Callable[[], None] | None = None
        # What is to be done of labels that hold all repairs.
        self._waiting: list[Callable[[], None]] = []
        workspace.switched.connect(self._follow)

    @property
    def running(self) -> bool:
        """Whether a repair is being worked out, or a brush stroke waits to be."""
        return self._workspace.scheduler.has(SLOT) or (
            self._label_sync is not None and self._label_sync.pending
        )

    @property
    def unfinished(self) -> bool:
        """Whether a repair that was asked for, or a brush stroke, is not in the session yet."""
        stroke = self._label_sync is not None and self._label_sync.has_stroke
        return self._asked is not None or self._next is not None or stroke

    @property
    def painted(self) -> tuple[Labels, ...]:
        """The user's layers on which a stroke of a brush is a repair."""
        return () if self._label_sync is None else self._label_sync.followed

    @property
    def comparing(self) -> bool:
        """Whether the session does not know yet what was painted, and nothing else is asked."""
        asked = self._asked is not None or self._next is not None
        return not asked and self._label_sync is not None and self._label_sync.has_stroke

    def take_back(self, layer: Labels) -> bool:
        """Take back a stroke that is not compared yet; return whether that was done."""
        return self._label_sync is not None and self._label_sync.take_back(layer)

    def once_done(self, then: Callable[[], None]) -> None:
        """Do something once the session holds all repairs and strokes; at once where it does."""
        self._waiting.append(then)
        self._call_waiting()

    def split_by_clicks(self) -> None:
        """Wait for two clicks on one object; a second call stops waiting."""
        from napari_unpack.viewer.split_tool import SplitTool

        # The button is a toggle.
        if self._split_tool is not None or self._workspace.controller is None:
            self.cancel()
            return
        self._split_tool = SplitTool(
            self._workspace.controller, self.splitting.emit, self._split_between
        )

    def cancel(self) -> None:
        """Wait for clicks no longer."""
        if self._split_tool is not None:
            self._split_tool.cancel()

    def call_off(self) -> bool:
        """Give up the repair that is being worked out; return whether there was one."""
        task, self._asked = self._asked, None
        if self._next is not None:
            self._next = None
            return True
        if task is None or not self._workspace.scheduler.has(SLOT):
            return False
        self._called_off = task
        self._workspace.scheduler.cancel(SLOT)
        return True

    def can_delete(self, ids: Collection[int]) -> bool:
        """Return whether objects can be deleted now: none is outside, and some are left."""
        session = self._workspace.session
        if session is None or not ids or self.running:
            return False
        states = session.states
        return len(ids) < len(states) and {states[i] for i in ids} <= REPAIRABLE

    def can_merge(self, ids: Collection[int]) -> bool:
        """Return whether objects can be made one now: none is outside."""
        session = self._workspace.session
        if session is None or len(ids) < 2 or self.running:
            return False
        return {session.states[i] for i in ids} <= REPAIRABLE

    def delete_selected(self) -> None:
        """Delete the selected objects, or say why that cannot be."""
        session = self._workspace.session
        if session is not None and session.selected:
            self.delete(sorted(session.selected))

    def merge(self, ids: list[int]) -> None:
        """Make one object of several."""
        self._put(lambda editor: editor.merge_task(ids))

    def delete(self, ids: list[int]) -> None:
        """Make background of objects, unless none would be left."""
        session = self._workspace.session
        if session is not None and len(ids) == len(session.ids):
            notifications.inform("One object must stay: select fewer to delete.")
            return
        self._put(lambda editor: editor.delete_task(ids))

    def answer(self, doubt: Doubt, said: Said) -> None:
        """Do what a person's answer to a doubt wants.

        Parameters
        ----------
        doubt : Doubt
        said : {"same", "different", "nothing", "skip"}
        """
        session = self._workspace.session
        if session is not None:
            review = session.review
            self._put(lambda _: review.answer_task(doubt, said), partial(review.apply, doubt, said))

    def _split_between(self, found: tuple[int, Voxel, Voxel] | None) -> None:
        self._split_tool = None
        session = self._workspace.session
        if found is not None and session is not None:
            split = partial(_split_off, session, found[0])
            self._put(lambda editor: editor.split_task(*found), split)

    def _put(self, task_of: Callable[[LabelEditor], Task[Any]], apply: Apply | None = None) -> None:
        session = self._workspace.session
        if session is None:
            return
        if self._workspace.scheduler.has(SLOT):
            if self._asked is None and self._next is None:
                self._next = partial(self._put, task_of, apply)
            else:
                notifications.inform("The last repair is still being worked out: wait a moment.")
            return
        with notifications.errors_shown():
            self._asked = task_of(session.label_editor)
            done = partial(_apply, apply or partial(_applied, session))
            self._start(session, self._asked, done, notifications.show_error)

    def _ask(self, task: Task[EditedLabels | None], done: Done, refused: Refused) -> bool:
        # The stroke is compared again a moment later. One whose hand rests is not at its end:
        # cut in two, it would be two steps of undo.
        draws = QApplication.mouseButtons() != Qt.MouseButton.NoButton
        if draws or self._workspace.scheduler.has(SLOT) or self._workspace.session is None:
            return False
        self._start(self._workspace.session, task, done, refused)
        return True

    def _start(self, session: Session, task: Task[Any], done: Done, refused: Refused) -> None:
        take = partial(self._take, session, task, done)
        fail = partial(self._fail, task, refused)
        self._workspace.scheduler.submit(task, Worker.LONG, take, failed=fail, slot=SLOT)
        self.busy.emit(True)

    def _take(
        self, session: Session, task: Task[Any], done: Done, edit: EditedLabels | None
    ) -> None:
        self._end(task)
        # A repair of a session that is no longer shown would come as a surprise.
        if session is self._workspace.session and task is not self._called_off:
            with notifications.errors_shown():
                done(edit)
        self._go_on()

    def _fail(self, task: Task[Any], refused: Refused, error: Exception) -> None:
        self._end(task)
        if not isinstance(error, Cancelled):
            with notifications.errors_shown():
                refused(error)
        self._go_on()

    def _go_on(self) -> None:
        following, self._next = self._next, None
        if following is not None:
            following()
        self._call_waiting()

    def _call_waiting(self) -> None:
        if self._waiting and self.running:
            # A stroke may turn out to be none, which nobody tells.
            self._workspace.scheduler.debounce(WAIT_MS, self._call_waiting)
            return
        waiting, self._waiting = self._waiting, []
        for call in waiting:
            call()

    def _end(self, task: Task[Any]) -> None:
        # What runs next may be a stroke, which nobody asked for here.
        if self._asked is task:
            self._asked = None
        self.busy.emit(False)

    def _follow(self) -> None:
        from napari_unpack.viewer.label_sync import LabelSync, with_sharing

        # Clicks on the layers of another session would mean nothing.
        self.cancel()
        self._next = None
        if self._label_sync is not None:
            self._label_sync.close()
            self._label_sync = None
        controller, session = self._workspace.controller, self._workspace.document
        if controller is not None and session is not None:
            self._label_sync = LabelSync(
                session,
                self._workspace.scheduler,
                with_sharing(controller.sources, self._workspace.viewer.layers),
                self._ask,
                notifications.warn,
                lambda: controller.slice_hues.painting,
                # There the layers show the whole bag, whose opened objects a stroke would forget.
                "go back to the bag first" if self._workspace.is_inside else "",
            )


def _apply(apply: Apply, edit: EditedLabels | None) -> None:
    if not apply(edit):
        notifications.warn("The labels changed meanwhile: repair once more.")


def _applied(session: Session, edit: EditedLabels | None) -> bool:
    # None changes nothing, which is no step of undo.
    return edit is None or session.label_editor.apply(edit)


def _split_off(session: Session, object_id: int, edit: EditedLabels | None) -> bool:
    applied = _applied(session, edit)
    if applied and edit is not None:
        names = session.objects["name"]
        new = listed_objects(str(names[i]) for i in edit.new)
        notifications.inform(f"Split off {names[object_id]}: {new}.")
    return applied
