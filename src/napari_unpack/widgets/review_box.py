"""Review: the most doubtful decisions one at a time, shown close up, answered by one key."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import Qt
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import QLabel

from napari_unpack.session.errors import listed_objects
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.file_names import ask_where_to_write
from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.section import Collapsible, button, keep_lines, label, row, scroll_to
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.segmentation.review.doubts import Doubt, Said
    from napari_unpack.session import Session

SLOT, PICTURE_SLOT = "review", "review picture"
# Pixels: two pictures side by side fit the panel at its narrowest.
SIDE = 136
# Keys that no other command of the panel has.
KEYS: dict[str, Said] = {"S": "same", "D": "different", "X": "nothing", "K": "skip"}
QUESTIONS = {
    "join": "One object now. Are orange and blue the same thing?",
    "border": "Two objects now. Are orange and blue the same thing?",
    "object": "Is the orange one a thing, or specks and streaks?",
}

SAME_HELP = "They are one object: join them, or leave them joined (S)."
OBJECT_HELP = "It is an object: leave it as it is (S)."


class ReviewBox(Collapsible):
    """Questions about the labels, the most worthwhile first; each answer is applied at once.

    Parameters
    ----------
    workspace : Workspace
    repair : RepairTools
        It changes the labels, one repair at a time.
    """

    def __init__(self, workspace: Workspace, repair: RepairTools) -> None:
        super().__init__(
            "Review", "Answer questions about what the segmentation was least sure of."
        )
        self._workspace, self._repair = workspace, repair
        self._left: list[Doubt] = []
        self._asked = self._now()
        self.sentence = label("", "hint", wrap=True, rich=True)
        self.picture = QLabel()
        self.picture.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.picture.setFixedHeight(SIDE)
        self.picture.setToolTip(
            "Left both sides in 3D, right the slice through where they meet: "
            "orange is the first side, blue the second."
        )
        self.picture.setAccessibleName("The decision, close up")
        self.answers = {
            "same": button("Same", SAME_HELP),
            "different": button(
                "Different", "They are two objects: cut them, or leave them apart (D)."
            ),
            "nothing": button(
                "Not an object", "The orange side is no object: remove it from the labels (X)."
            ),
            "skip": button("Skip", "Leave it as it is, and ask no more (K)."),
        }
        self.save = button(
            "Save answers…",
            "Save the answers as training data: what was measured, and what you said.",
        )
        self.contents.addWidget(self.sentence)
        self.contents.addWidget(self.picture)
        self.contents.addWidget(row(self.answers["same"], self.answers["different"]))
        self.contents.addWidget(row(self.answers["nothing"], self.answers["skip"]))
        self.contents.addWidget(self.save)
        for said in KEYS.values():
            self.answers[said].clicked.connect(partial(self.answer, said))
        self.save.clicked.connect(self._ask_where_to_save)
        # The buttons stay where they are from question to question.
        self.toggle.toggled.connect(lambda _: keep_lines(self.sentence, 3))
        self.toggle.toggled.connect(lambda _: self._ask())
        repair.busy.connect(lambda _: self._enable())
        workspace.switched.connect(self._follow)
        workspace.changed.connect(self._hear)
        self._follow()

    @property
    def doubt(self) -> Doubt | None:
        """What is asked now; None from a change of the labels or an answer until the next."""
        # The panel hears of changes a moment later: a key must not answer meanwhile.
        return self._left[0] if self._left and self._asked == self._now() else None

    def _now(self) -> tuple[object, ...]:
        """Return what the doubts depend on."""
        session = self._workspace.session
        if session is None:
            return ()
        return session, session.label_data.revision, session.review.answers

    def answer(self, said: Said, _checked: bool = False) -> None:
        """Answer what is asked now, and ask the next.

        Parameters
        ----------
        said : {"same", "different", "nothing", "skip"}
        """
        doubt, session = self.doubt, self._workspace.session
        # A key may come while the last answer is still being worked out, or nobody sees a question.
        offered = self.answers[said].isEnabled() and self.sentence.isVisible()
        if doubt is None or session is None or not offered:
            return
        self._repair.answer(doubt, said)

    def answer_by_key(self, said: Said) -> None:
        """Answer what is asked now; a question scrolled out of sight is first brought into it.

        Parameters
        ----------
        said : {"same", "different", "nothing", "skip"}
        """
        asked = self.sentence
        if asked.isVisible() and not asked.visibleRegion().contains(asked.rect().center()):
            scroll_to(self)
        else:
            self.answer(said)

    def _follow(self) -> None:
        # Two sessions ask with equal keys: what is looked for in the one shown before answers none.
        for slot in (SLOT, PICTURE_SLOT):
            self._workspace.scheduler.cancel(slot)
        self._left = []
        self.picture.clear()
        self._ask()

    def _hear(self, change: Change) -> None:
        if change & (Change.LABELS | Change.REVIEW):
            self._ask()
        elif Change.STATES in change and self.doubt is not None:
            # Names are among them, and what has left or come back.
            self._describe(self.doubt)
            self._enable()

    def _ask(self) -> None:
        """Have the doubts found, where somebody looks at them."""
        session = self._workspace.session
        self._left, self._asked = [], self._now()
        self.picture.clear()
        task = None if session is None else session.review.doubts_task()
        if session is not None and task is not None and self.toggle.isChecked():
            self.sentence.setText("Looking for what is doubtful…")
            take = partial(self._take, session, self._asked)
            self._workspace.scheduler.submit(task, Worker.LONG, take, slot=SLOT)
        elif task is None:
            self.sentence.setText(
                "There is nothing to review: only objects that Segment has found here have "
                "questions."
            )
        self._enable()

    def _take(self, session: Session, asked: tuple[object, ...], left: list[Doubt]) -> None:
        # Of another session, or of before the last change or answer: its own will come.
        if asked != self._now():
            return
        # First what can be answered as it is; among equals the order stays.
        outside = session.label_editor.outside
        self._left = sorted(left, key=lambda d: bool(outside(d.objects)))
        doubt, done = self.doubt, len(session.review.answers)
        if doubt is None:
            self.picture.clear()
            self.sentence.setText(f"All is reviewed: {done} answered.")
        else:
            self._describe(doubt)
            self.picture.setText("Drawing it close up…")
            pixels = round(SIDE * self.devicePixelRatioF())
            self._workspace.scheduler.submit(
                session.review.picture_task(doubt, pixels),
                Worker.LONG,
                partial(self._show_picture, doubt),
                slot=PICTURE_SLOT,
                failed=lambda _: self.picture.clear(),
            )
        self._enable()

    def _describe(self, doubt: Doubt) -> None:
        session = self._workspace.session
        if session is not None:
            done, known = len(session.review.answers), session.label_data.known
            objects = session.objects["name"]
            of = dict.fromkeys(str(objects[i]) for i in doubt.objects if i and i in known)
            self.sentence.setText(
                f"<b>{done + 1} of {done + len(self._left)}</b> {escape(' and '.join(of))}"
                f"<br>{QUESTIONS[doubt.kind]}"
            )
            if away := session.label_editor.outside(doubt.objects):
                names = escape(listed_objects(str(objects[i]) for i in sorted(away)))
                self.sentence.setText(f"{self.sentence.text()}<br>Restore {names} to change it.")

    def _show_picture(self, doubt: Doubt, pixels: NDArray[np.uint8]) -> None:
        if doubt is not self.doubt:
            return
        height, width = pixels.shape[:2]
        kept = np.ascontiguousarray(pixels)
        image = QImage(kept.data, width, height, 4 * width, QImage.Format.Format_RGBA8888)
        # A copy: the array goes when this call ends.
        picture = QPixmap.fromImage(image.copy())
        picture.setDevicePixelRatio(self.devicePixelRatioF())
        self.picture.setPixmap(picture)

    def _enable(self) -> None:
        session, doubt = self._workspace.session, self.doubt
        idle = doubt is not None and not self._repair.running
        away = session and doubt and session.label_editor.outside(doubt.objects)
        for said in KEYS.values():
            pressed = self.answers[said]
            offered = doubt is None or doubt.kind != "object" or said != "different"
            # A hidden button alone would still answer by its key.
            pressed.setEnabled(idle and offered and not (away and doubt and doubt.changed_by(said)))
            pressed.setVisible(offered)
        alone = doubt is not None and doubt.kind == "object"
        self.answers["same"].setText("An object" if alone else "Same")
        self.answers["same"].setToolTip(OBJECT_HELP if alone else SAME_HELP)
        self.save.setEnabled(session is not None and bool(session.review.answers))

    def _ask_where_to_save(self) -> None:
        answer = ask_where_to_write(
            self, "Save the answers", "answers.npz", "Training data (*.npz)", (".npz",)
        )
        session = self._workspace.session
        if answer is not None and session is not None:
            from napari_unpack.io.answers import save_answers

            with errors_shown():
                save_answers(session, answer[0])
