"""What is behind and around the bag: background, box, scale bar, and names of sprites."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qtpy.QtCore import QSignalBlocker
from qtpy.QtGui import QColor
from qtpy.QtWidgets import QColorDialog, QFileDialog

from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.narrow import Check, Choice
from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.preferences import preferences
from napari_unpack.widgets.section import Collapsible, form, row
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari.utils.events import Event

    from napari_unpack.appearance import Background, Decorations

DARK, NAPARIS, COLOR, IMAGE = "Dark", "napari's own", "A colour…", "A picture…"
# Titles of the backgrounds that `Decorations.of` knows by name.
NAMED = {
    DARK: "dark",
    "Dusk, a gradient": "dusk",
    "Light": "light",
    "Daylight, a gradient": "daylight",
}

IMAGE_FILES = "Pictures (*.png *.jpg *.jpeg *.tif *.tiff *.bmp)"
# Where the colour dialog starts: a dark grey, on which tints stand out.
SUGGESTED_COLOR = "#20242c"


class BackgroundOptions(Collapsible):
    """Background, box and scale bar of the 3D view and of exported pictures.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    """

    def __init__(self, workspace: Workspace, commands: Commands) -> None:
        super().__init__(
            "Background, box, scale and names",
            "What is behind and around the bag, here and in exported pictures and movies; names "
            "are shown here alone.",
        )
        self._workspace, self._settings = workspace, commands.settings
        self.background = Choice(*NAMED, NAPARIS, COLOR, IMAGE)
        self.background.setToolTip(
            "What is behind the bag: a colour, a gradient, napari's own canvas colour, or a "
            "picture, which is scaled until it covers the view."
        )
        self.box = Check("Box")
        self.box.setToolTip("Draw the edges of the box around all objects.")
        self.scale = Check("Scale bar")
        self.scale.setToolTip("Show a length, as it looks at the depth of the bag's middle.")
        self.contents.addLayout(form(Background=self.background))
        self.names = Check("Names")
        self.names.setToolTip("Write the names of unpacked objects beside them (T).")
        self._preferred = preferences().names
        self.names.setChecked(self._preferred)
        self.contents.addWidget(row(self.box, self.scale, self.names))
        self._chosen: Background | Path | str = NAMED[DARK]
        self._before = DARK
        self.background.textActivated.connect(self.choose)
        self.box.toggled.connect(lambda _: self._apply())
        self.scale.toggled.connect(lambda _: self._apply())
        self.names.toggled.connect(self._settings.set_names)
        workspace.switched.connect(self._reload)
        workspace.viewer.events.theme.connect(self._follow_theme)

    def choose(self, name: str) -> None:
        """Choose a background by its title here; asks for a colour or a picture if need be."""
        from napari_unpack.appearance import Background

        chosen: Background | Path | str | None = NAMED.get(name)
        if name == NAPARIS:
            chosen = self._canvas_color()
        elif name == COLOR:
            color = QColorDialog.getColor(QColor(SUGGESTED_COLOR), self, "Background")
            chosen = color.name() if color.isValid() else None
        elif name == IMAGE:
            path = QFileDialog.getOpenFileName(self, "Background", "", IMAGE_FILES)[0]
            chosen = Path(path) if path else None
        if chosen is not None:
            with errors_shown():
                self._chosen, self._before = Background.of(chosen), name
                self._apply()
        # A dialog that was cancelled, or a picture that cannot be read, changes nothing.
        self.background.setCurrentText(self._before)

    def end(self) -> None:
        """Listen to the viewer no longer."""
        # The viewer lives longer than the panel, and would keep it alive.
        self._workspace.viewer.events.theme.disconnect(self._follow_theme)

    def _apply(self) -> None:
        self._settings.set_decorations(self._decorations)

    def _decorations(self) -> Decorations:
        from napari_unpack.appearance import Decorations

        checked = {"box": self.box.isChecked(), "scale": self.scale.isChecked()}
        return Decorations.of(self._chosen, [kind for kind, on in checked.items() if on])

    def _reload(self) -> None:
        """Show the decorations of the session, which may be a saved one."""
        session, controller = self._workspace.session, self._workspace.controller
        if session is None or controller is None:
            return
        preferred = preferences().names
        # Only a preference that was changed meanwhile wins over what was chosen here.
        if preferred != self._preferred:
            self._preferred = preferred
            with QSignalBlocker(self.names):
                self.names.setChecked(preferred)
        controller.names.shown = self.names.isChecked()
        around = session.decorations
        self._chosen = background = around.background
        titles = {**{name: title for title, name in NAMED.items()}, "napari": NAPARIS}
        # A session may bring a colour that no entry of the list names.
        default = COLOR if background.image is None else IMAGE
        self._before = titles.get(background.name, default)
        self.background.setCurrentText(self._before)
        for box, on in ((self.box, around.box), (self.scale, around.scale)):
            with QSignalBlocker(box):
                box.setChecked(on)

    def _canvas_color(self) -> Background:
        from napari.utils.theme import get_theme

        from napari_unpack.appearance import Background

        rgb = get_theme(self._workspace.viewer.theme).canvas.as_rgb_tuple()
        red, green, blue = (value / 255 for value in rgb[:3])
        return Background(((red, green, blue, 1.0),), name="napari")

    def _follow_theme(self, _event: Event | None = None) -> None:
        # The colour was copied when it was chosen, so it must be copied again.
        if self._before == NAPARIS:
            self.choose(NAPARIS)
