"""A slider over the steps of the unpacking, and a button that plays them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QPointF, QRectF, QSignalBlocker, Qt
from qtpy.QtGui import QColor, QIcon, QPainter, QPixmap, QPolygonF
from qtpy.QtWidgets import QHBoxLayout, QSlider, QToolButton, QWidget

from napari_unpack.session.errors import listed_objects
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.plain_text import literal
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.section import column, keep_room, label
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from qtpy.QtGui import QResizeEvent

    from napari_unpack.session import Session

# How often playing checks whether the last object has landed, so that the next may fly.
PLAY_MS = 60

# Grey that shows on light and dark, until the panel sets the theme's.
DEFAULT_INK = "#8a93a0"


class StepSlider(QWidget):
    """A slider over the steps of the unpacking, and a play button.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands

    Notes
    -----
    The slider has a step for every object in the bag. Dragging applies steps at once, without
    flights; playing lets one object fly after another and ends at the empty bag.
    """

    def __init__(self, workspace: Workspace, commands: Commands) -> None:
        super().__init__()
        self._workspace, self._commands = workspace, commands
        self.play = QToolButton()
        self.play.setProperty("role", "play")
        self.play.setCheckable(True)
        self.play.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setToolTip("Drag to run the unpacking forwards or backwards to any step.")
        self.slider.setPageStep(1)
        self.slider.setAccessibleName("Step of the unpacking")
        self.play.setAccessibleName("Play the unpacking")
        self.slider.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.sentence = label("", "hint", wrap=True)
        self.sentence.setMinimumHeight(self.sentence.fontMetrics().lineSpacing() + 4)
        keep_room(self.sentence)
        line = QHBoxLayout()
        line.setSpacing(GAP)
        line.addWidget(self.play)
        line.addWidget(self.slider, stretch=1)
        layout = column(self)
        layout.addLayout(line)
        layout.addWidget(self.sentence)
        self.slider.valueChanged.connect(self._drag)
        self.play.toggled.connect(self._toggle)
        workspace.switched.connect(self._reload)
        workspace.changed.connect(self._follow)
        self._ink, self._words = DEFAULT_INK, ""
        self._draw_icon()
        self._reload()

    def set_ink(self, color: str) -> None:
        """Draw the button's icon in a colour."""
        self._ink = color
        self._draw_icon()

    @property
    def playing(self) -> bool:
        """Whether it is playing."""
        return self._workspace.scheduler.pending(self._play_on)

    def end(self) -> None:
        """Stop playing, for good."""
        self._workspace.scheduler.forget(self._play_on)

    def _reload(self) -> None:
        self.play.setChecked(False)
        self._refresh()

    def _follow(self, change: Change) -> None:
        if change & (Change.STATES | Change.QUEUE):
            self._refresh()

    def _refresh(self) -> None:
        session = self._workspace.session
        steps, step = ((), 0) if session is None else (session.steps, session.step)
        with QSignalBlocker(self.slider):
            self.slider.setRange(0, len(steps) + self._unplanned())
            self.slider.setValue(step)
        self.setEnabled(self.slider.maximum() > 0)
        # The next flight would end an inspection.
        self.play.setEnabled(not objects_in(session, ObjectState.INSPECTED))
        self._write("" if session is None else self._text(session))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Write the sentence for the new width."""
        super().resizeEvent(event)
        self._write(self._words)

    def _write(self, words: str) -> None:
        self._words, measure = words, self.sentence.fontMetrics()
        # A line breaks between words: one that is longer than a line would be cut off.
        middle = Qt.TextElideMode.ElideMiddle
        fitting = [measure.elidedText(word, middle, self.width()) for word in words.split(" ")]
        shown = " ".join(fitting)
        self.sentence.setText(shown)
        self.sentence.setToolTip("" if shown == words else literal(words))
        self.sentence.setVisible(bool(words))

    def _unplanned(self) -> int:
        """Return how many packed objects are in no known step yet."""
        session = self._workspace.session
        if session is None:
            return 0
        planned = {i for group in session.steps for i in group}
        return len(session.queries.packed - planned)

    def _text(self, session: Session) -> str:
        steps, step = session.steps, session.step
        if not steps:
            return ""
        if step == 0:
            known = "1 step" if len(steps) == 1 else f"{len(steps)} steps"
            return f"Everything packed, {known} known"
        names = session.objects["name"]
        leaving = listed_objects(str(names[i]) for i in steps[step - 1])
        return f"Step {step} of {self.slider.maximum()}: {leaving}"

    def _drag(self, step: int) -> None:
        self.play.setChecked(False)
        self._commands.go_to(step)
        # A step may not be reached, or several objects leave in one: show what came of it.
        self._refresh()

    def _toggle(self, on: bool) -> None:
        self._draw_icon()
        if not on:
            self._workspace.scheduler.forget(self._play_on)
            return
        session = self._workspace.session
        if session is None:
            self.play.setChecked(False)
            return
        # Played to its end, it begins again.
        if session.step == self.slider.maximum():
            self._commands.go_to(0)
        self._play_on()

    def _play_on(self) -> None:
        """Let the next object fly once the last has landed, and come back soon."""
        # Waiting for the next object handles events, in which playing may end.
        if self._fly_next() and self.play.isChecked():
            self._workspace.scheduler.debounce(PLAY_MS, self._play_on)
        else:
            self.play.setChecked(False)

    def _fly_next(self) -> bool:
        """Return whether to play on."""
        controller = self._workspace.controller
        if controller is None or controller.inspected:
            return False
        if controller.flying:
            return True
        before = controller.session.step
        if before < self.slider.maximum():
            self._commands.go_to(before + 1, flying=True)
        return self._workspace.controller is controller and controller.session.step != before

    def _draw_icon(self) -> None:
        playing = self.play.isChecked()
        self.play.setIcon(_icon(playing, self._ink))
        self.play.setToolTip(
            "Stop playing." if playing else "Play the unpacking from here, one object at a time."
        )


def _icon(pause: bool, color: str) -> QIcon:
    """Draw a triangle, or two bars."""
    picture = QPixmap(32, 32)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(color))
    if pause:
        painter.drawRect(QRectF(7, 6, 6, 20))
        painter.drawRect(QRectF(19, 6, 6, 20))
    else:
        corners = ((9, 5), (27, 16), (9, 27))
        painter.drawPolygon(QPolygonF([QPointF(x, y) for x, y in corners]))
    painter.end()
    return QIcon(picture)
