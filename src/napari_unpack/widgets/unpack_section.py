"""Step 3: take objects out, put them back, inspect one."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from qtpy.QtCore import QSignalBlocker, Qt
from qtpy.QtWidgets import QGridLayout, QHBoxLayout, QSlider, QSpinBox, QWidget

from napari_unpack.session.errors import NOTHING_UNPACKABLE, listed, share_of
from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.directions import ALONG_ARROW, DIRECTIONS, name_of, words_of
from napari_unpack.widgets.inspection_box import InspectionBox
from napari_unpack.widgets.narrow import Check, Choice
from napari_unpack.widgets.preferences import BACKENDS
from napari_unpack.widgets.reveal_box import RevealBox, RevealPlanner
from napari_unpack.widgets.section import (
    Collapsible,
    Section,
    button,
    column,
    form,
    keep_lines,
    keep_room,
    label,
    row,
)
from napari_unpack.widgets.step_slider import StepSlider
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.view_box import ViewBox
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.unpacking.direction_survey import BestDirection, RevealPlan

SEARCHING = "Looking for unpackable objects…"

# As in the plugin's preferences.
FLIGHT_SECONDS = (0.1, 5.0)

# In three lines, as any sentence of this place.
DRAWING = (
    "Drag an arrow, or turn it with the arrow keys and press Enter (Shift+Enter: straight out of "
    "the surface). Escape: no arrow."
)

# Of one button, both ways.
INSPECT_HELP = (
    "Look at one object, the selected one or the last unpacked (I): a sprite alone, an object in "
    "the bag where it lies."
)
LEAVE_HELP = "Put the object back where it was, and show the bag (I or Escape)."


class UnpackSection(Section):
    """Buttons for unpack, restore and inspect, and one sentence that says how things stand.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    planner : RevealPlanner
        Finds other directions, and what blocks an object.
    """

    def __init__(self, workspace: Workspace, commands: Commands, planner: RevealPlanner) -> None:
        super().__init__("3", "Unpack")
        self._workspace, self._commands, self._planner = workspace, commands, planner
        self._unpackable: frozenset[int] | None = None
        self._best: BestDirection | None = None
        # Qt's own blue cannot be read on a dark panel; the theme's text takes its place.
        self.link_color = "gray"
        self.direction = Choice(*DIRECTIONS)
        self.direction.setToolTip(
            "In which direction objects leave; by default straight towards you."
        )
        self.draw = button(
            "Draw…",
            "Drag an arrow in the 3D view: objects leave along it. With "
            "Shift, press on a surface: they leave straight out of it. By keys: arrow keys turn "
            "the arrow, Enter takes it, Shift+Enter goes straight out of the surface that it "
            "starts from, Escape takes none.",
        )
        self.draw.setCheckable(True)
        self.next = button("Unpack next", "Unpack one object that nothing blocks (N).", True)
        self.back = button("Restore last", "Fly the last object back into the bag (B).")
        self.inspect = button("Inspect", INSPECT_HELP)
        self.count = QSpinBox()
        # Two digits and the buttons: a spin box asks for the room of seven.
        self.count.setMaximumWidth(100)
        self.count.setRange(2, 999)
        self.count.setValue(5)
        self.count.setToolTip("How many objects the button beside this unpacks.")
        self.count.setAccessibleName("How many objects to unpack")
        self.several = button("Unpack 5", "Unpack several objects, one after another.")
        self.all_back = button("Restore all", "Fly every object back into the bag.")
        self.chosen = button(
            "Unpack selected", "Unpack the selected objects, unless other objects block them."
        )
        self.all_unpackable = button(
            "All unpackable", "Unpack all objects that nothing blocks now."
        )
        self.reveal = button(
            "Reveal…", "Find the objects that block the selected one, and the best direction (R)."
        )
        self.step_slider = StepSlider(workspace, commands)
        self.view = ViewBox(commands)
        self.reveal_box = RevealBox(planner)
        self.inspection = InspectionBox(workspace, commands)
        self.back_to_bag = button(
            "Close the opened object", "Go back to the bag that the object is from (Escape).", True
        )
        self.sentence = label("", "hint", wrap=True, rich=True)
        self.sentence.setTextInteractionFlags(Qt.TextInteractionFlag.LinksAccessibleByMouse)
        self.sentence.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.use_best = button(
            "Use that direction",
            "Let objects leave in the direction in which the most are unpackable.",
        )
        self.force = button(
            "Unpack the least occluded",
            "Unpack the object of which other objects occlude the smallest share.",
        )
        self._arrange()
        self._connect()
        self._reload()

    def _arrange(self) -> None:
        aim = QHBoxLayout()
        aim.setSpacing(GAP)
        aim.addLayout(form(Direction=self.direction), stretch=1)
        aim.addWidget(self.draw)
        self.contents.addLayout(aim)
        line = row()
        # The button pressed most is the widest.
        line.add(self.next, 2)
        line.add(self.back)
        self.contents.addWidget(line)
        self.contents.addWidget(row(self.inspect, self.reveal))
        several = row()
        several.add(self.count, 0)
        several.add(self.several)
        several.add(self.all_back)
        self.contents.addWidget(several)
        self.contents.addWidget(row(self.chosen, self.all_unpackable))
        for widget in (self.step_slider, self.view, self.inspection, self.back_to_bag):
            self.contents.addWidget(widget)
        self.answer = QWidget()
        inside = column(self.answer)
        inside.addWidget(self.sentence)
        for extra in (self.use_best, self.force):
            extra.hide()
            inside.addWidget(extra)
        # In one place, with room for either: the table below stays where it is.
        place = QGridLayout()
        for box in (self.answer, self.reveal_box):
            keep_room(box)
            place.addWidget(box, 0, 0, Qt.AlignmentFlag.AlignTop)
        keep_room(self.use_best)
        self.contents.addLayout(place)
        self.contents.addWidget(self._settings())

    def _settings(self) -> Collapsible:
        more = Collapsible(
            "Speed, drawing, rules", "How fast objects fly, what draws them, and which may leave."
        )
        self.speed = QSlider(Qt.Orientation.Horizontal)
        self.speed.setRange(*(round(seconds * 10) for seconds in FLIGHT_SECONDS))
        # The value is the duration in tenths of a second: the shortest stands on the right.
        self.speed.setInvertedAppearance(True)
        self.speed.setToolTip("Speed of a flight: slow on the left, fast on the right.")
        self.backend = Choice(*BACKENDS)
        self.backend.setToolTip("What draws the bag: the graphics card, or the processor.")
        self.take_least = Check("Else unpack the least occluded")
        self.take_least.setToolTip(
            "Where nothing is unpackable this way, Unpack next takes the object of which the "
            "smallest share is occluded; otherwise it says so and takes none."
        )
        self.outlines = Check("Outline unpackable objects")
        self.outlines.setChecked(True)
        self.outlines.setToolTip(
            "Outline unpackable objects in the 3D view; in yellow those that leave together; in "
            "orange, where nothing is unpackable, the least occluded one."
        )
        self.perspective = Check("Gentle perspective")
        self.perspective.setToolTip(
            "Draw what is nearer larger, so that objects come towards you when they fly."
        )
        more.contents.addLayout(form(Speed=self.speed, Draw_with=self.backend))
        for check in (self.take_least, self.outlines, self.perspective):
            more.contents.addWidget(check)
        return more

    def _connect(self) -> None:
        commands, workspace, planner = self._commands, self._workspace, self._planner
        self.next.clicked.connect(lambda: commands.unpack(1))
        self.several.clicked.connect(lambda: commands.unpack(self.count.value()))
        self.back.clicked.connect(lambda: commands.restore(1))
        self.all_back.clicked.connect(commands.restore_all)
        self.force.clicked.connect(commands.unpack_least_occluded)
        self.inspect.clicked.connect(commands.toggle_inspection)
        self.chosen.clicked.connect(commands.unpack_selected)
        self.all_unpackable.clicked.connect(commands.unpack_all_unpackable)
        self.reveal.clicked.connect(planner.reveal_selected)
        self.use_best.clicked.connect(self._use_best)
        self.sentence.linkActivated.connect(lambda _: commands.show_all())
        self.back_to_bag.clicked.connect(commands.leave_container)
        self.count.valueChanged.connect(lambda n: self.several.setText(f"Unpack {n}"))
        self.direction.currentTextChanged.connect(self._set_direction)
        self.draw.toggled.connect(self._set_drawing)
        self.speed.valueChanged.connect(lambda tenths: commands.settings.set_seconds(tenths / 10))
        self.backend.currentTextChanged.connect(
            lambda name: commands.settings.set_backend(BACKENDS[name])
        )
        self.take_least.toggled.connect(self._set_take_least)
        self.outlines.toggled.connect(commands.settings.set_outlines)
        self.perspective.toggled.connect(commands.settings.set_perspective)
        planner.best.connect(self._show_best)
        planner.found.connect(self._show_plan)
        planner.busy.connect(self._show_planning)
        workspace.switched.connect(self._reload)
        workspace.changed.connect(lambda _: self._refresh())

    def _reload(self) -> None:
        controller = self._workspace.controller
        self._unpackable = None
        self.lock("Available after step 1." if controller is None else None)
        # As many as it ever has: the table below stays where it is.
        keep_lines(self.sentence, 3)
        if controller is not None:
            # Shown, not set: the controls would write the values back.
            controls = (self.speed, self.backend, self.take_least, self.perspective)
            blockers = [QSignalBlocker(control) for control in controls]
            self.speed.setValue(round(controller.seconds * 10))
            self.backend.setCurrentText(
                next((k for k, v in BACKENDS.items() if v == controller.backend), "Best available")
            )
            self.take_least.setChecked(bool(controller.session.take_least_occluded))
            self.perspective.setChecked(self._workspace.viewer.scene.camera.perspective > 0)
            for blocker in blockers:
                blocker.unblock()
            self._commands.settings.set_outlines(self.outlines.isChecked())
            controller.events.direction_drawn.connect(lambda: self.draw.setChecked(False))
            controller.events.searching.connect(self._show_searching)
        self.draw.setChecked(controller is not None and controller.interaction.pencil.drawing)
        self.back_to_bag.setVisible(self._workspace.is_inside)
        self._refresh()

    def show_unpackable(self, ids: frozenset[int] | None) -> None:
        """Show how many objects are unpackable now.

        Parameters
        ----------
        ids : frozenset of int, optional
            Empty where nothing is unpackable, None while that is not known.
        """
        self._unpackable = ids
        # Objects that leave change which direction is best.
        self._best = None
        self._refresh()
        if ids == frozenset() and not self._planner.running:
            self._planner.find_best_direction()

    @property
    def answered(self) -> bool:
        """Whether the unpackable objects are known and, without any, the best direction."""
        return self._unpackable is not None and not self._planner.running

    def _show_best(self, best: BestDirection | None) -> None:
        self._best = best
        self._refresh()

    def _show_plan(self, plan: RevealPlan | None) -> None:
        self.reveal_box.show_plan(plan, self._workspace.session)
        self.answer.setVisible(plan is None)

    def _show_planning(self, busy: bool) -> None:
        self.reveal.setText("Looking…" if busy else "Reveal…")

    def _show_searching(self, searching: bool) -> None:
        self.sentence.setText(SEARCHING if searching else "")
        # At once: the main thread is about to wait for the result.
        self.sentence.repaint()

    def _use_best(self) -> None:
        if self._best is not None:
            z, y, x = (float(v) for v in self._best.direction)
            self._commands.settings.set_direction((z, y, x))

    def _set_direction(self, name: str) -> None:
        if name in DIRECTIONS:
            self._commands.settings.set_direction(DIRECTIONS[name])

    def _show_direction(self, session: Session) -> None:
        """Show D; one without a name is listed as long as it is D."""
        name = name_of(session.direction)
        with QSignalBlocker(self.direction):
            # At most one entry without a name, and none once the direction has one.
            while self.direction.count() > len(DIRECTIONS):
                self.direction.removeItem(len(DIRECTIONS))
            if name is None:
                name = ALONG_ARROW
                self.direction.addItem(name)
            self.direction.setCurrentText(name)

    def _set_drawing(self, drawing: bool) -> None:
        self._commands.settings.set_drawing(drawing)
        self._refresh()

    def _set_take_least(self, taken: bool) -> None:
        self._commands.settings.set_take_least_occluded(taken)
        self._refresh()

    def _refresh(self) -> None:
        session = self._workspace.session
        states = [] if session is None else list(session.states.values())
        packed, out = states.count(ObjectState.PACKED), states.count(ObjectState.UNPACKED)
        flying = sum(state.is_flying for state in states)
        inspected = ObjectState.INSPECTED in states
        can_unpack, can_restore = packed > 0 and not inspected, out + flying > 0 and not inspected
        for control in (self.next, self.several, self.chosen, self.reveal):
            control.setEnabled(can_unpack)
        self.all_unpackable.setEnabled(can_unpack and bool(self._unpackable))
        for control in (self.back, self.all_back):
            control.setEnabled(can_restore)
        # One button both ways, where the hand already is.
        self.inspect.setText("Back to the bag" if inspected else "Inspect")
        self.inspect.setToolTip(LEAVE_HELP if inspected else INSPECT_HELP)
        selected = session is not None and bool(session.selected)
        self.inspect.setEnabled(inspected or out > 0 or selected)
        hidden = states.count(ObjectState.HIDDEN)
        # What is inspected where it lies has not left.
        held: frozenset[int] = frozenset() if session is None else session.queries.packed
        lying = len(held.intersection(objects_in(session, ObjectState.INSPECTED)))
        counts = f"{packed + lying} in, {out + flying + inspected - lying} out"
        self.set_status((counts + (f", {hidden} hidden" if hidden else "")) if states else "")
        # None is not empty: nothing is offered while it is not known.
        stuck = self._unpackable == frozenset() and can_unpack and not flying
        self.force.setVisible(stuck and session is not None and not session.take_least_occluded)
        self.use_best.setVisible(stuck and self._best is not None)
        if self._best is not None:
            self.use_best.setText(f"Use that direction ({len(self._best.ids)} unpackable)")
        self.sentence.setText("")
        if session is not None:
            self.sentence.setText(self._sentence(session, packed, out, flying, inspected, lying))
            self._show_direction(session)
        self.reveal_box.refresh(session)

    def _sentence(
        self, session: Session, packed: int, out: int, flying: int, inspected: bool, lying: int
    ) -> str:
        if self.draw.isChecked():
            return DRAWING
        if lying:
            return "One object in the bag: a drag or Shift+arrows go round it; Escape goes back."
        if inspected:
            return "One object alone: a drag or Shift+arrows turn it; Escape goes back to the bag."
        if flying:
            return f"{flying} {'object is' if flying == 1 else 'objects are'} flying."
        if packed == 0:
            hidden = len(objects_in(session, ObjectState.HIDDEN))
            return _all_gone(out, hidden, self.link_color)
        if self._unpackable is None:
            return SEARCHING
        if not self._unpackable:
            return self._all_blocked(session)
        count = len(self._unpackable)
        groups = [g for g in session.queries.unpackable_groups() if self._unpackable.issuperset(g)]
        together = _together([len(group) for group in groups])
        return f"{count} of {packed} {'is' if count == 1 else 'are'} unpackable now{together}."

    def _all_blocked(self, session: Session) -> str:
        """Name the least occluded object, and what another direction would make unpackable."""
        # Three facts that people ask for one after another.
        words = [f"{NOTHING_UNPACKABLE}."]
        least = session.queries.least_occluded()
        if least is not None:
            object_id, ratio = least
            leads = "Next" if session.take_least_occluded else "Least occluded"
            name = escape(str(session.objects["name"][object_id]))
            words.append(f"{leads}: {name} ({share_of(ratio)} occluded).")
        if self._best is not None:
            # D may have the same words: one of 26 directions is seldom just the view's.
            way = words_of(self._best.direction, session.camera, session.unpack_direction)
            words.append(f"{way.capitalize()}: {len(self._best.ids)} unpackable.")
        elif not session.take_least_occluded:
            words.append("Turn the bag, or choose another direction.")
        return " ".join(words)


def _together(sizes: list[int]) -> str:
    """Say which of those that can leave do so by one click, interlocked."""
    several = [str(size) for size in sizes if size > 1]
    if not several:
        return ""
    return f", {'all' if len(sizes) == 1 else listed(several)} together"


def _all_gone(out: int, hidden: int, link_color: str) -> str:
    """Say why nothing is to be seen in the bag, and how what is hidden comes back."""
    if hidden:
        what = "1 object is" if hidden == 1 else f"{hidden} objects are"
        rest = "the rest is unpacked" if out else "none is shown"
        return f"{what} hidden, {rest}: <a href='show' style='color: {link_color}'>Show all</a>"
    return "The bag is empty. Double-click an object to inspect it." if out else ""
