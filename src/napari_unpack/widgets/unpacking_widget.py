"""The dock widget Virtual Unpacking: five steps, top to bottom."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Self

import napari
from qtpy.compat import isalive
from qtpy.QtCore import QEvent, QObject, QSize, Qt
from qtpy.QtGui import QKeySequence, QShortcut
from qtpy.QtWidgets import (
    QApplication,
    QDockWidget,
    QMainWindow,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from napari_unpack.layers import compat
from napari_unpack.viewer.process_end import end_with_process
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.viewer.screen import screen_notice
from napari_unpack.viewer.warm_up import warm_up_task
from napari_unpack.widgets import notifications
from napari_unpack.widgets.clipping_box import ClippingBox
from napari_unpack.widgets.color_section import ColorSection
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.dock_button import DockContents
from napari_unpack.widgets.files_section import FilesSection
from napari_unpack.widgets.focus_ring import FocusRing
from napari_unpack.widgets.held_place import HeldPlace
from napari_unpack.widgets.measure_box import MeasureBox
from napari_unpack.widgets.narrow_canvas import NarrowCanvas
from napari_unpack.widgets.objects_section import ObjectsSection
from napari_unpack.widgets.recovery import RecoveryBar, RecoveryKeeper
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.review_box import KEYS
from napari_unpack.widgets.section import (
    Collapsible,
    label,
    order_tabs,
    rule,
    scroll_to,
    scroll_to_new,
)
from napari_unpack.widgets.segment_section import SegmentSection
from napari_unpack.widgets.shortcuts import PANE_KEY, Shortcuts, help_text
from napari_unpack.widgets.slices_button import SlicesButton
from napari_unpack.widgets.theme import GAP, palette_of, style_sheet
from napari_unpack.widgets.unpack_section import UnpackSection
from napari_unpack.widgets.unsaved_work import UnsavedWork
from napari_unpack.widgets.wheel_guard import WheelGuard
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari.utils.events import Event
    from qtpy.QtGui import QCloseEvent, QShowEvent


def outermost(widget: QWidget) -> QWidget:
    """Return the window that a widget stands in, of a floating dock the one it belongs to."""
    window = widget.window()
    # A floating dock is a window of its own: closing it hides what is in it, and ends nothing.
    while window.parentWidget() is not None:
        window = window.parentWidget().window()
    return window


def panel_of(viewer: napari.viewer.Viewer) -> UnpackingWidget | None:
    """Return the panel that a viewer has, shown or not."""
    window = compat.native_window(viewer)
    known = [] if window is None else window.findChildren(UnpackingWidget)
    return next((one for one in known if not one._ended), None)


# Pixels: the narrowest in which no control of the panel is cut off, and the canvas keeps room.
WIDTH = 330


class UnpackingWidget(QWidget):
    """Segment, Colour, Unpack, the objects, and files.

    Parameters
    ----------
    napari_viewer : napari.Viewer
        Passed by napari.

    Notes
    -----
    A viewer has one panel. When its dock is closed it lives on, unseen, in the viewer's window,
    and its session stays in the 3D view: opened again, from whichever menu, it is as it was.
    """

    _ended = True

    def __new__(cls, napari_viewer: napari.viewer.Viewer) -> Self:
        """Return the panel that this viewer has already, or else a new one."""
        return panel_of(napari_viewer) or super().__new__(cls)

    def __init__(self, napari_viewer: napari.viewer.Viewer) -> None:
        if not self._ended:
            return
        super().__init__()
        self._ended = False
        self.setObjectName("unpacking_panel")
        self.setWindowTitle("Virtual Unpacking")
        self._viewer = napari_viewer
        self.workspace = Workspace(napari_viewer, self)
        self.commands = Commands(self.workspace)
        self.planner = RevealPlanner(self.workspace, self.commands, self)
        self.unsaved = UnsavedWork(self.workspace, self)
        self.segment = SegmentSection(self.workspace, self.unsaved)
        self.color = ColorSection(self.workspace, self.commands)
        self.unpack = UnpackSection(self.workspace, self.commands, self.planner)
        self.objects = ObjectsSection(self.workspace, self.commands, self.planner)
        self.files = FilesSection(self.workspace, self.unsaved, self.objects.repair)
        self.unsaved.unfinished = lambda: self.objects.repair.unfinished
        # After the sections: what the panel itself sets in a session is no work of a person.
        self.workspace.switched.connect(self.unsaved.follow)
        self.segment.progress.next_steps = (self.segment.start, self.unpack.next)
        self.keeper = RecoveryKeeper(self.workspace, self.unsaved, self)
        # Scores are no work of a person, but what is kept of the session is to have them.
        self.objects.confidence.scored.connect(self.keeper.follow)
        self.recovery = RecoveryBar(self.workspace, self.files.restore, self.keeper)
        self.slices = SlicesButton(self.workspace)
        self.clipping = ClippingBox(self.workspace)
        self.color.contents.addWidget(self.clipping)
        self.measure = MeasureBox(self.workspace)
        self.objects.contents.addWidget(self.measure)
        keys = {
            "T": self.color.background.names.toggle,
            "M": lambda: self.measure.measure(2),
            "A": lambda: self.measure.measure(3),
            **{k: partial(self.objects.review.answer_by_key, said) for k, said in KEYS.items()},
        }
        self.shortcuts = Shortcuts(
            self.workspace, self.commands, self.planner, self.objects.repair, keys
        )
        self.workspace.unpackable.connect(self.unpack.show_unpackable)
        self.workspace.unpackable.connect(
            lambda ids: self.objects.mark_unpackable(ids or frozenset())
        )
        self._arrange()
        native = getattr(compat.native_canvas(napari_viewer), "native", None)
        self.ring = None if native is None else FocusRing(native)
        self._narrow = None if native is None else NarrowCanvas(native)
        self.unpack.draw.toggled.connect(self._follow_drawing)
        # Where the keyboard was in the panel and in our docks.
        self._left: dict[QWidget, QWidget] = {}
        self._pane_keys = []
        for key, step in ((PANE_KEY, 1), (f"Shift+{PANE_KEY}", -1)):
            # Of the viewer's window, whose keys hold in all its floating docks as well.
            shortcut = QShortcut(QKeySequence(key), compat.native_window(napari_viewer) or self)
            shortcut.activated.connect(partial(self._go_to_pane, step))
            self._pane_keys.append(shortcut)
        QApplication.instance().focusChanged.connect(self._show_focused)
        compat.keep_keyboard(napari_viewer)
        WheelGuard(self)
        napari_viewer.events.theme.connect(self._dress)
        scheduler, release = self.workspace.scheduler, self.keeper.release
        # `Viewer.close` deletes the panel before it could end; long work would run on.
        self.destroyed.connect(lambda *_: scheduler.close())
        self.destroyed.connect(lambda *_: release())
        end_with_process(self.end)
        scheduler.submit(warm_up_task(), Worker.LONG, lambda _: None, failed=lambda _: None)
        if notice := screen_notice():
            notifications.warn(notice)

    def _arrange(self) -> None:
        inside = QWidget()
        column = QVBoxLayout(inside)
        column.setContentsMargins(2 * GAP, 2 * GAP, 2 * GAP, 2 * GAP)
        column.setSpacing(2 * GAP)
        column.addWidget(self.recovery)
        steps = (self.segment, self.color, self.unpack, self.objects, self.files)
        for k, step in enumerate(steps):
            # A rule between two steps, none above the first.
            if k:
                column.addWidget(rule())
            # The table takes the height that is left.
            column.addWidget(step, stretch=1 if step is self.objects else 0)
        column.addStretch(0)
        self.unpack.view.line.add(self.slices.button)
        keys = Collapsible("Keys and mouse", "What the keys and the mouse do in the 3D view.")
        keys.contents.addWidget(label(help_text(), "hint", wrap=True, rich=True))
        column.addWidget(keys)
        for folded in inside.findChildren(Collapsible):
            folded.toggle.toggled.connect(partial(self._show_opened, folded))
        order_tabs(column)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        # It follows the control that has the keyboard, and needs it for nothing itself.
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setWidget(inside)
        held = HeldPlace(scroll, self.objects, self.workspace.scheduler)
        self.workspace.switched.connect(held.let_go)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.addWidget(scroll)
        self.setMinimumWidth(WIDTH - 12)

    def _dress(self, _event: Event | None = None) -> None:
        palette = palette_of(self._viewer.theme)
        self.setStyleSheet(style_sheet(palette))
        for editor in (self.color.editor, self.unpack.inspection.editor):
            editor.set_accent(palette.accent)
        self.unpack.step_slider.set_ink(palette.text)
        self.unpack.link_color = palette.text
        if self.ring is not None:
            self.ring.paint_in(palette.focus)

    def take_keyboard(self) -> None:
        """Give the keyboard to the next thing to do."""
        steps = (self.unpack.next, self.segment.start, self.segment.sample)
        usable = (w for w in steps if w.isVisible() and w.isEnabled())
        next(usable, self.segment.fold).setFocus(Qt.FocusReason.ShortcutFocusReason)

    def _follow_drawing(self, drawing: bool) -> None:
        """Have the keyboard where the arrow is drawn, and back where that was begun."""
        self.shortcuts.bind()
        if self.ring is None:
            return
        if drawing:
            self.ring.take_keyboard()
        elif self.ring.isVisible():
            self.unpack.draw.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def _show_focused(self, before: QWidget | None, focused: QWidget | None) -> None:
        """Scroll to what keys have given the keyboard to, and follow whose keys go first."""
        if not self._ended:
            self.shortcuts.follow_keyboard(self._pane_of(focused) is not None)
        # Not under the mouse, and not where a window comes back that was scrolled by the wheel.
        by_keys = before is not None and QApplication.mouseButtons() == Qt.MouseButton.NoButton
        if by_keys and focused is not None and self.isAncestorOf(focused):
            scroll_to(focused)

    def _show_opened(self, folded: Collapsible, opened: bool) -> None:
        """Scroll to what was unfolded."""
        if opened:
            scroll_to_new(folded, self.workspace.scheduler)

    def _panes(self) -> list[FocusRing | UnpackingWidget | DockContents]:
        """Return the 3D view, and what of ours is to be seen."""
        ours = (self.ring, self, self.objects.table_button.dock, self.slices.dock)
        # A window that closes takes them away one by one.
        there = (one for one in ours if one is not None and isalive(one))
        return [one for one in there if one is self.ring or one.isVisible()]

    def _pane_of(self, focused: QWidget | None) -> QWidget | None:
        """Return the one of them that has the keyboard."""
        panes = self._panes()
        return next((pane for pane in panes if focused and pane.isAncestorOf(focused)), None)

    def _go_to_pane(self, step: int) -> None:
        """Hand the keyboard from the 3D view to the panel, to our docks, and around."""
        panes = self._panes()
        focused = QApplication.focusWidget()
        # The 3D view comes first, and is where the keyboard is while it is in none of them.
        place = self._pane_of(focused)
        if place is not None and focused is not None:
            self._left[place] = focused
        pane = panes[((0 if place is None else panes.index(place)) + step) % len(panes)]
        last = self._left.get(pane)
        if last is not None and isalive(last) and last.isVisible() and last.isEnabled():
            last.setFocus(Qt.FocusReason.ShortcutFocusReason)
        else:
            pane.take_keyboard()
        # A floating dock is a window of its own; others may stand in one place.
        pane.activateWindow()
        if isinstance(frame := pane.parentWidget(), QDockWidget):
            frame.raise_()

    def sizeHint(self) -> QSize:
        """Return a narrow size, which the window makes as tall as it is."""
        return QSize(WIDTH, 720)

    def end(self) -> None:
        """Close the session, unbind the keys and stop listening; a second call does nothing."""
        if self._ended:
            return
        self._ended = True
        self.keeper.end()
        self.unsaved.end()
        self.segment.end()
        self.files.end()
        self.slices.end()
        self.objects.end()
        self.unpack.step_slider.end()
        self.color.background.end()
        self.workspace.end()
        self.shortcuts.close()
        for key in filter(isalive, self._pane_keys):
            key.deleteLater()
        if self.ring is not None:
            self.ring.end()
        if self._narrow is not None:
            self._narrow.end()
        self._viewer.events.theme.disconnect(self._dress)

    def closeEvent(self, event: QCloseEvent) -> None:
        """End when the panel is closed."""
        self.end()
        super().closeEvent(event)

    def showEvent(self, event: QShowEvent) -> None:
        """Watch the viewer's window, to end when that closes."""
        super().showEvent(event)
        outermost(self).installEventFilter(self)
        self._watch_windows()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Ask before the window closes with unsaved work, and end after it closed.

        Parameters
        ----------
        watched : QObject
        event : QEvent
        """
        if self._ended:
            return False
        if event.type() == QEvent.Type.WindowDeactivate:
            # Another window may have been opened, from which one can quit as well.
            self.workspace.scheduler.soon(self._watch_windows)
        if event.type() == QEvent.Type.Close and compat.quits_with(watched):
            windows = [watched, *QApplication.topLevelWidgets()]
            panels = [one for window in windows for one in window.findChildren(UnpackingWidget)]
            if self._asked_before(watched, event, panels):
                return True
        if event.type() == QEvent.Type.Close and watched is outermost(self):
            if self._asked_before(watched, event, [self]):
                return True
            # Only after: the user may still call a close off, and then nothing may have ended.
            self.workspace.scheduler.soon(self._end_with_window)
        return False

    def _watch_windows(self) -> None:
        # *Exit* in any of them closes all, and lets nobody but itself be asked.
        for window in QApplication.topLevelWidgets():
            if isinstance(window, QMainWindow):
                window.installEventFilter(self)

    def _asked_before(
        self, window: QObject, event: QEvent, panels: Sequence[UnpackingWidget]
    ) -> bool:
        """Keep a window open until the first of the panels with unsaved work was asked about it."""
        # Where the canvas is gone already, a program closes the viewer: nobody is asked.
        one = next(
            (p for p in panels if p.unsaved.worth_keeping and compat.is_shown(p._viewer)), None
        )
        if one is None:
            return False

        def stay() -> None:
            compat.call_off_exit(window)
            for panel in panels:
                panel.unsaved.take_back()

        event.ignore()
        # Not by napari's own `close`, which asks whether one is sure; the next is asked then.
        again = partial(QWidget.close, window)
        quits = compat.quits_with(window)
        reason = "Quitting napari ends it." if quits else "Closing the window ends it."
        one.unsaved.ask(reason, again, quitting=True, cancelled=stay)
        return True

    def _end_with_window(self) -> None:
        if not outermost(self).isVisible():
            self.end()

    def event(self, event: QEvent) -> bool:
        """Dress when first shown; follow napari, which puts the panel into docks and out again."""
        if event.type() == QEvent.Type.Polish:
            # Not before: each change of parents applies a style sheet to everything anew.
            self._dress()
        if event.type() == QEvent.Type.ParentAboutToChange and isinstance(self.parent(), QWidget):
            # Only after: Qt has not done with this change of parents.
            follow = partial(self._leave_dock, self.parent(), outermost(self))
            self.workspace.scheduler.soon(follow)
        return bool(super().event(event))

    def _leave_dock(self, dock: QWidget, window: QWidget) -> None:
        """Stay in the viewer's window without a dock, or be seen in another."""
        if self.parent() is None:
            self.setParent(window)
            return
        self.show()
        # napari's menu and its API know the dock by two names: the one may follow the other.
        for other in window.findChildren(QDockWidget):
            if other is dock and other.widget() is None:
                self._viewer.window.remove_dock_widget(other)
