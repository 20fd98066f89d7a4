"""A button that opens a dock of ours and closes it, and shows whether it is open."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Generic, TypeVar
from weakref import ref

from qtpy.QtCore import QSignalBlocker, Qt, Signal
from qtpy.QtGui import QHideEvent, QShowEvent
from qtpy.QtWidgets import QDockWidget, QMainWindow, QPushButton, QWidget

from napari_unpack.layers.compat import unwrap
from napari_unpack.widgets.theme import palette_of, style_sheet

if TYPE_CHECKING:
    import napari
    from napari.utils.events import Event


class DockContents(QWidget):
    """What stands in a dock, in the colours of napari's theme.

    Signals: `shown`, whether it is to be seen.

    Parameters
    ----------
    viewer : napari.Viewer
    name : str
        By which the style sheet knows it.
    """

    shown = Signal(bool)

    def __init__(self, viewer: napari.Viewer, name: str) -> None:
        super().__init__()
        # The style sheet names the panel; what stands beside it looks like it.
        self.setObjectName(name)
        self._viewer = viewer
        viewer.events.theme.connect(self._dress)
        self._dress()

    def end(self) -> None:
        """Stop listening to others."""
        self._viewer.events.theme.disconnect(self._dress)

    def _dress(self, _event: Event | None = None) -> None:
        self.setStyleSheet(style_sheet(palette_of(self._viewer.theme)))

    def take_keyboard(self) -> None:
        """Give the keyboard to what a person opened this for."""

    def showEvent(self, event: QShowEvent) -> None:
        """Tell that it is seen."""
        super().showEvent(event)
        self.shown.emit(True)

    def hideEvent(self, event: QHideEvent) -> None:
        """Tell that it is not seen."""
        super().hideEvent(event)
        self.shown.emit(False)


D = TypeVar("D", bound=DockContents)


class DockButton(Generic[D]):
    """Opens a dock and closes it.

    Parameters
    ----------
    viewer : napari.Viewer
    button : QPushButton
        Is pressed as long as the dock is open.
    make : callable
        Returns what stands in the dock, when it is first opened.
    add : callable
        Puts that into the window.

    Attributes
    ----------
    dock : DockContents or None
        None until it is opened for the first time.
    """

    def __init__(
        self,
        viewer: napari.Viewer,
        button: QPushButton,
        make: Callable[[], D],
        add: Callable[[D], None],
    ) -> None:
        self._viewer, self._make, self._add = viewer, make, add
        self.button = button
        self.dock: D | None = None
        # Whoever keeps this must not keep the window.
        self._corners: list[tuple[ref[QMainWindow], Qt.Corner, Qt.DockWidgetArea]] = []
        button.setCheckable(True)
        button.toggled.connect(self._toggle)

    def give_corner(self, window: QMainWindow, corner: Qt.Corner, area: Qt.DockWidgetArea) -> None:
        """Have the docks at one side of the window fill one of its corners until the end.

        Parameters
        ----------
        window : QMainWindow
        corner : Qt.Corner
        area : Qt.DockWidgetArea
            The side.
        """
        before = window.corner(corner)
        # What another dock of ours has changed is put back by that one.
        if before != area:
            self._corners.append((ref(window), corner, before))
            window.setCorner(corner, area)

    def stand_beside_left_docks(self, window: QMainWindow) -> None:
        """Have docks at the bottom stand beside those at the left, not beneath them."""
        # Those of napari are tall: beneath them, a dock makes the window taller than a screen.
        left = Qt.DockWidgetArea.LeftDockWidgetArea
        self.give_corner(window, Qt.Corner.BottomLeftCorner, left)

    def end(self) -> None:
        """Take the dock away, and give the window its corners back."""
        dock, self.dock = self.dock, None
        if dock is None:
            return
        dock.shown.disconnect(self._follow)
        dock.end()
        # The window may have taken it away, or have gone itself.
        with suppress(LookupError, RuntimeError, AttributeError):
            unwrap(self._viewer).window.remove_dock_widget(dock)
        dock.deleteLater()
        for known, corner, area in self._corners:
            window = known()
            if window is not None:
                with suppress(RuntimeError):
                    window.setCorner(corner, area)
        self._corners.clear()

    def _toggle(self, wanted: bool) -> None:
        if self.dock is None:
            if not wanted:
                return
            self.dock = self._make()
            self.dock.shown.connect(self._follow)
        # Closed by its own cross it has been taken out of its frame, which is gone.
        if wanted and self.dock.parentWidget() is None:
            self._add(self.dock)
            added = self.dock.parentWidget()
            if isinstance(added, QDockWidget):
                # Behind another dock in one place it is hidden to a person, but not for Qt.
                added.visibilityChanged.connect(self._follow)
        frame = self.dock.parentWidget()
        if frame is not None:
            if wanted:
                _stand_where_there_is_room(frame)
            frame.setVisible(wanted)
            if wanted:
                frame.raise_()
                # By a click it has none.
                if self.button.hasFocus():
                    self.dock.take_keyboard()

    def _follow(self, shown: bool) -> None:
        """Show whether the dock is to be seen, however it was opened, closed or covered."""
        # A window that closes may take the button away first.
        with suppress(RuntimeError), QSignalBlocker(self.button):
            self.button.setChecked(shown)


def _stand_where_there_is_room(frame: QWidget) -> None:
    """Put a dock below the picture over another of ours, where both would widen the window."""
    window, below = frame.window(), Qt.DockWidgetArea.BottomDockWidgetArea
    if not (isinstance(window, QMainWindow) and isinstance(frame, QDockWidget)):
        return

    def is_below(dock: object) -> bool:
        return (
            isinstance(dock, QDockWidget)
            and not dock.isFloating()
            and window.dockWidgetArea(dock) == below
        )

    others = [one.parentWidget() for one in window.findChildren(DockContents) if one.isVisible()]
    beside = [one for one in others if one is not frame and is_below(one)]
    middle = window.centralWidget()
    if not beside or middle is None or not is_below(frame):
        return
    if sum(one.minimumSizeHint().width() for one in (frame, *beside)) >= middle.width():
        window.tabifyDockWidget(beside[-1], frame)
