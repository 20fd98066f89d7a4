"""Unsaved work outlives a crash: it is kept on disk by itself, and offered at the next start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date, datetime
from functools import partial
from typing import TYPE_CHECKING
from weakref import ref

from qtpy.QtCore import QObject
from qtpy.QtWidgets import QVBoxLayout, QWidget

from napari_unpack.io.recovery import Leftover, UnsavedCopy, leftovers, recovery_folder
from napari_unpack.layers.placement import standing
from napari_unpack.tasks import Cancelled, Progress, Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets import notifications
from napari_unpack.widgets.file_names import bag_name
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard
from napari_unpack.widgets.preferences import preferences
from napari_unpack.widgets.section import button, label, row, rule
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.unsaved_work import UnsavedWork
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.session import Session

# All that changes in a second is written once; a large bag takes some seconds to write.
KEEP_MS = 1000

# A full disk is no emptier a second later, and arrays take long to write in vain.
RETRY_MS = 60_000

# What turning and selecting change is no work; it is kept along with what is.
WORK = ~(Change.VIEW | Change.SELECTED | Change.QUEUE)


class RecoveryKeeper(QObject):
    """Keeps a copy of the unsaved session on disk, on a worker.

    Parameters
    ----------
    workspace : Workspace
    unsaved : UnsavedWork
        Says whether there is anything to keep.
    parent : QObject
    """

    def __init__(self, workspace: Workspace, unsaved: UnsavedWork, parent: QObject) -> None:
        super().__init__(parent)
        self._workspace, self._unsaved = workspace, unsaved
        self._copy = UnsavedCopy(recovery_folder())
        self._session: Callable[[], Session | None] = lambda: None
        self._kept = False
        self._told = False
        self._then: list[Callable[[], None]] = []
        workspace.switched.connect(self.follow)
        workspace.changed.connect(lambda change: self.follow() if change & WORK else None)
        # At once: what is saved or given up must not be offered, whatever ends now, nor be lost
        # where it was given up for nothing.
        unsaved.settled.connect(self._keep)

    def follow(self) -> None:
        """Keep what has changed, soon; and nothing where nothing is unsaved any more."""
        self._workspace.scheduler.throttle(KEEP_MS, self._keep)

    def once_kept(self, then: Callable[[], None]) -> None:
        """Call once the session shown is on disk, or need not be."""
        self._then.append(then)
        self.follow()

    def end(self) -> None:
        """Take the copy off the disk, unless it holds what nobody was asked about."""
        self._workspace.scheduler.cancel(self._copy)
        if self._workspace.document is not None and not self._unsaved.worth_keeping:
            self._kept = False
        self.release()

    def release(self) -> None:
        """End where the panel is deleted already."""
        # Also where a worker was to forget it, which has been called off by now.
        if not self._kept:
            self._copy.forget()
        self._copy.close()

    def _keep(self) -> None:
        session, controller = self._workspace.document, self._workspace.controller
        if session is None or controller is None:
            return
        if session is not self._session():
            # Of the session before, only what nobody was asked about is left on the disk.
            self._do(self._copy.close)
            self._copy, self._kept = UnsavedCopy(recovery_folder()), False
            self._session = ref(session)
        if not self._unsaved.worth_keeping:
            # Saved or given up: nothing of it has to be on the disk any more.
            self._on_kept(None)
        if not preferences().keep_unsaved:
            # Nothing of the scan is to stay on the disk either.
            self._kept = False
            self._do(self._copy.discard)
            return
        if not self._unsaved.worth_keeping:
            if self._kept:
                self._kept = False
                self._do(self._copy.forget)
            return
        self._kept = True
        # Of this moment, though written later.
        from napari_unpack.io.headless import snapshot

        frozen = snapshot(session)
        name, where = bag_name(controller.sources), standing(controller.packed, session.spacing)
        copy, opened = self._copy, self._workspace.opened

        def keep(progress: Progress) -> None:
            copy.keep(frozen, name, where, lambda fraction: progress(fraction, ""), opened)

        task, scheduler = Task(object(), keep), self._workspace.scheduler
        scheduler.submit(task, Worker.LONG, self._on_kept, failed=self._tell, slot=copy)

    def _do(self, work: Callable[[], object]) -> None:
        """Have a worker do something with the copy on the disk, after what it does there now."""
        task = Task(object(), lambda _: work())
        self._workspace.scheduler.submit(task, Worker.LONG, lambda _: None, slot=self._copy)

    def _on_kept(self, _: None) -> None:
        waiting, self._then = self._then, []
        for call in waiting:
            call()

    def _tell(self, error: Exception) -> None:
        if isinstance(error, Cancelled):
            return
        scheduler = self._workspace.scheduler
        scheduler.debounce(RETRY_MS, self._keep)
        # Once: whoever cannot mend it must not be disturbed by it.
        if not self._told:
            self._told = True
            notifications.inform(
                "Unsaved work cannot be kept in case napari ends unexpectedly: save the session "
                f"now and then. {notifications.sentence(error)}"
            )


class RecoveryBar(KeepsKeyboard, QWidget):
    """Offers the unsaved sessions of processes that have ended, one after another.

    Parameters
    ----------
    workspace : Workspace
    restore : callable
        Given a `Leftover` and what to do once it is shown, opens it.
    keeper : RecoveryKeeper
        Keeps it from then on.
    """

    def __init__(
        self,
        workspace: Workspace,
        restore: Callable[[Leftover, Callable[[], None]], None],
        keeper: RecoveryKeeper,
    ) -> None:
        super().__init__()
        self._workspace, self._restore, self._keeper = workspace, restore, keeper
        self._offered: Leftover | None = None
        self.sentence = label("", "warning", wrap=True)
        self.restore = button("Continue", "Open it as it was when napari ended.")
        self.discard = button("Discard", "Delete it for good.")
        self.restore.clicked.connect(self._take)
        self.discard.clicked.connect(self._discard)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, GAP)
        layout.setSpacing(GAP)
        layout.addWidget(self.sentence)
        layout.addWidget(row(self.restore, self.discard))
        layout.addWidget(rule())
        self.hide()
        self._look()

    def _look(self) -> None:
        home = recovery_folder()
        task = Task(object(), lambda _: leftovers(home))
        self._workspace.scheduler.submit(task, Worker.LONG, self._offer, slot=self)

    def _offer(self, found: Sequence[Leftover]) -> None:
        self._offered = found[0] if found else None
        self.setVisible(bool(found))
        if found:
            more = f" {len(found) - 1} more will be offered." if len(found) > 1 else ""
            self.sentence.setText(
                f"An unpacking of {found[0].name} from {said(found[0].kept)} was not saved.{more}"
            )

    def _take(self) -> None:
        if self._offered is not None:
            self._restore(self._offered, partial(self._on_shown, self._offered))

    def _on_shown(self, leftover: Leftover) -> None:
        self.hide()

        def drop() -> None:
            leftover.discard()
            self._look()

        # Only once it is on disk again: a second crash must not find nothing.
        self._keeper.once_kept(drop)

    def _discard(self) -> None:
        if self._offered is not None:
            self._offered.discard()
            self._look()


def said(when: datetime) -> str:
    """Return a time as people say it: the hour, and the day where it is another."""
    hour = f"{when:%H:%M}"
    return hour if when.date() == date.today() else f"{when.day} {when:%B}, {hour}"
