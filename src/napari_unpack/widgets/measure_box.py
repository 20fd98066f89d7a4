"""Lengths and angles: measured by clicks, listed, removed."""

from __future__ import annotations

from qtpy.QtCore import QSignalBlocker, Qt, Signal
from qtpy.QtGui import QKeyEvent
from qtpy.QtWidgets import QListWidget, QListWidgetItem

from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.viewer.plain_text import literal
from napari_unpack.viewer.ruler_tool import RulerTool
from napari_unpack.widgets.narrow import Check
from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.section import Collapsible, button, label, row, scroll_to_new
from napari_unpack.widgets.workspace import Change, Workspace

# Rows seen at once; more are scrolled to.
ROWS = 4
# Pixels: what Qt and the style sheet put around a row, and around the list.
PADDING = 6

AWAY = "Between objects that stand apart now it is drawn again when they are back in the bag."


class MeasureBox(Collapsible):
    """Tools that measure on surfaces, and the list of what was measured.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__("Measure", "Lengths and angles between points on surfaces.")
        self._workspace = workspace
        self._tool: RulerTool | None = None
        self.ruler = button(
            "Ruler", "Measure a length: click two points, in the 3D view or in slices (M)."
        )
        self.angle = button(
            "Angle", "Measure an angle: click three points; it is taken at the second (A)."
        )
        self.remove = button("Remove", "Remove the measurement selected in the list (Delete).")
        self.show_all = Check("Show")
        self.show_all.setToolTip(
            "Draw what was measured: in the 3D view and in slices, in pictures, movies and the web "
            "page."
        )
        self.show_all.setAccessibleName("Show measurements")
        self.show_all.setChecked(True)
        self.next_click = label("", "hint", wrap=True)
        self.next_click.hide()
        self.list = _List()
        self.list.setToolTip(f"What was measured. {AWAY}")
        self.list.setAccessibleName("Measurements")
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.hide()
        for tool in (self.ruler, self.angle):
            tool.setCheckable(True)
        self.contents.addWidget(row(self.ruler, self.angle, self.remove, self.show_all))
        self.contents.addWidget(self.next_click)
        self.contents.addWidget(self.list)
        self.ruler.clicked.connect(lambda: self.measure(2))
        self.angle.clicked.connect(lambda: self.measure(3))
        self.remove.clicked.connect(self._remove_chosen)
        self.show_all.toggled.connect(self._show_measurements)
        self.list.delete_pressed.connect(self._remove_chosen)
        self.list.itemSelectionChanged.connect(self._enable)
        workspace.switched.connect(self._follow)
        workspace.changed.connect(self._refresh)
        self._follow()

    def measure(self, count: int) -> None:
        """Wait for clicks on so many points; a second call stops waiting."""
        controller, before = self._workspace.controller, self._tool
        same = before is not None and before.count == count
        self.cancel()
        if controller is None or same:
            return
        # The keys begin it too, while the box is folded.
        self.toggle.setChecked(True)
        self._tool = RulerTool(controller, count, self._show_next_click, self._take)
        self._show_tool()

    def cancel(self) -> None:
        """Wait for clicks no longer."""
        if self._tool is not None:
            self._tool.cancel()

    def _take(self, points: list[SurfacePoint]) -> None:
        self._tool = None
        self._show_next_click("")
        self._show_tool()
        session = self._workspace.session
        if points and session is not None:
            with errors_shown():
                session.measurements.add(points)

    def _show_measurements(self, shown: bool) -> None:
        if (session := self._workspace.session) is not None:
            session.measurements.shown = shown

    def _show_next_click(self, sentence: str) -> None:
        self.next_click.setText(sentence)
        self.next_click.setVisible(bool(sentence))
        if sentence:
            scroll_to_new(self.next_click, self._workspace.scheduler)

    def _show_tool(self) -> None:
        count = 0 if self._tool is None else self._tool.count
        self.ruler.setChecked(count == 2)
        self.angle.setChecked(count == 3)

    def _follow(self) -> None:
        # The tool of a session that is no longer shown would wait for ever.
        self._tool = None
        self._show_next_click("")
        self._show_tool()
        session = self._workspace.session
        for tool in (self.ruler, self.angle, self.show_all):
            tool.setEnabled(session is not None)
        self._fill()

    def _refresh(self, change: Change) -> None:
        # Names may have changed with the states, and the unit of lengths with the surroundings.
        if change & (Change.MEASUREMENTS | Change.STATES | Change.LABELS | Change.SURROUNDINGS):
            self._fill()

    def _fill(self) -> None:
        session = self._workspace.session
        measurements = () if session is None else tuple(session.measurements)
        with QSignalBlocker(self.show_all):
            self.show_all.setChecked(session is None or session.measurements.shown)
        if not measurements and not self.list.count():
            self._enable()
            return
        chosen = self.list.currentRow()
        self.list.clear()
        if session is not None:
            names = session.objects["name"]
            for one in measurements:
                on = ", ".join(str(names[i]) for i in sorted(one.objects) if i in names.index)
                words = one.words_in(session.length_unit)
                item = QListWidgetItem(f"{words} on {on}" if on else words, self.list)
                item.setToolTip(literal(f"{item.text()}. {AWAY}"))
        self.list.setVisible(bool(measurements))
        height = self.list.fontMetrics().height() + PADDING
        self.list.setFixedHeight(min(len(measurements), ROWS) * height + PADDING)
        if chosen < len(measurements):
            self.list.setCurrentRow(chosen)
        self._enable()

    def _enable(self) -> None:
        self.remove.setEnabled(bool(self.list.selectedItems()))

    def _remove_chosen(self) -> None:
        session, chosen = self._workspace.session, self.list.selectedIndexes()
        if session is not None and chosen:
            session.measurements.remove(chosen[0].row())


class _List(QListWidget):
    delete_pressed = Signal()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Delete, Qt.Key.Key_Backspace):
            self.delete_pressed.emit()
        elif event.text().strip():
            # Letters are commands of the viewer.
            event.ignore()
        else:
            super().keyPressEvent(event)
