"""Beside an inspected object: its facts, its opacity, a cut, and a button that opens it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtCore import QSignalBlocker, Qt
from qtpy.QtWidgets import QSlider, QWidget

from napari_unpack.geometry.length_unit import MM, LengthUnit, density_text
from napari_unpack.session.errors import listed_objects, percent
from napari_unpack.session.object_state import ObjectState
from napari_unpack.session.quantities import three_digits, volume_words
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard
from napari_unpack.widgets.notifications import errors_shown, show_error
from napari_unpack.widgets.opacity_editor import OpacityEditor, Point, histogram
from napari_unpack.widgets.section import button, column, form, label, row
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.geometry.axes import Vector
    from napari_unpack.session import Session
    from napari_unpack.session.object_facts import Facts

SLOT = "facts of the inspected object"

# A drag is applied 25 times a second: about as often as bag or object can be drawn.
APPLY_MS = 40


class _Cut(KeepsKeyboard, QSlider):
    """A slider that goes with the inspection."""


class InspectionBox(KeepsKeyboard, QWidget):
    """Shown while an object is inspected; what is set here leaves the bag as it is.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    """

    def __init__(self, workspace: Workspace, commands: Commands) -> None:
        super().__init__()
        self._workspace = workspace
        self._inspected = 0
        self._points: list[Point] | None = None
        self._known: Facts | None = None
        self.facts = label("", "hint", wrap=True, rich=True)
        self.facts.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.editor = OpacityEditor()
        self.editor.setAccessibleName("Opacity curve of this object")
        self.cut = _Cut(Qt.Orientation.Horizontal)
        self.cut.setRange(0, 100)
        self.cut.setToolTip("Cut the object open from your side; the cut ends with the inspection.")
        self.open = button("Open", "Show what is inside the object as a bag of its own.")
        self.reset = button("Reset", "Take the cut and the object's own opacity curve away.")
        contents = column(self)
        contents.addWidget(self.facts)
        contents.addWidget(self.editor)
        contents.addLayout(form(Cut=self.cut))
        contents.addWidget(row(self.open, self.reset))
        self.editor.edited.connect(self._edit)
        self.cut.valueChanged.connect(lambda _: self._apply_soon())
        self.open.clicked.connect(lambda: commands.open_container(self._inspected))
        self.reset.clicked.connect(self._reset)
        workspace.changed.connect(self._follow)
        workspace.switched.connect(lambda: self._follow())
        self.hide()

    def _follow(self, change: Change | None = None) -> None:
        session = self._workspace.session
        inspected = next(iter(objects_in(session, ObjectState.INSPECTED)), 0)
        # News come with every flight; only another object is of interest here.
        if inspected == self._inspected:
            # The unit of lengths is among the surroundings, names are among the states.
            if change is not None and change & (Change.SURROUNDINGS | Change.STATES):
                self._describe()
            return
        self._inspected = inspected
        self._workspace.scheduler.forget(self._apply)
        self.setVisible(bool(inspected))
        if session is not None and inspected:
            self._load(session, inspected)

    def _load(self, session: Session, object_id: int) -> None:
        from napari_unpack.session.object_facts import facts_of

        self.facts.setText("…")
        self._known = None
        # In a worker: the tightest box and the neighbours of a large object take a while.
        task = Task(object(), lambda _: facts_of(session, object_id))
        show = partial(self._show_facts, session, object_id)
        self._workspace.scheduler.submit(task, Worker.LONG, show, failed=show_error, slot=SLOT)
        function = session.transfer_function_of(object_id)
        low, high = (float(v) for v in function.domain)
        window = session.boxes.slices(object_id)
        inside = session.labels[window] == object_id
        self.editor.show_histogram(histogram(session.volume[window][inside], (low, high)))
        self.editor.show_curve(function.points, (low, high))
        with QSignalBlocker(self.cut):
            self.cut.setValue(0)
        self._points = None

    def _show_facts(self, session: Session, object_id: int, facts: Facts) -> None:
        # The facts of an object left meanwhile come late.
        if session is self._workspace.session and object_id == self._inspected:
            self._known = facts
            self._describe()

    def _describe(self) -> None:
        facts, session = self._known, self._workspace.session
        # Facts outlive the inspection.
        if facts is not None and session is not None and self._inspected:
            names = session.objects["name"]
            # Some may have been deleted since.
            neighbours = [str(names[i]) for i in facts.neighbours if i in names.index]
            named = replace(facts, name=str(names[self._inspected]))
            self.facts.setText(describe(named, neighbours, session.length_unit))

    def _edit(self, points: list[Point]) -> None:
        self._points = points
        self._apply_soon()

    def _apply_soon(self) -> None:
        self._workspace.scheduler.throttle(APPLY_MS, self._apply)

    def _apply(self) -> None:
        from napari_unpack.appearance import TransferFunction
        from napari_unpack.rendering.object_style import ObjectStyle

        session, object_id = self._workspace.session, self._inspected
        if session is None or not object_id:
            return
        # A cut alone must keep the opacity set before.
        own = session.style(object_id).transfer_function
        if self._points is not None:
            colors = session.transfer_function_of(object_id).colors
            with errors_shown():
                own = TransferFunction(self._points, colors)
        session.set_style(object_id, ObjectStyle(own, self._cutting_plane()))

    def _cutting_plane(self) -> tuple[Vector, Vector] | None:
        """Return the plane that cuts the nearest part away, as the object is turned now."""
        from napari_unpack.rendering.object_style import cut_open

        controller, depth = self._workspace.controller, self.cut.value() / 100
        if depth == 0 or controller is None:
            return None
        session, held = controller.session, controller.rotation_of(self._inspected)
        towards = held[0] @ session.camera.stretch
        return cut_open(session.boxes, self._inspected, session.spacing, towards, depth)

    def _reset(self) -> None:
        session = self._workspace.session
        if session is not None and self._inspected:
            session.set_style(self._inspected, None)
            self._load(session, self._inspected)


def describe(facts: Facts, neighbours: Sequence[str], unit: LengthUnit = MM) -> str:
    """Write an object's facts as rich text.

    Parameters
    ----------
    facts : Facts
    neighbours : sequence of str
        Names of the objects that touched it, the largest contact first.
    unit : LengthUnit
    """
    # Three digits each, or edges of a cell would all be 0.
    size = " × ".join(three_digits(edge * unit.per_mm) for edge in facts.size_mm)
    lines = [
        f"<b>{escape(facts.name)}</b>",
        f"length × width × height {size} {unit.name}, along its own axes",
        f"{volume_words(facts.volume_mm3, unit)}, "
        f"mean density {density_text(facts.mean)} ± {density_text(facts.spread)}",
    ]
    if not np.isnan(facts.confidence):
        why = f": {'; '.join(facts.reasons)}" if facts.reasons else ""
        lines.append(f"confidence {percent(facts.confidence)} that it is one whole object{why}")
    if neighbours:
        lines.append(f"touches {escape(listed_objects(neighbours))}")
    else:
        lines.append("touches nothing")
    return "<br>".join(lines)
