"""The unpacking as a bar: drag it to any step, or let it play."""

from __future__ import annotations

from qtpy.QtCore import QPointF, QRectF, QSignalBlocker, Qt, QTimer
from qtpy.QtGui import QColor, QIcon, QPainter, QPixmap, QPolygonF
from qtpy.QtWidgets import QHBoxLayout, QSlider, QToolButton, QWidget

from napari_unpack.session.errors import listed
from napari_unpack.widgets.section import column, label
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.workspace import Workspace

PLAY_MS = 60
"""Between looks whether the last object has landed, so that the next may fly."""


class StepSlider(QWidget):
    """A slider over the steps of the unpacking, and a play button.

    Parameters
    ----------
    workspace : Workspace

    Notes
    -----
    The bar reaches as far as there are objects in the bag. Dragging applies steps at once,
    without flights; playing lets one object fly after another and ends at the empty bag.
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__()
        self._workspace = workspace
        self.play = QToolButton()
        self.play.setProperty("role", "play")
        self.play.setCheckable(True)
        self.play.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.bar = QSlider(Qt.Orientation.Horizontal)
        self.bar.setToolTip("Drag to run the unpacking forwards or backwards to any step.")
        self.bar.setPageStep(1)
        self.bar.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.words = label("", "hint", wrap=True)
        self._timer = QTimer(self)
        self._timer.setInterval(PLAY_MS)
        self._timer.timeout.connect(self._play_on)
        line = QHBoxLayout()
        line.setSpacing(GAP)
        line.addWidget(self.play)
        line.addWidget(self.bar, stretch=1)
        layout = column(self)
        layout.addLayout(line)
        layout.addWidget(self.words)
        self.bar.valueChanged.connect(self._drag)
        self.play.toggled.connect(self._toggle)
        workspace.staged.connect(self._reload)
        workspace.changed.connect(self._hear)
        self._ink = "#8a93a0"
        self._show_icon()
        self._reload()

    def set_ink(self, color: str) -> None:
        """Draw the button's sign in a colour."""
        self._ink = color
        self._show_icon()

    @property
    def playing(self) -> bool:
        """Whether it plays by itself."""
        return bool(self._timer.isActive())

    def end(self) -> None:
        """Stop playing, for good."""
        self._timer.stop()

    def _reload(self) -> None:
        self.play.setChecked(False)
        self._refresh()

    def _hear(self, news: frozenset[str]) -> None:
        if news & {"states", "queue"}:
            self._refresh()

    def _refresh(self) -> None:
        session = self._workspace.session
        steps, step = ((), 0) if session is None else (session.steps, session.step)
        with QSignalBlocker(self.bar):
            self.bar.setRange(0, len(steps) + self._unknown())
            self.bar.setValue(step)
        self.setEnabled(self.bar.maximum() > 0)
        self.words.setText(self._sentence(steps, step))
        self.words.setVisible(bool(self.words.text()))

    def _unknown(self) -> int:
        """Return how many packed objects are in no known step yet."""
        session = self._workspace.session
        if session is None:
            return 0
        known = {i for group in session.steps for i in group}
        return sum(
            state.name in ("PACKED", "FLYING_BACK") and i not in known
            for i, state in session.states.items()
        )

    def _sentence(self, steps: tuple[tuple[int, ...], ...], step: int) -> str:
        if not steps:
            return ""
        session = self._workspace.session
        if step == 0:
            return f"Everything packed, {len(steps)} steps known"
        names = session.objects["name"]
        who = listed(str(names[i]) for i in steps[step - 1])
        return f"Step {step} of {self.bar.maximum()}: {who}"

    def _drag(self, step: int) -> None:
        self.play.setChecked(False)
        self._workspace.go_to(step)
        # What was not reached, or reached in fewer steps, the bar shows as it is.
        self._refresh()

    def _toggle(self, on: bool) -> None:
        self._show_icon()
        if not on:
            self._timer.stop()
            return
        session = self._workspace.session
        if session is None:
            self.play.setChecked(False)
            return
        if session.step == self.bar.maximum():
            self._workspace.go_to(0)
        self._timer.start()
        self._play_on()

    def _play_on(self) -> None:
        controller = self._workspace.controller
        if controller is None or controller.inspected:
            self.play.setChecked(False)
            return
        if controller.flying:
            return
        before = controller.session.step
        if before < self.bar.maximum():
            self._workspace.go_to(before + 1, flying=True)
        if self._workspace.controller is not controller or controller.session.step == before:
            self.play.setChecked(False)

    def _show_icon(self) -> None:
        playing = self.play.isChecked()
        self.play.setIcon(_sign(playing, self._ink))
        self.play.setToolTip(
            "Stop playing." if playing else "Play the unpacking from here, one object at a time."
        )


def _sign(pause: bool, color: str) -> QIcon:
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
