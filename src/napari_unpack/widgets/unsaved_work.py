"""Whether a session holds work that is saved nowhere, and the one question before it would end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from qtpy.QtCore import QObject, Qt, Signal
from qtpy.QtWidgets import QMessageBox, QWidget

from napari_unpack.layers.compat import is_shown
from napari_unpack.viewer.removed_layers import RemovedLayers, close_without_layer
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari.layers import Layer

    from napari_unpack.session import Session

Call = Callable[[], None]

# Whoever waited that long for the objects would mind doing so again.
LONG_SECONDS = 60.0


@dataclass
class _Known:
    """What need not be asked for.

    Parameters
    ----------
    saved : object
        What was done when the session was opened or last saved.
    given_up : object
        What was done when the user said that it may be lost.
    long_found : bool
        Whether its objects took long to find and are saved nowhere.
    """

    saved: object
    given_up: object = None
    long_found: bool = False


class UnsavedWork(QObject):
    """Asks once before unsaved work ends: Save, Discard or Cancel.

    Signals: `settled` when work has been saved or given up, so that it need not be kept, or taken
    back, so that it must be.

    Parameters
    ----------
    workspace : Workspace
    parent : QWidget
        The question is shown over its window.

    Attributes
    ----------
    save : callable
        Given what to do once the session is saved, and what to do if it is not, asks where to and
        saves.
    unfinished : callable
        Tells whether something that was done is not in the session yet.
    question : QMessageBox or None
        The one that is shown.
    """

    settled = Signal()

    def __init__(self, workspace: Workspace, parent: QWidget) -> None:
        super().__init__(parent)
        self._workspace, self._panel = workspace, parent
        self._known: WeakKeyDictionary[Session, _Known] = WeakKeyDictionary()
        self._removed = RemovedLayers(workspace.viewer, workspace.scheduler)
        # What asks once more, and what is done instead where that comes to nothing.
        self._waiting: list[tuple[Call, Call]] = []
        self._quitting = False
        self.save: Callable[[Call, Call], None] = lambda then, cancelled: None
        self.unfinished: Callable[[], bool] = lambda: False
        self.question: QMessageBox | None = None

    @property
    def changed(self) -> bool:
        """Whether anything was done since the session was opened or last saved."""
        session, known = self._document()
        if session is None or known is None:
            return False
        work = _work_of(session)
        return work != known.given_up and (work != known.saved or self.unfinished())

    @property
    def worth_keeping(self) -> bool:
        """Whether anything would be missed after a crash: changes, or objects found for long."""
        _, known = self._document()
        long_found = known is not None and known.given_up is None and known.long_found
        return self.changed or long_found

    def mark(self) -> Call:
        """Return what is to be called once the session, as it is now, is saved."""
        session, known = self._document()
        if session is None or known is None:
            return lambda: None
        # The work of this moment: the session may go on while it is written.
        return partial(self._note_saved, known, _work_of(session))

    def never_saved(self) -> None:
        """Take note that the session shown is saved nowhere, though nothing is done yet."""
        _, known = self._document()
        if known is not None:
            known.saved = None

    def found_in(self, seconds: float) -> None:
        """Take note of how long it took to find the objects of the session shown."""
        _, known = self._document()
        if known is not None:
            known.long_found = seconds >= LONG_SECONDS

    def give_up(self) -> None:
        """Let all that is unsaved be lost without a question."""
        session, known = self._document()
        if session is not None and known is not None:
            known.given_up = _work_of(session)
            self.settled.emit()

    def take_back(self) -> None:
        """Forget that work was given up, since what it was given up for was not done."""
        _, known = self._document()
        if known is not None and known.given_up is not None:
            known.given_up = None
            self.settled.emit()

    def ask(
        self, reason: str, then: Call, quitting: bool = False, cancelled: Call = lambda: None
    ) -> None:
        """Do something that ends the session, after a question where work would be lost.

        While another question is open it waits for the answer.

        Parameters
        ----------
        reason : str
            A sentence: what ends it.
        then : callable
            Called at once where nothing would be lost, else once it is saved or given up.
        quitting : bool, optional
            Whether the layers end too: then objects that took long to find are work as well.
            During another question nothing comes of it; one can quit again.
        cancelled : callable, optional
            Called where the answer is Cancel, or Save and it is not saved, or nothing comes of it.
        """
        if self.question is not None:
            self.question.raise_()
            if not quitting:
                again = partial(self.ask, reason, then, cancelled=cancelled)
                self._waiting.append((again, cancelled))
            elif not self._quitting:
                cancelled()
        elif self.worth_keeping if quitting else self.changed:
            self._quitting = quitting
            self._show(reason, partial(self._quit, then) if quitting else then, cancelled)
        else:
            then()

    def end(self) -> None:
        """Watch nothing more."""
        self._removed.close()

    def _document(self) -> tuple[Session | None, _Known | None]:
        session = self._workspace.document
        return session, None if session is None else self._known.get(session)

    def follow(self) -> None:
        """Take note of the session shown, as it is now, and watch its layers."""
        session, controller = self._workspace.document, self._workspace.controller
        if session is not None and session not in self._known:
            self._known[session] = _Known(_work_of(session))
        if controller is not None:
            controller.layer_removed = self._on_layer_removed

    def _on_layer_removed(self) -> None:
        controller = self._workspace.controller
        if controller is None:
            return
        # A viewer that closes removes its layers too; nobody could answer any more.
        if not is_shown(self._workspace.viewer):
            controller.close()
        elif self.changed:
            self._workspace.scheduler.soon(self._ask_about_layers)
        else:
            close_without_layer(controller)

    def _ask_about_layers(self) -> None:
        controller = self._workspace.controller
        if controller is None or not controller.is_open:
            return
        if not is_shown(self._workspace.viewer):
            controller.close()
        # First: the question is asked over the picture as it was, and Cancel has nothing to do.
        elif removed := self._removed.put_back(partial(controller.framing.catch_up, finish=True)):
            self.ask("Without its layers it ends.", partial(self._end_without, removed))

    def _end_without(self, removed: list[Layer]) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.close()
        layers = self._workspace.viewer.layers
        # The person's own that were deleted along with them.
        for layer in removed:
            if layer in layers:
                layers.remove(layer)

    def _show(self, reason: str, then: Call, cancelled: Call) -> None:
        controller = self._workspace.controller
        sources = () if controller is None else controller.sources
        name = f" of {sources[0].name}" if sources else ""
        box = QMessageBox(self._panel.window())
        box.setIcon(QMessageBox.Icon.Warning)
        box.setWindowTitle("Virtual Unpacking")
        box.setTextFormat(Qt.TextFormat.PlainText)
        box.setText(f"Save the unpacking{name}?")
        box.setInformativeText(f"{reason} What was done since it was last saved would be lost.")
        kinds = QMessageBox.StandardButton
        box.setStandardButtons(kinds.Save | kinds.Discard | kinds.Cancel)
        box.setDefaultButton(kinds.Save)
        box.finished.connect(partial(self._answer, box, then, cancelled))
        self.question = box
        # Not `exec`, which would run everything else within this call.
        box.open()

    def _answer(self, box: QMessageBox, then: Call, cancelled: Call, _result: int) -> None:
        button = box.standardButton(box.clickedButton()) if box.clickedButton() else None
        self.question = None
        box.deleteLater()
        if button == QMessageBox.StandardButton.Discard:
            self.give_up()
            self._go_on(then)
        elif button == QMessageBox.StandardButton.Save:
            self.save(partial(self._go_on, then), partial(self._go_on, cancelled))
        else:
            self._go_on(cancelled)

    def _go_on(self, answered: Call) -> None:
        """Do what was answered, then ask what has waited for it."""
        answered()
        waiting, self._waiting = self._waiting, []
        for ask, _ in waiting:
            ask()

    def _quit(self, then: Call) -> None:
        # What waits would be done in a window that is gone.
        waiting, self._waiting = self._waiting, []
        for _, cancelled in waiting:
            cancelled()
        then()

    def _note_saved(self, known: _Known, work: object) -> None:
        known.saved, known.given_up, known.long_found = work, None, False
        self.settled.emit()


def _work_of(session: Session) -> object:
    # Once there is a session its modules are loaded; at the panel's opening they are not yet.
    from napari_unpack.io.session_json import work_of

    return work_of(session)
