"""Train the confidence: mark examples, train on them, load an oracle, go back to the default."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from qtpy.QtWidgets import QFileDialog

from napari_unpack.geometry.axes import triple
from napari_unpack.tasks import Progress, Share, TaskResult
from napari_unpack.widgets import notifications
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.file_names import ask_where_to_write
from napari_unpack.widgets.section import Collapsible, button, label, row
from napari_unpack.widgets.task_progress import TaskProgress
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.segmentation import Oracle
    from napari_unpack.session import Session

    Scored = tuple[Oracle | None, Mapping[int, float]]

FILES = "Model of the confidence (*.npz)"
# The fewest examples that `train_on_examples` accepts.
NEEDED = 8

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
    rescored : callable
        Called after the confidence of the objects has changed.
    """

    def __init__(
        self,
        workspace: Workspace,
        commands: Commands,
        chosen: Callable[[], list[int]],
        rescored: Callable[[], None],
    ) -> None:
        super().__init__(
            "Confidence", "Train what a whole object looks like, on examples that you mark."
        )
        self._workspace, self._commands = workspace, commands
        self._chosen = chosen
        self._rescored = rescored
        self._oracle: Oracle | None = None
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
        self.refresh()

    def refresh(self) -> None:
        """Say how many objects are marked, and enable what can be done."""
        session = self._workspace.session
        marked = frozenset() if session is None else session.examples
        model = "Using your own model" if self._oracle is not None else "Using the built-in model"
        if self.running:
            self.sentence.setText("Working…")
        else:
            # Said before a file is asked for, not after.
            wanted = f", training needs {NEEDED}" if 0 < len(marked) < NEEDED else ""
            count = "1 example" if len(marked) == 1 else f"{len(marked)} examples"
            self.sentence.setText(f"{model}. {count}{wanted}.{self._doubt()}")
        chosen = set() if session is None else set(self._chosen())
        idle = session is not None and not self.running
        self.mark.setEnabled(idle and bool(chosen - marked))
        self.unmark.setEnabled(idle and bool(chosen & marked))
        self.train.setEnabled(idle and len(marked) >= NEEDED)
        self.load.setEnabled(idle)
        self.restore.setEnabled(idle and self._oracle is not None)

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

        def work(progress: Progress) -> Scored:
            from napari_unpack.segmentation.training import train_on_examples

            share = Share(progress)
            oracle = train_on_examples(
                session.volume,
                labels,
                tuple(session.spacing),
                examples,
                progress=share.part(0.0, 0.7),
            )
            oracle.save(path)
            return oracle, _scores(session, labels, oracle, share.part(0.7, 1.0, "Scoring"))

        self._begin(session, work)

    def use_oracle(self, path: str | None) -> None:
        """Use the oracle in a file; None is the one that comes with the plugin."""
        session = self._workspace.session
        if session is None:
            return
        labels = session.labels

        def work(progress: Progress) -> Scored:
            from napari_unpack.segmentation import Oracle

            # None stands for the built-in one, also in the session.
            oracle = None if path is None else Oracle.load(path)
            return oracle, _scores(session, labels, oracle, Share(progress, text="Scoring"))

        self._begin(session, work)

    @property
    def running(self) -> bool:
        """Whether an oracle is being trained or used."""
        return self.progress.running

    def _begin(self, session: Session, work: Callable[[Progress], Scored]) -> None:
        if not self.running:
            self._scored = session
            self.progress.begin(work)
            self.refresh()

    def _end(self, outcome: TaskResult[Scored]) -> None:
        session = self._scored
        if outcome.cancelled or session is None:
            self.refresh()
            return
        with notifications.errors_shown():
            oracle, scores = outcome.get()
            # Kept for the sessions that are opened after this one.
            self._oracle = oracle
            session.use_oracle(oracle, scores)
            self._rescored()
        # Opened meanwhile, when this work was in its way.
        if self._workspace.session is not session:
            self._follow()
        self.refresh()

    def _follow(self) -> None:
        """Score the objects of a newly shown session by the oracle in use."""
        session, oracle = self._workspace.session, self._oracle
        if session is not None and oracle is not None:
            labels = session.labels
            work = partial(_scores, session, labels, oracle)
            self._begin(session, lambda report: (oracle, work(Share(report, text="Scoring"))))
        self.refresh()


def _scores(
    session: Session, labels: NDArray[Any], oracle: Oracle | None, share: Share
) -> dict[int, float]:
    """Score the objects; the labels are those of when it was asked, since repairs replace them."""
    from napari_unpack.segmentation.object_table import confidences

    return confidences(labels, session.volume, triple(session.spacing), oracle, share)
