"""Teach the confidence: mark good objects, train on them, keep and load what was learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from qtpy.QtWidgets import QFileDialog

from napari_unpack.tasks import Progress, TaskResult
from napari_unpack.widgets import notifications
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.section import Collapsible, button, label, row
from napari_unpack.widgets.workspace import Workspace

FILES = "Oracle (*.npz)"
NEEDED = 8
"""So many marked objects `train_on_marked` asks for."""

FEW, UNLIKE = 5, 0.01
"""Of at least so many objects, nine in ten less sure than this: the oracle knows none of them."""


class ConfidenceBox(Collapsible):
    """Mark, Train, Load and Default, behind one line under the table.

    Parameters
    ----------
    workspace : Workspace
    chosen : callable
        Returns the IDs selected in the table.
    rescored : callable
        Called after the confidence of the objects has changed.
    """

    def __init__(
        self,
        workspace: Workspace,
        chosen: Callable[[], list[int]],
        rescored: Callable[[], None],
    ) -> None:
        super().__init__(
            "Confidence", "Teach what a whole object looks like, from objects that you mark good."
        )
        self._workspace = workspace
        self._chosen = chosen
        self._rescored = rescored
        self._oracle: Any = None
        self._subject: Any = None
        self.job = Job(self)
        self.told = label("", "hint", wrap=True)
        self.mark = button("Mark good", "The selected objects are examples of whole objects (✓).")
        self.unmark = button("Unmark", "The selected objects are no examples any more.")
        self.train = button(
            "Train…", "Learn the confidence from the objects marked good, and save it to a file."
        )
        self.load = button("Load…", "Judge by a confidence that was trained before.")
        self.restore = button("Default", "Judge by the confidence that comes with the plugin.")
        self.contents.addWidget(self.told)
        self.contents.addLayout(row(self.mark, self.unmark))
        self.contents.addLayout(row(self.train, self.load, self.restore))
        self.mark.clicked.connect(lambda: self._mark(True))
        self.unmark.clicked.connect(lambda: self._mark(False))
        self.train.clicked.connect(self._ask_where_to_save)
        self.load.clicked.connect(self._ask_what_to_load)
        self.restore.clicked.connect(lambda: self.judge_by(None))
        self.job.ended.connect(self._finish)
        workspace.staged.connect(self._follow_controller)
        self.refresh()

    def refresh(self) -> None:
        """Say how many objects are marked, and enable what can be done."""
        session = self._workspace.session
        marked = frozenset() if session is None else session.examples
        whose = "your confidence" if self._oracle is not None else "the default confidence"
        if self.job.running:
            self.told.setText("Working…")
        else:
            wanted = f", training needs {NEEDED}" if 0 < len(marked) < NEEDED else ""
            said = f"{len(marked)} marked good{wanted}. Judged by {whose}."
            self.told.setText(said + self._doubt())
        some = set() if session is None else set(self._chosen())
        idle = session is not None and not self.job.running
        self.mark.setEnabled(idle and bool(some - marked))
        self.unmark.setEnabled(idle and bool(some & marked))
        self.train.setEnabled(idle and len(marked) >= NEEDED)
        self.load.setEnabled(idle)
        self.restore.setEnabled(idle and self._oracle is not None)

    def _doubt(self) -> str:
        """Return what to say where the confidence has never seen anything like these objects."""
        session = self._workspace.session
        if session is None or "confidence" not in session.objects:
            return ""
        scores = session.objects["confidence"].to_numpy(float)
        known = scores[~np.isnan(scores)]
        if len(known) < FEW or np.quantile(known, 0.9) > UNLIKE:
            return ""
        return " It was taught on other things than these: mark good ones and train your own."

    def _mark(self, good: bool) -> None:
        self._workspace.mark_examples(self._chosen(), good)
        self.refresh()

    def _ask_where_to_save(self) -> None:
        path, _ = QFileDialog.getSaveFileName(self, "Train on the marked", "oracle.npz", FILES)
        if path:
            self.train_to(path if path.endswith(".npz") else f"{path}.npz")

    def _ask_what_to_load(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Load a confidence", "", FILES)
        if path:
            self.judge_by(path)

    def train_to(self, path: str) -> None:
        """Train on the marked objects, save the result and judge by it."""
        session = self._workspace.session
        labels, good = session.labels, session.examples

        def work(progress: Progress) -> tuple[Any, Mapping[int, float]]:
            from napari_unpack.segmentation.training import train_on_marked

            progress(0.0, "Learning")
            oracle = train_on_marked(session.volume, labels, session.spacing, good)
            oracle.save(path)
            return oracle, _scores(session, labels, oracle)

        self._begin(session, work)

    def judge_by(self, path: str | None) -> None:
        """Judge by the confidence in a file; None is the one that comes with the plugin."""
        session = self._workspace.session
        labels = session.labels

        def work(progress: Progress) -> tuple[Any, Mapping[int, float]]:
            from napari_unpack.segmentation import Oracle

            progress(0.0, "Judging")
            oracle = None if path is None else Oracle.load(path)
            return oracle, _scores(session, labels, oracle)

        self._begin(session, work)

    def _begin(self, session: Any, work: Callable[[Progress], Any]) -> None:
        if self.job.running:
            return
        self._subject = session
        self.job.start(work)
        self.refresh()

    def _finish(self, outcome: TaskResult[Any]) -> None:
        session, self._subject = self._subject, None
        if not outcome.cancelled:
            with notifications.spoken():
                self._oracle, scores = outcome.get()
                session.use_oracle(self._oracle, scores)
                self._rescored()
        self.refresh()

    def _follow_controller(self) -> None:
        session, oracle = self._workspace.session, self._oracle
        if session is not None and oracle is not None:
            labels = session.labels
            self._begin(session, lambda _: (oracle, _scores(session, labels, oracle)))
        self.refresh()


def _scores(session: Any, labels: Any, oracle: Any) -> dict[int, float]:
    from napari_unpack.segmentation.object_table import confidences

    z, y, x = (float(v) for v in session.spacing)
    return confidences(labels, session.volume, (z, y, x), oracle)
