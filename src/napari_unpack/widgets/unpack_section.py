"""Step 3: take objects out, put them back, study one."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QCheckBox, QComboBox, QSlider, QSpinBox

from napari_unpack.session.errors import share_of
from napari_unpack.widgets.directions import ALONG_ARROW, DIRECTIONS, name_of, words_of
from napari_unpack.widgets.inspection_box import InspectionBox
from napari_unpack.widgets.notifications import inform, spoken
from napari_unpack.widgets.preferences import BACKENDS
from napari_unpack.widgets.reveal_box import RevealBox, RevealPlanner
from napari_unpack.widgets.section import Collapsible, Section, button, form, label, row
from napari_unpack.widgets.step_slider import StepSlider
from napari_unpack.widgets.workspace import Workspace

PERSPECTIVE = 20.0
"""Vertical field of view of a gentle perspective, degrees."""

_LOOKING = "Looking for what can leave…"
_FLYING = ("FLYING_OUT", "FLYING_BACK")


class UnpackSection(Section):
    """Buttons for unpack, restore and inspect, and one line that says how things stand.

    Parameters
    ----------
    workspace : Workspace
    ways : RevealPlanner
        Knows of other directions.
    """

    def __init__(self, workspace: Workspace, ways: RevealPlanner) -> None:
        super().__init__("3", "Unpack")
        self._workspace, self._ways = workspace, ways
        self._free: frozenset[int] | None = None
        self._best: Any = None
        self.direction = QComboBox()
        self.direction.addItems(list(DIRECTIONS))
        self.direction.setToolTip("Where objects leave to; by default straight towards you.")
        self.draw = button(
            "Draw…",
            "Drag an arrow in the picture: objects leave along it. With "
            "Shift, press on a surface: they leave straight out of it.",
        )
        self.draw.setCheckable(True)
        self.next = button("Unpack next", "Fly one object out that nothing blocks (N).", True)
        self.back = button("Restore last", "Fly the last object back the way it came (B).")
        self.count = QSpinBox()
        self.count.setRange(2, 999)
        self.count.setValue(5)
        self.count.setToolTip("How many objects Unpack several takes out.")
        self.several = button("Unpack 5", "Fly several objects out, one after another.")
        self.all_back = button("Restore all", "Fly everything back into the bag.")
        self.chosen = button("Selected", "Fly the selected objects out, with who blocks them not.")
        self.all_free = button("All free", "Fly out everything that nothing blocks now.")
        self.inspect = button("Inspect", "Study one object alone: the selected, or the last (I).")
        self.scrub = StepSlider(workspace)
        self.news = label("", "hint", wrap=True)
        self.force = button(
            "Take the least blocked", "Fly out the object of which the least is blocked."
        )
        self.way = button("", "Let objects leave along the direction that frees the most.")
        self.box = RevealBox(ways)
        self.studied = InspectionBox(workspace)
        self.outside = button("Back to the bag", "Leave the opened object (Escape).", True)
        self._arrange()
        self._connect()
        self._reload()

    def _arrange(self) -> None:
        leave = form(Leave=self.direction)
        aim = row()
        aim.addLayout(leave, stretch=1)
        aim.addWidget(self.draw)
        self.contents.addLayout(aim)
        line = row(self.back, self.inspect)
        line.insertWidget(0, self.next, stretch=2)
        self.contents.addLayout(line)
        self.contents.addLayout(row(self.count, self.several, self.all_back))
        self.reveal = button(
            "Reveal…", "See what must leave first for the selected object, and along which way (R)."
        )
        self.contents.addLayout(row(self.chosen, self.all_free, self.reveal))
        self.contents.addWidget(self.scrub)
        self.contents.addWidget(self.box)
        self.contents.addWidget(self.studied)
        self.contents.addWidget(self.outside)
        self.contents.addWidget(self.news)
        for extra in (self.way, self.force):
            extra.hide()
            self.contents.addWidget(extra)

        more = Collapsible(
            "Speed, drawing, rules", "How fast objects fly, what draws them, and who may leave."
        )
        self.speed = QSlider(Qt.Orientation.Horizontal)
        self.speed.setRange(1, 30)
        self.speed.setInvertedAppearance(True)
        self.speed.setToolTip("Speed of a flight: slow on the left, fast on the right.")
        self.backend = QComboBox()
        self.backend.addItems(list(BACKENDS))
        self.backend.setToolTip("What draws the bag: the graphics card, or the processor.")
        self.least = QCheckBox("If all are blocked, take the least")
        self.least.setToolTip(
            "When nothing is free along the direction, Unpack next takes the object that is "
            "blocked least; otherwise it tells you."
        )
        self.marked = QCheckBox("Outline what is free")
        self.marked.setChecked(True)
        self.marked.setToolTip(
            "Outline in the picture who can leave now; in yellow, who leaves together; in orange, "
            "where nobody can, who is blocked least."
        )
        self.deep = QCheckBox("Gentle perspective")
        self.deep.setToolTip("Let what is nearer look larger, so that flights come towards you.")
        more.contents.addLayout(form(Speed=self.speed, Draw_with=self.backend))
        for check in (self.least, self.marked, self.deep):
            more.contents.addWidget(check)
        self.contents.addWidget(more)

    def _connect(self) -> None:
        workspace = self._workspace
        self.next.clicked.connect(lambda: workspace.unpack(1))
        self.several.clicked.connect(lambda: workspace.unpack(self.count.value()))
        self.back.clicked.connect(lambda: workspace.restore(1))
        self.all_back.clicked.connect(workspace.restore_all)
        self.force.clicked.connect(workspace.unpack_least)
        self.inspect.clicked.connect(self._toggle_inspection)
        self.count.valueChanged.connect(lambda n: self.several.setText(f"Unpack {n}"))
        self.direction.currentTextChanged.connect(self._set_direction)
        self.speed.valueChanged.connect(self._set_speed)
        self.backend.currentTextChanged.connect(self._set_backend)
        self.least.toggled.connect(self._set_policy)
        self.marked.toggled.connect(self._set_marks)
        self.deep.toggled.connect(self._set_perspective)
        self.draw.toggled.connect(self._set_drawing)
        self.chosen.clicked.connect(workspace.unpack_selected)
        self.all_free.clicked.connect(workspace.unpack_free)
        self.reveal.clicked.connect(self.reveal_selected)
        self.way.clicked.connect(self._use_way)
        self.outside.clicked.connect(workspace.leave_object)
        self._ways.best.connect(self._tell_way)
        self._ways.found.connect(lambda one: self.box.show_found(one, workspace.session))
        self._ways.busy.connect(self._tell_busy)
        workspace.staged.connect(self._reload)
        workspace.changed.connect(lambda _: self._refresh())

    def _reload(self) -> None:
        controller = self._workspace.controller
        self._free = None
        self.lock("Available after step 1." if controller is None else None)
        if controller is not None:
            widgets = (self.speed, self.backend, self.direction, self.least)
            blocked = [w.blockSignals(True) for w in widgets]
            self.speed.setValue(round(controller.seconds * 10))
            self.backend.setCurrentText(
                next((k for k, v in BACKENDS.items() if v == controller.backend), "Best available")
            )
            self._show_direction()
            self.least.setChecked(bool(controller.session.take_least_occluded))
            for widget, was in zip(widgets, blocked, strict=True):
                widget.blockSignals(was)
            self._set_marks(self.marked.isChecked())
            self.deep.blockSignals(True)
            self.deep.setChecked(self._workspace.viewer.scene.camera.perspective > 0)
            self.deep.blockSignals(False)
            controller.events.drawn.connect(lambda: self.draw.setChecked(False))
            controller.events.looking.connect(self._tell_looking)
        self.draw.setEnabled(hasattr(controller, "drawing"))
        self.outside.setVisible(self._workspace.is_inside)
        self._refresh()

    def tell_free(self, ids: frozenset[int] | None) -> None:
        """Say how many objects are free now; None while that is unknown."""
        self._free = ids
        self._best = None
        self._refresh()
        if ids == frozenset() and not self._ways.running:
            self._ways.look()

    @property
    def answered(self) -> bool:
        """Whether it is known who is free and, if nobody is, which direction would help."""
        return self._free is not None and not self._ways.running

    def reveal_selected(self) -> None:
        """Find out what frees the selected object, if it is in the bag."""
        session = self._workspace.session
        chosen = [] if session is None else sorted(session.selected)
        if len(chosen) == 1:
            self._ways.reveal(chosen[0])
        elif session is not None:
            inform("Select one object in the bag to reveal: click it in the table.")

    def _tell_way(self, way: Any) -> None:
        self._best = way
        self._refresh()

    def _tell_busy(self, busy: bool) -> None:
        self.reveal.setText("Looking…" if busy else "Reveal…")

    def _tell_looking(self, looking: bool) -> None:
        # Said at once: what is asked meanwhile waits for the answer.
        self.news.setText(_LOOKING if looking else "")
        self.news.repaint()

    def _use_way(self) -> None:
        if self._best is not None and self._workspace.session is not None:
            with spoken():
                self._workspace.session.direction = tuple(float(v) for v in self._best.direction)

    def _set_direction(self, name: str) -> None:
        if self._workspace.session is not None and name in DIRECTIONS:
            with spoken():
                self._workspace.session.direction = DIRECTIONS[name]

    def _show_direction(self) -> None:
        """Show D; one without a name is listed as long as it is D."""
        direction = self._workspace.session.direction
        name = name_of(direction)
        box, named = self.direction, len(DIRECTIONS)
        blocked = box.blockSignals(True)
        while box.count() > named:
            box.removeItem(named)
        if name is None:
            name = ALONG_ARROW
            box.addItem(name)
        box.setCurrentText(name)
        box.blockSignals(blocked)

    def _set_drawing(self, drawing: bool) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.drawing = drawing

    def _set_marks(self, marked: bool) -> None:
        overlays = getattr(self._workspace.controller, "overlays", None)
        if overlays is not None:
            overlays.mark_free = marked

    def _set_perspective(self, deep: bool) -> None:
        if self._workspace.controller is not None:
            self._workspace.viewer.scene.camera.perspective = PERSPECTIVE if deep else 0.0
            self._workspace.controller.frame_bag()

    def _set_speed(self, tenths: int) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.seconds = tenths / 10

    def _set_backend(self, name: str) -> None:
        if self._workspace.controller is not None:
            with spoken():
                self._workspace.controller.backend = BACKENDS[name]

    def _set_policy(self, least: bool) -> None:
        if self._workspace.session is not None:
            self._workspace.session.take_least_occluded = least
            self._refresh()

    def _toggle_inspection(self) -> None:
        session = self._workspace.session
        names = {i: state.name for i, state in session.states.items()}
        if "INSPECTED" in names.values():
            self._workspace.leave()
            return
        out = [i for i, name in names.items() if name == "UNPACKED"]
        chosen = sorted(session.selected) or out
        if chosen:
            self._workspace.inspect(chosen[-1])

    def _refresh(self) -> None:
        session = self._workspace.session
        names = [] if session is None else [state.name for state in session.states.values()]
        packed, out = names.count("PACKED"), names.count("UNPACKED")
        flying = sum(names.count(name) for name in _FLYING)
        inspected = "INSPECTED" in names
        self.next.setEnabled(packed > 0 and not inspected)
        self.several.setEnabled(packed > 0 and not inspected)
        self.chosen.setEnabled(packed > 0 and not inspected)
        self.all_free.setEnabled(packed > 0 and not inspected and bool(self._free))
        self.reveal.setEnabled(packed > 0 and not inspected)
        self.back.setEnabled((out > 0 or flying > 0) and not inspected)
        self.all_back.setEnabled((out > 0 or flying > 0) and not inspected)
        self.inspect.setText("Leave" if inspected else "Inspect")
        selected = bool(session.selected) if session is not None else False
        self.inspect.setEnabled(inspected or out > 0 or selected)
        self.set_status(f"{packed} in, {out + flying + inspected} out" if names else "")
        self.news.setText(self._sentence(packed, out, flying, inspected))
        stuck = self._free == frozenset() and packed > 0 and not flying and not inspected
        self.force.setVisible(stuck and not session.take_least_occluded)
        self.way.setVisible(stuck and self._best is not None)
        if self._best is not None:
            count = len(self._best.ids)
            self.way.setText(f"Use that direction ({count} free)")
        if session is not None:
            self._show_direction()
        self.box.look(session)

    def _sentence(self, packed: int, out: int, flying: int, inspected: bool) -> str:
        if inspected:
            return "One object alone: drag turns it, Escape returns."
        if flying:
            return f"{flying} {'object is' if flying == 1 else 'objects are'} in the air."
        if packed == 0 and out:
            return "The bag is empty. Double-click an object to study it alone."
        if packed == 0:
            return ""
        if self._free is None:
            return _LOOKING
        if not self._free:
            return self._stuck()
        return f"{len(self._free)} of {packed} {'is' if len(self._free) == 1 else 'are'} free now."

    def _stuck(self) -> str:
        """Say that nobody is free, who is blocked least, and what another direction would free."""
        session = self._workspace.session
        least = session.least_occluded_object()
        which = "the least blocked"
        if least is not None:
            object_id, ratio = least
            which = f"{session.objects['name'][object_id]}, {share_of(ratio)} hidden,"
        said = (
            f"Every object is blocked this way; {which} leaves next."
            if session.take_least_occluded
            else f"Every object is blocked this way; {which} is blocked least. Turn the bag, or "
            "choose a direction."
        )
        if self._best is not None:
            count = len(self._best.ids)
            words = words_of(self._best.direction, session.camera)
            said += f" {words.capitalize()}, {count} would be free."
        return said
