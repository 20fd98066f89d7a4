"""Beside an object that is studied alone: its facts, its opacity, a cut, and what is in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import Qt, QTimer
from qtpy.QtWidgets import QSlider, QWidget

from napari_unpack.session.errors import percent
from napari_unpack.tasks import TaskResult
from napari_unpack.widgets.job import Job
from napari_unpack.widgets.notifications import spoken
from napari_unpack.widgets.opacity_editor import OpacityEditor, Point, histogram
from napari_unpack.widgets.section import button, column, form, label, row
from napari_unpack.widgets.workspace import Workspace

_LIVE_MS = 40


class InspectionBox(QWidget):
    """Shown while an object is inspected; what is set here leaves the bag as it is.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__()
        self._workspace = workspace
        self._shown = 0
        self._job = Job(self)
        self._job.ended.connect(self._tell)
        self.facts = label("", "hint", wrap=True)
        self.facts.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.editor = OpacityEditor()
        self.cut = QSlider(Qt.Orientation.Horizontal)
        self.cut.setRange(0, 100)
        self.cut.setToolTip("Cut the object open from your side; turn it to see the cut.")
        self.open = button("Open", "Take out what is inside it, as a bag of its own.", True)
        self.plain = button("Reset", "Show it as in the bag again: no own curve, no cut.")
        contents = column(self)
        contents.addWidget(self.facts)
        contents.addWidget(self.editor)
        contents.addLayout(form(Cut=self.cut))
        contents.addLayout(row(self.open, self.plain))
        self._edited: list[Point] | None = None
        self._live = QTimer(self)
        self._live.setSingleShot(True)
        self._live.setInterval(_LIVE_MS)
        self._live.timeout.connect(self._apply)
        self.editor.edited.connect(self._edit)
        self.cut.valueChanged.connect(lambda _: self._start())
        self.open.clicked.connect(lambda: workspace.open_object(self._shown))
        self.plain.clicked.connect(self._reset)
        workspace.changed.connect(self._follow)
        workspace.staged.connect(self._follow)
        self.hide()

    def _follow(self, _news: Any = None) -> None:
        session = self._workspace.session
        states = {} if session is None else session.states
        now = next((i for i, state in states.items() if state.name == "INSPECTED"), 0)
        if now == self._shown:
            return
        self._shown = now
        self._live.stop()
        self.setVisible(bool(now))
        if now:
            self._load()

    def _load(self) -> None:
        from napari_unpack.rendering.object_style import facts_of

        session, object_id = self._workspace.session, self._shown
        self.facts.setText("…")
        if not self._job.running:
            self._job.start(lambda _progress: (object_id, facts_of(session, object_id)))
        function = session.transfer_function_of(object_id)
        low, high = (float(v) for v in function.domain)
        window = session.boxes.slices(object_id)
        inside = session.labels[window] == object_id
        self.editor.show_histogram(histogram(session.volume[window][inside], (low, high)))
        self.editor.show_curve(function.points, (low, high))
        blocked = self.cut.blockSignals(True)
        self.cut.setValue(0)
        self.cut.blockSignals(blocked)
        self._edited = None

    def _tell(self, outcome: TaskResult[Any]) -> None:
        if not self._shown or self._workspace.session is None:
            return
        with spoken():
            object_id, facts = outcome.get()
            if object_id != self._shown:
                self._load()
                return
            names = self._workspace.session.objects["name"]
            self.facts.setText(describe(facts, [str(names[i]) for i in facts.neighbours]))

    def _edit(self, points: list[Point]) -> None:
        self._edited = points
        self._start()

    def _start(self) -> None:
        if not self._live.isActive():
            self._live.start()

    def _apply(self) -> None:
        from napari_unpack.appearance import TransferFunction
        from napari_unpack.rendering.object_style import ObjectStyle

        session, object_id = self._workspace.session, self._shown
        if session is None or not object_id:
            return
        known = session.study(object_id)
        own = known.transfer_function
        if self._edited is not None:
            colors = session.transfer_function_of(object_id).colors
            with spoken():
                own = TransferFunction(self._edited, colors)
        session.set_study(object_id, ObjectStyle(own, self._plane()))

    def _plane(self) -> Any:
        """Return the plane that takes the nearest part away, as the object is turned now."""
        from napari_unpack.rendering.object_style import cut_open

        depth = self.cut.value() / 100
        if depth == 0:
            return None
        session, rotation = (
            self._workspace.session,
            self._workspace.controller.rotation_of(self._shown),
        )
        return cut_open(session, self._shown, rotation, depth)

    def _reset(self) -> None:
        if self._workspace.session is not None and self._shown:
            self._workspace.session.set_study(self._shown, None)
            self._load()


def describe(facts: Any, neighbours: list[str]) -> str:
    """Write an object's facts as rich text."""
    size = " × ".join(f"{edge:.0f}" for edge in facts.size_mm)
    volume = facts.volume_mm3 / 1000
    lines = [
        f"<b>{facts.name}</b>",
        f"{size} mm along its own axes",
        f"{volume:.1f} cm³, density {facts.mean:.0f} ± {facts.spread:.0f}",
    ]
    if not np.isnan(facts.confidence):
        lines.append(f"{percent(facts.confidence)} sure that it is one whole object")
    if neighbours:
        more = f" and {len(neighbours) - 4} more" if len(neighbours) > 4 else ""
        lines.append(f"touched {', '.join(neighbours[:4])}{more}")
    else:
        lines.append("touched nothing")
    return "<br>".join(lines)
