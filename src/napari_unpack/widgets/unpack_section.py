"""Step 3: take objects out, put them back, study one."""

from __future__ import annotations

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QCheckBox, QComboBox, QSlider, QSpinBox

from napari_unpack.widgets.directions import DIRECTIONS, name_of
from napari_unpack.widgets.notices import spoken
from napari_unpack.widgets.section import Disclosure, Section, button, form, label, row
from napari_unpack.widgets.settings import BACKENDS
from napari_unpack.widgets.workbench import Workbench

_FLYING = ("FLYING_OUT", "FLYING_BACK")


class UnpackSection(Section):
    """Buttons for unpack, restore and inspect, and one line that says how things stand.

    Parameters
    ----------
    workbench : Workbench
    """

    def __init__(self, workbench: Workbench) -> None:
        super().__init__("3", "Unpack")
        self._bench = workbench
        self._free: frozenset[int] | None = None
        self.direction = QComboBox()
        self.direction.addItems(list(DIRECTIONS))
        self.direction.setToolTip("Where objects leave to; by default straight towards you.")
        self.next = button("Unpack next", "Fly one object out that nothing blocks (N).", True)
        self.back = button("Restore last", "Fly the last object back the way it came (B).")
        self.count = QSpinBox()
        self.count.setRange(2, 999)
        self.count.setValue(5)
        self.count.setToolTip("How many objects Unpack several takes out.")
        self.several = button("Unpack 5", "Fly several objects out, one after another.")
        self.all_back = button("Restore all", "Fly everything back into the bag.")
        self.inspect = button("Inspect", "Study one object alone: the selected, or the last (I).")
        self.news = label("", "hint", wrap=True)
        self.force = button(
            "Take the least blocked", "Fly out the object of which the least is blocked."
        )
        self._arrange()
        self._connect()
        self._reload()

    def _arrange(self) -> None:
        self.contents.addLayout(form(Leave=self.direction))
        line = row(self.back, self.inspect)
        line.insertWidget(0, self.next, stretch=2)
        self.contents.addLayout(line)
        self.contents.addLayout(row(self.count, self.several, self.all_back))
        self.contents.addWidget(self.news)
        self.force.hide()
        self.contents.addWidget(self.force)

        more = Disclosure(
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
        more.contents.addLayout(form(Speed=self.speed, Draw_with=self.backend))
        more.contents.addWidget(self.least)
        self.contents.addWidget(more)

    def _connect(self) -> None:
        bench = self._bench
        self.next.clicked.connect(lambda: bench.unpack(1))
        self.several.clicked.connect(lambda: bench.unpack(self.count.value()))
        self.back.clicked.connect(lambda: bench.restore(1))
        self.all_back.clicked.connect(bench.restore_all)
        self.force.clicked.connect(bench.unpack_least)
        self.inspect.clicked.connect(self._toggle_inspection)
        self.count.valueChanged.connect(lambda n: self.several.setText(f"Unpack {n}"))
        self.direction.currentTextChanged.connect(self._set_direction)
        self.speed.valueChanged.connect(self._set_speed)
        self.backend.currentTextChanged.connect(self._set_backend)
        self.least.toggled.connect(self._set_policy)
        bench.staged.connect(self._reload)
        bench.changed.connect(lambda _: self._refresh())

    def _reload(self) -> None:
        stage = self._bench.stage
        self._free = None
        self.lock("Available after step 1." if stage is None else None)
        if stage is not None:
            widgets = (self.speed, self.backend, self.direction, self.least)
            blocked = [w.blockSignals(True) for w in widgets]
            self.speed.setValue(round(stage.seconds * 10))
            self.backend.setCurrentText(
                next((k for k, v in BACKENDS.items() if v == stage.backend), "Best available")
            )
            self.direction.setCurrentText(
                name_of(stage.session.direction) or self.direction.currentText()
            )
            self.least.setChecked(bool(stage.session.take_least_occluded))
            for widget, was in zip(widgets, blocked, strict=True):
                widget.blockSignals(was)
        self._refresh()

    def tell_free(self, ids: frozenset[int] | None) -> None:
        """Say how many objects are free now; None while that is unknown."""
        self._free = ids
        self._refresh()

    def _set_direction(self, name: str) -> None:
        if self._bench.session is not None:
            with spoken():
                self._bench.session.direction = DIRECTIONS[name]

    def _set_speed(self, tenths: int) -> None:
        if self._bench.stage is not None:
            self._bench.stage.seconds = tenths / 10

    def _set_backend(self, name: str) -> None:
        if self._bench.stage is not None:
            with spoken():
                self._bench.stage.backend = BACKENDS[name]

    def _set_policy(self, least: bool) -> None:
        if self._bench.session is not None:
            self._bench.session.take_least_occluded = least
            self._refresh()

    def _toggle_inspection(self) -> None:
        session = self._bench.session
        names = {i: state.name for i, state in session.states.items()}
        if "INSPECTED" in names.values():
            self._bench.leave()
            return
        out = [i for i, name in names.items() if name == "UNPACKED"]
        chosen = sorted(session.selected) or out
        if chosen:
            self._bench.inspect(chosen[-1])

    def _refresh(self) -> None:
        session = self._bench.session
        names = [] if session is None else [state.name for state in session.states.values()]
        packed, out = names.count("PACKED"), names.count("UNPACKED")
        flying = sum(names.count(name) for name in _FLYING)
        inspected = "INSPECTED" in names
        self.next.setEnabled(packed > 0 and not inspected)
        self.several.setEnabled(packed > 0 and not inspected)
        self.back.setEnabled((out > 0 or flying > 0) and not inspected)
        self.all_back.setEnabled((out > 0 or flying > 0) and not inspected)
        self.inspect.setText("Leave" if inspected else "Inspect")
        selected = bool(session.selected) if session is not None else False
        self.inspect.setEnabled(inspected or out > 0 or selected)
        self.set_status(f"{packed} in, {out + flying + inspected} out" if names else "")
        self.news.setText(self._sentence(packed, out, flying, inspected))
        stuck = self._free == frozenset() and packed > 0 and not flying and not inspected
        self.force.setVisible(stuck and not session.take_least_occluded)

    def _sentence(self, packed: int, out: int, flying: int, inspected: bool) -> str:
        if inspected:
            return "One object alone: drag turns it, Escape returns."
        if flying:
            return f"{flying} {'object is' if flying == 1 else 'objects are'} in the air."
        if packed == 0 and out:
            return "The bag is empty. Double-click an object to study it alone."
        if self._free is None or packed == 0:
            return ""
        if not self._free:
            return (
                "Every object is blocked from here; the least blocked leaves next."
                if self._bench.session.take_least_occluded
                else "Every object is blocked from here: turn the bag, or choose a direction."
            )
        return f"{len(self._free)} of {packed} {'is' if len(self._free) == 1 else 'are'} free now."
