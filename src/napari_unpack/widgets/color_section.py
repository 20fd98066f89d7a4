"""Step 2: hues that neighbours in this view do not share, and what density shows."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from qtpy.QtCore import QSignalBlocker

from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.background_options import BackgroundOptions
from napari_unpack.widgets.color_ramp_editor import ColorRampEditor, Stop
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.inspection_box import APPLY_MS
from napari_unpack.widgets.narrow import Check, Choice
from napari_unpack.widgets.opacity_editor import SAMPLES, OpacityEditor, Point, histogram
from napari_unpack.widgets.remembered import remembered
from napari_unpack.widgets.section import Collapsible, Section, button, form, row
from napari_unpack.widgets.typed_points import TypedPoints
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari_unpack.appearance import TransferFunction
    from napari_unpack.appearance.tints import Mode
    from napari_unpack.session import Session

AUTOMATIC = "Automatic"
CUSTOM = "My own curve"
# Titles of `TransferFunction.preset`, all for CT numbers.
PRESETS = {
    "All matter": "all",
    "Air: foam and all else": "air",
    "Soft: cloth to water": "soft",
    "Water": "water",
    "Plastic": "plastic",
    "Dense: solids": "dense",
    "Metal": "metal",
}

# Of what is remembered.
HUES = "hues"
MODES: dict[str, Mode] = {"Even": "perceptual", "Colour-blind safe": "safe", "Vivid": "hsv"}


def transfer_function(
    name: str, volume: ArrayLike, labels: NDArray[np.uint16] | None = None
) -> TransferFunction:
    """Make the transfer function of a name.

    Parameters
    ----------
    name : str
        `AUTOMATIC`, or a key of `PRESETS`.
    volume : (Z, Y, X) array_like
        The automatic one is fitted to its densities.
    labels : (Z, Y, X) ndarray of uint16, optional
        Of the objects that the automatic one should show.

    Raises
    ------
    ValueError
        If there is no such name, or nothing can be fitted to the volume.
    """
    from napari_unpack.appearance import TransferFunction
    from napari_unpack.session.colors import first_transfer_function

    if name == AUTOMATIC:
        return first_transfer_function(np.asarray(volume), labels)
    if name not in PRESETS:
        raise ValueError(f"no transfer function {name!r}: choose one of {', '.join(PRESETS)}")
    return TransferFunction.preset(PRESETS[name]).shifted(ct_offset(volume) or 0.0)


# In HU air is -1000, and as density, HU + 1000, water is 1000; eight bits hold neither.
LEAST_CT = 500.0


def ct_offset(volume: ArrayLike) -> float | None:
    """Return what lies between a volume's values and HU + 1000, None where it is no CT in HU.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Only some of its voxels are looked at.
    """
    values = np.asarray(volume).reshape(-1)
    values = values[:: max(1, values.size // SAMPLES)]
    values = values[np.isfinite(values)]
    if not values.size or values.max() < LEAST_CT:
        return None
    return -1000.0 if values.min() <= -LEAST_CT else 0.0


class ColorSection(Section):
    """Recolour, choose what is shown, edit the opacity curve.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    """

    def __init__(self, workspace: Workspace, commands: Commands) -> None:
        super().__init__("2", "Colour")
        self._workspace, self._settings = workspace, commands.settings
        self._points: list[Point] | None = None
        self._stops: list[Stop] | None = None
        self._domain: tuple[float, float] | None = None
        # Those of the session that have a name.
        self._named: dict[TransferFunction, str] = {}
        self.recolor = button(
            "Recolour",
            "Give objects that meet in this view colours that are far apart (C).",
            primary=True,
        )
        self.at_rest = Check("Automatically")
        self.at_rest.setToolTip("Recolour whenever you stop turning the bag.")
        self.preset = Choice()
        self.preset.addItems([AUTOMATIC, *PRESETS, CUSTOM])
        self.preset.setToolTip("Which densities are shown, and how opaque they are.")
        self.mode = Choice(*MODES)
        # Who cannot tell red from green chooses once, and not at every start.
        self.mode.setCurrentText(str(remembered().value(HUES, "Even")))
        self.mode.setToolTip(
            "Even: all hues look equally bright and strong. Colour-blind safe: colours that differ "
            "in light or dark, and yellow or blue, and never in red or green alone. Vivid: full "
            "saturation and value, as in the paper."
        )
        self.editor, self.ramp, self.typed = OpacityEditor(), ColorRampEditor(), TypedPoints()
        self.unlabelled = Check("Show everything else")
        self.unlabelled.setToolTip(
            "Draw what belongs to no object, such as the bag itself, almost transparent."
        )
        self.curve = Collapsible(
            "Opacity curve and colours",
            "Which densities are shown, and in which colours; everything else beside the objects.",
        )
        for widget in (self.editor, self.ramp, self.typed, self.unlabelled):
            self.curve.contents.addWidget(widget)
        self.background = BackgroundOptions(workspace, commands)
        line = row(self.recolor)
        line.add(self.at_rest, 0)
        self.contents.addWidget(line)
        self.preset.setAccessibleName("Show densities")
        self.contents.addLayout(form(Show=self.preset, Hues=self.mode))
        self.contents.addWidget(self.curve)
        self.contents.addWidget(self.background)

        self.recolor.clicked.connect(lambda: commands.recolor())
        self.at_rest.toggled.connect(self._settings.set_recolor_at_rest)
        self.mode.currentTextChanged.connect(self._set_mode)
        self.unlabelled.toggled.connect(self._settings.set_show_unlabelled)
        self.preset.activated.connect(lambda _: self._apply_preset())
        self.editor.edited.connect(self._edit_points)
        self.typed.edited.connect(self._edit_points)
        self.ramp.edited.connect(self._edit_stops)
        self.curve.toggle.toggled.connect(lambda _: self._show_curve())
        workspace.switched.connect(self._reload)
        workspace.changed.connect(self._refresh)
        self._reload()

    def _reload(self) -> None:
        controller = self._workspace.controller
        self._domain, self._named = None, {}
        self.editor.let_go()
        self.ramp.let_go()
        # What is under the hand is of the bag before.
        self._workspace.scheduler.forget(self._apply_curve)
        self._points = self._stops = None
        self.lock("Available after step 1." if controller is None else None)
        if controller is None:
            return
        with QSignalBlocker(self.at_rest):
            self.at_rest.setChecked(bool(controller.recolor_at_rest))
        # A session that was saved with other hues, or with everything else, has them still.
        if controller.session.show_unlabelled:
            with QSignalBlocker(self.unlabelled):
                self.unlabelled.setChecked(True)
        saved = controller.session.tint_mode
        if saved != "perceptual":
            with QSignalBlocker(self.mode):
                self.mode.setCurrentText(next(k for k, mode in MODES.items() if mode == saved))
        # The panel keeps its choices from bag to bag.
        self._settings.set_tint_mode(MODES[self.mode.currentText()])
        self._settings.set_show_unlabelled(self.unlabelled.isChecked())
        # Named for what CT shows; of other volumes nobody knows which values are water.
        volume, labels = self._scan
        names = [AUTOMATIC, *(PRESETS if ct_offset(volume) is not None else ())]
        self.preset.clear()
        self.preset.addItems([*names, CUSTOM])
        # The automatic one of a large volume takes a tenth of a second.
        # Of two that are alike the first stands.
        task = Task(
            object(), lambda _: {transfer_function(n, volume, labels): n for n in names[::-1]}
        )
        take = partial(self._take_named, controller.session)
        self._workspace.scheduler.submit(task, Worker.LONG, take, slot="named curves")
        self._show_curve()

    @property
    def _scan(self) -> tuple[NDArray[Any], NDArray[np.uint16]]:
        """Volume and labels that curves are made for, inside an opened object too: shown alike."""
        document = self._workspace.document
        assert document is not None, "a session is shown"
        return document.volume, document.labels

    def _take_named(self, session: Session, named: dict[TransferFunction, str]) -> None:
        if session is self._workspace.session:
            self._named = named
            self._show_name()

    def _show_name(self) -> None:
        session = self._workspace.session
        # Of a curve under the hand the session does not know yet.
        held = self._workspace.scheduler.pending(self._apply_curve)
        if session is not None and self._named and not held:
            self.preset.setCurrentText(self._named.get(session.transfer_function, CUSTOM))

    def _set_mode(self, name: str) -> None:
        remembered().setValue(HUES, name)
        self._settings.set_tint_mode(MODES[name])

    def _refresh(self, change: Change) -> None:
        if Change.TRANSFER_FUNCTION in change:
            self._show_name()
            self._show_curve()

    def _show_curve(self) -> None:
        session = self._workspace.session
        # A histogram of a large volume takes time: none is counted for a closed editor.
        if session is None or not self.curve.toggle.isChecked():
            return
        shown = session.transfer_function
        low, high = shown.domain
        # The axis only grows: a point dragged inwards must not move under the mouse.
        before = self._domain or (low, high)
        domain = float(min(low, before[0])), float(max(high, before[1]))
        if domain != self._domain:
            self._domain = domain
            self.editor.show_histogram(histogram(session.volume, domain))
        self.editor.show_curve(shown.points, domain)
        self.typed.show_points(shown.points)
        self.ramp.show_colors(shown.colors, domain)

    def _apply_preset(self) -> None:
        name = self.preset.currentText()
        # "My own curve" has no curve of its own: it opens the editor.
        if name == CUSTOM:
            self.curve.toggle.setChecked(True)
        else:
            self._settings.set_transfer_function(lambda _: transfer_function(name, *self._scan))

    def _edit_points(self, points: list[Point]) -> None:
        self._points = points
        self._apply_soon()

    def _edit_stops(self, stops: list[Stop]) -> None:
        self._stops = stops
        self._apply_soon()

    def _apply_soon(self) -> None:
        # The curve is no longer that of the preset.
        self.preset.setCurrentText(CUSTOM)
        self._workspace.scheduler.throttle(APPLY_MS, self._apply_curve)

    def _apply_curve(self) -> None:
        from napari_unpack.appearance import TransferFunction

        points, stops = self._points, self._stops
        self._points = self._stops = None

        def edited(session: Session) -> TransferFunction:
            shown = session.transfer_function
            # No stops at all mean white, which the transfer function writes as None.
            colors = shown.colors if stops is None else stops or None
            return TransferFunction(shown.points if points is None else points, colors)

        self._settings.set_transfer_function(edited)
