"""Step 2: hues that neighbours in this view do not share, and what density shows.

The names under which transfer functions are offered.
"""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import QTimer
from qtpy.QtWidgets import QCheckBox, QComboBox, QHBoxLayout

from napari_unpack.widgets.background_options import BackgroundOptions
from napari_unpack.widgets.color_ramp_editor import ColorRampEditor, Stop
from napari_unpack.widgets.notifications import spoken
from napari_unpack.widgets.opacity_editor import OpacityEditor, Point, histogram
from napari_unpack.widgets.section import Collapsible, Section, button, form
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.workspace import Workspace

AUTOMATIC = "Automatic"
CUSTOM = "My own curve"
PRESETS = {
    "All matter": "all",
    "Soft: cloth to water": "soft",
    "Dense: solids": "dense",
    "Metal": "metal",
}
"""Names here to names in `appearance.TransferFunction.preset`, all for CT numbers."""


def transfer_function(name: str, volume: Any) -> Any:
    """Make the transfer function of a name.

    Parameters
    ----------
    name : str
        `AUTOMATIC`, or a key of `PRESETS`.
    volume : (Z, Y, X) ndarray
        What the automatic one is fitted to.

    Returns
    -------
    napari_unpack.TransferFunction

    Raises
    ------
    ValueError
        If there is no such name, or nothing can be fitted to the volume.
    """
    from napari_unpack.appearance import TransferFunction

    if name == AUTOMATIC:
        return TransferFunction.default_for(volume)
    if name not in PRESETS:
        raise ValueError(f"no transfer function {name!r}: choose one of {', '.join(PRESETS)}")
    return TransferFunction.preset(PRESETS[name])


MODES = {"Even": "perceptual", "Colour-blind safe": "safe", "Vivid": "hsv"}
_LIVE_MS = 40


class ColorSection(Section):
    """Recolour, choose what is shown, edit the opacity curve.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__("2", "Colour")
        self._workspace = workspace
        self.recolor = button(
            "Recolour for this view",
            "Give objects that meet in this view hues that are far apart (C).",
            primary=True,
        )
        self.at_rest = QCheckBox("at rest")
        self.at_rest.setToolTip("Recolour by itself when you stop turning the bag.")
        self.preset = QComboBox()
        self.preset.addItems([AUTOMATIC, *PRESETS, CUSTOM])
        self.preset.setToolTip("Which densities are shown, and how opaque they are.")
        self.mode = QComboBox()
        self.mode.addItems(list(MODES))
        self.mode.setToolTip(
            "Even: all hues look equally bright and strong. Colour-blind safe: colours that differ "
            "in light or dark, and yellow or blue, and never in red or green alone. Vivid: full "
            "saturation and value, as in the paper."
        )
        self.editor, self.strip = OpacityEditor(), ColorRampEditor()
        more = Collapsible(
            "Opacity curve, colours and veil",
            "Which densities are shown and in which colours, by hand; matter of no object.",
        )
        self.unlabelled = QCheckBox("Show matter of no object")
        self.unlabelled.setToolTip(
            "Draw what is not part of any object, such as the bag itself, as a thin veil."
        )
        more.contents.addWidget(self.editor)
        more.contents.addWidget(self.strip)
        more.contents.addWidget(self.unlabelled)
        self.curve = more
        line = QHBoxLayout()
        line.setSpacing(GAP)
        line.addWidget(self.recolor, stretch=1)
        line.addWidget(self.at_rest)
        self.contents.addLayout(line)
        self.contents.addLayout(form(Show=self.preset, Hues=self.mode))
        self.picture = BackgroundOptions(workspace)
        self.contents.addWidget(more)
        self.contents.addWidget(self.picture)

        self._edited: list[Point] | None = None
        self._colored: list[Stop] | None = None
        self._live = QTimer(self)
        self._live.setSingleShot(True)
        self._live.setInterval(_LIVE_MS)
        self._live.timeout.connect(self._apply_curve)
        self._domain: tuple[float, float] | None = None
        self.recolor.clicked.connect(lambda: self._workspace.recolor())
        self.at_rest.toggled.connect(self._set_at_rest)
        self.mode.currentTextChanged.connect(self._set_mode)
        self.unlabelled.toggled.connect(self._set_unlabelled)
        self.preset.activated.connect(lambda _: self._apply_preset())
        self.editor.edited.connect(self._edit)
        self.strip.edited.connect(self._edit_colors)
        more.toggle.toggled.connect(lambda _: self._show_curve())
        workspace.staged.connect(self._reload)
        workspace.changed.connect(self._refresh)
        self._reload()

    def _reload(self) -> None:
        controller = self._workspace.controller
        self._domain = None
        self.lock("Available after step 1." if controller is None else None)
        if controller is None:
            return
        blocked = self.at_rest.blockSignals(True)
        self.at_rest.setChecked(bool(controller.recolor_at_rest))
        self.at_rest.blockSignals(blocked)
        self._set_mode(self.mode.currentText())
        self._set_unlabelled(self.unlabelled.isChecked())
        self.preset.setCurrentText(AUTOMATIC)
        self._show_curve()

    def _refresh(self, news: frozenset[str]) -> None:
        if "transfer_function" in news:
            self._show_curve()

    def _show_curve(self) -> None:
        session = self._workspace.session
        if session is None or not self.curve.toggle.isChecked():
            return
        shown = session.transfer_function
        low, high = shown.domain
        if self._domain is None or low < self._domain[0] or high > self._domain[1]:
            self._domain = (float(low), float(high))
            self.editor.show_histogram(histogram(session.volume, self._domain))
        self.editor.show_curve(shown.points, self._domain)
        self.strip.show_colors(shown.colors, self._domain)

    def _set_at_rest(self, on: bool) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.recolor_at_rest = on

    def _set_mode(self, name: str) -> None:
        if self._workspace.session is not None:
            with spoken():
                self._workspace.session.tint_mode = MODES[name]

    def _set_unlabelled(self, shown: bool) -> None:
        if self._workspace.session is not None:
            self._workspace.session.show_unlabelled = shown

    def _apply_preset(self) -> None:
        session = self._workspace.session
        name = self.preset.currentText()
        if session is None:
            return
        if name == CUSTOM:
            self.curve.toggle.setChecked(True)
            return
        with spoken():
            session.transfer_function = transfer_function(name, session.volume)

    def _edit(self, points: list[Point]) -> None:
        self._edited = points
        self._apply_soon()

    def _edit_colors(self, stops: list[Stop]) -> None:
        self._colored = stops
        self._apply_soon()

    def _apply_soon(self) -> None:
        self.preset.setCurrentText(CUSTOM)
        if not self._live.isActive():
            self._live.start()

    def _apply_curve(self) -> None:
        from napari_unpack.appearance import TransferFunction

        session = self._workspace.session
        if session is None:
            return
        shown = session.transfer_function
        points = shown.points if self._edited is None else self._edited
        colors = shown.colors if self._colored is None else self._colored or None
        self._edited = self._colored = None
        with spoken():
            session.transfer_function = TransferFunction(points, colors)
