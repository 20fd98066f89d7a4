"""The dock widget Virtual Unpacking: five steps, top to bottom.

Keep the bag and what lies beside it in the window while the window changes its size.
"""

from __future__ import annotations

from typing import Any

import napari
import numpy as np
from qtpy.QtCore import QEvent, QObject, QSize, Qt, QTimer
from qtpy.QtWidgets import QScrollArea, QVBoxLayout, QWidget

from napari_unpack.widgets.color_section import ColorSection
from napari_unpack.widgets.files_section import FilesSection
from napari_unpack.widgets.free_watch import FreeWatch
from napari_unpack.widgets.objects_section import ObjectsSection
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.section import Collapsible, label, rule
from napari_unpack.widgets.segment_section import SegmentSection
from napari_unpack.widgets.shortcuts import Shortcuts, help_text
from napari_unpack.widgets.theme import GAP, palette_of, style_sheet
from napari_unpack.widgets.unpack_section import UnpackSection
from napari_unpack.widgets.workspace import Workspace


class KeepFramed(QObject):
    """Frame the bag anew after a resize, unless the user has zoomed or panned since.

    Turning the bag does not count: frames hold it at every turn.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._size: tuple[int, int] | None = None
        self._framed = np.zeros(0)
        workspace.staged.connect(self._begin)
        workspace.changed.connect(self._hear)

    def _begin(self) -> None:
        session = self._workspace.session
        if session is not None:
            self._size, self._framed = session.canvas_size, self._camera()

    def _hear(self, news: frozenset[str]) -> None:
        session = self._workspace.session
        if "view" not in news or session.canvas_size == self._size:
            return
        self._size = session.canvas_size
        if np.allclose(self._camera(), self._framed, rtol=1e-3):
            self._workspace.frame()
            self._framed = self._camera()

    def _camera(self) -> Any:
        """Return zoom and centre."""
        camera = self._workspace.viewer.scene.camera
        return np.array([camera.zoom, *camera.center], dtype=np.float64)


WIDTH = 328


class UnpackingWidget(QWidget):
    """Segment, Colour, Unpack, the objects, and files.

    Parameters
    ----------
    napari_viewer : napari.Viewer
        Passed by napari.
    """

    def __init__(self, napari_viewer: napari.viewer.Viewer) -> None:
        super().__init__()
        self.setObjectName("unpacking_panel")
        self.setWindowTitle("Virtual Unpacking")
        self._viewer = napari_viewer
        self.workspace = Workspace(napari_viewer, self)
        self.segment = SegmentSection(self.workspace)
        self.ways = RevealPlanner(self.workspace, self)
        self.color = ColorSection(self.workspace)
        self.unpack = UnpackSection(self.workspace, self.ways)
        self.objects = ObjectsSection(self.workspace, self.ways)
        self.files = FilesSection(self.workspace)
        self.keys = Shortcuts(
            self.workspace, self.unpack.reveal_selected, self.ways, self.objects.repair
        )
        self._framing = KeepFramed(self.workspace, self)
        self._watch = FreeWatch(self.workspace, self)
        self._watch.known.connect(self.unpack.tell_free)
        self._watch.known.connect(lambda ids: self.objects.mark_free(ids or frozenset()))
        self._ended = False
        self._was_docked = False
        self._after_close = QTimer(self)
        self._after_close.setSingleShot(True)
        self._after_close.timeout.connect(self._end_with_window)
        self._arrange()
        self._dress()
        napari_viewer.events.theme.connect(self._dress)

    def _arrange(self) -> None:
        inside = QWidget()
        column = QVBoxLayout(inside)
        column.setContentsMargins(2 * GAP, 2 * GAP, 2 * GAP, 2 * GAP)
        column.setSpacing(2 * GAP)
        steps = (self.segment, self.color, self.unpack, self.objects, self.files)
        for k, step in enumerate(steps):
            if k:
                column.addWidget(rule())
            column.addWidget(step, stretch=1 if step is self.objects else 0)
        column.addStretch(0)
        keys = Collapsible("Keys and mouse", "What the keys and the mouse do in the picture.")
        keys.contents.addWidget(label(help_text(), "hint", wrap=True))
        column.addWidget(keys)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setWidget(inside)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.addWidget(scroll)
        self.setMinimumWidth(WIDTH - 36)

    def _dress(self, _event: Any = None) -> None:
        palette = palette_of(self._viewer.theme)
        self.setStyleSheet(style_sheet(palette))
        self.color.editor.set_accent(palette.accent)
        self.unpack.scrub.set_ink(palette.text)

    def sizeHint(self) -> QSize:
        """Return the size it likes: narrow, and as tall as the window gives."""
        return QSize(WIDTH, 720)

    def end(self) -> None:
        """Take the stage down, give the keys back and stop listening; safe to call twice."""
        if self._ended:
            return
        self._ended = True
        self.segment.end()
        self.files.end()
        self.unpack.scrub.end()
        self.color.picture.end()
        self._watch.end()
        self.ways.end()
        self.workspace.end()
        self.keys.close()
        self._viewer.events.theme.disconnect(self._dress)

    def closeEvent(self, event: Any) -> None:
        """End when the panel is closed."""
        self.end()
        super().closeEvent(event)

    def showEvent(self, event: Any) -> None:
        """Learn which window the panel stands in, to end when that closes."""
        super().showEvent(event)
        self.window().installEventFilter(self)

    def eventFilter(self, watched: Any, event: Any) -> bool:
        """End after the window closed; a close that the user calls off changes nothing."""
        if event.type() == QEvent.Type.Close and watched is self.window():
            self._after_close.start(0)
        return False

    def _end_with_window(self) -> None:
        if not self.window().isVisible():
            self.end()

    def event(self, event: Any) -> bool:
        """End when napari takes the panel out of its dock: it is neither hidden nor closed then."""
        if event.type() == QEvent.Type.ParentAboutToChange:
            self._was_docked = self.parent() is not None
        taken_out = event.type() == QEvent.Type.ParentChange and self.parent() is None
        if taken_out and self._was_docked:
            self.end()
        return bool(super().event(event))
