"""Cut the packed bag open: a plane with a handle in the 3D view, and a box by numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import QSignalBlocker, Qt
from qtpy.QtWidgets import QGridLayout, QSlider, QWidget

from napari_unpack.widgets.inspection_box import APPLY_MS
from napari_unpack.widgets.narrow import Check, Choice
from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.number_box import NumberBox
from napari_unpack.widgets.section import Collapsible, button, column, form, label, row
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.geometry.axes import Vector
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

THIS_VIEW, ANOTHER_WAY = "This view", "Another direction"
AXES = {"z (slices)": 0, "y (rows)": 1, "x (columns)": 2}
SIDES = "from", "to"


class ClippingBox(Collapsible):
    """A cutting plane and a clipping box; what is cut away still blocks.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(
            "Cut the bag open",
            "Hide a part of the packed bag behind a plane or outside a box. What is cut away "
            "still blocks.",
        )
        self._workspace = workspace
        self.plane = Check("Plane")
        self.plane.setToolTip(
            "Cut the bag open along a plane. In the 3D view drag its arrow to push it and its rim "
            "to turn it."
        )
        self.handle = Check("Handle")
        self.handle.setToolTip("Show the plane's arrow and rim in the 3D view.")
        self.handle.setChecked(True)
        self.flip = button("Flip", "Cut away the other side of the plane.")
        self.across = Choice(THIS_VIEW, *AXES, ANOTHER_WAY)
        self.across.setToolTip(
            "In which direction the plane faces: towards you now, or along an axis of the scan."
        )
        self.depth = QSlider(Qt.Orientation.Horizontal)
        self.depth.setRange(0, 100)
        self.depth.setToolTip("How much of the bag the plane cuts away.")
        self.depth.setAccessibleName("Depth of the plane")
        self.across.setAccessibleName("Plane across")
        self._of_plane = QWidget()
        rows = column(self._of_plane)
        rows.addLayout(form(Across=self.across, Depth=self.depth))
        self.box = Check("Clipping box")
        self.box.setToolTip("Show only what lies within these numbers along the axes of the scan.")
        self.whole = button("Whole bag", "Set the box to the whole bag again.")
        self.sides = [[_spin_box(axis, side) for axis in AXES] for side in SIDES]
        self._per_mm = 1.0
        self._of_box = QWidget()
        grid = QGridLayout(self._of_box)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(GAP)
        self._titles = [label(side, "field") for side in SIDES]
        for j, title in enumerate(self._titles):
            grid.addWidget(title, 0, j + 1)
            grid.setColumnStretch(j + 1, 1)
        for k, axis in enumerate(AXES):
            grid.addWidget(label(axis.split()[0], "field"), k + 1, 0)
            for j in range(len(SIDES)):
                grid.addWidget(self.sides[j][k], k + 1, j + 1)
        self.contents.addWidget(row(self.plane, self.handle, self.flip))
        self.contents.addWidget(self._of_plane)
        self.contents.addWidget(row(self.box, self.whole))
        self.contents.addWidget(self._of_box)
        self._connect()
        self._follow()

    def _connect(self) -> None:
        self.plane.toggled.connect(self._switch_plane)
        self.handle.toggled.connect(self._show_handle)
        self.flip.clicked.connect(self._flip)
        self.across.activated.connect(lambda _: self._face())
        self.depth.valueChanged.connect(
            lambda _: self._workspace.scheduler.throttle(APPLY_MS, self._push)
        )
        self.box.toggled.connect(self._switch_box)
        self.whole.clicked.connect(lambda: self._set_box(self._limits()))
        for spin_box in (*self.sides[0], *self.sides[1]):
            spin_box.valueChanged.connect(
                lambda _: self._workspace.scheduler.throttle(APPLY_MS, self._crop)
            )
        self._workspace.switched.connect(self._follow)
        self._workspace.changed.connect(self._refresh)

    # What the controls do.

    def _switch_plane(self, on: bool) -> None:
        controller = self._workspace.controller
        if controller is None:
            return
        if on:
            self._face()
        else:
            controller.session.cutting.plane = None
        self._show_values()

    def _show_handle(self, shown: bool) -> None:
        if (controller := self._workspace.controller) is not None:
            controller.cut_handle.shown = shown

    def _face(self) -> None:
        """Turn the plane to what is chosen, as deep as it was."""
        controller, chosen = self._workspace.controller, self.across.currentText()
        if controller is None or chosen == ANOTHER_WAY:
            return
        share = controller.cut_handle.share if self._has_plane() else 0.5
        with errors_shown():
            controller.cut_handle.cut_along(_normal(controller, chosen), share)
        self._show_values()

    def _flip(self) -> None:
        controller, session = self._workspace.controller, self._workspace.session
        if controller is not None and session is not None and session.cutting.plane is not None:
            share = controller.cut_handle.share
            controller.cut_handle.cut_along(-session.cutting.plane[1], 1.0 - share)
            self._show_values()

    def _push(self) -> None:
        controller, session = self._workspace.controller, self._workspace.session
        if controller is not None and session is not None and session.cutting.plane is not None:
            normal = session.cutting.plane[1]
            controller.cut_handle.cut_along(normal, self.depth.value() / 100, merge=True)

    def _switch_box(self, on: bool) -> None:
        self._set_box(self._limits() if on else None)

    def _crop(self) -> None:
        if self.box.isChecked():
            values = np.array([[spin_box.value() for spin_box in side] for side in self.sides])
            self._set_box(values / self._per_mm)

    def _set_box(self, box: NDArray[np.float64] | None) -> None:
        session = self._workspace.session
        if session is not None:
            with errors_shown():
                session.cutting.box = box
            self._show_values()

    # What they show.

    def _follow(self) -> None:
        session, controller = self._workspace.session, self._workspace.controller
        self.setEnabled(session is not None)
        if session is None or controller is None:
            return
        controller.cut_handle.shown = self.handle.isChecked()
        self._show_unit(session)
        self._show_values()

    def _show_unit(self, session: Session) -> None:
        unit = session.length_unit
        self._per_mm = unit.per_mm
        corners = np.array([(0, 0, 0), session.labels.shape]) - 0.5
        low, high = unit.per_mm * session.spacing * corners
        for title, words in zip(self._titles, SIDES, strict=True):
            title.setText(f"{words}, {unit.name}")
        for side in self.sides:
            for axis, spin_box in enumerate(side):
                step = unit.per_mm * float(session.spacing[axis])
                with QSignalBlocker(spin_box):
                    # A tenth of a voxel, whatever the unit.
                    spin_box.setDecimals(max(1, int(np.ceil(1 - np.log10(step)))))
                    spin_box.setRange(low[axis], high[axis])
                    spin_box.setSingleStep(step)

    def _refresh(self, change: Change) -> None:
        session, scheduler = self._workspace.session, self._workspace.scheduler
        if session is not None and Change.SURROUNDINGS in change:
            # The unit of lengths is among them.
            self._show_unit(session)
            self._show_values()
        # News of an earlier value must not take back one that is about to be applied.
        waiting = scheduler.pending(self._push) or scheduler.pending(self._crop)
        # Clipping is told as a change of the transfer function.
        if Change.TRANSFER_FUNCTION in change and not waiting:
            self._show_values()

    def _show_values(self) -> None:
        session, controller = self._workspace.session, self._workspace.controller
        if session is None or controller is None:
            return
        has_plane, box = self._has_plane(), session.cutting.box
        limits = self._limits() if box is None else box
        blocked = [self.plane, self.depth, self.box, self.across, *self.sides[0], *self.sides[1]]
        blockers = [QSignalBlocker(widget) for widget in blocked]
        self.plane.setChecked(has_plane)
        self.box.setChecked(box is not None)
        self.depth.setValue(round(100 * controller.cut_handle.share))
        if session.cutting.plane is not None:
            self.across.setCurrentText(self._faces(controller, session.cutting.plane[1]))
        for side, values in zip(self.sides, limits, strict=True):
            for spin_box, value in zip(side, values, strict=True):
                # What is being typed must not change under the cursor.
                if not spin_box.hasFocus():
                    spin_box.setValue(self._per_mm * float(value))
        for blocker in blockers:
            blocker.unblock()
        self._of_plane.setVisible(has_plane)
        self.handle.setEnabled(has_plane)
        self.flip.setEnabled(has_plane)
        self._of_box.setVisible(box is not None)
        self.whole.setEnabled(box is not None)

    def _has_plane(self) -> bool:
        session = self._workspace.session
        return session is not None and session.cutting.plane is not None

    def _faces(self, controller: SessionController, normal: Vector) -> str:
        """Return which entry a normal is, of either sign."""
        for name in (self.across.currentText(), *AXES, THIS_VIEW):
            if name != ANOTHER_WAY and abs(float(_normal(controller, name) @ normal)) > 1 - 1e-6:
                return name
        return ANOTHER_WAY

    def _limits(self) -> NDArray[np.float64]:
        session = self._workspace.session
        if session is None:
            return np.array([[0.0] * 3, [1.0] * 3])
        return np.stack([session.bag.lower, session.bag.upper])


def _normal(controller: SessionController, name: str) -> Vector:
    from napari_unpack.viewer.cut_handle import facing

    if name == THIS_VIEW:
        return facing(controller.session.camera)
    return np.eye(3)[AXES[name]]


def _spin_box(axis: str, side: str) -> NumberBox:
    made = NumberBox()
    # Every digit typed would cut anew.
    made.setKeyboardTracking(False)
    limit, beyond = ("First", "before") if side == SIDES[0] else ("Last", "behind")
    made.setToolTip(
        f"{limit} place along {axis.split()[0]} that is shown, counted from the scan's first "
        f"voxel; what lies {beyond} it is cut away."
    )
    made.setAccessibleName(f"Clipping box along {axis.split()[0]}, {side}")
    return made
