"""Train the confidence: mark examples, train on them, load an oracle, go back to the default."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import Signal
from qtpy.QtWidgets import QFileDialog

from napari_unpack.tasks import Progress, Share, TaskResult
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets import notifications
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.file_names import ask_where_to_write
from napari_unpack.widgets.section import Collapsible, button, label, row
from napari_unpack.widgets.task_progress import TaskProgress
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.session.label_edits import Scores

FILES = "Model of the confidence (*.npz)"

# Where nine in ten of at least so many objects score lower than this, the oracle was trained on
# other kinds of objects: in bags like its own, at least the whole objects score near 1.
FEWEST_SCORES, UNKNOWN_SCORE = 5, 0.01


class ConfidenceBox(Collapsible):
    """Buttons to mark, train, load and restore, behind one line under the table.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    chosen : callable
        Returns the IDs selected in the table.

    Signals
    -------
    scored : the confidence of objects has changed, or what it is by
    """

    scored = Signal()

    def __init__(
        self, workspace: Workspace, commands: Commands, chosen: Callable[[], list[int]]
    ) -> None:
        super().__init__(
            "Confidence", "Train what a whole object looks like, on examples that you mark."
        )
        self._workspace, self._commands = workspace, commands
        self._chosen = chosen
        # What was chosen here, for the sessions that are opened after; each keeps its own.
        self._oracle: Callable[[Any], float] | None = None
        self.sentence = label("", "hint", wrap=True)
        self.mark = button(
            "Mark as example", "Mark the selected objects as examples of whole objects (✓)."
        )
        self.unmark = button("Unmark", "Remove the mark from the selected objects.")
        self.train = button("Train…", "Train a model on the examples, and save it to a file.")
        self.load = button("Load…", "Use a model that was trained before.")
        self.restore = button("Built-in", "Use the model that comes with the plugin.")
        self.contents.addWidget(self.sentence)
        self.contents.addWidget(row(self.mark, self.unmark))
        self.contents.addWidget(row(self.train, self.load, self.restore))
        self.progress = TaskProgress(
            workspace.scheduler, "Stop; the model in use stays.", "Confidence"
        )
        self.contents.addWidget(self.progress)
        self._scored: Session | None = None
        self.progress.ended.connect(self._end)
        self.mark.clicked.connect(lambda: self._mark(True))
        self.unmark.clicked.connect(lambda: self._mark(False))
        self.train.clicked.connect(self._ask_where_to_save)
        self.load.clicked.connect(self._ask_what_to_load)
        self.restore.clicked.connect(lambda: self.use_oracle(None))
        workspace.switched.connect(self._follow)
        workspace.changed.connect(self._follow_repairs)
        self.refresh()

    def refresh(self) -> None:
        """Say how many objects are marked, and enable what can be done."""
        session = self._workspace.session
        marked = frozenset() if session is None else session.examples
        oracle = self._oracle if session is None else session.label_editor.oracle
        model = "Using your own model" if oracle is not None else "Using the built-in model"
        enough, examples = _examples(session)
        if self.running:
            self.sentence.setText("Working…")
        else:
            self.sentence.setText(f"{model}. {examples}.{self._doubt()}")
        chosen = set() if session is None else set(self._chosen())
        idle = session is not None and not self.running
        self.mark.setEnabled(idle and bool(chosen - marked))
        self.unmark.setEnabled(idle and bool(chosen & marked))
        self.train.setEnabled(idle and enough)
        self.load.setEnabled(idle)
        self.restore.setEnabled(idle and oracle is not None)

    def _doubt(self) -> str:
        """Return a warning where the oracle was trained on other kinds of objects."""
        session = self._workspace.session
        if session is None or "confidence" not in session.objects:
            return ""
        scores = session.objects["confidence"].to_numpy(float)
        known = scores[~np.isnan(scores)]
        if len(known) < FEWEST_SCORES or np.quantile(known, 0.9) > UNKNOWN_SCORE:
            return ""
        return " It was trained on other kinds of objects: mark examples and train your own."

    def _mark(self, examples: bool) -> None:
        self._commands.mark_examples(self._chosen(), examples)
        self.refresh()

    def _ask_where_to_save(self) -> None:
        title = "Train on the examples"
        answer = ask_where_to_write(self, title, "oracle.npz", FILES, (".npz",))
        if answer is not None:
            self.train_to(str(answer[0]))

    def _ask_what_to_load(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Load a model", "", FILES)
        if path:
            self.use_oracle(path)

    def train_to(self, path: str) -> None:
        """Train an oracle on the marked objects, save it and use it.

        Parameters
        ----------
        path : str
            File to write.
        """
        session = self._workspace.session
        if session is None:
            return
        labels, examples = session.labels, session.examples

        def work(progress: Progress) -> Scores:
            from napari_unpack.segmentation.training import train_on_examples

            share = Share(progress)
            oracle = train_on_examples(
                session.volume,
                labels,
                tuple(session.spacing),
                examples,
                progress=share.part(0.0, 0.7),
            )
            scores = session.label_editor.scores_task(oracle).run(share.part(0.7, 1.0, "Scoring"))
            # Last, after what can still be called off: a file of before is replaced.
            oracle.save(path)
            return scores

        self._begin(session, work)

    def use_oracle(self, path: str | None) -> None:
        """Use the oracle in a file; None is the one that comes with the plugin."""
        session = self._workspace.session
        if session is None:
            return

        def work(progress: Progress) -> Scores:
            from napari_unpack.segmentation import Oracle

            # None stands for the built-in one, also in the session.
            oracle = None if path is None else Oracle.load(path)
            return session.label_editor.scores_task(oracle).run(progress)

        self._begin(session, work)

    @property
    def running(self) -> bool:
        """Whether an oracle is being trained or used."""
        return self.progress.running

    def _begin(self, session: Session, work: Callable[[Progress], Scores]) -> None:
        if not self.running:
            self._scored = session
            self.progress.begin(work)
            self.refresh()

    def _end(self, outcome: TaskResult[Scores]) -> None:
        session, taken = self._scored, False
        try:
            if session is not None and not outcome.cancelled:
                with notifications.errors_shown():
                    scores = outcome.get()
                    if scores.chosen:
                        self._oracle = scores.rating.oracle
                    self._take(session, scores)
                    taken = True
        finally:
            # Never at once again what has failed or was called off.
            if self._workspace.session is not session:
                # Opened meanwhile, when this work was in its way.
                self._follow()
            else:
                if taken:
                    self._score_missing()
                self.refresh()

    def _follow(self) -> None:
        """Score a newly shown session by the model chosen here, unless it has one of its own."""
        session, oracle = self._workspace.session, self._oracle
        if session is not None:
            if oracle is not None and session.label_editor.oracle is None:
                self._begin(session, session.label_editor.scores_task(oracle).run)
            self._score_missing()
        self.refresh()

    def _follow_repairs(self, change: Change) -> None:
        if Change.LABELS in change:
            self._score_missing()

    def _score_missing(self) -> None:
        """Score objects that the model in use has not: undo brought them back, for example."""
        session = self._workspace.session
        task = None if session is None else session.label_editor.missing_scores_task()
        if session is None or task is None:
            return
        if len(session.label_data.unrated) == len(session.ids):
            # All of a bag takes as long as by a model that was chosen.
            self._begin(session, task.run)
        else:
            # What fails is unknown until the labels change again.
            done, told = partial(self._take, session), notifications.show_error
            self._workspace.scheduler.submit(task, Worker.LONG, done, failed=told, slot=self)

    def _take(self, session: Session, scores: Scores) -> None:
        session.label_editor.take_scores(scores)
        self.scored.emit()


def _examples(session: Session | None) -> tuple[bool, str]:
    """Return whether enough objects are marked to train on, and what there is to say of them."""
    marked = frozenset() if session is None else session.examples
    if session is None or not marked:
        return False, "0 examples"
    # What a session has loaded already, and the panel without one has not.
    from napari_unpack.segmentation.confidence.examples import FEWEST, SMALLEST, usable_examples

    usable = usable_examples(marked, session.boxes.ids, session.boxes.counts)
    said = "1 example" if len(marked) == 1 else f"{len(marked)} examples"
    if usable < len(marked):
        said += f", {len(marked) - usable} of them below {SMALLEST} voxels"
    # Said before a file is asked for, not after.
    if usable < FEWEST:
        said += f", training needs {FEWEST} of {SMALLEST} voxels or more"
    return usable >= FEWEST, said
