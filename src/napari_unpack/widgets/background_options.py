"""What is behind and around the bag: background, box and scale bar."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qtpy.QtGui import QColor
from qtpy.QtWidgets import QCheckBox, QColorDialog, QComboBox, QFileDialog, QHBoxLayout

from napari_unpack.widgets.notifications import spoken
from napari_unpack.widgets.section import Collapsible, form
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.workspace import Workspace

DARK, OWN, COLOR, PICTURE = "Dark", "napari's own", "A colour…", "A picture…"
NAMED = {
    DARK: "dark",
    "Dusk, a gradient": "dusk",
    "Light": "light",
    "Daylight, a gradient": "daylight",
}
PICTURES = "Pictures (*.png *.jpg *.jpeg *.tif *.tiff *.bmp)"


class BackgroundOptions(Collapsible):
    """Background, box and scale bar of the picture in the viewer and of exported ones.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(
            "Background, box and scale",
            "What is behind and around the bag, here and in exported pictures and films.",
        )
        self._workspace = workspace
        self.background = QComboBox()
        self.background.addItems([*NAMED, OWN, COLOR, PICTURE])
        self.background.setToolTip(
            "What is behind the bag: a colour, a gradient, napari's own canvas colour, or a "
            "picture, which is scaled until it covers."
        )
        self.box = QCheckBox("Box")
        self.box.setToolTip("Draw the edges of the box around all objects.")
        self.scale = QCheckBox("Scale bar")
        self.scale.setToolTip("Show how long a length is, at the depth of the bag's middle.")
        line = QHBoxLayout()
        line.setSpacing(2 * GAP)
        line.addWidget(self.box)
        line.addWidget(self.scale)
        line.addStretch(1)
        self.contents.addLayout(form(Behind=self.background))
        self.contents.addLayout(line)
        self._wanted: Any = NAMED[DARK]
        self._before = DARK
        self.background.textActivated.connect(self.choose)
        self.box.toggled.connect(lambda _: self._apply())
        self.scale.toggled.connect(lambda _: self._apply())
        workspace.staged.connect(self._reload)
        workspace.viewer.events.theme.connect(self._follow_theme)

    def choose(self, name: str) -> None:
        """Choose a background by its name here, asking for a colour or a picture if need be."""
        wanted: Any = NAMED.get(name)
        if name == OWN:
            wanted = self._own()
        elif name == COLOR:
            color = QColorDialog.getColor(QColor("#20242c"), self, "Background")
            wanted = color.name() if color.isValid() else None
        elif name == PICTURE:
            path = QFileDialog.getOpenFileName(self, "Background", "", PICTURES)[0]
            wanted = Path(path) if path else None
        if wanted is None:
            self.background.setCurrentText(self._before)
            return
        self._wanted, self._before = wanted, name
        self.background.setCurrentText(name)
        self._apply()

    def end(self) -> None:
        """Stop listening."""
        self._workspace.viewer.events.theme.disconnect(self._follow_theme)

    def _apply(self) -> None:
        from napari_unpack.appearance import Surroundings

        session = self._workspace.session
        if session is None:
            return
        shown = [kind for kind in ("box", "scale") if getattr(self, kind).isChecked()]
        with spoken():
            session.surroundings = Surroundings.of(self._wanted, shown)

    def _reload(self) -> None:
        """Show what a session brings, which may be a saved one."""
        session = self._workspace.session
        if session is None:
            return
        around = session.surroundings
        self._wanted = around.background
        names = {**{own: shown for shown, own in NAMED.items()}, "napari": OWN}
        ground = around.background
        name = names.get(ground.name, COLOR if ground.picture is None else PICTURE)
        self._before = name
        self.background.setCurrentText(name)
        for box, on in ((self.box, around.box), (self.scale, around.scale)):
            blocked = box.blockSignals(True)
            box.setChecked(on)
            box.blockSignals(blocked)

    def _own(self) -> Any:
        from napari.utils.theme import get_theme

        from napari_unpack.appearance import Background

        color: Any = get_theme(self._workspace.viewer.theme).canvas
        red, green, blue = (value / 255 for value in color.as_rgb_tuple()[:3])
        return Background(((red, green, blue, 1.0),), name="napari")

    def _follow_theme(self, _event: Any = None) -> None:
        if self._before == OWN:
            self.choose(OWN)
