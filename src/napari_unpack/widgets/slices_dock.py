"""Three linked slices in a dock of their own, drawn while it is seen."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtCore import QSignalBlocker, Qt
from qtpy.QtWidgets import QGridLayout, QSlider, QWidget

from napari_unpack.rendering.slice_image import PLANES
from napari_unpack.viewer.linked_slices import LinkedSlices
from napari_unpack.widgets.dock_button import DockContents
from napari_unpack.widgets.number_box import NumberBox
from napari_unpack.widgets.remembered import remembered
from napari_unpack.widgets.section import button, column, form, label, row
from napari_unpack.widgets.slice_view import AXES, SliceView
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.wheel_guard import WheelGuard
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from qtpy.QtGui import QHideEvent, QResizeEvent, QShowEvent

    from napari_unpack.rendering.slice_image import Plane
    from napari_unpack.viewer.controller import SessionController
    from napari_unpack.viewer.linked_slices import Voxel

# Of what is remembered.
OVERLAY = "slices/overlay"

# Wider than that by its height the dock has all in one row, and narrower in one column.
WIDE, NARROW = 2.2, 0.62


class SlicesDock(DockContents):
    """Three slices through one voxel, and what sets how they look.

    `shown` tells whether the dock is to be seen.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace.viewer, "unpacking_slices")
        self._workspace = workspace
        self._linked: LinkedSlices | None = None
        self._controller: SessionController | None = None
        self.views = {plane: SliceView(plane) for plane in PLANES}
        self.where = label("", "status", wrap=True)
        self.overlay = QSlider(Qt.Orientation.Horizontal)
        self.overlay.setRange(0, 100)
        self.overlay.setValue(int(remembered().value(OVERLAY, 50)))
        self.overlay.setToolTip("How much of an object's colour lies over the greys.")
        self.black = _density("Densities up to this are black.")
        self.white = _density("Densities from this on are white.")
        names = {self.overlay: "Colours", self.black: "Black density", self.white: "White density"}
        for control, name in names.items():
            control.setAccessibleName(name)
        self.automatic = button(
            "Automatic greys",
            "Let black and white suit what most objects are of, until the contrast limits of the "
            "image are set anew.",
        )
        self.fit = button("Fit", "Show each slice whole (Home).")
        self.fit.setAccessibleName("Fit the slices")
        self.center = button(
            "Centre", "Move the crosshair into the selected object, or into the middle of the bag."
        )
        self._bar = self._make_bar()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(GAP, GAP, GAP, GAP)
        self._grid.setSpacing(GAP)
        self._columns = 0
        self._arrange()
        self._connect()
        WheelGuard(self)

    @property
    def linked(self) -> LinkedSlices | None:
        """What is shown, None without a session."""
        return self._linked

    @property
    def settled(self) -> bool:
        """Whether every slice is drawn as it is to be."""
        return self._linked is None or self._linked.settled

    def _make_bar(self) -> QWidget:
        bar = QWidget()
        inside = column(bar)
        inside.addWidget(self.where)
        inside.addLayout(form(Colours=self.overlay, Black=self.black, White=self.white))
        inside.addWidget(row(self.fit, self.center))
        inside.addWidget(self.automatic)
        inside.addStretch(1)
        bar.setMinimumWidth(190)
        bar.setMaximumWidth(300)
        return bar

    def _arrange(self) -> None:
        """Put the slices and the bar in one row, in one column, or two by two."""
        share = self.width() / max(self.height(), 1)
        columns = 4 if share > WIDE else 1 if share < NARROW else 2
        if columns == self._columns:
            return
        self._columns = columns
        for k in range(4):
            self._grid.setColumnStretch(k, 0)
            self._grid.setRowStretch(k, 0)
        for k, part in enumerate((*self.views.values(), self._bar)):
            at = divmod(k, columns)
            self._grid.addWidget(part, *at)
            if part is not self._bar:
                self._grid.setRowStretch(at[0], 1)
                self._grid.setColumnStretch(at[1], 1)

    def _connect(self) -> None:
        for view in self.views.values():
            view.pointed.connect(self._point)
            view.left.connect(self._leave)
            view.clicked.connect(self._click)
            view.contrasted.connect(self._contrast)
        self.overlay.valueChanged.connect(self._set_overlay)
        for box in (self.black, self.white):
            box.valueChanged.connect(lambda _: self._set_window())
        self.automatic.clicked.connect(self._set_automatic)
        self.center.clicked.connect(self._center)
        self.fit.clicked.connect(self._fit)
        self._workspace.switched.connect(self.follow)
        self._workspace.changed.connect(self._hear)

    def end(self) -> None:
        """Show nothing more, and stop listening."""
        super().end()
        if self._linked is not None:
            self._linked.close()
        self._workspace.switched.disconnect(self.follow)
        self._workspace.changed.disconnect(self._hear)

    def take_keyboard(self) -> None:
        """Give the keyboard to the first slice."""
        self.views[PLANES[0]].setFocus(Qt.FocusReason.TabFocusReason)

    # What is shown.

    def follow(self) -> None:
        """Show the session that is open; without being seen itself the dock does nothing."""
        controller, linked = self._workspace.controller, self._linked
        if linked is not None and (controller is not self._controller or not self.isVisible()):
            linked.close()
        if controller is not self._controller:
            self._linked = self._controller = None
        if not self.isVisible():
            return
        if self._linked is None and controller is not None:
            self._linked, self._controller = LinkedSlices(controller), controller
            self._begin(self._linked)
        if self._linked is not None:
            self._linked.open()
        else:
            for view in self.views.values():
                view.show_volume(None, np.ones(3))
            self.where.setText("")

    def _begin(self, linked: LinkedSlices) -> None:
        linked.overlay = self.overlay.value() / 100
        linked.events.crosshair.connect(self._show_crosshair)
        linked.events.drawn.connect(self._show_image)
        linked.events.window.connect(self._show_window)
        linked.events.rulers.connect(self._show_rulers)
        for view in self.views.values():
            view.show_volume(linked.shape, linked.spacing)
        low, high = linked.window
        # To a hundredth of what lies between. Once: other digits would change what is being typed.
        digits = int(np.ceil(2 - np.log10(max(high - low, 1e-9))))
        for box in (self.black, self.white):
            with QSignalBlocker(box):
                box.setDecimals(max(1, digits))
        self._show_window(linked.window)
        self._show_crosshair(linked.crosshair)

    def _show_image(self, plane: Plane, pixels: NDArray[np.uint8]) -> None:
        # A window may destroy the dock while a worker still draws for it, of which Qt tells so.
        with suppress(RuntimeError):
            self.views[plane].show_image(pixels)

    def _show_crosshair(self, voxel: Voxel) -> None:
        for view in self.views.values():
            view.show_crosshair(voxel)
        self._say_where(voxel)
        self._show_rulers()

    def _say_where(self, voxel: Voxel) -> None:
        if self._linked is not None and self._controller is not None:
            name = self._linked.name_at(voxel) or "No object"
            density = float(self._controller.session.volume[voxel])
            place = ", ".join(f"{axis} {n}" for axis, n in zip(AXES, voxel, strict=True))
            self.where.setText(f"{name}\n{place}; density {density:.5g}")

    def _show_rulers(self) -> None:
        if self._linked is not None:
            for plane, view in self.views.items():
                view.show_rulers(self._linked.rulers_in(plane))

    def _show_window(self, window: tuple[float, float]) -> None:
        width = window[1] - window[0]
        for box, density in zip((self.black, self.white), window, strict=True):
            with QSignalBlocker(box):
                box.setValue(density)
                box.setSingleStep(max(width / 50, 1e-6))

    def _hear(self, change: Change) -> None:
        # Another object may be there now, or one of another size or name, or another unit.
        if change & (Change.LABELS | Change.STATES | Change.SURROUNDINGS) and self._linked:
            self._say_where(self._linked.crosshair)

    # What the hand does.

    def _point(self, voxel: Voxel) -> None:
        if self._linked is not None:
            self._linked.point_at(voxel)
            for view in self.views.values():
                view.name = self._linked.name_at(voxel)

    def _leave(self) -> None:
        if self._controller is not None:
            self._controller.interaction.point_at(0)

    def _click(self, there: tuple[float, float, float], held: set[str]) -> None:
        if self._linked is not None:
            self._linked.click_at(there, held)

    def _contrast(self, wider: float, brighter: float) -> None:
        """Widen the window and move it, by shares of itself."""
        if self._linked is not None:
            low, high = self._linked.window
            width = (high - low) * float(np.exp(2.0 * wider))
            level = (low + high) / 2 + brighter * width
            self._linked.window = level - width / 2, level + width / 2

    def _set_window(self) -> None:
        if self._linked is not None:
            self._linked.window = self.black.value(), self.white.value()

    def _set_automatic(self) -> None:
        if self._linked is not None:
            self._linked.reset_window()

    def _center(self) -> None:
        if self._linked is not None:
            self._linked.center()

    def _fit(self) -> None:
        for view in self.views.values():
            view.fit()

    def _set_overlay(self, percent: int) -> None:
        remembered().setValue(OVERLAY, percent)
        if self._linked is not None:
            self._linked.overlay = percent / 100

    # What the window does.

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Arrange the slices for the new size."""
        super().resizeEvent(event)
        self._arrange()

    def showEvent(self, event: QShowEvent) -> None:
        """Begin to draw."""
        self.follow()
        super().showEvent(event)

    def hideEvent(self, event: QHideEvent) -> None:
        """Draw nothing while nobody sees it."""
        self.follow()
        super().hideEvent(event)


def _density(tooltip: str) -> NumberBox:
    box = NumberBox()
    box.setRange(-1e9, 1e9)
    box.setDecimals(1)
    box.setToolTip(tooltip)
    # While a number is typed its first digits are no density.
    box.setKeyboardTracking(False)
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    return box
